//! Digital output of a CANopen node that feeds the motors: a second way to stop that does not depend on the drive.
//!
//! Accessed by SDO, so that each order is acknowledged. The output is read all the time, so that it is known in advance
//! whether its node answers, and whether the motors are fed. An output that was cut, by this process or an earlier one,
//! stays so until a person switches it on.

use base::{Duration, Instant};
use canopen::Master;
use canopen::master::{Target, Ticket};
use canopen::{NmtCommand, NmtState};
use messages::Hold;
use settings::{Table, settings};

/// Period of reading, and of repeating an order that was not acknowledged.
const PERIOD: Duration = Duration::from_millis(400);
/// Age of the last answer from which the output counts as lost: three answers are missing.
pub(super) const ANSWER_AGE_MAX: Duration = Duration::from_millis(1200);
/// Time after which a transfer that waits behind others is given up.
const PATIENCE: Duration = Duration::from_millis(600);

settings! {
    /// `[stop.output]`: digital output of a CANopen node, on the bus of the drives, that feeds the motors: it holds a
    /// relay, or the safe-torque-off input of the propulsion drive. The object belongs to it as a whole.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct OutputConfig {
        /// CANopen node: none of the drives, nor the master.
        node: u8 = required, 1..=127;
        /// Index of the object: 0x6200 of an output module (CiA 401), or the maker's.
        index: u16 = required, 0x2000..=0x9FFF;
        /// Its sub-index.
        subindex: u8 = 1, 0..=254;
        /// Its size: 8, 16 or 32.
        bits: u8 = 8, 8..=32;
        /// Value with which the motors are fed.
        on: u32 = 1, 0..=u32::MAX;
        /// Value that cuts their feed.
        cut: u32 = 0, 0..=u32::MAX;
    }
    check OutputConfig::check;
}

impl OutputConfig {
    fn check(&self, table: &Table<'_>) {
        if ![8, 16, 32].contains(&self.bits) {
            table.refuse("bits", "8, 16 or 32");
        }
        for (key, value) in [("on", self.on), ("cut", self.cut)] {
            if u64::from(value) >> self.bits != 0 {
                table.refuse(key, "a value that fits the object");
            }
        }
        if self.on == self.cut {
            let key = if table.has("cut") { "cut" } else { "on" };
            table.refuse(key, "two values that differ");
        }
    }

    /// Bytes of a value on the wire.
    fn bytes(&self, value: u32) -> Vec<u8> {
        value.to_le_bytes()[..usize::from(self.bits / 8)].to_vec()
    }

    /// Value of these bytes; `None` if the object has another size.
    fn value(&self, bytes: &[u8]) -> Option<u32> {
        let mut value = [0; 4];
        value.get_mut(..bytes.len())?.copy_from_slice(bytes);
        (bytes.len() == usize::from(self.bits / 8)).then(|| u32::from_le_bytes(value))
    }
}

/// News of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum News {
    /// Its node does not answer, or refuses.
    Lost,
    /// It answers again.
    Back,
}

/// Transfer whose end is awaited until an instant.
#[derive(Debug)]
struct Pending {
    ticket: Ticket,
    written: Option<u32>,
    until: Instant,
}

/// The output.
#[derive(Debug)]
pub(super) struct FeedOutput {
    config: OutputConfig,
    /// Value as it was last read, or written and acknowledged.
    value: Option<u32>,
    /// Value to be written, until the node has acknowledged it.
    order: Option<u32>,
    pending: Option<Pending>,
    /// Time of the last answer, or of the start.
    answered: Instant,
    due: Instant,
    lost: bool,
}

impl FeedOutput {
    pub(super) fn new(config: OutputConfig) -> Self {
        let (answered, due) = (Instant::ZERO, Instant::ZERO);
        Self { config, value: None, order: None, pending: None, answered, due, lost: false }
    }

    /// Starts its time limits.
    pub(super) fn start(&mut self, now: Instant) {
        (self.answered, self.due) = (now, now);
    }

    pub(super) fn config(&self) -> &OutputConfig {
        &self.config
    }

    /// True if the motors are known not to be fed.
    pub(super) fn is_off(&self) -> bool {
        self.value.is_some_and(|value| value != self.config.on)
    }

    /// Objection to any motion: the output does not answer, or it does not feed the motors.
    pub(super) fn objection(&self) -> Option<Hold> {
        match self.value {
            Some(_) if self.lost => Some(Hold::SecondWayLost),
            Some(_) => self.is_off().then_some(Hold::FeedOff),
            None => Some(Hold::SecondWayLost),
        }
    }

    /// Cuts the motors' feed, or switches it on: written at once, and again until the node acknowledges it.
    pub(super) fn order(&mut self, now: Instant, on: bool) {
        self.order = Some(if on { self.config.on } else { self.config.cut });
        self.due = now;
        // A read that is under way is not waited for.
        self.pending.take_if(|pending| pending.written.is_none());
    }

    /// Does what is due; `cut`: the feed must be cut.
    pub(super) fn advance(&mut self, now: Instant, up: bool, cut: bool, master: &mut Master) -> Option<News> {
        self.pending.take_if(|pending| pending.until <= now);
        if cut && self.order.is_none() && self.value.is_some_and(|value| value != self.config.cut) {
            self.order(now, false);
        }
        if self.pending.is_none() && self.due <= now {
            self.due = now + PERIOD;
            if up {
                self.request(now, master);
            }
        }
        let lost = now.since(self.answered) >= ANSWER_AGE_MAX;
        let changed = std::mem::replace(&mut self.lost, lost) != lost;
        changed.then_some(if lost { News::Lost } else { News::Back })
    }

    fn request(&mut self, now: Instant, master: &mut Master) {
        let OutputConfig { node, index, subindex, .. } = self.config;
        // After its power-up a node that the master does not manage waits for the start command.
        if master.config(node).is_none() && master.nmt_state(node) == Some(NmtState::PreOperational) {
            master.nmt(Target::Node(node), NmtCommand::Start);
        }
        let ticket = match self.order {
            Some(value) => master.sdo_write(now, node, index, subindex, self.config.bytes(value).as_slice()),
            None => master.sdo_read(now, node, index, subindex),
        };
        let until = now + PATIENCE;
        self.pending = ticket.ok().map(|ticket| Pending { ticket, written: self.order, until });
    }

    /// A transfer has ended: with the data that was read, or without data if it was a write; `None`: it failed. False
    /// if it does not concern this output.
    pub(super) fn on_sdo(&mut self, now: Instant, ticket: Ticket, result: Option<&[u8]>) -> bool {
        let Some(Pending { written, .. }) = self.pending.take_if(|pending| pending.ticket == ticket) else {
            return false;
        };
        let Some(data) = result else { return true };
        let value = written.or_else(|| self.config.value(data));
        if let Some(value) = value {
            (self.value, self.answered) = (Some(value), now);
            self.order.take_if(|order| written == Some(*order));
            if self.order.is_some() {
                self.due = now;
            }
        }
        true
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let lost = (!self.lost).then_some(self.answered + ANSWER_AGE_MAX);
        let next = self.pending.as_ref().map_or(self.due, |pending| pending.until);
        Some(lost.map_or(next, |lost| lost.min(next)))
    }
}
