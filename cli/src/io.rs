//! `advee io [NAME [VALUE [--for S]]]`: shows inputs and outputs, or sets an output and waits until it has its value.

use super::bus::{Heard, Tool, error_of};
use super::diag::configuration;
use super::{Common, Failed, Outcome, finite, print, seconds};
use base::{Duration, Fault as Code, Instant, Ticker};
use host::clock;
use messages::lowlevel::{CmdOutput, DataIo, Signal};
use messages::{Channel, Message};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Io {
    /// Name of an input or output
    name: Option<String>,
    /// Value of the output; of a switch 0 or 1
    #[arg(value_parser = finite, requires = "name", conflicts_with = "json")]
    value: Option<f64>,
    /// Repeat the command for this time, s, so that the value holds; then the output's own time begins
    #[arg(long = "for", value_name = "S", value_parser = seconds, requires = "value")]
    time: Option<Duration>,
    /// A JSON object
    #[arg(long)]
    json: bool,
}

/// The driver publishes at least each minute; usually each second.
const HEARD: Duration = Duration::from_secs(61);
/// The same where the configuration here names no inputs or outputs: a robot elsewhere may have some.
const ELSEWHERE: Duration = Duration::from_millis(1200);
/// Longest time until an output is written.
const WRITTEN: Duration = Duration::from_secs(3);
/// Period in which a command is repeated.
const PERIOD: Duration = Duration::from_millis(200);
const DRIVER: &str = "driver_io";

pub fn io(common: &Common, command: &Io) -> Outcome {
    let mut tool = Tool::join(common, "io", &[Channel::LlDataIo, Channel::CmEventError])?;
    // The receivers must be connected first.
    let is_configured = is_configured(common);
    let patience = if is_configured { HEARD } else { ELSEWHERE };
    let Some(first) = heard(&mut tool, clock::now() + patience, |_| true)? else {
        let why = match is_configured {
            true => "is advee up?",
            false => "robot.toml names no inputs or outputs: it has no table [io]",
        };
        return Err(format!("no LL_DATA_IO on {}; {why}", common.lcm_url()).into());
    };
    match (&command.name, command.value) {
        (Some(name), Some(value)) => set(&mut tool, name, value, command.time),
        (name, _) => show(&first, name.as_deref(), command.json),
    }
}

/// False if the robot that runs here, else the configured one, has no inputs or outputs and so no driver of them.
fn is_configured(common: &Common) -> bool {
    configuration(common).map_or(true, |(_, config)| config.robot.io.is_some())
}

fn show(io: &DataIo, only: Option<&str>, json: bool) -> Outcome {
    let signals: Vec<&Signal> =
        io.signals.iter().filter(|signal| only.is_none_or(|name| signal.name == name)).collect();
    if let Some(name) = only.filter(|_| signals.is_empty()) {
        return Err(format!("there is no signal {name}").into());
    }
    if json {
        let shown = DataIo { timestamp: io.timestamp, signals: signals.into_iter().cloned().collect() };
        print(serde_json::to_string(&shown).map_err(|error| error.to_string())?)?;
        return Ok(ExitCode::SUCCESS);
    }
    for Signal { name, value, output, valid } in signals {
        let kind = if *output { "output" } else { "input" };
        let stale = if *valid { "" } else { "  not valid" };
        print(format_args!("{name:<20} {kind:<7} {value}{stale}"))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn set(tool: &mut Tool, name: &str, value: f64, time: Option<Duration>) -> Outcome {
    let begin = clock::now();
    order(tool, name, value)?;
    let is = |io: &DataIo| io.signals.iter().any(|signal| signal.name == name && signal.valid && signal.value == value);
    if heard(tool, begin + WRITTEN, is)?.is_none() {
        return Err(format!("{name} was not set within {} s", WRITTEN.as_secs()).into());
    }
    print(format_args!("{name} is {value}"))?;
    let Some(time) = time else { return Ok(ExitCode::SUCCESS) };
    let mut period = Ticker::new(begin + PERIOD, PERIOD);
    while clock::now() < begin + time {
        if period.due(clock::now()) {
            order(tool, name, value)?;
        }
        heard(tool, period.next().min(begin + time), |_| false)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn order(tool: &mut Tool, name: &str, value: f64) -> Result<(), Failed> {
    let (timestamp, source) = (tool.timestamp(), tool.source.clone());
    tool.publish(CmdOutput { timestamp, name: name.into(), value, source })
}

/// The next message that `is` accepts; none if it does not arrive before `until`.
fn heard(tool: &mut Tool, until: Instant, is: impl Fn(&DataIo) -> bool) -> Result<Option<DataIo>, Failed> {
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::LlDataIo(io)) if is(&io) => return Ok(Some(io)),
            Heard::Message(message) => {
                if let Some(error) = error_of(&message, DRIVER)
                    && error.number == Code::OutputRefused as i32
                {
                    return Err(Failed::from(error.message.clone()));
                }
            }
            Heard::Nothing => return Ok(None),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}
