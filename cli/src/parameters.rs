//! `advee parameters [NAME [VALUE]]`: shows the parameters of the planner that can be changed while it runs, or changes
//! one until it restarts.

use super::bus::{Heard, Tool, error_of};
use super::{Common, Failed, Outcome, finite, print};
use base::{Duration, Fault as Code, Instant};
use diagnostics::orders;
use host::clock;
use host::log::OneLine;
use messages::middlelevel::{DataParameters, LiveParameter};
use messages::{Channel, Message};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(allow_negative_numbers = true, after_help = EXAMPLES)]
pub struct Parameters {
    /// Name of a parameter; without one all are shown
    name: Option<String>,
    /// New value, until the planner restarts
    #[arg(value_parser = finite, requires = "name", conflicts_with = "json")]
    value: Option<f64>,
    /// A JSON object
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "Examples:
  advee parameters                      all, with their ranges
  advee parameters speed_mps 0.3        drives no faster than 0.3 m/s to its goals
  advee parameters margin_m 0.25        keeps farther from what is sensed beside it";

/// The planner publishes its parameters each second, and answers at once.
const ANSWER: Duration = Duration::from_secs(2);

pub fn parameters(common: &Common, command: &Parameters) -> Outcome {
    let mut tool = Tool::join(common, "parameters", &[Channel::MlDataParameters, Channel::CmEventError])?;
    // The receivers must be connected before a command is sent.
    let Some(all) = heard(&mut tool, clock::now() + ANSWER, |_| true)? else {
        return Err(format!("no planner publishes its parameters on {}; is advee up?", common.lcm_url()).into());
    };
    match (&command.name, command.value) {
        (Some(name), Some(value)) => set(&mut tool, name, value),
        (name, _) => show(&all, name.as_deref(), command.json),
    }
}

fn show(all: &DataParameters, only: Option<&str>, json: bool) -> Outcome {
    let parameters: Vec<&LiveParameter> =
        all.parameters.iter().filter(|parameter| only.is_none_or(|name| parameter.name == name)).collect();
    if let Some(name) = only.filter(|_| parameters.is_empty()) {
        return Err(format!("there is no parameter {name}").into());
    }
    if json {
        let parameters = parameters.into_iter().cloned().collect();
        let shown = DataParameters { parameters, ..all.clone() };
        print(serde_json::to_string(&shown).map_err(|error| error.to_string())?)?;
        return Ok(ExitCode::SUCCESS);
    }
    for parameter in parameters {
        print(in_words(parameter))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// `speed_mps            0.3  (0.1 to 0.5, configured 0.5)`.
fn in_words(parameter: &LiveParameter) -> String {
    let LiveParameter { name, value, minimum, maximum, configured } = parameter;
    format!("{:<20} {value:>6}  ({minimum} to {maximum}, configured {configured})", OneLine(name).to_string())
}

fn set(tool: &mut Tool, name: &str, value: f64) -> Outcome {
    tool.publish(orders::parameter(tool.timestamp(), name, value, &tool.source))?;
    let is_set = |all: &DataParameters| {
        all.parameters.iter().any(|parameter| parameter.name == name && parameter.value == value)
    };
    if heard(tool, clock::now() + ANSWER, is_set)?.is_none() {
        return Err(format!("{name} was not set within {} s", ANSWER.as_secs()).into());
    }
    print(format_args!("{name} is {value} until the planner restarts"))?;
    Ok(ExitCode::SUCCESS)
}

/// The next message that `is` accepts; none if it does not arrive before `until`. A refusal of the planner is an error.
fn heard(
    tool: &mut Tool,
    until: Instant,
    is: impl Fn(&DataParameters) -> bool,
) -> Result<Option<DataParameters>, Failed> {
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::MlDataParameters(all)) if is(&all) => return Ok(Some(all)),
            Heard::Message(message) => {
                if let Some(error) = error_of(&message, planner::NAME)
                    && error.number == Code::ParameterRefused as i32
                {
                    return Err(Failed::from(error.message.clone()));
                }
            }
            Heard::Nothing => return Ok(None),
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_is_a_line_with_its_range() {
        let parameter =
            LiveParameter { name: "speed_mps".into(), value: 0.3, minimum: 0.1, maximum: 0.5, configured: 0.5 };
        assert_eq!(in_words(&parameter), "speed_mps               0.3  (0.1 to 0.5, configured 0.5)");
    }
}
