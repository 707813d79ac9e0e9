//! `advee rs485 scan`: every address is asked for its firmware version.

use super::line::{Answer, Line, status_name, why};
use super::target::{Known, Target, Where};
use crate::progress::Progress;
use crate::{Common, Outcome, print, whole};
use base::Duration;
use rs485::boards::{GET_VERSION, Version};
use rs485::frame::Status;
use serde_json::{Value, json};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Scan {
    #[command(flatten)]
    place: Where,
    /// First address
    #[arg(long, default_value = "1", value_parser = address)]
    first: u8,
    /// Last address
    #[arg(long, default_value = "254", value_parser = address)]
    last: u8,
    /// How long a board may take to answer, ms
    #[arg(long, value_name = "MS", default_value = "20", value_parser = clap::value_parser!(u64).range(1..=1000))]
    timeout: u64,
    /// JSON lines: one a board
    #[arg(long)]
    json: bool,
}

/// An address, decimal or 0x….
fn address(text: &str) -> Result<u8, String> {
    whole(text).filter(|address| (1..=254).contains(address)).ok_or_else(|| "expected an address from 1 to 254".into())
}

/// A board found, and what it said.
struct Row {
    board: Known,
    found: Found,
}

enum Found {
    Version {
        version: Option<Version>,
        seconds: f64,
    },
    Status(Status),
    Damaged(String),
    /// Configured, and silent.
    Missing,
}

/// One that is disturbed once is asked again; most addresses are empty, and cost their time but once.
const RETRIES: u8 = 0;
const TRIES_DAMAGED: usize = 3;

pub fn scan(common: &Common, command: &Scan) -> Outcome {
    let timeout = Duration::from_millis(command.timeout);
    let mut target = command.place.find(common)?;
    for known in &mut target.known {
        known.timeout = known.timeout.max(timeout);
    }
    let mut line = Line::open(&target, RETRIES, timeout)?;
    let (mut rows, mut asked, mut interrupted) = (Vec::new(), 0_u32, false);
    let mut progress = Progress::new("scanning");
    for address in command.first..=command.last {
        let all = f64::from(command.last - command.first) + 1.0;
        let share = f64::from(address - command.first) / all;
        progress.show(share, |_| format!("{address:#04x}  {} found", rows.len()));
        let board = target.at(address);
        match look(&mut line, &board)? {
            Err(()) => {
                interrupted = true;
                break;
            }
            Ok(Some(found)) => rows.push(Row { board, found }),
            Ok(None) if target.known.iter().any(|known| known.address == address) => {
                rows.push(Row { board, found: Found::Missing });
            }
            Ok(None) => {}
        }
        asked += 1;
    }
    progress.clear();
    let answered = rows.iter().filter(|row| !matches!(row.found, Found::Missing)).count();
    if command.json {
        rows.iter().try_for_each(|row| print(row.json(&target)))?;
    } else {
        table(&rows).iter().try_for_each(print)?;
        let until = if interrupted { ", then interrupted" } else { "" };
        let s = if answered == 1 { "" } else { "s" };
        print(format!("{answered} board{s} on {}; {asked} addresses asked{until}", target.name))?;
    }
    if interrupted {
        return Err("interrupted".into());
    }
    if answered == 0 {
        let what = format!("{}: nobody answers", target.name);
        return Err(format!("{what}: power, wires, A and B, baud and transport are what to look at").into());
    }
    Ok(ExitCode::SUCCESS)
}

/// What is at an address; `Err` at Ctrl-C.
fn look(line: &mut Line, board: &Known) -> Result<Result<Option<Found>, ()>, crate::Failed> {
    let mut damage = None;
    for _ in 0..TRIES_DAMAGED {
        match line.ask(GET_VERSION.ask(board.address, &[]))? {
            Answer::Interrupt => return Ok(Err(())),
            Answer::Reply { status: Status::Ok, data, round_trip } => {
                let (version, seconds) = (Version::parse(&data), round_trip.as_secs_f64());
                return Ok(Ok(Some(Found::Version { version, seconds })));
            }
            Answer::Reply { status, .. } => return Ok(Ok(Some(Found::Status(status)))),
            Answer::Garbled(what) => damage = Some(why(what)),
            Answer::Silent | Answer::Sent => break,
        }
    }
    Ok(Ok(damage.map(Found::Damaged)))
}

impl Row {
    fn said(&self) -> (String, String) {
        match &self.found {
            Found::Version { version, seconds } => {
                (version.map_or("?".into(), |version| version.to_string()), format!("{:.2}", seconds * 1e3))
            }
            Found::Status(status) => (format!("answers {}", status_name(*status)), String::new()),
            Found::Damaged(how) => (format!("damaged: {how}; two boards at one address?"), String::new()),
            Found::Missing => ("MISSING: configured, does not answer".into(), String::new()),
        }
    }

    fn json(&self, target: &Target) -> Value {
        let mut object = json!({
            "bus": target.name,
            "address": self.board.address,
            "name": self.board.name,
            "board": self.board.board.map(|board| board.name),
            "configured": target.known.iter().any(|known| known.address == self.board.address),
        });
        let (key, value) = match &self.found {
            Found::Version { version, seconds } => {
                object["round_trip_s"] = (*seconds).into();
                ("version", json!(version.map(|version| version.to_string())))
            }
            Found::Status(status) => ("status", status_name(*status).into()),
            Found::Damaged(how) => ("damaged", how.as_str().into()),
            Found::Missing => ("missing", true.into()),
        };
        object[key] = value;
        object
    }
}

fn table(rows: &[Row]) -> Vec<String> {
    if rows.is_empty() {
        return Vec::new();
    }
    let width = rows.iter().map(|row| row.board.name.len()).max().unwrap_or(0).max(4);
    let heading = format!("ADDRESS  {:width$}  BOARD  VERSION    ms", "NAME");
    let line = |row: &Row| {
        let kind = row.board.board.map_or("?".into(), |board| board.name.to_uppercase());
        let (said, ms) = row.said();
        format!("{:#04x}     {:width$}  {kind:5}  {said:7}  {ms:>4}", row.board.address, row.board.name)
            .trim_end()
            .into()
    };
    [heading].into_iter().chain(rows.iter().map(line)).collect()
}
