//! `advee level [MODULE] [--print LEVEL] [--send LEVEL] [--reset]`: shows from which level modules print and send their
//! texts and reports, or changes that while they run.

use super::bus::{Heard, Tool};
use super::{Common, Outcome, print};
use base::{Duration, Instant, Level as Value};
use diagnostics::orders;
use host::clock;
use host::log::OneLine;
use messages::common::DataLevel;
use messages::{Channel, Message};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Level {
    /// Which module; without it all
    module: Option<String>,
    /// Lowest level that is printed
    #[arg(long, value_name = "LEVEL", value_parser = LEVELS)]
    print: Option<String>,
    /// Lowest level that is sent on the bus
    #[arg(long, value_name = "LEVEL", value_parser = LEVELS)]
    send: Option<String>,
    /// Back to the configuration
    #[arg(long, conflicts_with_all = ["print", "send"])]
    reset: bool,
    /// A JSON object for each module
    #[arg(long)]
    json: bool,
}

const LEVELS: [&str; 4] = ["debug", "info", "warning", "error"];

const EXAMPLES: &str = "Examples:
  advee level                                     of all modules
  advee level planner --print debug --send debug  until its process ends
  advee level --reset                             back to the configuration, all modules";

/// Modules announce themselves once a second, and answer at once.
const LISTEN: Duration = Duration::from_millis(1200);
/// Period of repeating the command, which has the same effect each time.
const REPEAT: Duration = Duration::from_millis(400);

pub fn level(common: &Common, command: &Level) -> Outcome {
    let mut tool = Tool::join(common, "level", &[Channel::CmDataLevel, Channel::CmDataState])?;
    let module = command.module.as_deref().unwrap_or("*");
    let [print_from, send_from] = command.names();
    let (mut answers, mut announced) = (BTreeMap::new(), BTreeSet::new());
    let (begin, mut sent) = (clock::now(), None::<Instant>);
    loop {
        let now = clock::now();
        if now.since(begin) >= LISTEN || answers.contains_key(module) {
            break;
        }
        if sent.is_none_or(|at| now.since(at) >= REPEAT) {
            tool.publish(orders::level(tool.timestamp(), module, &print_from, &send_from, &tool.source)?)?;
            sent = Some(now);
        }
        match tool.hear(now + REPEAT)? {
            Heard::Message(Message::CmDataLevel(level)) if ["*", &level.module].contains(&module) => {
                answers.insert(level.module.clone(), level);
            }
            Heard::Message(Message::CmDataState(state)) => {
                announced.insert(state.module);
            }
            Heard::Message(_) | Heard::Nothing => {}
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
    if answers.is_empty() {
        let who = if module == "*" { "no module" } else { module };
        return Err(format!("{who} answers on {}; is advee up?", common.lcm_url()).into());
    }
    if command.json {
        answers.values().map(object).try_for_each(print)?;
        return Ok(ExitCode::SUCCESS);
    }
    print("MODULE           PRINTS FROM  SENDS FROM")?;
    answers.values().map(line).try_for_each(print)?;
    let silent = announced.iter().filter(|name| module == "*" && !answers.contains_key(*name));
    silent.map(|name| format!("{:16} not known: it does not answer", OneLine(name).to_string())).try_for_each(print)?;
    Ok(ExitCode::SUCCESS)
}

impl Level {
    /// Names of the commanded levels, as [`orders::level`] takes them.
    fn names(&self) -> [String; 2] {
        if self.reset {
            return ["CONFIGURED".into(), "CONFIGURED".into()];
        }
        [&self.print, &self.send].map(|level| level.as_deref().unwrap_or("UNCHANGED").to_ascii_uppercase())
    }
}

/// Name of a level on the wire, in lower case; `?` for other values.
fn name(value: i8) -> String {
    Value::from_value(value).map_or("?", Value::name).to_ascii_lowercase()
}

fn line(level: &DataLevel) -> String {
    let changed = if level.commanded { "  changed, until its process ends" } else { "" };
    let module = OneLine(&level.module).to_string();
    let (print, send) = (name(level.print_from), name(level.send_from));
    format!("{module:16} {print:12} {send:10}{changed}").trim_end().into()
}

fn object(level: &DataLevel) -> serde_json::Value {
    let (print_from, send_from) = (name(level.print_from), name(level.send_from));
    json!({ "module": level.module, "print_from": print_from, "send_from": send_from, "changed": level.commanded })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(print: Option<&str>, send: Option<&str>, reset: bool) -> [String; 2] {
        let [print, send] = [print, send].map(|level| level.map(String::from));
        Level { module: None, print, send, reset, json: false }.names()
    }

    #[test]
    fn what_is_not_named_stays_and_reset_takes_back_both() {
        assert_eq!(asked(None, None, false), ["UNCHANGED", "UNCHANGED"]);
        assert_eq!(asked(Some("debug"), None, false), ["DEBUG", "UNCHANGED"]);
        assert_eq!(asked(None, None, true), ["CONFIGURED", "CONFIGURED"]);
        for level in LEVELS {
            let [print, send] = asked(Some(level), Some(level), false);
            assert!(orders::level(0, "*", &print, &send, "x").is_ok(), "{level}");
        }
    }

    #[test]
    fn a_line_says_what_was_changed_and_an_unknown_level_is_shown_as_such() {
        let level = |print_from, commanded| DataLevel {
            module: "planner".into(),
            print_from,
            send_from: 2,
            commanded,
            ..DataLevel::default()
        };
        assert_eq!(line(&level(0, true)), "planner          debug        warning     changed, until its process ends");
        assert_eq!(line(&level(9, false)), "planner          ?            warning");
        assert_eq!(object(&level(1, false))["print_from"], "info");
    }
}
