//! `advee rs485 poll`: one instruction again and again, and what came of it.

use super::decode;
use super::line::{Answer, Line, Settled, status_name};
use super::target::{Known, TIMEOUT, Target, Where};
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, finite, print, seconds, whole};
use base::{Duration, Instant};
use host::clock;
use rs485::boards::{GET_VERSION, Instruction, psc1, sbs1, sd1, so1};
use rs485::frame::{OVERHEAD, Status};
use rs485::master::Lengths;
use rs485::word_time;
use serde_json::json;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Poll {
    /// Board, by its name or its address
    board: String,
    /// Instruction, by its name or its number [default: what its driver polls]
    instruction: Option<String>,
    /// The request's data, hexadecimal: 30ff
    #[arg(long, value_name = "HEX", value_parser = hex, default_value = "")]
    data: Hex,
    /// Polls a second; without it as many as the wire carries
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// So many polls
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// How long, s; without it and --count until Ctrl-C
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    #[command(flatten)]
    place: Where,
    /// One JSON object at the end
    #[arg(long)]
    json: bool,
}

/// Bytes as they are typed.
#[derive(Clone, Debug)]
struct Hex(Vec<u8>);

fn hex(text: &str) -> Result<Hex, String> {
    let digits: Vec<u8> = text.bytes().filter(|byte| !byte.is_ascii_whitespace()).collect();
    let digit = |digit: u8| char::from(digit).to_digit(16).map(|digit| digit as u8);
    let pair = |pair: &[u8]| Some(digit(pair[0])? << 4 | digit(pair[1])?);
    let bytes: Option<Vec<u8>> =
        digits.chunks(2).map(|chunk| if chunk.len() == 2 { pair(chunk) } else { None }).collect();
    bytes
        .filter(|bytes| bytes.len() <= 255)
        .map(Hex)
        .ok_or_else(|| "expected at most 255 bytes as pairs of hexadecimal digits".into())
}

fn rate(text: &str) -> Result<f64, String> {
    let rate = finite(text)?;
    if (0.01..=10_000.0).contains(&rate) { Ok(rate) } else { Err("expected 0.01 to 10000 Hz".into()) }
}

/// What came of all polls.
#[derive(Default)]
struct Tally {
    good: u64,
    refused: u64,
    silent: u64,
    /// Of the silent ones: answered after the time limit.
    late: u64,
    damaged: u64,
    /// Of good answers, in order of time.
    round_trips: Vec<Duration>,
    /// Words of a request and of the last answer.
    words: u32,
    last: String,
}

/// Round trips that are remembered for their percentile.
const REMEMBERED: usize = 100_000;
/// For so long after a poll without an answer the line must be silent: an answer that is late is not that of the next
/// poll.
const LATE: Duration = Duration::from_millis(100);

