//! `advee estimate RUN_DIR`, `advee estimate --csv …`: the estimator over recorded data.

mod csv;
mod run;
mod trial;

use super::{Common, Failed, Outcome, print};
use estimator::filter::{Counts, Estimate as Believed, Mount, Nuisances, Quality};
use estimator::recorded;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Estimate {
    /// The folder of a recorded run, or the file of its estimator's inputs
    #[arg(value_name = "RUN_DIR", conflicts_with_all = ["odometry", "bearings", "beacons"])]
    run: Option<PathBuf>,
    /// From the three files below; may be left out
    #[arg(long)]
    csv: bool,
    /// time,speed,rotation: s, m/s, rad/s
    #[arg(long, value_name = "FILE", requires = "bearings")]
    odometry: Option<PathBuf>,
    /// time,id,bearing: s, -, rad from the robot's x axis counter-clockwise
    #[arg(long, value_name = "FILE", requires = "beacons")]
    bearings: Option<PathBuf>,
    /// id,x,y: -, m, m
    #[arg(long, value_name = "FILE", requires = "odometry")]
    beacons: Option<PathBuf>,
    /// Initial pose: m, m, rad; without it unknown
    #[arg(long, value_name = "X,Y,THETA", value_parser = super::pose::pose)]
    start: Option<[f64; 3]>,
    /// True if rates hold up to their row's time or from it on; without it, what the bearings fit better
    #[arg(long, value_enum, conflicts_with = "run")]
    hold: Option<Hold>,
    /// Place of the beacon scanner: ahead of the rear axle and left of the middle, m; without it, what the bearings say
    #[arg(long, value_name = "X,Y", value_parser = place, conflicts_with = "run")]
    sensor: Option<[f64; 2]>,
    /// CSV file for the estimate; without it stdout, unless --json
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// A summary as JSON
    #[arg(long)]
    json: bool,
}

impl Estimate {
    /// True if it is of recorded data in files, not of a recorded run.
    pub fn is_of_files(&self) -> bool {
        self.run.is_none()
    }
}

/// Interval of validity of an odometry row's rates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Hold {
    /// From the row before up to its time
    Before,
    /// From its time to the next row's
    After,
}

impl From<Hold> for recorded::Hold {
    fn from(hold: Hold) -> Self {
        match hold {
            Hold::Before => Self::Before,
            Hold::After => Self::After,
        }
    }
}

/// Greatest distance of the sensor from the rear axle's centre along x and y, m, as in a configuration.
const SENSOR_MAX_M: f64 = 10.0;

/// The place of the sensor.
fn place(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split(',').map(|number| super::finite(number.trim())).collect::<Result<Vec<f64>, _>>();
    let place = numbers.ok().and_then(|numbers| <[f64; 2]>::try_from(numbers).ok());
    let near = |place: &[f64; 2]| place.iter().all(|along| along.abs() <= SENSOR_MAX_M);
    place.filter(near).ok_or_else(|| format!("expected x,y, each of at most {SENSOR_MAX_M} m"))
}

/// A row of what comes out.
struct Row {
    /// s
    time: f64,
    believed: Believed,
}

/// Results.
struct Outcomes {
    rows: Vec<Row>,
    counts: Option<(Counts, Nuisances)>,
    /// Parameters found from the data, for people.
    assumed: Value,
}

/// Standard deviations of `--start`: x, y, m; theta, rad.
const START: [f64; 3] = [0.1, 0.1, 0.05];

