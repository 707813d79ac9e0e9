//! Objects of a drive on which its stop depends, read back while the robot runs.
//!
//! The boot-up writes and compares them; afterwards another program on the bus, or a fault of the drive, may change
//! them. Each is read once in [`PERIOD`], all of them at once when another program has asked the drive for something,
//! and written again if it differs.

use base::{Duration, Instant};
use canopen::Master;
use canopen::NodeConfig;
use canopen::master::{ConfigWrite, Foreign, Ticket};

/// All objects of a drive are read within this time.
const PERIOD: Duration = Duration::from_secs(10);
/// The same, of one object, after another program has asked the drive for something: it must have been answered.
const AFTER_FOREIGN: Duration = Duration::from_millis(5);

/// News of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// The object holds another value; it is written again.
    Changed { index: u16, sub: u8 },
    /// It holds the right value again.
    Restored,
}

/// Objects of one drive.
#[derive(Debug)]
pub(super) struct Readback {
    node: u8,
    objects: Vec<ConfigWrite>,
    next: usize,
    due: Option<Instant>,
    ticket: Option<Ticket>,
    /// The object that `next` names was found changed.
    changed: bool,
    /// Number of objects that another program may have changed: they are read without a pause.
    suspect: usize,
}

impl Readback {
    /// `master`: node id whose heartbeat the drive watches.
    pub(super) fn new(config: &NodeConfig, master: u8) -> Self {
        // Modes and PDOs are changed by the driver, and checked by what the drive does.
        let matters = |write: &&ConfigWrite| matches!(write.index, 0x1029 | 0x6007 | 0x605A..=0x605E | 0x607F..=0x6086);
        let watches = config.master_limit.map(|limit| {
            let limit = u32::try_from(limit.as_millis()).unwrap_or(u32::MAX) & 0xFFFF;
            ConfigWrite::new(0x1016, 1, u32::from(master) << 16 | limit)
        });
        let guarded = config.guarding.map(|guarding| {
            let period = u16::try_from(guarding.period.as_millis()).unwrap_or(u16::MAX);
            [ConfigWrite::new(0x100C, 0, period), ConfigWrite::new(0x100D, 0, guarding.factor)]
        });
        let watches = watches.into_iter().chain(guarded.into_iter().flatten());
        let objects = config.writes.iter().filter(matters).cloned().chain(watches).collect();
        Self { node: config.id, objects, next: 0, due: None, ticket: None, changed: false, suspect: 0 }
    }

    /// True while an object is known to hold another value.
    pub(super) fn is_changed(&self) -> bool {
        self.changed
    }

    /// Another program commands a drive.
    pub(super) fn on_foreign(&mut self, now: Instant, by: Foreign) {
        if by == (Foreign::SdoRequest { node: self.node }) && self.due.is_some() {
            self.suspect = self.objects.len();
            // Further requests do not postpone it.
            self.due = self.due.map(|due| due.min(now + AFTER_FOREIGN));
        }
    }

    /// Reads the next object if that is due; `running` while the drive is booted.
    pub(super) fn advance(&mut self, now: Instant, running: bool, master: &mut Master) {
        if !running || self.objects.is_empty() {
            (self.due, self.ticket, self.changed, self.suspect) = (None, None, false, 0);
            return;
        }
        let pause = match self.suspect {
            0 => PERIOD / u32::try_from(self.objects.len()).unwrap_or(1).max(1),
            _ => AFTER_FOREIGN,
        };
        let due = *self.due.get_or_insert(now + pause);
        if now < due || self.ticket.is_some() {
            return;
        }
        self.due = Some(now + pause);
        let ConfigWrite { index, sub, .. } = self.objects[self.next];
        self.ticket = master.sdo_read(now, self.node, index, sub).ok();
    }

    /// A transfer has ended; `data` if it was read. Absent if it is not one of these.
    pub(super) fn on_sdo(
        &mut self,
        now: Instant,
        ticket: Ticket,
        data: Option<&[u8]>,
        master: &mut Master,
    ) -> Option<Option<Found>> {
        self.ticket.take_if(|own| *own == ticket)?;
        // An object that was not read is read again when it is due.
        let Some(data) = data else { return Some(None) };
        let write = &self.objects[self.next];
        if data == write.value.as_slice() {
            self.next = (self.next + 1) % self.objects.len();
            self.suspect = self.suspect.saturating_sub(1);
            return Some(std::mem::take(&mut self.changed).then_some(Found::Restored));
        }
        let (index, sub) = (write.index, write.sub);
        // The answer to the write is not awaited: the object is read again, the first time at once.
        let _written = master.sdo_write(now, self.node, index, sub, write.value.as_slice());
        if std::mem::replace(&mut self.changed, true) {
            return Some(None);
        }
        self.ticket = master.sdo_read(now, self.node, index, sub).ok();
        Some(Some(Found::Changed { index, sub }))
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.due.filter(|_| self.ticket.is_none())
    }
}
