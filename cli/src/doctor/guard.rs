//! The guard (docs/guard.md), as it is configured: what it senses with, the deceleration on which it counts, and where
//! nothing senses.

use super::finding::Finding;
use ::guard::fields::{Cause, Fields};
use ::guard::{Config, Direction, Motion, Ranging, Settings};
use drivers::canbus::{PauseStop, Stop};
use settings::robot::Limits;

/// Part of a field that may be in no sensor's view: the corners between the sensors, at the robot.
const UNWATCHED_MAX: f64 = 0.05;

/// What senses what is in the way.
pub fn ranging(config: &Config) -> Finding {
    const CHECK: &str = "guard";
    match config.settings {
        Settings { ranging: Ranging::None, speed_blind, .. } => {
            let what = format!("NOTHING SENSES WHAT IS IN THE WAY: AT MOST {speed_blind} m/s (guard.ranging)");
            Finding::warning(CHECK, what).why("Driven by hand it does not stop before a person. docs/guard.md")
        }
        Settings { ranging, .. } => Finding::ok(CHECK, format!("bounds every speed by the {}", named(ranging))),
    }
}

fn named(ranging: Ranging) -> &'static str {
    match ranging {
        Ranging::None => "limit of a robot that senses nothing",
        Ranging::Sonar => "sonars",
        Ranging::Lidar => "lidars",
        Ranging::SonarAndLidar => "sonars and lidars",
    }
}

/// The deceleration on which the law counts: at most that of any stop that the configuration allows.
pub fn deceleration(config: &Config, limits: &Limits, stop: &Stop) -> Finding {
    const CHECK: &str = "guard, braking";
    let Some(fields) = Fields::new(config, config.base) else { return no_outline(CHECK) };
    let law = fields.law();
    let (without_power, key) = match stop.pause {
        PauseStop::Brake => (stop.brake_mps2, "stop.brake_mps2"),
        // A delayed opening brakes only while there is power.
        PauseStop::Coast | PauseStop::Delayed => (stop.coasting_mps2, "stop.coasting_mps2"),
    };
    let stops = [
        (limits.deceleration_mps2, "limits.deceleration_mps2"),
        (limits.quick_stop_mps2, "limits.quick_stop_mps2"),
        (without_power, key),
    ];
    let (least, key) = stops.into_iter().fold(stops[0], |least, next| if next.0 < least.0 { next } else { least });
    if law.worst > least {
        return Finding::warning(CHECK, format!("counts on {} m/s², and {key} is {least}", law.worst))
            .why("After that stop it stands later than its guard computes.");
    }
    Finding::ok(CHECK, format!("counts on {} m/s², the least of all stops is {least}", law.worst))
}

/// Directions in which the base can move and that no sensor covers over the robot's width; `None` where nothing senses.
pub fn coverage(config: &Config) -> Option<Finding> {
    const CHECK: &str = "guard, sensors";
    if config.settings.ranging == Ranging::None {
        return None;
    }
    let speed = config.settings.speed_blind;
    // With nothing in the way only a direction without a sensor has a bound of zero.
    let settings = Settings { speed_blind: 0.0, ..config.settings.clone() };
    let Some(mut fields) = Fields::new(&Config { settings, ..config.clone() }, config.base) else {
        return Some(no_outline(CHECK));
    };
    let mut is_blind = |direction| fields.bound(direction, &Motion::default(), &[]).cause == Some(Cause::Blind);
    let blind: Vec<&str> = Direction::ALL.into_iter().filter(|way| is_blind(*way)).map(name).collect();
    Some(match blind.as_slice() {
        [] => Finding::ok(CHECK, "cover the width of the robot in every direction of travel"),
        blind => Finding::warning(CHECK, format!("do not cover the width of the robot {}", blind.join(", ")))
            .why(format!("It drives there at most at {speed} m/s (guard.speed_blind_mps).")),
    })
}

/// Fields of the configuration, and those of which a part is in no sensor's view; `None` without such fields.
pub fn fields(config: &Config) -> Option<Finding> {
    const CHECK: &str = "guard, fields";
    let parts = ::guard::unwatched(config);
    let blind = |(n, part): (usize, &f64)| (*part > UNWATCHED_MAX).then(|| format!("{:.0} % of {n}", 100.0 * part));
    let unwatched: Vec<String> = parts.iter().enumerate().filter_map(blind).collect();
    Some(match (parts.len(), unwatched.as_slice()) {
        (0, _) => return None,
        (count, []) => Finding::ok(CHECK, format!("{count} beside those that are computed, in view of the sensors")),
        (_, unwatched) => Finding::warning(CHECK, format!("no sensor looks at {}", unwatched.join(", ")))
            .why("What is there is not sensed. Numbers are places in guard.fields, from 0."),
    })
}

fn no_outline(check: &str) -> Finding {
    let why = "The module guard does not start, and the robot does not drive.";
    Finding::fail(check, "the outline of the robot has no area").why(why)
}

fn name(direction: Direction) -> &'static str {
    match direction {
        Direction::Forward => "forward",
        Direction::Backward => "backward",
        Direction::Left => "to the left",
        Direction::Right => "to the right",
        Direction::TurnLeft => "in turns to the left",
        Direction::TurnRight => "in turns to the right",
    }
}