pub fn estimate(common: &Common, command: &Estimate) -> Outcome {
    let outcomes = match (&command.run, &command.odometry, &command.bearings, &command.beacons) {
        (Some(run), ..) => run::estimates(run, command.start, &common.sets)?,
        (None, Some(odometry), Some(bearings), Some(beacons)) => {
            let data = csv::Data::read(odometry, bearings, beacons)?;
            data.unknown_beacons(bearings, beacons)?;
            let mount = command.sensor.map(|[x, y]| Mount { x, y });
            let known = recorded::Known { hold: command.hold.map(Into::into), mount };
            trial::estimates(data, common, command.start, known)?
        }
        _ => return Err("either RUN_DIR, or --odometry, --bearings and --beacons; see --help".into()),
    };
    match &command.out {
        Some(path) => {
            let named = |error| Failed::from(format!("{}: {error}", path.display()));
            let mut file = BufWriter::new(File::create(path).map_err(named)?);
            write_rows(&outcomes.rows, &mut file).and_then(|()| file.flush()).map_err(named)?;
        }
        None if command.json => {}
        None => {
            let mut text = Vec::new();
            write_rows(&outcomes.rows, &mut text).map_err(|error| Failed::from(error.to_string()))?;
            print(String::from_utf8_lossy(&text).trim_end())?;
        }
    }
    match (command.json, &command.out) {
        (true, _) => print(summary(&outcomes))?,
        (false, Some(path)) => print(as_text(&outcomes, path))?,
        (false, None) => {}
    }
    if outcomes.rows.iter().all(|row| row.believed.quality < Quality::Coarse) {
        eprintln!("the pose was never found: do the bearings, the numbers and the places of the beacons fit together?");
    }
    Ok(ExitCode::SUCCESS)
}

fn write_rows(rows: &[Row], out: &mut impl Write) -> std::io::Result<()> {
    writeln!(out, "time,x,y,theta,sxx,sxy,sxt,syy,syt,stt,quality")?;
    for Row { time, believed: Believed { pose, covariance: c, quality, .. } } in rows {
        let (theta, quality) = (pose.theta.radians(), *quality as i8);
        write!(out, "{time},{},{},{theta},{},{},{}", pose.x, pose.y, c[0][0], c[0][1], c[0][2])?;
        writeln!(out, ",{},{},{},{quality}", c[1][1], c[1][2], c[2][2])?;
    }
    Ok(())
}

/// The part of the rows with this quality.
fn part(rows: &[Row], quality: Quality) -> f64 {
    rows.iter().filter(|row| row.believed.quality == quality).count() as f64 / rows.len().max(1) as f64
}

fn located(rows: &[Row]) -> Option<f64> {
    rows.iter().find(|row| row.believed.quality >= Quality::Coarse).map(|row| row.time - rows[0].time)
}

fn summary(outcomes: &Outcomes) -> Value {
    let rows = &outcomes.rows;
    let span = rows.last().map_or(0.0, |last| last.time - rows[0].time);
    let of = |quality| part(rows, quality);
    let mut summary = json!({
        "rows": rows.len(),
        "seconds": span,
        "located_after": located(rows),
        "quality": {
            "LOST": of(Quality::Lost), "SEARCHING": of(Quality::Searching),
            "COARSE": of(Quality::Coarse), "FINE": of(Quality::Fine),
        },
        "assumed": outcomes.assumed,
    });
    if let Some((counts, nuisances)) = &outcomes.counts {
        summary["counts"] = json!({
            "ways": counts.ways, "bearings": counts.bearings, "gated": counts.gated, "repeated": counts.repeated,
            "found": counts.found, "doubted": counts.doubted, "bad_values": counts.values,
            "backwards": counts.backwards, "out_of_time": counts.times, "unknown_beacons": counts.unknown,
        });
        summary["robot"] = json!({
            "sensor_turn": nuisances.turn, "scale": nuisances.scale, "bend": nuisances.bend,
            "track": nuisances.track, "delay": nuisances.delay,
            "sensor_x": nuisances.place.x, "sensor_y": nuisances.place.y,
        });
    }
    summary
}

fn as_text(outcomes: &Outcomes, path: &Path) -> String {
    let rows = &outcomes.rows;
    let known = 100.0 * (part(rows, Quality::Coarse) + part(rows, Quality::Fine));
    let found = located(rows)
        .map_or("the position was never found".into(), |after| format!("position found after {after:.2} s"));
    // COARSE and FINE are the qualities by which the planner drives (docs/navigation.md).
    let known = format!("known well enough to drive by (COARSE or FINE) in {known:.1} % of the rows");
    format!("{}: {} rows, {found}, {known}", path.display(), rows.len())
}
