//! `advee fault TARGET FAULT [VALUE] [--for S]`: breaks something in the simulation; without a fault it lists what can
//! be broken, and `none` ends what was.

use super::bus::{Heard, Tool, error_of};
use super::{Common, Failed, Outcome, finite, print, seconds};
use base::{Duration, Fault as Code};
use host::clock;
use messages::{Channel, Message, simulation};
use robot::config::SIMULATOR;
use robot::preflight;
use serde_json::json;
use simulator::faults::{about, is_momentary};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Fault {
    /// Target: robot, gamepad, a board, a drive, a bus; or `none`: ends all faults; without it all targets are listed
    target: Option<String>,
    /// Which fault, or `none`: ends those of the target; without it the faults of the target are described
    fault: Option<String>,
    /// Value of the fault, else 0; of robot kidnap the number of a place, else one by chance
    #[arg(value_parser = finite, allow_negative_numbers = true)]
    value: Option<f64>,
    /// Duration, s; without it until it is ended
    #[arg(long = "for", value_name = "S", value_parser = seconds, requires = "fault")]
    time: Option<Duration>,
    /// The list as a JSON object: the faults of each target
    #[arg(long, conflicts_with = "fault")]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  advee fault                        what can be broken
  advee fault psc1 bumper 2 --for 1  a bumper is pressed for a second
  advee fault fan1 stall             a fan is blocked, until: advee fault fan1 none
  advee fault none                   ends all faults";

/// Ends faults, as a fault of a target or as the target.
const NONE: &str = "none";
const ROBOT: &str = "robot";
const GAMEPAD: &str = "gamepad";
/// Of the robot: it is carried to a place by its number.
const KIDNAP: &str = "kidnap";
/// The numbers of places are below it.
const PLACES: i64 = 1_000_000;
/// A simulator announces itself once a second.
const LISTEN: Duration = Duration::from_millis(1200);
/// Time limit for a refusal of an unknown fault.
const REFUSAL: Duration = Duration::from_millis(300);

/// Targets with the faults that each can have.
pub type Offered = Vec<(String, Vec<&'static str>)>;

pub fn fault(common: &Common, command: &Fault) -> Outcome {
    let offered = offered(common);
    match (command.target.as_deref(), command.fault.as_deref()) {
        (Some(NONE), None) => {
            let ends = endings(&offered?.0);
            let mut tool = join(common)?;
            for (target, fault) in &ends {
                send(&mut tool, target, fault, 0.0, None)?;
            }
            refusal(&mut tool)?;
            print("all faults are ended")?;
        }
        (target, None) => {
            let (mut offered, _) = offered?;
            if let Some(target) = target {
                known(&offered, target)?;
                offered.retain(|(name, _)| name == target);
            }
            show(&offered, target.is_some(), command.json)?;
        }
        (Some(target), Some(fault)) => {
            // Of a robot elsewhere the configuration is not known here: its simulator judges.
            if let Ok((offered, true)) = &offered {
                permit(offered, target, fault)?;
            }
            let mut tool = join(common)?;
            let value = command.value.unwrap_or_else(|| default_value(fault, tool.timestamp()));
            send(&mut tool, target, fault, value, command.time)?;
            refusal(&mut tool)?;
            print(done(target, fault, command.value, command.time))?;
        }
        (None, Some(_)) => return Err("a target is expected".into()),
    }
    Ok(ExitCode::SUCCESS)
}

/// Value of a fault that is commanded without one, by the time, µs: a kidnapping is to another place each time.
pub fn default_value(fault: &str, timestamp: i64) -> f64 {
    if fault == KIDNAP { (timestamp % PLACES) as f64 } else { 0.0 }
}

/// What can be broken in the simulated robot that runs here, and true; or else in the configured one, and false.
fn offered(common: &Common) -> Result<(Offered, bool), Failed> {
    if let Some(place) = common.running().filter(|place| place.sim)
        && let Ok(faults) = preflight::faults(&place)
    {
        return Ok((faults, true));
    }
    let place = common.robot().map(|(place, _)| place).ok().filter(|place| place.sim);
    let is_here = place.is_some();
    Ok((preflight::faults(&place.unwrap_or_else(|| common.place(true)))?, is_here))
}

/// Faults of a target that people name: the robot can be put somewhere, too.
fn names<'a>(target: &str, faults: &[&'a str]) -> Vec<&'a str> {
    let put = (target == ROBOT).then_some("put:X,Y,THETA");
    faults.iter().copied().chain(put).collect()
}

