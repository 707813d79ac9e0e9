//! `advee mode [NAME]`: shows the operation mode of the planner, or commands one.

use super::bus::{Heard, Tool};
use super::{Common, Failed, Outcome, print};
use base::{Duration, Instant};
use diagnostics::orders;
use host::clock;
use host::log::OneLine;
use messages::middlelevel::{CmdMode, DataMode};
use messages::{Channel, Message};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Mode {
    /// Mode; without one the present mode is shown
    #[arg(value_parser = CmdMode::NAMES)]
    name: Option<String>,
    /// A JSON object
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Modes:
  manual      only people drive: goals are refused
  route       goals as they are commanded; the mode after the start
  wait        stands at its place, and waits for people
  approach    drives to the nearest person who stands
  home        drives to the configured home place

Examples:
  advee mode            the present mode
  advee mode home       sends the robot home
  advee mode route      ends any other mode";

/// State of a mode in a word, by its number.
pub const STATE: [&str; 5] = ["idle", "driving", "waiting", "arrived", "failed"];

/// The planner publishes its mode each second, and answers at once.
const ANSWER: Duration = Duration::from_secs(2);

pub fn mode(common: &Common, command: &Mode) -> Outcome {
    let mut tool = Tool::join(common, "mode", &[Channel::MlDataMode])?;
    // The receivers must be connected before a command is sent.
    let Some(mut current) = heard(&mut tool, clock::now() + ANSWER, |_| true)? else {
        return Err(format!("no planner publishes its mode on {}; is advee up?", common.lcm_url()).into());
    };
    if let Some(name) = &command.name {
        let wanted = orders::mode(tool.timestamp(), name, &tool.source).map_err(Failed::from)?;
        let mode = wanted.mode;
        tool.publish(wanted)?;
        let Some(answer) = heard(&mut tool, clock::now() + ANSWER, |data| data.mode == mode)? else {
            return Err(format!("the planner did not enter the mode {name} within {} s", ANSWER.as_secs()).into());
        };
        current = answer;
    }
    if command.json {
        print(serde_json::to_string(&current).map_err(|error| error.to_string())?)?;
    } else {
        print(in_words(&current))?;
    }
    match current.state {
        DataMode::FAILED if command.name.is_some() => Err(current.text.into()),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// The next message that `is` accepts; none if it does not arrive before `until`.
fn heard(tool: &mut Tool, until: Instant, is: impl Fn(&DataMode) -> bool) -> Result<Option<DataMode>, Failed> {
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::MlDataMode(data)) if is(&data) => return Ok(Some(data)),
            Heard::Message(_) => {}
            Heard::Nothing => return Ok(None),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}

/// `approach, waiting: waits for people`.
pub fn in_words(data: &DataMode) -> String {
    let name = CmdMode::name_of(data.mode).unwrap_or("?");
    let state = usize::try_from(data.state).ok().and_then(|place| STATE.get(place)).unwrap_or(&"?");
    let text = if data.text.is_empty() { String::new() } else { format!(": {}", OneLine(&data.text)) };
    format!("{name}, {state}{text}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_is_a_sentence() {
        let data = |mode, state, text: &str| DataMode { mode, state, text: text.into(), ..DataMode::default() };
        let waits = data(CmdMode::APPROACH, DataMode::WAITING, "waits for people");
        assert_eq!(in_words(&waits), "approach, waiting: waits for people");
        assert_eq!(in_words(&data(CmdMode::ROUTE, DataMode::IDLE, "")), "route, idle");
        let wild = in_words(&data(-1, 9, "a\nb"));
        assert!(wild.starts_with("?, ?: a") && !wild.contains('\n'), "{wild}");
    }
}
