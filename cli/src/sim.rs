//! `advee sim [pause | run | speed N | step [S] | reset | world NAME]`: the time and the world of a simulated robot
//! that was started with `advee up --sim --speed N`.

use super::bus::{Heard, Tool};
use super::{Common, Failed, Outcome, print, seconds};
use base::{Duration, Instant};
use host::clock;
use host::log::OneLine;
use messages::simulation::{CmdRun, DataRun};
use messages::{Channel, Message};
use robot::config::SIMULATOR;
use sim::paced::pacer::Speed;
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Sim {
    #[command(subcommand)]
    action: Option<Action>,
    /// The state as a JSON object
    #[arg(long)]
    json: bool,
}

#[derive(clap::Subcommand)]
enum Action {
    /// Time stands still
    Pause,
    /// Time passes
    Run,
    /// Time passes at another speed
    Speed {
        /// Simulated seconds per real second, 0.05 to 1000, or max
        #[arg(value_name = "N")]
        speed: Speed,
    },
    /// Time passes for a duration, then stands still
    Step {
        /// Duration in simulated time, s; without it one tick of SIM_DATA_CLOCK, 0.05 s
        #[arg(value_name = "S", value_parser = seconds)]
        time: Option<Duration>,
    },
    /// The robot is started anew in its world, with the same seed
    Reset,
    /// The robot is started anew in another world
    World {
        /// A name in conf/worlds
        name: String,
    },
}

const EXAMPLES: &str = "Examples:
  advee sim              speed, world, and which programs are in step
  advee sim pause        time stands still
  advee sim step 0.5     it passes for half a second
  advee sim speed 20     it passes at twenty times real time
  advee sim world empty  the robot begins anew in another world";

/// A robot in virtual time publishes `SIM_DATA_RUN` once a second.
const LISTEN: Duration = Duration::from_millis(2500);
/// Time limit of an answer: for a new start the robot is first shut down in good order.
const ANSWER: Duration = Duration::from_secs(20);

pub fn sim(common: &Common, command: &Sim) -> Outcome {
    let mut tool = Tool::join(common, "sim", &[Channel::SimDataRun, Channel::SimDataClock, Channel::CmDataState])?;
    let mut state = present(common, &mut tool)?;
    if let Some(action) = &command.action {
        let wanted = action.message(&tool);
        tool.publish(wanted.clone())?;
        state = answer(common, &mut tool, &wanted)?;
        if !state.refusal.is_empty() {
            return Err(format!("{}", OneLine(&state.refusal)).into());
        }
    }
    match command.json {
        true => print(serde_json::to_string(&state).map_err(|error| error.to_string())?)?,
        false => print(in_words(&state))?,
    }
    Ok(ExitCode::SUCCESS)
}

impl Action {
    fn message(&self, tool: &Tool) -> CmdRun {
        let (action, value, world) = match self {
            Self::Pause => (CmdRun::PAUSE, 0.0, ""),
            Self::Run => (CmdRun::RUN, 0.0, ""),
            Self::Speed { speed } => (CmdRun::SPEED, speed.factor(), ""),
            Self::Step { time } => (CmdRun::STEP, time.map_or(0.0, |time| time.as_secs_f64()), ""),
            Self::Reset => (CmdRun::RESET, 0.0, ""),
            Self::World { name } => (CmdRun::WORLD, 0.0, name.as_str()),
        };
        CmdRun { timestamp: tool.timestamp(), action, value, world: world.into(), source: tool.source.clone() }
    }
}

/// The present state. Refuses a robot whose time is real.
fn present(common: &Common, tool: &mut Tool) -> Result<DataRun, Failed> {
    let (until, mut is_real) = (clock::now() + LISTEN, false);
    loop {
        match next(tool, until)? {
            Some(Message::SimDataRun(state)) => return Ok(state),
            Some(Message::SimDataClock(_)) => is_real = true,
            Some(Message::CmDataState(state)) => is_real |= state.module == SIMULATOR,
            Some(_) => {}
            None if is_real => {
                let why = "the simulated robot runs in real time, which neither stands still nor begins anew";
                return Err(format!("{why}; start it with: advee up --sim --speed 1").into());
            }
            None => {
                return Err(format!(
                    "no simulated robot is on {}; start one: advee up --sim --speed 1",
                    common.lcm_url()
                )
                .into());
            }
        }
    }
}

/// The state after a command; a step that began is waited for.
fn answer(common: &Common, tool: &mut Tool, wanted: &CmdRun) -> Result<DataRun, Failed> {
    let (mut until, mut steps) = (clock::now() + ANSWER, false);
    loop {
        match next(tool, until)? {
            Some(Message::SimDataRun(state)) if state.command == wanted.timestamp => {
                if wanted.action != CmdRun::STEP || state.paused || !state.refusal.is_empty() {
                    return Ok(state);
                }
                // It lasts as long as it lasts, but the robot announces itself meanwhile.
                (until, steps) = (clock::now() + ANSWER, true);
            }
            // Another program commands meanwhile.
            Some(Message::SimDataRun(_)) if steps => return present(common, tool),
            Some(_) => {}
            None => return Err(format!("the simulated robot does not answer on {}", common.lcm_url()).into()),
        }
    }
}

fn next(tool: &mut Tool, until: Instant) -> Result<Option<Message>, Failed> {
    match tool.hear(until)? {
        Heard::Message(message) => Ok(Some(message)),
        Heard::Nothing => Ok(None),
        Heard::Interrupt => Err("interrupted".into()),
    }
}

/// `runs at 20 times real time in hall; in step: pilot`.
fn in_words(state: &DataRun) -> String {
    let speed = match state.speed {
        0.0 => "as fast as possible".into(),
        factor => format!("at {factor} times real time"),
    };
    let mut words = if state.paused { format!("paused, else {speed}") } else { format!("runs {speed}") };
    words += &format!(", in the world {}", OneLine(&state.world));
    for (what, programs) in [("in step", &state.in_step), ("not in step", &state.not_in_step)] {
        if !programs.is_empty() {
            words += &format!("; {what}: {}", OneLine(&programs.join(", ")));
        }
    }
    if state.refused > 0 {
        words += &format!("; refused motion commands: {}", state.refused);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_is_a_line() {
        let mut state = DataRun { speed: 20.0, world: "hall".into(), ..DataRun::default() };
        assert_eq!(in_words(&state), "runs at 20 times real time, in the world hall");
        state.paused = true;
        state.speed = 0.0;
        state.in_step = vec!["pilot".into()];
        state.not_in_step = vec!["drive@host:1".into(), "a\nb".into()];
        state.refused = 3;
        assert_eq!(
            in_words(&state),
            "paused, else as fast as possible, in the world hall; in step: pilot; not in step: drive@host:1, a b; \
             refused motion commands: 3"
        );
    }

    #[test]
    fn speeds_and_steps_out_of_range_are_refused_before_anything_is_sent() {
        let parse = |line: &str| crate::command().try_get_matches_from(line.split(' ')).map(drop);
        for line in
            ["sim", "sim pause", "sim speed 0.05", "sim speed max", "sim step", "sim step 0.5", "sim world empty"]
        {
            assert!(parse(&format!("advee {line}")).is_ok(), "{line}");
        }
        for line in ["sim speed 0", "sim speed 1001", "sim speed fast", "sim step 0", "sim world", "up --speed 2"] {
            assert!(parse(&format!("advee {line}")).is_err(), "{line}");
        }
    }
}
