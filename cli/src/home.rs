//! `advee home [AXIS]`: homes an axis and waits until it is.

use super::bus::{Heard, Tool, error_of};
use super::{Common, Failed, Outcome, print};
use base::{Duration, Fault as Code};
use diagnostics::orders;
use host::clock;
use messages::{Channel, Message};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Home {
    /// Which axis
    #[arg(default_value = "steering", value_parser = ["steering"])]
    axis: String,
}

/// Homing must have begun within this time.
const BEGIN: Duration = Duration::from_secs(2);
/// And have ended within this: from one end stop to the other at 10 °/s, and back to the middle.
const END: Duration = Duration::from_secs(20);
const DRIVER: &str = "driver_canbus";

pub fn home(common: &Common, command: &Home) -> Outcome {
    let mut tool = Tool::join(common, "home", &[Channel::LlDataMotion, Channel::LlDataAxes, Channel::CmEventError])?;
    tool.publish(orders::home(tool.timestamp(), &command.axis))?;
    let started = clock::now();
    let (mut begun, mut reason) = (false, String::from("LL_DATA_MOTION is not heard"));
    loop {
        let until = started + if begun { END } else { BEGIN };
        match tool.hear(until)? {
            Heard::Message(Message::LlDataMotion(motion)) => {
                begun |= !motion.homed;
                if begun && motion.homed {
                    print(format_args!("{} is homed", command.axis))?;
                    return Ok(ExitCode::SUCCESS);
                }
                reason = motion.reason;
            }
            Heard::Message(Message::LlDataAxes(list)) if list.axes.iter().all(|axis| axis.name != command.axis) => {
                let names: Vec<&str> = list.axes.iter().map(|axis| axis.name.as_str()).collect();
                let others = if names.is_empty() { String::new() } else { format!("; there are {}", names.join(", ")) };
                return Err(format!("there is no axis {}{others}", command.axis).into());
            }
            Heard::Message(message) => {
                // Once it has begun, what is refused is another command.
                let ends =
                    |number| number == Code::HomingFailed as i32 || !begun && number == Code::CommandForbidden as i32;
                if let Some(error) = error_of(&message, DRIVER).filter(|error| ends(error.number)) {
                    return Err(Failed::from(error.message.clone()));
                }
            }
            Heard::Nothing if begun => {
                return Err(format!("{} is not homed in time: {reason}", command.axis).into());
            }
            Heard::Nothing => {
                return Err(format!("homing of {} does not begin: {reason}", command.axis).into());
            }
            Heard::Interrupt => return Err("interrupted; homing goes on".into()),
        }
    }
}