fn show(offered: &Offered, in_detail: bool, as_json: bool) -> Result<(), Failed> {
    if as_json {
        let object = |(target, faults): &(String, Vec<&str>)| (target.clone(), json!(names(target, faults)));
        return print(serde_json::Value::Object(offered.iter().map(object).collect()));
    }
    let width = offered.iter().map(|(target, _)| target.len()).max().unwrap_or_default();
    if !in_detail {
        for (target, faults) in offered {
            print(format_args!("{target:width$}  {}", names(target, faults).join(", ")))?;
        }
        return print("\nadvee fault TARGET describes its faults; advee fault none ends all");
    }
    for (target, faults) in offered {
        for name in names(target, faults) {
            let words = about(name.split(':').next().unwrap_or_default());
            print(format_args!("{target} {name:14} {words}"))?;
        }
    }
    Ok(())
}

/// Refuses a target that there is not, with those that there are.
fn known<'a>(offered: &'a Offered, target: &str) -> Result<&'a [&'static str], Failed> {
    let found = offered.iter().find(|(name, _)| name == target);
    found.map(|(_, faults)| faults.as_slice()).ok_or_else(|| {
        let all: Vec<&str> = offered.iter().map(|(name, _)| name.as_str()).collect();
        format!("there is no target {target}; there are {}", all.join(", ")).into()
    })
}

/// Refuses what the simulated robot would refuse, before anything is sent.
fn permit(offered: &Offered, target: &str, fault: &str) -> Result<(), Failed> {
    let faults = known(offered, target)?;
    let put = target == ROBOT && fault.starts_with("put:");
    if put || faults.contains(&fault) {
        return Ok(());
    }
    Err(format!("{target} has no fault {fault}; it has {}", names(target, faults).join(", ")).into())
}

/// What ends all faults: `none` for each target that takes it; the gamepad is unplugged.
fn endings(offered: &Offered) -> Vec<(String, &'static str)> {
    let end = |(target, faults): &(String, Vec<&'static str>)| {
        let fault = if target == GAMEPAD { "unplug" } else { NONE };
        faults.contains(&fault).then(|| (target.clone(), fault))
    };
    offered.iter().filter_map(end).collect()
}

/// How a fault is ended that lasts; empty for one of the moment.
fn end(target: &str, fault: &str) -> String {
    match (target, fault) {
        _ if is_momentary(fault) => String::new(),
        (GAMEPAD, "plug") => "advee fault gamepad unplug".into(),
        (GAMEPAD, "hold") => "advee fault gamepad release".into(),
        (GAMEPAD, stick) => format!("advee fault gamepad {stick} 0"),
        (target, _) => format!("advee fault {target} none"),
    }
}

/// What was done, and how it ends.
fn done(target: &str, fault: &str, value: Option<f64>, time: Option<Duration>) -> String {
    let end = end(target, fault);
    let value = value.map_or_else(String::new, |value| format!(" {value}"));
    match (target, fault, time) {
        (ROBOT, ..) => format!("{target} {fault}: the robot was put elsewhere"),
        (_, NONE, _) => format!("the faults of {target} are ended"),
        (_, _, Some(time)) => format!("{target} {fault}{value} for {} s", time.as_secs_f64()),
        _ if end.is_empty() => format!("{target} {fault}{value}: done"),
        _ => format!("{target} {fault}{value} until: {end}"),
    }
}

