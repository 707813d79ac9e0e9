//! What is typed behind `:`, as messages.

use crate::cli::{goal, pose};
use messages::Message;
use messages::common::{CmdLog, CmdState};
use messages::lowlevel::{CmdHoming, CmdPower};
use messages::middlelevel::{CmdEstimate, CmdGoal};
use messages::simulation::CmdFault;
use module::State;
use rs485::boards::psc1::CHANNELS;

/// What a line asks for.
#[derive(Debug, PartialEq)]
pub enum Asked {
    /// To be sent.
    Say(Box<Message>),
    /// To end the program.
    Quit,
}

/// All commands with what they take, for help.
pub const HELP: [(&str, &str); 10] = [
    ("goal X,Y[,THETA] ...", "drive there"),
    ("cancel", "forget the goal, stand still"),
    ("pose X,Y,THETA", "tell the robot where it is"),
    ("home [AXIS]", "home the steering"),
    ("state MODULE STATE", "RUN PAUSE STOP TERMINATE; * for all"),
    ("power CHANNEL on|off|reboot", "switch a power channel"),
    ("fault TARGET FAULT [VALUE]", "simulation only"),
    ("mark TEXT", "a mark in the log"),
    ("log start|stop", "the recorder"),
    ("q", "quit"),
];

/// Reads a line; `timestamp` is now, `source` who asks.
pub fn read(line: &str, timestamp: i64, source: &str) -> Result<Asked, String> {
    let mut words = line.split_whitespace();
    let Some(verb) = words.next() else { return Err("a command is expected; ? for help".into()) };
    let rest: Vec<&str> = words.collect();
    let usage = || HELP.iter().find(|(usage, _)| usage.split(' ').next() == Some(verb)).map_or("", |(usage, _)| usage);
    let wrong = || format!("expected: {}", usage());
    let message: Message = match (verb, &rest[..]) {
        ("q" | "quit", []) => return Ok(Asked::Quit),
        ("goal", [_, ..]) => {
            let waypoints =
                rest.iter().map(|place| goal::waypoint(place)).collect::<Result<Vec<_>, _>>().map_err(|_| wrong())?;
            let id = (timestamp / 1000 % 1_000_000_000) as i32;
            CmdGoal { timestamp, id, waypoints, r#loop: false }.into()
        }
        ("cancel", []) => CmdGoal { timestamp, ..CmdGoal::default() }.into(),
        ("pose", [place]) => {
            let [x, y, theta] = pose::pose(place).map_err(|_| wrong())?;
            let covariance = pose::covariance(pose::DEVIATIONS);
            CmdEstimate { timestamp, x, y, theta, covariance }.into()
        }
        ("home", []) => CmdHoming { timestamp, axis: "steering".into() }.into(),
        ("home", [axis]) => CmdHoming { timestamp, axis: (*axis).into() }.into(),
        ("state", [module, state]) => {
            let wanted = State::from_name(state).filter(|state| !matches!(state, State::Unknown | State::Init));
            let state = wanted.ok_or_else(|| format!("{state} is no state that can be commanded"))? as i8;
            CmdState { timestamp, module: (*module).into(), state, manual: true, source: source.into() }.into()
        }
        ("power", [channel, action]) => {
            let device = CHANNELS.iter().position(|name| name == channel);
            let device = device.ok_or_else(|| format!("channels are {}", CHANNELS.join(", ")))? as i8;
            let action = match *action {
                "off" => CmdPower::OFF,
                "on" => CmdPower::ON,
                "reboot" => CmdPower::REBOOT,
                _ => return Err(wrong()),
            };
            CmdPower { timestamp, device, action }.into()
        }
        ("fault", [target, fault]) => {
            CmdFault { timestamp, target: (*target).into(), fault: (*fault).into(), ..CmdFault::default() }.into()
        }
        ("fault", [target, fault, value]) => {
            let value = value.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(wrong)?;
            CmdFault { timestamp, target: (*target).into(), fault: (*fault).into(), value, duration: 0.0 }.into()
        }
        ("mark", [_, ..]) => CmdLog { timestamp, action: CmdLog::MARK, text: rest.join(" ") }.into(),
        ("log", ["start"]) => CmdLog { timestamp, action: CmdLog::START, ..CmdLog::default() }.into(),
        ("log", ["stop"]) => CmdLog { timestamp, action: CmdLog::STOP, ..CmdLog::default() }.into(),
        _ if usage().is_empty() => return Err(format!("{verb} is no command; ? for help")),
        _ => return Err(wrong()),
    };
    Ok(Asked::Say(Box::new(message)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_message_or_says_what_was_expected() {
        let said = |line: &str| read(line, 7, "diag").map(|asked| format!("{asked:?}"));
        assert!(said("goal 3,4 5,6,1.57").unwrap().contains("waypoints: [Waypoint { x: 3.0, y: 4.0"));
        assert!(said("state driver_canbus stop").unwrap().contains("state: 2, manual: true"));
        assert!(said("power motors reboot").unwrap().contains("device: 3, action: 2"));
        assert!(said("mark here it was").unwrap().contains("here it was"));
        assert_eq!(read("q", 0, ""), Ok(Asked::Quit));
        for (line, error) in [
            ("", "a command is expected; ? for help"),
            ("goal 3", "expected: goal X,Y[,THETA] ..."),
            ("goal nan,1", "expected: goal X,Y[,THETA] ..."),
            ("pose 1,2", "expected: pose X,Y,THETA"),
            ("state x INIT", "INIT is no state that can be commanded"),
            ("fly", "fly is no command; ? for help"),
        ] {
            assert_eq!(said(line), Err(error.into()), "{line}");
        }
    }
}
