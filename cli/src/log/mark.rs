//! `advee log mark`: a word in the log that is being written.

use crate::bus::{Heard, Tool};
use crate::{Common, Failed, Outcome, complain, print};
use base::Duration;
use diagnostics::orders;
use host::clock;
use messages::{Channel, Message, common};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Mark {
    /// Text of the mark
    text: String,
}

/// Time limit for the logger's state, which is published once a second.
const PATIENCE: Duration = Duration::from_millis(1500);

pub fn mark(common: &Common, command: &Mark) -> Outcome {
    // An invalid text is reported first.
    let mark = orders::mark(0, &command.text)?;
    let mut tool = Tool::join(common, "mark", &[Channel::CmDataLog])?;
    tool.publish(common::CmdLog { timestamp: tool.timestamp(), ..mark })?;
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