/// Joins the bus of a simulated robot.
fn join(common: &Common) -> Result<Tool, Failed> {
    let mut tool = Tool::join(common, "fault", &[Channel::CmDataState, Channel::CmEventError])?;
    let listen_until = clock::now() + LISTEN;
    loop {
        match tool.hear(listen_until)? {
            Heard::Message(Message::CmDataState(state)) if state.module == SIMULATOR => return Ok(tool),
            Heard::Message(_) => {}
            Heard::Nothing => {
                return Err(format!("no simulator is heard on {}", common.lcm_url()).into());
            }
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}

fn send(tool: &mut Tool, target: &str, fault: &str, value: f64, time: Option<Duration>) -> Result<(), Failed> {
    tool.publish(simulation::CmdFault {
        timestamp: tool.timestamp(),
        target: target.into(),
        fault: fault.into(),
        value,
        duration: time.map_or(0.0, |time| time.as_secs_f64()),
    })
}

/// Waits for the simulator's refusal.
fn refusal(tool: &mut Tool) -> Result<(), Failed> {
    let until = clock::now() + REFUSAL;
    loop {
        match tool.hear(until)? {
            Heard::Message(message) => {
                let refusal = error_of(&message, SIMULATOR).filter(|error| error.number == Code::FaultUnknown as i32);
                if let Some(error) = refusal {
                    return Err(Failed::from(error.message.clone()));
                }
            }
            Heard::Nothing => return Ok(()),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Offered {
        vec![
            (ROBOT.into(), vec!["kidnap"]),
            (GAMEPAD.into(), vec!["plug", "unplug"]),
            ("fan1".into(), vec!["stall", NONE]),
        ]
    }

    #[test]
    fn what_there_is_not_is_refused_with_what_there_is() {
        let why = |target, fault| permit(&some(), target, fault).map_err(|failed| failed.why);
        assert_eq!(why("fan2", "stall"), Err("there is no target fan2; there are robot, gamepad, fan1".into()));
        assert_eq!(why("fan1", "melt"), Err("fan1 has no fault melt; it has stall, none".into()));
        assert_eq!(why("robot", "fly"), Err("robot has no fault fly; it has kidnap, put:X,Y,THETA".into()));
        for (target, fault) in [("fan1", "stall"), ("fan1", "none"), ("robot", "put:1,2,3")] {
            assert_eq!(why(target, fault), Ok(()), "{target} {fault}");
        }
    }

    #[test]
    fn the_end_of_all_faults_is_one_message_for_each_target_that_takes_it() {
        assert_eq!(endings(&some()), [("gamepad".into(), "unplug"), ("fan1".into(), "none")]);
    }

    #[test]
    fn a_kidnapping_without_a_number_is_to_another_place_each_time() {
        let all = [("kidnap", 5_000_017), ("kidnap", 5_000_018), ("stall", 5_000_018)];
        assert_eq!(all.map(|(fault, at)| default_value(fault, at)), [17.0, 18.0, 0.0]);
    }

    #[test]
    fn what_was_done_says_how_it_ends() {
        let second = Some(Duration::from_secs(1));
        assert_eq!(done("fan1", "stall", None, None), "fan1 stall until: advee fault fan1 none");
        assert_eq!(done("fan1", "stall", Some(2.0), second), "fan1 stall 2 for 1 s");
        assert_eq!(done("gamepad", "speed", Some(0.3), None), "gamepad speed 0.3 until: advee fault gamepad speed 0");
        assert_eq!(done("so1", "reset", None, None), "so1 reset: done");
        assert_eq!(done("robot", "kidnap", None, None), "robot kidnap: the robot was put elsewhere");
        assert_eq!(done("fan1", "none", None, None), "the faults of fan1 are ended");
    }
}
