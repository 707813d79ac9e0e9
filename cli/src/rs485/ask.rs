//! `advee rs485 version` and `reset`: one question to one board.

use super::line::{Answer, Line, status_name, why};
use super::target::{Known, TIMEOUT, Where};
use crate::{Common, Failed, Outcome, print};
use rs485::boards::{DO_RESET, GET_VERSION};
use rs485::frame::{BROADCAST, Status};
use rs485::master::Request;
use serde_json::json;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Version {
    /// Board, by its name or its address
    board: String,
    #[command(flatten)]
    place: Where,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
pub struct Reset {
    /// Board, by its name or its address; all: everyone on the line, who then say nothing
    board: String,
    #[command(flatten)]
    place: Where,
    /// One JSON object
    #[arg(long)]
    json: bool,
}

/// A question that may be asked again when the answer is lost.
const RETRIES: u8 = 2;

pub fn version(common: &Common, command: &Version) -> Outcome {
    let target = command.place.find(common)?;
    let board = target.board(&command.board)?;
    let mut line = Line::open(&target, RETRIES, TIMEOUT)?;
    line.allow(&board);
    let (data, seconds) = good(&board, &target.name, line.ask(GET_VERSION.ask(board.address, &[]))?)?;
    let version = rs485::boards::Version::parse(&data).ok_or("a version without numbers")?;
    let more = data.get(2..).filter(|more| !more.is_empty());
    if command.json {
        print(json!({
            "bus": target.name,
            "name": board.name,
            "address": board.address,
            "version": version.to_string(),
            "more": more,
            "round_trip_s": seconds,
        }))?;
    } else {
        let more = more.map(|more| format!(", then {more:02x?}")).unwrap_or_default();
        print(format!("{}: version {version}{more} ({:.2} ms)", board.text(), seconds * 1e3))?;
    }
    Ok(ExitCode::SUCCESS)
}

pub fn reset(common: &Common, command: &Reset) -> Outcome {
    let target = command.place.find(common)?;
    let all = command.board == "all";
    let board = if all { None } else { Some(target.board(&command.board)?) };
    let mut line = Line::open(&target, RETRIES, TIMEOUT)?;
    let Some(board) = board else {
        return match line.ask(Request::new(BROADCAST, DO_RESET.code, &[]))? {
            Answer::Sent if command.json => {
                print(json!({"bus": target.name, "address": BROADCAST})).map(|()| ExitCode::SUCCESS)
            }
            Answer::Sent => print("all were told to reset; nobody answers that").map(|()| ExitCode::SUCCESS),
            _ => Err("the line did not take the request".into()),
        };
    };
    line.allow(&board);
    let (_, seconds) = good(&board, &target.name, line.ask(DO_RESET.ask(board.address, &[]))?)?;
    if command.json {
        let (name, address) = (&board.name, board.address);
        print(json!({"bus": target.name, "name": name, "address": address, "round_trip_s": seconds}))?;
    } else {
        print(format!("{}: resets ({:.2} ms)", board.text(), seconds * 1e3))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The data of a good answer and its round trip, s; or what came instead, in one line.
fn good(board: &Known, bus: &str, answer: Answer) -> Result<(Vec<u8>, f64), Failed> {
    let wrong = match answer {
        Answer::Reply { status: Status::Ok, data, round_trip } => return Ok((data, round_trip.as_secs_f64())),
        Answer::Reply { status, .. } => format!("answers {}", status_name(status)),
        Answer::Silent | Answer::Sent => {
            format!("does not answer on {bus} within {} ms, asked {} times", board.timeout.as_millis(), RETRIES + 1)
        }
        Answer::Garbled(what) => format!("its answer is damaged: {}", why(what)),
        Answer::Interrupt => return Err("interrupted".into()),
    };
    Err(format!("{} {wrong}", board.text()).into())
}

impl Known {
    /// For people: `so1 (0x20)`.
    pub fn text(&self) -> String {
        match self.name.as_str() {
            "?" => format!("board {:#04x}", self.address),
            name => format!("{name} ({:#04x})", self.address),
        }
    }
}
