//! The robot does not drive blindly (docs/design.md, section 4): no set-point in a direction whose ranging board has
//! not answered for a second.
//!
//! The witness is the wire: an answer of the board with its distances and a right CRC. The time counts from the last
//! answer, or, if that is later, from the last instant at which a process on the way, or LCM, was delayed by a fault.
//! That the body then comes to a standstill is the rule `body`.

use super::Verdict;
use super::facts::Facts;
use base::serial::Word;
use base::{Duration, Instant};
use navitools::Pose;
use rs485::boards::sd1;
use rs485::crc::Crc8;
use rs485::frame::{Frame, Status};
use rs485::reader::{Reader, Received};

/// Maximum time without an answer.
const SILENCE_MAX: Duration = Duration::from_secs(1);

/// Board of range finders.
#[derive(Clone, Debug, PartialEq)]
pub struct RangingBoard {
    /// Name, as target of faults.
    pub name: String,
    /// Module that polls it.
    pub module: String,
    /// Bus: `rs485.a`.
    pub bus: String,
    /// Check of its frames.
    pub crc: Crc8,
    /// Address.
    pub address: u8,
    /// Has a sonar that looks forward.
    pub forward: bool,
    /// Has a sonar that looks backward.
    pub backward: bool,
    /// Its sonars: channel, and where on the robot.
    pub sonars: Vec<(usize, Pose)>,
}

/// What a board put on the wire.
#[derive(Debug)]
struct Line {
    reader: Reader,
    answered: Option<Instant>,
}

/// Answers of all boards, in the order of the limits.
#[derive(Debug)]
pub(super) struct Rule(Vec<Line>);

impl Rule {
    pub fn new(boards: &[RangingBoard]) -> Self {
        Self(boards.iter().map(|board| Line { reader: Reader::new(board.crc, None), answered: None }).collect())
    }

    /// Words have arrived on a serial bus.
    pub fn on_words(&mut self, now: Instant, bus: &str, words: &[Word], facts: &Facts) {
        for (board, line) in facts.limits.ranging.iter().zip(&mut self.0).filter(|(board, _)| board.bus == *bus) {
            for word in words {
                if let Some(Received::Frame(frame)) = line.reader.push(now, *word)
                    && answer(&frame, board.address).is_some()
                {
                    line.answered = Some(now);
                }
            }
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        for (board, line) in facts.limits.ranging.iter().zip(&self.0) {
            let ahead = if speed > 0.0 { board.forward } else { board.backward };
            let ill = facts.life(&board.module).map_or(Instant::ZERO, |life| life.ill(now));
            let disturbed = facts.lcm_disturbed(now).unwrap_or_default().max(facts.driver.ill(now)).max(ill);
            let from = line.answered.unwrap_or_default().max(disturbed);
            if ahead && now.since(from) > SILENCE_MAX + facts.slack(now) {
                return Err(match line.answered {
                    Some(at) => format!("{speed:.3} m/s, and {} answered last at {at:?}", board.name),
                    None => format!("{speed:.3} m/s, and {} has never answered", board.name),
                });
            }
        }
        Ok(())
    }
}

/// Distances in an answer of the board at an address.
pub(super) fn answer(frame: &Frame<'_>, address: u8) -> Option<sd1::Both> {
    // A request has no data.
    let of = frame.address == address && frame.instruction == sd1::GET_BOTH_DATA.code;
    sd1::Both::parse(frame.data).ok().filter(|_| of && frame.flags == Status::Ok as u8)
}
