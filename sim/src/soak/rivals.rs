//! Other sources that command the robot beside its operator, to exercise the arbitration. None of them avoids
//! obstacles.

use super::chaos::Fault;
use crate::host::Virtual;
use base::Duration;
use messages::{lowlevel, middlelevel};

/// Period of motion commands and estimates.
const PERIOD: Duration = Duration::from_millis(50);
/// Names and priorities of manual sources.
const MANUAL: [(&str, i8); 3] = [
    ("remote", lowlevel::CmdMotion::REMOTE),
    ("gamepad", lowlevel::CmdMotion::GAMEPAD),
    ("maintenance", lowlevel::CmdMotion::MAINTENANCE),
];

/// Sends the messages of a rival; false if the fault is not of this kind. `drive`: the target commands `value` m/s with
/// the priority of its name, by default the planner's. `plan`: the same with a goal and an estimate; `plan_unasked`:
/// without a goal; `plan_blind`: without an estimate. `engage`: the target reports that it has engaged the PAUSE line.
pub(super) fn speak(machine: &mut Virtual, fault: &Fault) -> bool {
    let now = machine.now();
    let lasts = Duration::from_secs_f64(fault.lasts.clamp(0.0, 600.0));
    let (asked, located) = match fault.fault.as_str() {
        "drive" => (false, false),
        "plan" => (true, true),
        "plan_unasked" => (false, true),
        "plan_blind" => (true, false),
        "engage" => {
            for (at, engaged) in [(now, true), (now + lasts, false)] {
                machine.inject(at, lowlevel::EventStop { timestamp: 0, engaged, source: fault.target.clone() });
            }
            return true;
        }
        _ => return false,
    };
    let end = now + lasts;
    let mut at = now;
    while at < end {
        if asked {
            machine.inject(at, goal());
        }
        if located {
            let quality = middlelevel::DataEstimate::FINE;
            machine.inject(at, middlelevel::DataEstimate { quality, ..Default::default() });
        }
        machine.inject(at, command(&fault.target, fault.value));
        at += PERIOD;
    }
    true
}

fn goal() -> middlelevel::CmdGoal {
    middlelevel::CmdGoal { waypoints: vec![middlelevel::Waypoint::default()], ..Default::default() }
}

fn command(source: &str, speed: f64) -> lowlevel::CmdMotion {
    let known = MANUAL.into_iter().find(|(name, _)| *name == source);
    let priority = known.map_or(lowlevel::CmdMotion::PLANNER, |(_, priority)| priority);
    lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source: source.into() }
}
