//! The filter over three files: with a configuration, or with settings that are found from the data.

use super::super::{Common, Failed};
use super::csv::Data;
use super::{Outcomes, Row, START};
use crate::progress::Progress;
use estimator::filter::{Config, Nuisances};
use estimator::recorded::{self, Found, Hold, Known, Recording, Robot, RunError};
use navitools::Pose;
use robot::config;
use serde_json::json;

pub fn estimates(data: Data, common: &Common, start: Option<[f64; 3]>, known: Known) -> Result<Outcomes, Failed> {
    let Data { recording, beacons } = data;
    let start = start.map(|[x, y, theta]| {
        let [dx, dy, turn] = START.map(|deviation| deviation * deviation);
        (Pose::new(x, y, theta), [[dx, 0.0, 0.0], [0.0, dy, 0.0], [0.0, 0.0, turn]])
    });
    let configured = configured(common)?;
    let knows = configured.is_some();
    let Found { robot, start } = match configured {
        Some(config) => {
            let mount = known.mount.unwrap_or(config.mount);
            let robot = Robot {
                config: Config { beacons, mount, ..config },
                hold: known.hold.unwrap_or(Hold::Before),
                known: Nuisances::default(),
            };
            let robot = match known.hold {
                Some(_) => robot,
                None => recorded::find_hold(&recording, robot, start).map_err(refused)?,
            };
            Found { robot, start }
        }
        None => recorded::find_out(&recording, beacons, known, start).map_err(refused)?,
    };
    outcomes(&recording, &robot, start, knows)
}

/// The table `estimator` of the configuration, if one is given.
fn configured(common: &Common) -> Result<Option<Config>, Failed> {
    let Some(path) = &common.config else {
        return match common.sets.is_empty() {
            true => Ok(None),
            false => Err("--set needs --config with CSV files: without it the settings are found from the data".into()),
        };
    };
    let path = if path.is_dir() { path.join("robot.toml") } else { path.clone() };
    let table = config::estimator_of(&path, &common.sets)?;
    table.map(Some).ok_or_else(|| format!("{}: no table [estimator]", path.display()).into())
}

fn refused(error: RunError) -> Failed {
    match error {
        RunError::Config(error) => error.to_string().into(),
        RunError::Start(_) => "--start: beyond any map".into(),
    }
}

fn outcomes(
    recording: &Recording,
    robot: &Robot,
    start: Option<recorded::Start>,
    knows: bool,
) -> Result<Outcomes, Failed> {
    let mut progress = Progress::new("estimating");
    let all = recording.odometry.len();
    let mut rows = Vec::with_capacity(all);
    let each = |time, believed| {
        rows.push(Row { time, believed });
        let done = rows.len() as f64;
        progress.show(done / all as f64, |took| format!("{:.0} rows/s", done / took.as_secs_f64()));
    };
    let ended = recorded::run(recording, robot, start, each).map_err(refused)?;
    let Robot { config, hold, known } = robot;
    let Config { mount, bearing, lasting, lasting_s, wild, odometry, turn, .. } = config;
    let assumed = json!({
        "hold": hold.name(),
        "from": if knows { "the configuration" } else { "the data" },
        "sensor_x_m": mount.x, "sensor_y_m": mount.y, "sensor_turn_rad": turn,
        "bearing_rad": bearing, "bearing_lasting": lasting, "bearing_lasting_s": lasting_s, "bearing_wild": wild,
        "odometry_along_per_m": odometry.along_per_m, "odometry_along_per_s": odometry.along_per_s,
        "odometry_turn_per_m": odometry.turn_per_m, "odometry_turn_per_s": odometry.turn_per_s,
        "delay_s": config.delay, "scale": config.scale,
        "found": {
            "sensor_turn": known.turn, "scale": known.scale, "bend": known.bend, "track": known.track,
            "delay": known.delay,
        },
    });
    Ok(Outcomes { rows, counts: Some((ended.counts, ended.nuisances)), assumed })
}
