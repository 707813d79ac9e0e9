//! `advee log mark`: a word in the log that is being written.

use crate::cli::bus::{Heard, Tool};
use crate::cli::{Common, Failed, Outcome, complain, print};
use crate::live::clock;
use base::Duration;
use messages::{Channel, Message, common};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Mark {
    /// What happened
    text: String,
}

/// The longest text of a mark, bytes: a word to find a place again.
const TEXT_MAX: usize = 1000;
/// The logger says once a second whether it writes.
const PATIENCE: Duration = Duration::from_millis(1500);

pub fn mark(common: &Common, command: &Mark) -> Outcome {
    if command.text.is_empty() || command.text.len() > TEXT_MAX || command.text.contains('\0') {
        return Err(format!("a mark's text has 1 to {TEXT_MAX} bytes and no NUL").into());
    }
    let mut tool = Tool::join(common, "mark", &[Channel::CmDataLog])?;
    let (timestamp, text) = (tool.timestamp(), command.text.clone());
    tool.publish(common::CmdLog { timestamp, action: common::CmdLog::MARK, text })?;
    let until = clock::now() + PATIENCE;
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::CmDataLog(log)) if log.recording => {
                print(format_args!("marked in {}", log.run.escape_debug()))?;
                return Ok(ExitCode::SUCCESS);
            }
            Heard::Message(Message::CmDataLog(_)) => {
                return Err("the logger does not record now: the mark is in no log".into());
            }
            Heard::Message(_) => {}
            Heard::Nothing => {
                complain(&"no logger is heard; whoever records the bus has the mark");
                return Ok(ExitCode::SUCCESS);
            }
            Heard::Interrupt => return Err(Failed::from("interrupted; the mark is published")),
        }
    }
}
