//! Current, torque and temperature of a drive's motor, read by SDO while the drive is booted: in a PDO a current would
//! send a frame at each end of the inhibit time, and the PDOs of the drives stay as they are. A torque that comes in a
//! PDO all the same, because it is judged, is not read.
//!
//! Timing    one object in [`PERIOD`], at the moment at which the drive has shown that it is there, by a PDO or an
//!           answer, and while no answer is awaited on which the motion depends: a request to a drive that is gone
//!           would delay by its time limit that this is noticed. None while another master is on the bus: a drive has
//!           one SDO server, and a request ends the transfer of the other
//! Silence   an object that was not answered is read again after [`PAUSE`]; one that the drive refuses, or answers with
//!           another length, not before its next boot-up. A value counts for [`AGE_MAX`]

use base::{Duration, Instant};
use canopen::drives::motor::{Motor, Reading, Topic, Unit};
use canopen::master::Ticket;
use canopen::{Master, sdo};

/// Pause between two objects of a drive.
const PERIOD: Duration = Duration::from_millis(200);
/// Pause after an object that was not answered.
const PAUSE: Duration = Duration::from_secs(2);
/// Age beyond which a value is unknown.
const AGE_MAX: Duration = Duration::from_secs(3);

/// An object, and when it was read last.
#[derive(Debug)]
struct Item {
    reading: Reading,
    at: Option<Instant>,
    refused: bool,
    /// The drive sends it.
    sent: bool,
}

impl Item {
    fn is_due(&self) -> bool {
        !(self.refused || self.sent || self.reading.topic.is_rating() && self.at.is_some())
    }
}

/// The readings of one drive.
#[derive(Debug)]
pub(super) struct MotorWatch {
    node: u8,
    items: Vec<Item>,
    /// Read next, or being read.
    next: usize,
    ticket: Option<Ticket>,
    /// No object is read before.
    due: Option<Instant>,
    motor: Motor,
    /// The drive was booted at the last call of [`Self::advance`].
    running: bool,
}

impl MotorWatch {
    pub(super) fn new(node: u8, readings: &[Reading]) -> Self {
        let items =
            readings.iter().map(|reading| Item { reading: *reading, at: None, refused: false, sent: false }).collect();
        Self { node, items, next: 0, ticket: None, due: None, motor: Motor::default(), running: false }
    }

    /// Reads the next object if that is due; `running` while the drive is booted, `may_ask` if it has just shown that
    /// it is there, and owes no answer on which the motion depends.
    pub(super) fn advance(&mut self, now: Instant, running: bool, may_ask: bool, master: &mut Master) {
        if !running {
            if std::mem::take(&mut self.running) {
                let forget = |item: &mut Item| (item.at, item.refused, item.sent) = (None, false, false);
                self.items.iter_mut().for_each(forget);
                (self.motor, self.ticket, self.due) = (Motor::default(), None, None);
            }
            return;
        }
        self.running = true;
        for item in &mut self.items {
            if item.at.is_some_and(|at| now.since(at) > AGE_MAX) {
                item.sent = false;
                self.motor.forget(item.reading.topic);
            }
        }
        if !may_ask || self.ticket.is_some() || self.due.is_some_and(|due| now < due) {
            return;
        }
        self.due = Some(now + PERIOD);
        let count = self.items.len();
        let mut after = (0..count).map(|place| (self.next + place) % count);
        let Some(next) = after.find(|place| self.items[*place].is_due()) else { return };
        self.next = next;
        let Reading { index, sub, .. } = self.items[next].reading;
        self.ticket = master.sdo_read(now, self.node, index, sub).ok();
    }

    /// The torque came in a PDO of the booted drive, per mille of the rated one.
    pub(super) fn on_torque(&mut self, now: Instant, per_mille: i16) {
        if !self.running {
            return;
        }
        self.motor.torque = Some((per_mille.into(), Unit::PerMille));
        for item in self.items.iter_mut().filter(|item| item.reading.topic == Topic::Torque) {
            (item.at, item.sent) = (Some(now), true);
        }
    }

    /// A transfer has ended. Absent if it is not one of these; else the reading that is given up by it, if one is.
    pub(super) fn on_sdo(
        &mut self,
        now: Instant,
        ticket: Ticket,
        result: Result<&[u8], sdo::Error>,
    ) -> Option<Option<Reading>> {
        self.ticket.take_if(|own| *own == ticket)?;
        let place = self.next;
        self.next = (place + 1) % self.items.len();
        let item = &mut self.items[place];
        match result {
            Ok(data) if self.motor.take(&item.reading, data) => item.at = Some(now),
            Ok(_) | Err(sdo::Error::Refused(_)) => {
                item.refused = true;
                self.motor.forget(item.reading.topic);
                return Some(Some(item.reading));
            }
            Err(sdo::Error::Timeout | sdo::Error::Protocol(_) | sdo::Error::Cancelled) => {
                self.due = Some(now + PAUSE);
            }
        }
        Some(None)
    }

    /// What was read last.
    pub(super) fn motor(&self) -> &Motor {
        &self.motor
    }
}
