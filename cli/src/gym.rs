//! `advee gym`: the simulated robot in virtual time for programs that plan or learn, on standard input and output.

mod episode;
mod protocol;
mod seen;

use super::{Common, Failed, Outcome};
use episode::{Episode, Rig};
use protocol::{Answer, LINE_MAX, Line, Request};
use robot::place::RobotLocation;
use std::io::{self, BufRead, BufWriter, ErrorKind, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `advee gym`.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Gym {
    /// The world where a reset names none: a file, also a map in YAML, or a name in conf/worlds [default: hall]
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
    /// Leave out a module without which the robot moves; may be given often
    #[arg(long, value_name = "MODULE")]
    without: Vec<String>,
}

const EXAMPLES: &str = r#"A request per line, an object with one key; each is answered by an object in a line:
  {"robot": {}}
  {"reset": {"seed": 1, "world": "empty", "goal": [16, 9], "people": 0}}
  {"step": {"v": 0.4, "steering": 0.1, "seconds": 0.1}}
The keys are in docs/other-planners.md."#;

/// Runs the command, until the end of its input.
///
/// # Errors
/// The configuration is refused, or the input cannot be read.
pub fn gym(common: &Common, command: &Gym) -> Outcome {
    // Names the keys with old names, once.
    common.load(true)?;
    let place = RobotLocation { world: command.world.clone(), ..common.place(true) };
    let rig = Rig::new(place, &command.without)?;
    let mut output = BufWriter::new(io::stdout().lock());
    serve(&rig, &mut io::stdin().lock(), &mut output)?;
    Ok(ExitCode::SUCCESS)
}

/// Answers each line of the input, until its end or until nobody reads the answers.
fn serve(rig: &Rig, input: &mut impl BufRead, output: &mut impl Write) -> Result<(), Failed> {
    let mut episode = None;
    while let Some(line) = protocol::line(input).map_err(|error| format!("stdin: {error}"))? {
        let answer = answered(rig, &mut episode, &line).unwrap_or_else(|why| Answer::error(&why));
        match write(output, &answer) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::BrokenPipe => return Ok(()),
            Err(error) => return Err(format!("stdout: {error}").into()),
        }
    }
    Ok(())
}

fn write(output: &mut impl Write, answer: &Answer) -> io::Result<()> {
    serde_json::to_writer(&mut *output, answer)?;
    output.write_all(b"\n")?;
    output.flush()
}

fn answered(rig: &Rig, episode: &mut Option<Episode>, line: &Line) -> Result<Answer, String> {
    let text = match line {
        Line::Text(text) => text,
        Line::TooLong => return Err(format!("a line is longer than {LINE_MAX} bytes")),
    };
    match protocol::parse(text)? {
        Request::Robot(_) => Ok(Answer::Robot { robot: rig.robot().clone() }),
        Request::Reset(reset) => {
            *episode = None;
            let new = rig.reset(&reset)?;
            let state = new.first();
            *episode = Some(new);
            Ok(Answer::State(Box::new(state)))
        }
        Request::Step(step) => match episode {
            None => Err("step: there is no episode; reset first".into()),
            Some(episode) if episode.is_over() => Err("step: the episode is over; reset first".into()),
            Some(episode) => Ok(Answer::State(Box::new(episode.step(&step)))),
        },
    }
}
