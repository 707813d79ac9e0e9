//! The filter over three files. Unknown parameters of the sensors are chosen by the best fit of the bearings.

use super::super::Failed;
use super::csv::Data;
use super::{Hold, Outcomes, Row, START};
use crate::progress::Progress;
use base::Instant;
use estimator::Filter;
use estimator::filter::{Config, Mount, Noise};
use navitools::{Motion, Pose};
use robot::config;
use serde_json::json;
use std::path::Path;

/// The filter's time begins so long before the first row: a bearing may be of before it, s.
const BEFORE: f64 = 10.0;
/// To find out how a robot measures, so much of its way is enough, s.
const ENOUGH: f64 = 600.0;

/// Assumed parameters of a robot.
#[derive(Clone, Debug)]
struct Assumed {
    config: Config,
    hold: Hold,
}

/// Number of other robots that are tried where nothing is known ([`find_out`]).
const TRIED: usize = 36;

/// How far the work is, in rows of odometry.
struct Work {
    progress: Progress,
    done: usize,
    all: usize,
    /// Rows of a trial.
    each: usize,
}

impl Work {
    fn new(data: &Data, trials: usize) -> Self {
        let each = data.odometry.iter().take_while(|(time, _)| time - data.odometry[0].0 <= ENOUGH).count();
        Self { progress: Progress::new("estimating"), done: 0, all: trials * each + data.odometry.len(), each }
    }

    fn add(&mut self, rows: usize) {
        self.done += rows;
        let share = self.done as f64 / self.all.max(1) as f64;
        let done = self.done;
        self.progress.show(share, |took| format!("{:.0} rows/s", done as f64 / took.as_secs_f64()));
    }
}

pub fn estimates(
    data: &Data,
    config: Option<&Path>,
    start: Option<[f64; 3]>,
    hold: Option<Hold>,
) -> Result<Outcomes, Failed> {
    let told = match config {
        Some(path) => {
            let path = if path.is_dir() { path.join("robot.toml") } else { path.into() };
            let table = config::estimator_of(&path)?;
            Some(table.ok_or_else(|| format!("{}: no table [estimator]", path.display()))?)
        }
        None => None,
    };
    let knows = told.is_some();
    let config = Config { beacons: data.beacons.clone(), ..told.unwrap_or_else(unknown) };
    // What else is found out depends on it, so each has its own.
    let holds = hold.map_or_else(|| vec![Hold::Before, Hold::After], |hold| vec![hold]);
    let mut best: Option<(Assumed, f64)> = None;
    let mut work = Work::new(data, holds.len() * if knows { 1 } else { 1 + TRIED });
    for hold in holds {
        let mut assumed = Assumed { config: config.clone(), hold };
        let mut fits = evidence(data, &assumed, start, &mut work)?;
        if !knows {
            find_out(data, start, &mut assumed, &mut fits, &mut work)?;
        }
        if best.as_ref().is_none_or(|(_, other)| fits > *other) {
            best = Some((assumed, fits));
        }
    }
    let Some((assumed, _)) = best else { return Err("nothing was tried".into()) };
    let mut rows = Vec::with_capacity(data.odometry.len());
    let filter = run(data, &assumed, start, f64::INFINITY, |time, filter| {
        rows.push(Row { time, believed: filter.estimate(at(data, time)) });
        if rows.len().is_multiple_of(4096) {
            work.add(4096);
        }
    })?;
    let Config { mount, bearing, lasting, odometry, turn, .. } = &assumed.config;
    let assumed = json!({
        "hold": if assumed.hold == Hold::Before { "before" } else { "after" },
        "from": if knows { "the configuration" } else { "the data" },
        "sensor_x_m": mount.x, "sensor_y_m": mount.y, "sensor_turn_rad": turn,
        "bearing_rad": bearing, "bearing_lasting": lasting,
        "odometry_along_per_m": odometry.along_per_m, "odometry_along_per_s": odometry.along_per_s,
        "odometry_turn_per_m": odometry.turn_per_m, "odometry_turn_per_s": odometry.turn_per_s,
        "delay_s": assumed.config.delay, "scale": assumed.config.scale,
    });
    Ok(Outcomes { rows, counts: Some((filter.counts(), filter.nuisances())), assumed })
}

/// A robot of which nothing is known: the sensor in its middle, and the figures of docs/facts/robot.md 3.3.
fn unknown() -> Config {
    let odometry = Noise { along_per_m: 0.0, along_per_s: 0.015, turn_per_m: 0.0, turn_per_s: 0.025 };
    Config { mount: Mount { x: 0.0, y: 0.0 }, odometry, lasting: 0.0, range: 1000.0, ..Config::default() }
}

