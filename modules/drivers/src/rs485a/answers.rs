//! What the boards answer, or fail to: from the master's events to messages and reports.

use super::odometry::Step;
use super::{Kind, Rs485a, version_of};
use base::{Duration, Fault, Instant, Severity};
use messages::lowlevel::{DataIrs, DataSrfs};
use module::Actions;
use rs485::boards::{GET_VERSION, Implausible, Version, sd1, so1};
use rs485::frame::Status;
use rs485::master::{self, Why};
use rs485::node::Health;
use std::mem;

/// Jumps of counters are reported this often at most.
const JUMPS_EVERY: Duration = Duration::from_secs(10);

impl Rs485a {
    pub(super) fn on_event(&mut self, now: Instant, event: &master::Event, out: &mut Actions) {
        use master::Event;
        match event {
            Event::Reply { to, instruction, status: Status::Ok, data } => {
                self.on_answer(now, *to, *instruction, data, out);
            }
            Event::Reply { to, instruction, status, .. } => self.on_refusal(now, *to, *instruction, *status, out),
            Event::Silent { to, instruction } => {
                self.fails(*to, "does not answer");
                self.on_failure(now, *to, *instruction, out);
            }
            Event::Garbled { to, instruction, why } => {
                self.fails(*to, damage(*why));
                self.on_failure(now, *to, *instruction, out);
            }
            Event::Unsent { to, instruction } => {
                self.stuck = true;
                let message = format!("{}: the port does not send; what was asked is dropped", self.bus);
                out.raise(Severity::Warning, Fault::PortOverrun, self.bus.as_str(), message);
                self.on_failure(now, *to, *instruction, out);
            }
            Event::Sent { .. }
            | Event::Unasked { .. }
            | Event::Babble { .. }
            | Event::BabbleOver { .. }
            | Event::Clash { .. }
            | Event::ClashOver { .. } => {}
            Event::Degraded { node } => {
                let (name, board) = self.name(*node);
                let message = format!("{board} fails again and again: it {}; asked on", self.failure(*node));
                out.raise(Severity::Warning, Fault::BoardDegraded, name, message);
            }
            Event::Recovered { node } => {
                let (name, board) = self.name(*node);
                out.clear(Fault::BoardDegraded, name, format!("{board} answers well again"));
            }
            Event::Lost { node } => {
                self.schedule.lost(now, *node);
                let (name, board) = self.name(*node);
                let message = format!("{board} {}: its data is invalid, asked once a second", self.failure(*node));
                out.raise(Severity::Error, Fault::BoardLost, name, message);
            }
            Event::Back { node } => {
                self.schedule.back(now, *node);
                self.schedule.demand(version_of(*node));
                let (name, board) = self.name(*node);
                out.clear(Fault::BoardDegraded, name.as_str(), format!("{board} answers well again"));
                out.clear(Fault::BoardLost, name, format!("{board} answers again"));
            }
        }
    }

    fn fails(&mut self, address: u8, how: &'static str) {
        if let Some(board) = self.boards.iter_mut().find(|board| board.node.address == address) {
            board.fails = how;
        }
    }

