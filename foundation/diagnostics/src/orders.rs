//! Commands of operators as messages, for the command line, the terminal and the web page.

use base::Level;
use messages::common::{CmdLevel, CmdLog, CmdState};
use messages::lowlevel::{CmdHoming, CmdPower};
use messages::middlelevel::{CmdBeaconUse, CmdEstimate, CmdGoal, CmdMode, CmdParameter, Waypoint};
use messages::simulation::CmdRun;
use module::State;
use rs485::boards::psc1::CHANNELS;

/// Default standard deviations of a pose set by hand: x, y, theta; m, m, rad.
pub const DEVIATIONS: [f64; 3] = [0.2, 0.2, 0.1];
/// Longest text of a mark in the log, bytes.
pub const MARK_MAX: usize = 1000;

/// Goal along waypoints; without waypoints it cancels the goal. Its number differs from those of recent goals.
#[must_use]
pub fn goal(timestamp: i64, waypoints: Vec<Waypoint>, looped: bool) -> CmdGoal {
    CmdGoal { timestamp, id: (timestamp / 1000 % 1_000_000_000) as i32, waypoints, r#loop: looped }
}

/// Operation mode of the planner, by its name.
///
/// # Errors
/// A sentence: there is no such mode.
pub fn mode(timestamp: i64, name: &str, source: &str) -> Result<CmdMode, String> {
    let mode = CmdMode::from_name(name).ok_or_else(|| format!("modes are {}", CmdMode::NAMES.join(", ")))?;
    Ok(CmdMode { timestamp, mode, source: source.into() })
}

/// Change of a parameter of the planner, which checks name and value.
#[must_use]
pub fn parameter(timestamp: i64, name: &str, value: f64, source: &str) -> CmdParameter {
    CmdParameter { timestamp, parameter: name.into(), value, source: source.into() }
}

/// Pose of the robot with standard deviations; m, m, rad.
#[must_use]
pub fn pose(timestamp: i64, [x, y, theta]: [f64; 3], deviations: [f64; 3]) -> CmdEstimate {
    CmdEstimate { timestamp, x, y, theta, covariance: covariance(deviations) }
}

/// Covariance of independent standard deviations.
#[must_use]
pub fn covariance([dx, dy, turn]: [f64; 3]) -> [[f64; 3]; 3] {
    [[dx * dx, 0.0, 0.0], [0.0, dy * dy, 0.0], [0.0, 0.0, turn * turn]]
}

/// Permits a beacon of the map to be used for the estimate, or excludes it; `None` means all beacons.
#[must_use]
pub fn beacon(timestamp: i64, id: Option<i32>, permitted: bool) -> CmdBeaconUse {
    CmdBeaconUse { timestamp, id: id.unwrap_or(CmdBeaconUse::ALL), permitted }
}

/// Homing of an axis.
#[must_use]
pub fn home(timestamp: i64, axis: &str) -> CmdHoming {
    CmdHoming { timestamp, axis: axis.into() }
}

/// Commands a module's state as an operator; `*` means all modules.
///
/// # Errors
/// A sentence: the state cannot be commanded.
pub fn state(timestamp: i64, module: &str, state: &str, source: &str) -> Result<CmdState, String> {
    let wanted = State::from_name(state).filter(|state| !matches!(state, State::Unknown | State::Init | State::Error));
    let wanted = wanted.ok_or_else(|| format!("{state} is not a state that can be commanded"))?;
    Ok(manual(timestamp, module, wanted, source))
}

/// Commands a valid state as an operator.
#[must_use]
pub fn manual(timestamp: i64, module: &str, state: State, source: &str) -> CmdState {
    CmdState { timestamp, module: module.into(), state: state as i8, manual: true, source: source.into() }
}

/// Commands the levels from which a module prints and sends its texts and reports; `*` means all modules. A level is
/// `DEBUG`, `INFO`, `WARNING`, `ERROR`, `UNCHANGED`, or `CONFIGURED` for that of the configuration.
///
/// # Errors
/// A sentence: that is not a level.
pub fn level(timestamp: i64, module: &str, print: &str, send: &str, source: &str) -> Result<CmdLevel, String> {
    let value = |name: &str| match name {
        "UNCHANGED" => Ok(CmdLevel::UNCHANGED),
        "CONFIGURED" => Ok(CmdLevel::CONFIGURED),
        _ => {
            let level = Level::ALL.into_iter().find(|level| level.name() == name);
            level.map(|level| level as i8).ok_or_else(|| format!("{name} is not a level"))
        }
    };
    let (print_from, send_from) = (value(print)?, value(send)?);
    Ok(CmdLevel { timestamp, module: module.into(), print_from, send_from, source: source.into() })
}

/// Switches a power channel: `on`, `off` or `reboot`.
///
/// # Errors
/// A sentence: the channel or the action does not exist.
pub fn power(timestamp: i64, channel: &str, action: &str) -> Result<CmdPower, String> {
    let device = CHANNELS.iter().position(|name| *name == channel);
    let device = device.ok_or_else(|| format!("channels are {}", CHANNELS.join(", ")))? as i8;
    let action = match action {
        "off" => CmdPower::OFF,
        "on" => CmdPower::ON,
        "reboot" => CmdPower::REBOOT,
        _ => return Err("expected on, off or reboot".into()),
    };
    Ok(CmdPower { timestamp, device, action })
}

/// Mark in the log.
///
/// # Errors
/// A sentence: the text is empty or too long.
pub fn mark(timestamp: i64, text: &str) -> Result<CmdLog, String> {
    if text.is_empty() || text.len() > MARK_MAX || text.contains('\0') {
        return Err(format!("a mark's text has 1 to {MARK_MAX} bytes and no NUL"));
    }
    Ok(CmdLog { timestamp, action: CmdLog::MARK, text: text.into() })
}

/// Command to the time of a simulation with `--speed`. `action` is `pause`, `run`, `speed`, `step` or `reset`; `value`
/// is the speed in simulated seconds per real second, or the duration of the step, s. The simulation checks their
/// ranges.
///
/// # Errors
/// A sentence: there is no such action.
pub fn simulation(timestamp: i64, action: &str, value: f64, source: &str) -> Result<CmdRun, String> {
    let action = match action {
        "pause" => CmdRun::PAUSE,
        "run" => CmdRun::RUN,
        "speed" => CmdRun::SPEED,
        "step" => CmdRun::STEP,
        "reset" => CmdRun::RESET,
        _ => return Err("a simulation can pause, run, speed, step and reset".into()),
    };
    Ok(CmdRun { timestamp, action, value, world: String::new(), source: source.into() })
}

/// Maximum length of the text of a world in a command, bytes; [`scenario`] and its receiver refuse longer ones.
pub const SCENARIO_MAX: usize = 32 << 10;

/// A new start of a simulation with `--speed` in a world of this text: that of a file, TOML.
///
/// # Errors
/// There is no text, or it is longer than [`SCENARIO_MAX`].
pub fn scenario(timestamp: i64, text: &str, source: &str) -> Result<CmdRun, String> {
    if text.trim().is_empty() || text.len() > SCENARIO_MAX || text.contains('\0') {
        return Err(format!("a scenario is the text of a world's file, at most {SCENARIO_MAX} bytes"));
    }
    Ok(CmdRun { timestamp, action: CmdRun::SCENARIO, value: 0.0, world: text.into(), source: source.into() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_commands_are_refused_with_a_sentence() {
        assert_eq!(state(0, "planner", "PAUSE", "x").unwrap().state, State::Pause as i8);
        for none in ["INIT", "UNKNOWN", "ERROR", "pause!", ""] {
            assert!(state(0, "planner", none, "x").is_err(), "{none}");
        }
        let asked = level(0, "planner", "DEBUG", "UNCHANGED", "x").unwrap();
        assert_eq!((asked.print_from, asked.send_from), (0, CmdLevel::UNCHANGED));
        for none in ["", "debug", "NOTICE", "4", "DEBUG "] {
            assert!(level(0, "planner", "INFO", none, "x").is_err() && level(0, "planner", none, "INFO", "x").is_err());
        }
        assert_eq!(power(0, "motors", "reboot").unwrap(), CmdPower { timestamp: 0, device: 3, action: 2 });
        assert!(power(0, "engine", "on").unwrap_err().starts_with("channels are host, "));
        assert!(power(0, "motors", "toggle").is_err());
        assert!(mark(0, "").is_err() && mark(0, &"x".repeat(1001)).is_err() && mark(0, "a\0").is_err());
        assert_eq!(mark(0, "here").unwrap().action, CmdLog::MARK);
        assert_eq!([Some(7), None].map(|id| beacon(0, id, true).id), [7, CmdBeaconUse::ALL]);
        assert_eq!(
            simulation(7, "step", 0.5, "x").map(|command| (command.action, command.value)),
            Ok((CmdRun::STEP, 0.5))
        );
        assert!(simulation(7, "world", 0.0, "x").is_err());
        assert_eq!(scenario(7, "start = [0, 0, 0]", "x").map(|command| command.action), Ok(CmdRun::SCENARIO));
        for none in ["", " \n", "a\0", &"#".repeat(SCENARIO_MAX + 1)] {
            assert!(scenario(7, none, "x").is_err());
        }
        assert_eq!(goal(1_795_302_110_792_249, Vec::new(), false).id, 302_110_792);
    }
}