/// Looks one thing after the other for what the bearings fit better, coarsely and then finely.
fn find_out(
    data: &Data,
    start: Option<[f64; 3]>,
    best: &mut Assumed,
    fits: &mut f64,
    work: &mut Work,
) -> Result<(), Failed> {
    for step in [4.0, 2.0, std::f64::consts::SQRT_2] {
        let with = |best: &Assumed, change: &dyn Fn(&mut Config)| {
            let mut other = best.clone();
            change(&mut other.config);
            other
        };
        for factor in [1.0 / step, step] {
            let others = vec![with(best, &|config| config.bearing *= factor)];
            try_others(data, start, best, fits, others, work)?;
            let others = vec![with(best, &|config| config.odometry.turn_per_s *= factor)];
            try_others(data, start, best, fits, others, work)?;
            let others = vec![with(best, &|config| config.odometry.along_per_s *= factor)];
            try_others(data, start, best, fits, others, work)?;
        }
        let advee = Config::default();
        let others = vec![
            with(best, &|config| {
                config.mount = if config.mount.x == 0.0 { advee.mount } else { Mount { x: 0.0, y: 0.0 } }
            }),
            with(best, &|config| config.lasting = if config.lasting == 0.0 { advee.lasting } else { 0.0 }),
        ];
        try_others(data, start, best, fits, others, work)?;
        // A robot that is as it should be needs no explanation: each that is not missed is left out.
        let others = [
            with(best, &|config| (config.bend, config.track) = (0.0, 0.0)),
            with(best, &|config| config.delay = 0.0),
            with(best, &|config| config.turn = 0.0),
            with(best, &|config| config.scale = 0.0),
        ];
        for other in others {
            let both = Config {
                bend: other.config.bend.min(best.config.bend),
                track: other.config.track.min(best.config.track),
                delay: other.config.delay.min(best.config.delay),
                turn: other.config.turn.min(best.config.turn),
                scale: other.config.scale.min(best.config.scale),
                ..best.config.clone()
            };
            let other = Assumed { config: both, hold: best.hold };
            try_others(data, start, best, fits, vec![other], work)?;
        }
    }
    Ok(())
}

fn try_others(
    data: &Data,
    start: Option<[f64; 3]>,
    best: &mut Assumed,
    fits: &mut f64,
    others: Vec<Assumed>,
    work: &mut Work,
) -> Result<(), Failed> {
    for other in others {
        let own = evidence(data, &other, start, work)?;
        if own > *fits {
            (*best, *fits) = (other, own);
        }
    }
    Ok(())
}

/// Fit of the bearings, as a log-likelihood.
fn evidence(data: &Data, assumed: &Assumed, start: Option<[f64; 3]>, work: &mut Work) -> Result<f64, Failed> {
    work.add(work.each);
    Ok(run(data, assumed, start, ENOUGH, |_, _| ())?.evidence())
}

fn at(data: &Data, time: f64) -> Instant {
    let seconds = (time - data.odometry[0].0 + BEFORE).max(0.0);
    Instant::from_nanos((seconds * 1e9 + 0.5) as u64)
}

/// Runs the filter up to this time, s; calls back for each row of odometry.
fn run(
    data: &Data,
    assumed: &Assumed,
    start: Option<[f64; 3]>,
    seconds: f64,
    mut tell: impl FnMut(f64, &mut Filter),
) -> Result<Filter, Failed> {
    let mut filter = Filter::new(assumed.config.clone()).map_err(|error| Failed::from(error.to_string()))?;
    let mut bearings = data.bearings.iter().peekable();
    let mut before = Motion::default();
    for (time, rates) in data.odometry.iter().take_while(|(time, _)| time - data.odometry[0].0 <= seconds) {
        let own = if assumed.hold == Hold::Before { *rates } else { before };
        before = *rates;
        // Refusals are counted, and shown in the summary.
        let _ = filter.odometry(at(data, *time), own);
        if let Some([x, y, theta]) = start.filter(|_| *time == data.odometry[0].0) {
            let [dx, dy, turn] = START.map(|deviation| deviation * deviation);
            let covariance = [[dx, 0.0, 0.0], [0.0, dy, 0.0], [0.0, 0.0, turn]];
            filter.set(Pose::new(x, y, theta), covariance).map_err(|_| Failed::from("--start: beyond any map"))?;
        }
        while let Some((stamp, id, bearing)) = bearings.next_if(|(stamp, ..)| stamp <= time) {
            let _ = filter.bearing(at(data, *stamp), *id, *bearing);
        }
        tell(*time, &mut filter);
    }
    // Processes the last measurements too.
    let end = filter.at();
    filter.estimate(end);
    Ok(filter)
}
