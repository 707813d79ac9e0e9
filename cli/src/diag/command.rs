//! What is typed behind `:`, as messages.

use super::sdo::Object;
use crate::can::{standard, value};
use crate::fault::{Offered, default_value};
use crate::{goal, pose};
use diagnostics::orders;
use messages::Message;
use messages::common::CmdLog;
use messages::lowlevel::CmdPower;
use messages::simulation::CmdFault;
use module::State;
use rs485::boards::psc1::CHANNELS;

/// Action of a command line.
#[derive(Debug, PartialEq)]
pub enum Asked {
    /// To be sent.
    Say(Box<Message>),
    /// Publishes a message after a confirmation.
    Confirm(String, Box<Message>),
    /// An object of a CANopen node.
    Object(Object),
    /// To end the program.
    Quit,
}

/// All commands with their arguments, for help.
pub const HELP: [(&str, &str); 11] = [
    ("goal X,Y[,THETA] ...", "drive there, by way of all of them"),
    ("cancel", "forget the goal, stand still"),
    ("pose X,Y,THETA", "tell the robot where it is"),
    ("home [AXIS]", "home the steering"),
    ("state MODULE STATE", "RUN PAUSE STOP TERMINATE; * for all"),
    ("power CHANNEL on|off|reboot", "switch a power channel"),
    ("sdo NODE INDEX [SUB [VALUE [TYPE]]]", "read or write an object"),
    ("fault TARGET FAULT [VALUE]", "simulation only; FAULT none ends them"),
    ("mark TEXT", "a mark in the log"),
    ("log start|stop", "the recorder"),
    ("q", "quit"),
];

/// States that can be commanded.
const STATES: [&str; 4] = ["RUN", "PAUSE", "STOP", "TERMINATE"];

/// Usage of a command, as soon as its first word is complete.
pub fn usage(line: &str) -> Option<(&'static str, &'static str)> {
    let verb = line.split_whitespace().next()?;
    HELP.into_iter().find(|(usage, _)| usage.split(' ').next() == Some(verb))
}

/// The line with its last word completed as far as that is one thing only.
pub fn complete(line: &str, modules: &[String], faults: &Offered) -> String {
    let (before, last) = parts(line);
    let fit = fitting(line, modules, faults);
    let Some(first) = fit.first() else { return line.into() };
    let same =
        |len: &usize| fit.iter().all(|word| word.get(..*len).is_some_and(|head| Some(head) == first.get(..*len)));
    let common = (last.len()..=first.len()).rev().find(same).unwrap_or(last.len());
    let gap = if before.is_empty() { "" } else { " " };
    let end = if fit.len() == 1 { " " } else { "" };
    format!("{before}{gap}{}{end}", &first[..common])
}

/// The words that fit as the argument that is typed, if there are several.
pub fn choices<'a>(line: &str, modules: &'a [String], faults: &'a Offered) -> Vec<&'a str> {
    let fit = fitting(line, modules, faults);
    if parts(line).0.trim().is_empty() || fit.len() < 2 { Vec::new() } else { fit }
}

/// The line before its last word, and that word.
fn parts(line: &str) -> (&str, &str) {
    line.rsplit_once(' ').unwrap_or(("", line))
}

/// All words that begin as the last word of the line and are known in its place.
fn fitting<'a>(line: &str, modules: &'a [String], faults: &'a Offered) -> Vec<&'a str> {
    let (before, last) = parts(line);
    let words: Vec<&str> = before.split_whitespace().collect();
    let all: Vec<&str> = match words[..] {
        [] => HELP.iter().filter_map(|(usage, _)| usage.split(' ').next()).collect(),
        ["state"] => modules.iter().map(String::as_str).chain(["*"]).collect(),
        ["state", _] => STATES.to_vec(),
        ["power"] => CHANNELS.to_vec(),
        ["power", _] => vec!["on", "off", "reboot"],
        ["log"] => vec!["start", "stop"],
        ["fault"] => faults.iter().map(|(target, _)| target.as_str()).collect(),
        ["fault", target] => {
            let found = faults.iter().find(|(name, _)| name == target);
            found.map_or_else(Vec::new, |(_, faults)| faults.clone())
        }
        _ => Vec::new(),
    };
    all.into_iter().filter(|word| word.starts_with(last)).collect()
}

