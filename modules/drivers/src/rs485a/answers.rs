//! Conversion of the boards' answers and failures to messages.

use super::Rs485a;
use super::odometry::Step;
use crate::line::BusEvent;
use crate::rs485_bus::Kind;
use base::{Duration, Fault, Instant, Severity};
use messages::lowlevel::{DataIrs, DataRanges, DataSrfs};
use module::Actions;
use rs485::boards::{Implausible, sd1, so1};
use std::mem;

/// Maximum interval of `LL_DATA_RANGES`, even if no board answers.
const RANGES_PERIOD_MAX: Duration = Duration::from_secs(1);
/// Maximum time from the first answer of a round to its `LL_DATA_RANGES`.
const ROUND_MAX: Duration = Duration::from_millis(30);
/// Minimum interval between reports of counter jumps.
const JUMP_REPORT_INTERVAL: Duration = Duration::from_secs(10);

impl Rs485a {
    pub(super) fn on_bus_event(&mut self, now: Instant, event: &BusEvent, out: &mut Actions) {
        match event {
            BusEvent::Answer { to, instruction, asked, data } => {
                self.on_answer(now, *to, *instruction, *asked, data, out);
            }
            BusEvent::Failed { to, instruction } => self.on_failure(now, *to, *instruction, out),
            BusEvent::Recovered | BusEvent::Unsolicited { .. } => {}
        }
    }

    fn on_answer(&mut self, now: Instant, to: u8, instruction: u8, asked: Instant, data: &[u8], out: &mut Actions) {
        let understood = match self.nodes.iter().find(|node| node.address == to).map(|node| node.kind) {
            // The board has released the PAUSE line.
            Some(Kind::Sd1) if instruction == sd1::CLEAR_PAUSE_SRC.code => return,
            Some(Kind::Sd1) if instruction == sd1::GET_PAUSE_SRC.code => {
                match self.line.judge(to, sd1::PauseSource::parse(data), out) {
                    Some(engages) => self.floor.on_answer(to, engages, out),
                    None => self.floor.on_failure(to),
                }
                return;
            }
            Some(Kind::Sd1) => {
                let both = sd1::Both::parse(data).and_then(|both| self.plausibility.judge(now, to, both));
                let both = self.line.judge(to, both, out);
                both.map(|both| self.on_ranges(now, to, Some(both), out))
            }
            Some(Kind::So1) => {
                let counts = self.line.judge(to, wheels(data), out);
                counts.map(|counts| self.on_ticks(now, to, asked, counts, out))
            }
            Some(Kind::Sbs1 | Kind::Psc1) | None => return,
        };
        if understood.is_none() {
            self.on_failure(now, to, instruction, out);
        }
    }

    /// A request to a board failed.
    fn on_failure(&mut self, now: Instant, to: u8, instruction: u8, out: &mut Actions) {
        if instruction == sd1::GET_BOTH_DATA.code {
            self.on_ranges(now, to, None, out);
        }
    }

    fn on_ranges(&mut self, now: Instant, board: u8, both: Option<sd1::Both>, out: &mut Actions) {
        // While the robot drives, the message does not wait for a board that looks elsewhere.
        let leading = |address| self.pace.is_leading(address) && !self.line.is_lost(address);
        let leads = leading(board);
        let waits = self.ranges.boards().any(leading);
        if self.ranges.is_done(board) && !waits {
            self.publish_readings(now, out);
            self.publish_views(out);
        }
        self.ranges.put(now, board, both);
        let complete = self.ranges.complete(|address| !self.line.is_lost(address));
        if leads || complete && !waits {
            self.publish_readings(now, out);
        } else if !waits {
            // Boards that are polled in another phase must not make this one's readings old.
            self.repeat = self.repeat.min(now + ROUND_MAX);
        }
        if complete {
            self.publish_views(out);
        }
    }

    /// Publishes the views of 2011 and starts the next round.
    fn publish_views(&mut self, out: &mut Actions) {
        let (at, srfs, irs) = self.ranges.publish();
        let timestamp = out.timestamp(at);
        out.publish(DataSrfs { timestamp, srfs });
        out.publish(DataIrs { timestamp, irs });
    }

    /// Publishes `LL_DATA_RANGES`, repeated after a second without new readings.
    pub(super) fn publish_readings(&mut self, now: Instant, out: &mut Actions) {
        if self.ranges.is_empty() {
            self.repeat = Instant::NEVER;
            return;
        }
        let readings = self.ranges.readings(|at| out.timestamp(at));
        out.publish(DataRanges { timestamp: out.timestamp(now), readings });
        self.repeat = now + RANGES_PERIOD_MAX;
    }

    fn on_ticks(&mut self, now: Instant, board: u8, asked: Instant, counts: (i16, i16), out: &mut Actions) {
        match self.odometry.answer(asked, now, out.timestamp(now), counts) {
            Step::First => {}
            Step::Motion(odo) => out.publish(odo),
            Step::Jump { ticks: (left, right) } => {
                self.jumps += 1;
                if now < self.jumps_quiet {
                    return;
                }
                let (name, board) = self.line.name(board);
                let again = match mem::take(&mut self.jumps) {
                    1 => String::new(),
                    jumps => format!(", {jumps} times since the last report"),
                };
                let message =
                    format!("{board} was reset: its counters jumped by {left} and {right}{again}; odometry goes on");
                out.report(Severity::Warning, Fault::BoardImplausible, name, message);
                self.jumps_quiet = now + JUMP_REPORT_INTERVAL;
            }
        }
    }
}

/// Counters of the left and the right wheel.
fn wheels(data: &[u8]) -> Result<(i16, i16), Implausible> {
    match so1::parse_ticks(data)?[..] {
        [left, right, ..] => Ok((left, right)),
        _ => Err(Implausible::Layout { len: data.len() }),
    }
}