    fn failure(&self, address: u8) -> &'static str {
        self.boards.iter().find(|board| board.node.address == address).map_or("", |board| board.fails)
    }

    fn on_answer(&mut self, now: Instant, to: u8, instruction: u8, data: &[u8], out: &mut Actions) {
        let Some(board) = self.boards.iter_mut().find(|board| board.node.address == to) else {
            return;
        };
        board.answered = true;
        let kind = board.node.kind;
        if mem::take(&mut self.stuck) {
            out.clear(Fault::PortOverrun, self.bus.as_str(), format!("{}: the port sends again", self.bus));
        }
        if instruction == GET_VERSION.code {
            if let Some(version) = Version::parse(data) {
                out.note(format!("{}: firmware {version}", self.name(to).1));
            }
            return;
        }
        let refusals = mem::take(&mut board.refusals);
        if refusals > 0 {
            let (name, board) = self.name(to);
            let message = format!("{board} does what it is asked again, after {refusals} refusals");
            out.clear(Fault::BoardRefused, name, message);
        }
        let result = match kind {
            Kind::Sd1 => sd1::Both::parse(data).map(|both| self.on_ranges(now, to, Some(both), out)),
            Kind::So1 => wheels(data).map(|counts| self.on_ticks(now, to, counts, out)),
        };
        self.on_plausibility(now, to, instruction, result, out);
    }

    fn on_plausibility(
        &mut self,
        now: Instant,
        to: u8,
        instruction: u8,
        result: Result<(), Implausible>,
        out: &mut Actions,
    ) {
        let Some(board) = self.boards.iter_mut().find(|board| board.node.address == to) else {
            return;
        };
        let stood = mem::replace(&mut board.implausible, result.is_err());
        match result {
            Ok(()) if stood => {
                let (name, board) = self.name(to);
                out.clear(Fault::BoardImplausible, name, format!("{board} is plausible again"));
            }
            Ok(()) => {}
            Err(why) => {
                let (name, board) = self.name(to);
                let message = format!("{board} answered what it cannot: {why}; dropped");
                out.raise(Severity::Warning, Fault::BoardImplausible, name, message);
                self.on_failure(now, to, instruction, out);
            }
        }
    }

    fn on_refusal(&mut self, now: Instant, to: u8, instruction: u8, status: Status, out: &mut Actions) {
        let Some(board) = self.boards.iter_mut().find(|board| board.node.address == to) else {
            return;
        };
        board.answered = true;
        let version = instruction == GET_VERSION.code;
        if !version {
            board.refusals = board.refusals.saturating_add(1);
        }
        let verb = if status == Status::UnknownInstruction { "does not know" } else { "could not do" };
        let (name, board) = self.name(to);
        let message = format!("{board} {verb} instruction {instruction:#04x}");
        if version {
            // Asked once only: what it would clear never comes.
            out.report(Severity::Warning, Fault::BoardRefused, name, format!("{message}; its version stays unknown"));
        } else {
            out.raise(
                Severity::Warning,
                Fault::BoardRefused,
                name,
                format!("{message}; asked on, its data is missing"),
            );
        }
        self.on_failure(now, to, instruction, out);
    }

    /// The board did not say what it was asked.
    fn on_failure(&mut self, now: Instant, to: u8, instruction: u8, out: &mut Actions) {
        if instruction == sd1::GET_BOTH_DATA.code {
            self.on_ranges(now, to, None, out);
        }
    }

    fn on_ranges(&mut self, now: Instant, board: u8, both: Option<sd1::Both>, out: &mut Actions) {
        if self.ranges.is_done(board) {
            self.publish_ranges(out);
        }
        self.ranges.put(now, board, both);
        if self.ranges.complete(|address| self.master.health(address) != Health::Lost) {
            self.publish_ranges(out);
        }
    }

    fn publish_ranges(&mut self, out: &mut Actions) {
        let (at, srfs, irs) = self.ranges.publish();
        let timestamp = out.timestamp(at);
        out.publish(DataSrfs { timestamp, srfs });
        out.publish(DataIrs { timestamp, irs });
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
                let (name, board) = self.name(board);
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

const fn damage(why: Why) -> &'static str {
    match why {
        Why::Crc => "answers with a wrong CRC",
        Why::Length { .. } => "answers with a wrong length",
        Why::Status { .. } => "answers with a status that is none",
        Why::Incomplete => "answers with half a frame",
        Why::Request => "finds a wrong CRC in what it is asked",
    }
}

/// The counters of the left and the right wheel.
fn wheels(data: &[u8]) -> Result<(i16, i16), Implausible> {
    match so1::parse_ticks(data)?[..] {
        [left, right, ..] => Ok((left, right)),
        _ => Err(Implausible::Layout { len: data.len() }),
    }
}