/// Reads a line; `timestamp` is now, `source` who asks, `nodes` are those of the CAN bus with their axes.
pub fn read(line: &str, timestamp: i64, source: &str, nodes: &[(i32, String)]) -> Result<Asked, String> {
    let mut words = line.split_whitespace();
    let Some(verb) = words.next() else { return Err("a command is expected; ? for help".into()) };
    let rest: Vec<&str> = words.collect();
    let usage = || usage(line).map_or("", |(usage, _)| usage);
    let wrong = || format!("expected: {}", usage());
    let message: Message = match (verb, &rest[..]) {
        ("q" | "quit", []) => return Ok(Asked::Quit),
        ("sdo", [node, index, rest @ ..]) if rest.len() <= 3 => {
            return object(nodes, node, index, rest).map(Asked::Object);
        }
        ("goal", [_, ..]) => {
            let waypoints =
                rest.iter().map(|place| goal::waypoint(place)).collect::<Result<Vec<_>, _>>().map_err(|_| wrong())?;
            orders::goal(timestamp, waypoints, false).into()
        }
        ("cancel", []) => orders::goal(timestamp, Vec::new(), false).into(),
        ("pose", [place]) => {
            let place = pose::pose(place).map_err(|_| wrong())?;
            orders::pose(timestamp, place, orders::DEVIATIONS).into()
        }
        ("home", []) => orders::home(timestamp, "steering").into(),
        ("home", [axis]) => orders::home(timestamp, axis).into(),
        ("state", [module, state]) => {
            let command = orders::state(timestamp, module, state, source)?;
            if *module == "*" && command.state == State::Terminate as i8 {
                return Ok(Asked::Confirm(format!("{line}: ends all modules"), Box::new(command.into())));
            }
            command.into()
        }
        ("power", [channel, action]) => {
            let command = orders::power(timestamp, channel, action)?;
            // Channel host is the computer that this runs on.
            if *channel == "host" && command.action != CmdPower::ON {
                return Ok(Asked::Confirm(format!("{line}: ends the robot's computer"), Box::new(command.into())));
            }
            command.into()
        }
        ("fault", [target, fault]) => {
            let value = default_value(fault, timestamp);
            CmdFault { timestamp, target: (*target).into(), fault: (*fault).into(), value, duration: 0.0 }.into()
        }
        ("fault", [target, fault, value]) => {
            let value = value.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(wrong)?;
            CmdFault { timestamp, target: (*target).into(), fault: (*fault).into(), value, duration: 0.0 }.into()
        }
        ("mark", [_, ..]) => orders::mark(timestamp, &rest.join(" "))?.into(),
        ("log", ["start"]) => CmdLog { timestamp, action: CmdLog::START, ..CmdLog::default() }.into(),
        ("log", ["stop"]) => CmdLog { timestamp, action: CmdLog::STOP, ..CmdLog::default() }.into(),
        _ if usage().is_empty() => return Err(format!("{verb} is no command; ? for help")),
        _ => return Err(wrong()),
    };
    Ok(Asked::Say(Box::new(message)))
}

