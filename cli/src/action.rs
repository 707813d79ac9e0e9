//! `advee action NAME [KEY=VALUE…]`: commands an action of the high level and follows it to its end; `--cancel`,
//! `--list` and `--follow` for those under way (docs/highlevel.md).

mod list;
mod order;

use super::bus::{Heard, Tool};
use super::{Common, Failed, Outcome, print, seconds};
use base::Duration;
use host::clock;
use host::log::OneLine;
use messages::action::{self, ActionStatus, Defect, VALUE_MAX};
use messages::highlevel::{CmdAction, DataAction, Parameter};
use messages::{Channel, Message};
use order::{End, Order};
use serde_json::{Value, json};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Action {
    /// Name of the action, as a module offers it
    #[arg(value_parser = named, required_unless_present_any = ["cancel", "list", "follow"])]
    #[arg(conflicts_with_all = ["cancel", "list", "follow"])]
    name: Option<String>,
    /// Parameters of the action
    #[arg(value_name = "KEY=VALUE", value_parser = parameter)]
    parameters: Vec<Parameter>,
    /// Identifier of the action, unique; without it one is made
    #[arg(long, value_name = "ID", value_parser = identifier, requires = "name")]
    id: Option<String>,
    /// Duration, s, after which the action is cancelled, or following ends
    #[arg(long = "for", value_name = "S", value_parser = seconds, conflicts_with_all = ["cancel", "list"])]
    time: Option<Duration>,
    /// Cancel the action of this identifier, and wait until it has ended
    #[arg(long, value_name = "ID", value_parser = identifier, conflicts_with_all = ["list", "follow"])]
    cancel: Option<String>,
    /// List the actions that are under way
    #[arg(long, conflicts_with = "follow")]
    list: bool,
    /// List them, and print each change until Ctrl-C
    #[arg(long)]
    follow: bool,
    /// A JSON object for each status
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  advee action present text=\"Good morning.\"   until it has ended; Ctrl-C cancels it
  advee action present text=Hello --for 5     cancelled after 5 s
  advee action --list                         what is under way
  advee action --cancel ID                    ends one";

/// Longest part of a name in an identifier that is made, bytes: with host, process and time it is at most
/// [`action::ID_MAX`].
const NAME_IN_ID_MAX: usize = 32;

fn named(text: &str) -> Result<String, String> {
    if action::is_name(text) { Ok(text.into()) } else { Err(Defect::Name.to_string()) }
}

fn identifier(text: &str) -> Result<String, String> {
    if action::is_id(text) { Ok(text.into()) } else { Err(Defect::Id.to_string()) }
}

fn parameter(text: &str) -> Result<Parameter, String> {
    let (name, value) = text.split_once('=').ok_or("expected KEY=VALUE")?;
    if value.len() > VALUE_MAX {
        return Err(format!("a value has at most {VALUE_MAX} bytes"));
    }
    Ok(Parameter { name: named(name)?, value: value.into() })
}

pub fn action(common: &Common, command: &Action) -> Outcome {
    let Action { name, cancel, time, json, .. } = command;
    match (name, cancel) {
        (Some(name), _) => start(common, name, command),
        (None, Some(id)) => {
            let mut tool = Tool::join(common, "action", &[Channel::HlDataAction])?;
            let cancel = CmdAction { id: id.clone(), cancel: true, ..CmdAction::default() };
            let pursued = pursue(&mut tool, Order::new(clock::now(), cancel, None), *json)?;
            match pursued.end {
                End::Unanswered => Err(format!("nobody runs {id} on {}", common.lcm_url()).into()),
                End::Silent => Err(silent(id)),
                End::Reported(_) => Ok(ExitCode::SUCCESS),
            }
        }
        (None, None) => list::list(common, command.follow, *time, *json),
    }
}

/// Commands an action and waits for its end.
fn start(common: &Common, name: &str, command: &Action) -> Outcome {
    let mut tool = Tool::join(common, &name[..name.len().min(NAME_IN_ID_MAX)], &[Channel::HlDataAction])?;
    let id = command.id.clone().unwrap_or_else(|| unique(&tool.source, tool.timestamp()));
    let parameters = command.parameters.clone();
    let wanted = CmdAction { id, name: name.into(), parameters, ..CmdAction::default() };
    action::check(&wanted).map_err(|defect| Failed { code: 2, why: defect.to_string() })?;
    let Pursued { end, words, interrupted } =
        pursue(&mut tool, Order::new(clock::now(), wanted.clone(), command.time), command.json)?;
    if !matches!(end, End::Reported(_)) {
        // Its answers may have been lost: the module may have started the action.
        tool.publish(CmdAction { timestamp: tool.timestamp(), cancel: true, parameters: Vec::new(), ..wanted })?;
    }
    let because = if words.is_empty() { String::new() } else { format!(": {}", OneLine(&words)) };
    match end {
        End::Reported(ActionStatus::Succeeded) => Ok(ExitCode::SUCCESS),
        End::Reported(_) if interrupted => Err(format!("interrupted; {name} has ended{because}").into()),
        End::Reported(ActionStatus::Rejected) => Err(format!("{name} was rejected{because}").into()),
        End::Reported(ActionStatus::Cancelled) => Err(format!("{name} was cancelled{because}").into()),
        End::Reported(_) => Err(format!("{name} has failed{because}").into()),
        End::Unanswered => Err(format!("nobody offers {name} on {}", common.lcm_url()).into()),
        End::Silent => Err(silent(name)),
    }
}

fn silent(what: &str) -> Failed {
    let seconds = action::SILENCE.as_secs();
    format!("{what} counts as failed: its module has been silent for {seconds} s").into()
}

/// Identifier that no other action has: name, host, process, and time in ms.
fn unique(source: &str, timestamp: i64) -> String {
    let source = source.chars().filter(char::is_ascii_graphic).collect::<String>();
    format!("{source}-{}", timestamp / 1000 % 1_000_000_000)
}

/// Result of following an action.
struct Pursued {
    end: End,
    /// Last message of its module.
    words: String,
    /// True if Ctrl-C cancelled it.
    interrupted: bool,
}

/// Sends what is to be sent and prints each change until the action has ended. Ctrl-C cancels it; a second one returns.
fn pursue(tool: &mut Tool, mut order: Order, json: bool) -> Result<Pursued, Failed> {
    let mut interrupted = false;
    loop {
        let now = clock::now();
        if let Some(end) = order.end(now) {
            return Ok(Pursued { end, words: order.words().to_owned(), interrupted });
        }
        if let Some(message) = order.poll(now) {
            tool.publish(CmdAction { timestamp: tool.timestamp(), ..message })?;
        }
        match tool.hear(order.timeout())? {
            Heard::Message(Message::HlDataAction(data)) => {
                if let Some(status) = order.on_status(clock::now(), &data) {
                    print_status(status, &data, json)?;
                }
            }
            Heard::Message(_) | Heard::Nothing => {}
            Heard::Interrupt if interrupted => {
                return Err(format!("interrupted; {} may go on", order.id()).into());
            }
            Heard::Interrupt => {
                interrupted = true;
                order.cancel(clock::now());
            }
        }
    }
}

fn print_status(status: ActionStatus, data: &DataAction, json: bool) -> Result<(), Failed> {
    match json {
        true => print(status_json(Shown::Status(status), data)),
        false => print(status_line(Shown::Status(status), data)),
    }
}

/// What is shown of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shown {
    Status(ActionStatus),
    /// It has not ended, but its module has fallen silent.
    Silent,
}