pub fn poll(common: &Common, command: &Poll) -> Outcome {
    let target = command.place.find(common)?;
    let board = target.board(&command.board)?;
    let instruction = instruction(&board, command.instruction.as_deref())?;
    let data = &command.data.0;
    // Each poll is counted for itself: nothing is repeated.
    let mut line = Line::open(&target, 0, TIMEOUT)?;
    line.allow(&board);
    let (begin, mut progress) = (clock::now(), Progress::new("polling"));
    let until = command.time.map_or(Instant::NEVER, |time| begin + time);
    let period = command.rate.map(|rate| Duration::from_secs_f64(1.0 / rate));
    let (mut tally, mut next) = (Tally::default(), begin);
    while command.count.is_none_or(|count| tally.polls() < count) && clock::now() < until {
        let answer = line.ask(instruction.ask(board.address, data))?;
        if answer == Answer::Interrupt {
            break;
        }
        let silent = answer == Answer::Silent;
        tally.count(&board, &instruction, data.len(), answer);
        match if silent { line.settle(LATE)? } else { Settled::Quiet } {
            Settled::Late => tally.late += 1,
            Settled::Quiet => {}
            Settled::Interrupt => break,
        }
        let now = clock::now();
        match share(now.since(begin), command.time, tally.polls(), command.count) {
            Some(share) => progress.show(share, |took| tally.short(took)),
            None => progress.open(|took| tally.short(took)),
        }
        if let Some(period) = period {
            // What is late is left out, the grid stays.
            while next <= now {
                next += period;
            }
            if pause(&mut line, next.min(until))? {
                break;
            }
        }
    }
    let took = clock::now().since(begin);
    progress.clear();
    if command.json {
        print(tally.json(&target, &board, &instruction, took))?;
    } else {
        tally.lines(&target, &board, &instruction, took).iter().try_for_each(print)?;
    }
    match tally.good {
        0 => Err(format!("{} gave no good answer on {}", board.text(), target.name).into()),
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// What is done of all, by the time or the number of polls that ends it first; `None` without an end.
fn share(took: Duration, time: Option<Duration>, polls: u64, count: Option<u64>) -> Option<f64> {
    let by_time = time.map(|time| took.as_secs_f64() / time.as_secs_f64());
    let by_count = count.map(|count| polls as f64 / count as f64);
    by_time.into_iter().chain(by_count).reduce(f64::max)
}

/// Waits; true at Ctrl-C.
fn pause(line: &mut Line, until: Instant) -> Result<bool, Failed> {
    while clock::now() < until {
        if line.wait(until)? {
            return Ok(true);
        }
    }
    Ok(false)
}

fn instruction(board: &Known, name: Option<&str>) -> Result<Instruction, Failed> {
    let Some(name) = name else {
        return Ok(match board.board.map(|board| board.name) {
            Some("sd1") => sd1::GET_BOTH_DATA,
            Some("so1") => so1::GET_TICKS,
            Some("sbs1") => sbs1::GET_BEACON_DATA,
            Some("psc1") => psc1::GET_PWR_STATUS,
            _ => GET_VERSION,
        });
    };
    let table = board.board.map_or(&[][..], |board| board.instructions);
    let number: Option<u8> = whole(name);
    let known = table.iter().find(|known| known.name == name || Some(known.code) == number);
    let unknown = |code| Instruction { code, name: "", request: Lengths::ANY, answer: Lengths::ANY };
    known.copied().or(number.map(unknown)).ok_or_else(|| {
        let names: Vec<&str> = table.iter().map(|known| known.name).collect();
        Failed::from(format!("{} has no instruction {name:?}; it has {}", board.text(), names.join(", ")))
    })
}

impl Tally {
    fn polls(&self) -> u64 {
        self.good + self.refused + self.silent + self.damaged
    }

    fn count(&mut self, board: &Known, instruction: &Instruction, asked: usize, answer: Answer) {
        match answer {
            Answer::Reply { status: Status::Ok, data, round_trip } => {
                self.good += 1;
                if self.round_trips.len() < REMEMBERED {
                    self.round_trips.push(round_trip);
                }
                self.words = (2 * OVERHEAD + asked + data.len()) as u32;
                self.last = match decode::answer(board.board, instruction.code, &data) {
                    Ok(says) => says.text,
                    Err(implausible) => format!("implausible: {implausible}"),
                };
            }
            Answer::Reply { status, .. } => {
                self.refused += 1;
                self.last = status_name(status).into();
            }
            Answer::Garbled(_) => self.damaged += 1,
            Answer::Silent | Answer::Sent | Answer::Interrupt => self.silent += 1,
        }
    }

    fn short(&self, took: Duration) -> String {
        let Self { good, refused, silent, late, damaged, last, .. } = self;
        let hz = self.polls() as f64 / took.as_secs_f64().max(1e-9);
        format!(
            "{} polls, {hz:.1}/s; {good} good, {silent} silent ({late} late), {damaged} damaged, {refused} refused  \
             {last}",
            self.polls()
        )
    }

    /// Least, mean, 99th percentile and greatest, ms.
    fn times(&self) -> Option<[f64; 4]> {
        let mut sorted = self.round_trips.clone();
        sorted.sort_unstable();
        let (first, last) = (sorted.first()?, sorted.last()?);
        let sum: Duration = sorted.iter().sum();
        let mean = sum / u32::try_from(sorted.len()).unwrap_or(u32::MAX);
        let p99 = sorted[(sorted.len() * 99 / 100).min(sorted.len() - 1)];
        Some([*first, mean, p99, *last].map(|time| time.as_secs_f64() * 1e3))
    }

    /// What a poll costs the wire alone: its words, and the silence after it.
    fn wire_ms(&self, target: &Target) -> f64 {
        (word_time(target.terminal.baud) * (self.words + 2)).as_secs_f64() * 1e3
    }

    fn lines(&self, target: &Target, board: &Known, instruction: &Instruction, took: Duration) -> Vec<String> {
        let polls = self.polls().max(1) as f64;
        let share = |count: u64| format!("{count:>8}  {:>6.2} %", 100.0 * count as f64 / polls);
        let name = decode::instruction(board.board, instruction.code);
        let seconds = took.as_secs_f64();
        let mut lines = vec![
            format!("{} on {}: {name}, {} Bd", board.text(), target.name, target.terminal.baud),
            format!(
                "  polls    {:>8}  in {seconds:.2} s, {:.1}/s",
                self.polls(),
                self.polls() as f64 / seconds.max(1e-9)
            ),
            format!("  good     {}", share(self.good)),
            format!("  silent   {}", share(self.silent)),
            format!("  late     {}", share(self.late)),
            format!("  damaged  {}", share(self.damaged)),
            format!("  refused  {}", share(self.refused)),
        ];
        if let Some([min, mean, p99, max]) = self.times() {
            let wire = self.wire_ms(target);
            lines.push(format!(
                "  round trip  min {min:.2}  mean {mean:.2}  p99 {p99:.2}  max {max:.2} ms; the wire alone {wire:.2} ms"
            ));
        }
        if !self.last.is_empty() {
            lines.push(format!("  last        {}", self.last));
        }
        lines
    }

    fn json(&self, target: &Target, board: &Known, instruction: &Instruction, took: Duration) -> serde_json::Value {
        let times = self.times().map(
            |[min, mean, p99, max]| json!({"min": min / 1e3, "mean": mean / 1e3, "p99": p99 / 1e3, "max": max / 1e3}),
        );
        json!({
            "bus": target.name,
            "name": board.name,
            "address": board.address,
            "instruction": decode::instruction(board.board, instruction.code),
            "seconds": took.as_secs_f64(),
            "polls": self.polls(),
            "hz": self.polls() as f64 / took.as_secs_f64().max(1e-9),
            "good": self.good,
            "silent": self.silent,
            "late": self.late,
            "damaged": self.damaged,
            "refused": self.refused,
            "round_trip_s": times,
            "wire_s": self.wire_ms(target) / 1e3,
            "last": self.last,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rs485::master::Why;

    #[test]
    fn data_is_typed_in_pairs_of_digits() {
        assert_eq!(hex("30 ff00").unwrap().0, [0x30, 0xFF, 0x00]);
        assert_eq!(hex("").unwrap().0, [0; 0]);
        assert!(hex("3").is_err() && hex("zz").is_err() && hex("+1").is_err() && hex(&"00".repeat(256)).is_err());
        assert!(rate("0").is_err() && rate("NaN").is_err());
        assert_eq!(rate("20"), Ok(20.0));
    }

    #[test]
    fn the_end_that_comes_first_tells_how_far_it_is() {
        let (took, time) = (Duration::from_secs(3), Duration::from_secs(10));
        assert_eq!(share(took, None, 5, None), None);
        assert_eq!(share(took, Some(time), 5, None), Some(0.3));
        assert_eq!(share(took, Some(time), 5, Some(10)), Some(0.5));
        assert_eq!(share(took, Some(time), 1, Some(10)), Some(0.3));
    }

    #[test]
    fn the_tally_counts_each_poll_once() {
        let so1 =
            Known { name: "so1".into(), address: 0x20, board: Some(&so1::BOARD), timeout: Duration::from_millis(20) };
        let mut tally = Tally::default();
        let good = |ms, data: &[u8]| Answer::Reply {
            status: Status::Ok,
            data: data.to_vec(),
            round_trip: Duration::from_millis(ms),
        };
        let answers = [good(1, &[1, 0]), good(3, &[2, 0]), Answer::Silent, Answer::Garbled(Why::Crc)];
        answers.into_iter().for_each(|answer| tally.count(&so1, &so1::GET_TICKS, 0, answer));
        assert_eq!((tally.polls(), tally.good, tally.silent, tally.damaged), (4, 2, 1, 1));
        assert_eq!(tally.times(), Some([1.0, 2.0, 3.0, 3.0]));
        assert_eq!((tally.words, tally.last.as_str()), (12, "ticks 2"));
    }
}