/// An object of a node: `1 0x6041 0`, `steering 6081h 0 1000 u32`, `1 statusword`.
fn object(nodes: &[(i32, String)], node: &str, index: &str, rest: &[&str]) -> Result<Object, String> {
    let named = nodes.iter().find(|(_, axis)| axis == node).map(|(id, _)| *id);
    // 1000 more for each CAN bus before its own.
    let number = || node.parse().ok().filter(|node: &i32| *node > 0 && (1..=127).contains(&(node % 1000)));
    let node = named.or_else(number).ok_or_else(|| {
        let axes: Vec<String> = nodes.iter().map(|(id, axis)| format!("{id} {axis}")).collect();
        format!("nodes are 1 to 127: {}", axes.join(", "))
    })?;
    let hex = |text: &str| u16::from_str_radix(text, 16).ok().filter(|_| !text.starts_with('+'));
    let digits = index.strip_prefix("0x").or_else(|| index.strip_suffix('h')).unwrap_or(index);
    let (index, named_sub) = match (hex(digits), standard::resolve(index)) {
        (Some(index), _) => (index, 0),
        (None, Some((index, sub))) => (index, sub),
        (None, None) => return Err(format!("{index} is no index: 0x6041, 6041h or statusword")),
    };
    let sub = rest.first().map_or(Ok(named_sub), |text| {
        let sub = text.strip_prefix("0x").map_or_else(|| text.parse().ok(), |text| u8::from_str_radix(text, 16).ok());
        sub.ok_or_else(|| format!("{text} is no subindex, 0 to 255"))
    })?;
    let told = rest.get(2).map(|text| value::data_type(text)).transpose()?;
    let data_type = told.or_else(|| standard::object(index, sub).map(|(_, data_type)| data_type));
    let data = rest.get(1).map(|text| match value::parse(data_type, text) {
        Err(_) if data_type.is_none() => Err(format!(
            "the type of {text} is not known: say u8, i16, u32, ... behind it, or 0x0001, as wide as it is"
        )),
        parsed => parsed,
    });
    Ok(Object { node, index, sub, data_type, data: data.transpose()? })
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::dictionary::DataType;

    #[test]
    fn a_line_is_a_message_or_says_what_was_expected() {
        let said = |line: &str| read(line, 7, "diag", &[]).map(|asked| format!("{asked:?}"));
        assert!(said("goal 3,4 5,6,1.57").unwrap().contains("waypoints: [Waypoint { x: 3.0, y: 4.0"));
        assert!(said("state driver_canbus stop").unwrap().contains("state: 2, manual: true"));
        assert!(said("power motors reboot").unwrap().contains("device: 3, action: 2"));
        assert!(said("mark here it was").unwrap().contains("here it was"));
        assert!(said("power host off").unwrap().starts_with("Confirm(\"power host off: ends"));
        assert!(said("state * TERMINATE").unwrap().starts_with("Confirm("));
        assert_eq!(read("q", 0, "", &[]), Ok(Asked::Quit));
        for (line, error) in [
            ("", "a command is expected; ? for help"),
            ("goal 3", "expected: goal X,Y[,THETA] ..."),
            ("goal nan,1", "expected: goal X,Y[,THETA] ..."),
            ("pose 1,2", "expected: pose X,Y,THETA"),
            ("state x INIT", "INIT is not a state that can be commanded"),
            ("fly", "fly is no command; ? for help"),
        ] {
            assert_eq!(said(line), Err(error.into()), "{line}");
        }
    }

    #[test]
    fn an_object_is_named_as_people_do() {
        let nodes = [(1, "propulsion".into()), (2, "steering".into())];
        let asked = |line: &str| match read(line, 7, "diag", &nodes) {
            Ok(Asked::Object(object)) => Ok(object),
            Ok(other) => panic!("{other:?}"),
            Err(why) => Err(why),
        };
        let status = Object { node: 1, index: 0x6041, sub: 0, data_type: Some(DataType::U16), data: None };
        for line in
            ["sdo 1 0x6041 0", "sdo 1 6041", "sdo 1 6041h 0x0", "sdo propulsion statusword", "sdo 1 status-word 0"]
        {
            assert_eq!(asked(line), Ok(status.clone()), "{line}");
        }
        let data = |line: &str| asked(line).unwrap().data;
        assert_eq!(data("sdo 2 0x6060 0 -1"), Some(vec![0xFF]));
        assert_eq!(data("sdo 2 0x2000 1 5 u32"), Some(vec![5, 0, 0, 0]));
        assert_eq!(data("sdo 2 0x2000 1 0x0005"), Some(vec![5, 0]));
        assert!(asked("sdo 2 0x2000 1 5").unwrap_err().contains("the type of 5 is not known"));
        for line in [
            "sdo 0 0x6041",
            "sdo 128 0x6041",
            "sdo 1 0x16041",
            "sdo 1 0x+041",
            "sdo 1 nothing",
            "sdo 1 0x6041 256",
            "sdo 1",
            "sdo 1 2 3 4 5 6",
            "sdo 1 0x6041 0 1 u17",
        ] {
            assert!(asked(line).is_err(), "{line}");
        }
    }

    #[test]
    fn tab_completes_what_is_one_thing_only() {
        let faults: Offered = vec![
            ("fan1".into(), vec!["stall", "none"]),
            ("psc1".into(), vec!["bumper"]),
            ("propulsion".into(), vec!["silent"]),
        ];
        let modules = ["driver_canbus".to_string(), "driver_power".into(), "planner".into()];
        for (line, completed) in [
            ("st", "state "),
            ("p", "po"),
            ("po", "po"),
            ("pow", "power "),
            ("state d", "state driver_"),
            ("state driver_c", "state driver_canbus "),
            ("state planner T", "state planner TERMINATE "),
            ("power mot", "power motors "),
            ("log st", "log st"),
            ("log sta", "log start "),
            ("fly ", "fly "),
            ("fault f", "fault fan1 "),
            ("fault p", "fault p"),
            ("fault fan1 st", "fault fan1 stall "),
            ("fault fan2 st", "fault fan2 st"),
            ("", ""),
        ] {
            assert_eq!(complete(line, &modules, &faults), completed, "{line}");
        }
        for (line, several) in [
            ("fault ", &["fan1", "psc1", "propulsion"][..]),
            ("fault p", &["psc1", "propulsion"]),
            ("fault fan1 ", &["stall", "none"]),
            ("fault fan1 s", &[]),
            ("fault fan2 ", &[]),
            ("log st", &["start", "stop"]),
            ("p", &[]),
            ("", &[]),
        ] {
            assert_eq!(choices(line, &modules, &faults), several, "{line}");
        }
        assert_eq!(usage("state x").map(|(usage, _)| usage), Some("state MODULE STATE"));
        assert_eq!(usage(""), None);
    }
}