impl Shown {
    fn name(self) -> &'static str {
        match self {
            Self::Status(status) => status.name(),
            Self::Silent => "silent",
        }
    }
}

/// `running    50 %  Good morning.`
fn status_line(status: Shown, data: &DataAction) -> String {
    let share = action::progress(data).map_or("-".into(), |share| format!("{:.0} %", share * 100.0));
    let line = format!("{:9} {share:>5}  {}", status.name(), OneLine(&data.message));
    line.trim_end().to_owned()
}

/// The same for programs.
fn status_json(status: Shown, data: &DataAction) -> Value {
    json!({ "status": status.name(), "action": data })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::error::ErrorKind;

    fn parsed(line: &str) -> Result<(), ErrorKind> {
        let words = ["advee", "action"].into_iter().chain(line.split_whitespace());
        crate::command().try_get_matches_from(words).map(|_| ()).map_err(|error| error.kind())
    }

    #[test]
    fn an_action_is_commanded_cancelled_or_listed_and_nothing_else() {
        for line in [
            "present",
            "present text=Hello seconds=3 --id a-1 --for 5 --json",
            "--cancel present@advee:1-2",
            "--list --json",
            "--follow --for 3",
        ] {
            assert_eq!(parsed(line), Ok(()), "{line}");
        }
        assert_eq!(parsed(""), Err(ErrorKind::MissingRequiredArgument));
        for line in ["present --list", "present --cancel a", "--list --follow", "--cancel a --for 3"] {
            assert_eq!(parsed(line), Err(ErrorKind::ArgumentConflict), "{line}");
        }
        for line in ["2nd", "present text", "present =x", "present --id ä", "present --for 0"] {
            assert_eq!(parsed(line), Err(ErrorKind::ValueValidation), "{line}");
        }
    }

    #[test]
    fn a_parameter_is_a_name_and_whatever_comes_after_the_first_equals_sign() {
        let given = |name: &str, value: &str| Ok(Parameter { name: name.into(), value: value.into() });
        assert_eq!(parameter("text=a=b c"), given("text", "a=b c"));
        assert_eq!(parameter("text="), given("text", ""));
        assert!(parameter("text").is_err() && parameter("a b=c").is_err());
        assert!(parameter(&format!("text={}", "x".repeat(VALUE_MAX + 1))).is_err());
    }

    #[test]
    fn every_identifier_that_is_made_is_one() {
        let longest = format!("{}@{}:{}", "n".repeat(NAME_IN_ID_MAX), "h".repeat(64), u32::MAX);
        for source in ["present@advee:4711", "present@strange host\u{e4}:1", &longest] {
            let id = unique(source, 1_767_225_600_123_456);
            assert!(action::is_id(&id) && id.ends_with("-225600123"), "{id}");
        }
    }

    #[test]
    fn a_status_is_a_line_and_an_object() {
        let data = DataAction { timestamp: 7, id: "a".into(), status: 1, progress: 0.5, message: "Good\nday".into() };
        assert_eq!(status_line(Shown::Status(ActionStatus::Running), &data), "running    50 %  Good day");
        let unknown = DataAction { progress: f64::NAN, message: String::new(), ..data };
        assert_eq!(status_line(Shown::Silent, &unknown), "silent        -");
        let object = status_json(Shown::Status(ActionStatus::Running), &unknown).to_string();
        let expected =
            r#"{"action":{"timestamp":7,"id":"a","status":1,"progress":null,"message":""},"status":"running"}"#;
        assert_eq!(serde_json::from_str::<Value>(&object).unwrap(), serde_json::from_str::<Value>(expected).unwrap());
    }
}
