//! `advee fault TARGET FAULT [VALUE] [--for S]`: breaks something in the simulation.

use super::bus::{Heard, Tool, error_of};
use super::{Common, Failed, Outcome, finite, print, seconds};
use base::{Duration, Fault as Code};
use host::clock;
use messages::{Channel, Message, simulation};
use robot::config::SIMULATOR;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Fault {
    /// Target: a bus, a board, a module
    target: String,
    /// Which fault
    fault: String,
    /// Value of the fault
    #[arg(value_parser = finite, allow_negative_numbers = true, default_value = "0")]
    value: f64,
    /// Duration, s; without it permanent
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
}

/// A simulator announces itself once a second.
const LISTEN: Duration = Duration::from_millis(1200);
/// Time limit for a refusal of an unknown fault.
const REFUSAL: Duration = Duration::from_millis(300);

pub fn fault(common: &Common, command: &Fault) -> Outcome {
    let mut tool = Tool::join(common, "fault", &[Channel::CmDataState, Channel::CmEventError])?;
    let listen_until = clock::now() + LISTEN;
    loop {
        match tool.hear(listen_until)? {
            Heard::Message(Message::CmDataState(state)) if state.module == SIMULATOR => break,
            Heard::Message(_) => {}
            Heard::Nothing => {
                return Err(format!("no simulator is heard on {}", common.lcm_url()).into());
            }
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
    tool.publish(simulation::CmdFault {
        timestamp: tool.timestamp(),
        target: command.target.clone(),
        fault: command.fault.clone(),
        value: command.value,
        duration: command.time.map_or(0.0, |time| time.as_secs_f64()),
    })?;
    let until = clock::now() + REFUSAL;
    loop {
        match tool.hear(until)? {
            Heard::Message(message) => {
                let refusal = error_of(&message, SIMULATOR).filter(|error| error.number == Code::FaultUnknown as i32);
                if let Some(error) = refusal {
                    return Err(Failed::from(error.message.clone()));
                }
            }
            Heard::Nothing => break,
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
    let time = command.time.map_or("for good".into(), |time| format!("for {} s", time.as_secs_f64()));
    print(format_args!("{} {} {} {time}", command.target, command.fault, command.value))?;
    Ok(ExitCode::SUCCESS)
}
