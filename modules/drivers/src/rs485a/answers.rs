//! What the boards answer, or fail to: from what is heard to messages.

use super::Rs485a;
use super::odometry::Step;
use crate::line::Heard;
use crate::rs485_bus::Kind;
use base::{Duration, Fault, Instant, Severity};
use messages::lowlevel::{DataIrs, DataRanges, DataSrfs};
use module::Actions;
use rs485::boards::{Implausible, sd1, so1};
use std::mem;

/// `LL_DATA_RANGES` comes at least this often, whether boards answer or not.
const RANGES_AGAIN: Duration = Duration::from_secs(1);
/// Jumps of counters are reported this often at most.
const JUMPS_EVERY: Duration = Duration::from_secs(10);

impl Rs485a {
    pub(super) fn on_heard(&mut self, now: Instant, heard: &Heard, out: &mut Actions) {
        match heard {
            Heard::Answer { to, instruction, data } => self.on_answer(now, *to, *instruction, data, out),
            Heard::Failed { to, instruction } => self.on_failure(now, *to, *instruction, out),
            Heard::Back | Heard::Unasked { .. } => {}
        }
    }

    fn on_answer(&mut self, now: Instant, to: u8, instruction: u8, data: &[u8], out: &mut Actions) {
        let understood = match self.nodes.iter().find(|node| node.address == to).map(|node| node.kind) {
            // It has let go of the PAUSE line.
            Some(Kind::Sd1) if instruction == sd1::CLEAR_PAUSE_SRC.code => return,
            Some(Kind::Sd1) => {
                let both = self.line.judge(to, sd1::Both::parse(data), out);
                both.map(|both| self.on_ranges(now, to, Some(both), out))
            }
            Some(Kind::So1) => {
                let counts = self.line.judge(to, wheels(data), out);
                counts.map(|counts| self.on_ticks(now, to, counts, out))
            }
            Some(Kind::Sbs1 | Kind::Psc1) | None => return,
        };
        if understood.is_none() {
            self.on_failure(now, to, instruction, out);
        }
    }

    /// The board did not say what it was asked.
    fn on_failure(&mut self, now: Instant, to: u8, instruction: u8, out: &mut Actions) {
        if instruction == sd1::GET_BOTH_DATA.code {
            self.on_ranges(now, to, None, out);
        }
    }

    fn on_ranges(&mut self, now: Instant, board: u8, both: Option<sd1::Both>, out: &mut Actions) {
        if self.ranges.is_done(board) {
            self.publish_ranges(now, out);
        }
        self.ranges.put(now, board, both);
        if self.ranges.complete(|address| !self.line.is_lost(address)) {
            self.publish_ranges(now, out);
        }
    }

    fn publish_ranges(&mut self, now: Instant, out: &mut Actions) {
        self.publish_readings(now, out);
        let (at, srfs, irs) = self.ranges.publish();
        let timestamp = out.timestamp(at);
        out.publish(DataSrfs { timestamp, srfs });
        out.publish(DataIrs { timestamp, irs });
    }

    /// `LL_DATA_RANGES`; again in a second where nothing new comes until then.
    pub(super) fn publish_readings(&mut self, now: Instant, out: &mut Actions) {
        if self.ranges.is_empty() {
            self.repeat = Instant::NEVER;
            return;
        }
        let readings = self.ranges.readings(|at| out.timestamp(at));
        out.publish(DataRanges { timestamp: out.timestamp(now), readings });
        self.repeat = now + RANGES_AGAIN;
    }

    fn on_ticks(&mut self, now: Instant, board: u8, counts: (i16, i16), out: &mut Actions) {
        match self.odometry.answer(now, out.timestamp(now), counts) {
            Step::First => {}
            Step::Way(odo) => out.publish(odo),
            Step::Jump { ticks: (left, right) } => {
                self.jumps += 1;
                if now < self.jumps_quiet {
                    return;
                }
                let (name, board) = self.line.name(board);
                let again = match mem::take(&mut self.jumps) {
                    1 => String::new(),
                    jumps => format!(", {jumps} times since it was told"),
                };
                let message =
                    format!("{board} was reset: its counters jumped by {left} and {right}{again}; odometry goes on");
                out.report(Severity::Warning, Fault::BoardImplausible, name, message);
                self.jumps_quiet = now + JUMPS_EVERY;
            }
        }
    }
}

/// The counters of the left and the right wheel.
fn wheels(data: &[u8]) -> Result<(i16, i16), Implausible> {
    match so1::parse_ticks(data)?[..] {
        [left, right, ..] => Ok((left, right)),
        _ => Err(Implausible::Layout { len: data.len() }),
    }
}
