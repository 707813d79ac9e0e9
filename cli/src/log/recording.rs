//! `advee log start`, `advee log stop`: a run begins, or ends, by command.

use crate::bus::{Heard, Tool};
use crate::{Common, Failed, Outcome, print};
use base::Duration;
use host::clock;
use messages::common::CmdLog;
use messages::{Channel, Message};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Start {}

#[derive(clap::Args)]
pub struct Stop {}

/// Time limit for the logger's state to change; it is published on change and once a second.
const PATIENCE: Duration = Duration::from_millis(3000);

pub fn start(common: &Common, _: &Start) -> Outcome {
    command(common, CmdLog::START)
}

pub fn stop(common: &Common, _: &Stop) -> Outcome {
    command(common, CmdLog::STOP)
}

fn command(common: &Common, action: i8) -> Outcome {
    let begins = action == CmdLog::START;
    let mut tool = Tool::join(common, "log", &[Channel::CmDataLog])?;
    tool.publish(CmdLog { timestamp: tool.timestamp(), action, text: String::new() })?;
    let until = clock::now() + PATIENCE;
    let mut is_there = false;
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::CmDataLog(log)) if log.recording == begins => {
                match begins {
                    true => print(format_args!("records in {}", log.run.escape_debug()))?,
                    false => print("the run has ended")?,
                }
                return Ok(ExitCode::SUCCESS);
            }
            Heard::Message(Message::CmDataLog(_)) => is_there = true,
            Heard::Message(_) => {}
            Heard::Nothing if !is_there => return Err("no logger is heard".into()),
            Heard::Nothing if begins => return Err("the logger does not record: advee errors shows why".into()),
            Heard::Nothing => return Err("the logger still records".into()),
            Heard::Interrupt => return Err(Failed::from("interrupted; the command is published")),
        }
    }
}
