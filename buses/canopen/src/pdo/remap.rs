//! How a mapping is read from a node, and how it is changed.

use super::{INVALID, Layout, LayoutError, MAX_ENTRIES};
use crate::write::ConfigWrite;
use alloc::vec::Vec;

/// Content of a communication record and its mapping record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pdo {
    /// Index of the communication record: 0x1400 and up for RPDOs, 0x1800 and up for TPDOs.
    pub record: u16,
    /// The COB-ID with its bits 29 to 31.
    pub cob_id: u32,
    /// Transmission type.
    pub kind: u8,
    /// Inhibit time in 100 µs; `None` where the node has no such object.
    pub inhibit: Option<u16>,
    /// Event timer in ms; `None` where the node has no such object.
    pub event_timer: Option<u16>,
    /// Mapping entries in the form of 0x1600.
    pub entries: Vec<u32>,
}

impl Pdo {
    /// The identifier; `None` while the PDO does not exist or has a 29-bit one.
    #[must_use]
    pub const fn id(&self) -> Option<u16> {
        match self.cob_id & (INVALID | 1 << 29) {
            0 => Some((self.cob_id & 0x7FF) as u16),
            _ => None,
        }
    }

    /// Layout of the objects in the frame.
    ///
    /// # Errors
    /// More than a PDO holds.
    pub fn layout(&self) -> Result<Layout, LayoutError> {
        Layout::new(&self.entries)
    }

    /// Writes that change a node's PDO to this one; see [`remap`].
    #[must_use]
    pub fn writes(&self) -> Vec<ConfigWrite> {
        remap(self.record, self.cob_id, &self.entries, self.kind, self.inhibit, self.event_timer)
    }
}

/// The remapping procedure of CiA 301, 9.5.4, in the order in which a node wants it; the node must be
/// Pre-operational. `record`: 0x1400 and up for RPDOs, 0x1800 and up for TPDOs. `cob_id`: with bit 30 where remote
/// frames are not allowed, with bit 31 to leave the PDO off. `inhibit` in 100 µs and `event_timer` in ms are written
/// where given: a device may lack the object.
#[must_use]
pub fn remap(
    record: u16,
    cob_id: u32,
    entries: &[u32],
    kind: u8,
    inhibit: Option<u16>,
    event_timer: Option<u16>,
) -> Vec<ConfigWrite> {
    let map = record | 0x0200;
    // Off first, already with its new identifier: that may change only while the PDO is off.
    let mut writes = Vec::with_capacity(entries.len() + 7);
    writes.push(ConfigWrite::new(record, 1, cob_id | INVALID));
    writes.push(ConfigWrite::new(map, 0, 0_u8));
    writes.extend(entries.iter().zip(1..=MAX_ENTRIES as u8).map(|(entry, sub)| ConfigWrite::new(map, sub, *entry)));
    if !entries.is_empty() {
        writes.push(ConfigWrite::new(map, 0, entries.len().min(MAX_ENTRIES) as u8));
    }
    writes.push(ConfigWrite::new(record, 2, kind));
    writes.extend(inhibit.map(|inhibit| ConfigWrite::new(record, 3, inhibit)));
    writes.extend(event_timer.map(|timer| ConfigWrite::new(record, 5, timer)));
    if cob_id & INVALID == 0 {
        writes.push(ConfigWrite::new(record, 1, cob_id));
    }
    writes
}

/// Sequence of reads that gives a PDO of a node: read [`Reading::object`] and pass the data to [`Reading::found`] until
/// no object is left; then call [`Reading::finish`].
#[must_use]
pub fn read_plan(record: u16) -> Reading {
    let pdo = Pdo { record, cob_id: INVALID, kind: 0, inhibit: None, event_timer: None, entries: Vec::new() };
    Reading { pdo, step: Step::CobId }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    CobId,
    Kind,
    Inhibit,
    EventTimer,
    Count,
    Entry {
        sub: u8,
        count: u8,
    },
    Done,
    /// No such PDO, or an invalid one.
    Failed,
}

/// A PDO being read; see [`read_plan`].
#[derive(Clone, Debug)]
pub struct Reading {
    pdo: Pdo,
    step: Step,
}

impl Reading {
    /// The COB-ID with its bits 29 to 31 as it was read; [`INVALID`] before that. A caller that takes a PDO under one
    /// identifier alone need not read further.
    #[must_use]
    pub const fn cob_id(&self) -> u32 {
        self.pdo.cob_id
    }

    /// The object to read now; `None`: all is read, or it makes no sense.
    #[must_use]
    pub const fn object(&self) -> Option<(u16, u8)> {
        let record = self.pdo.record;
        Some(match self.step {
            Step::CobId => (record, 1),
            Step::Kind => (record, 2),
            Step::Inhibit => (record, 3),
            Step::EventTimer => (record, 5),
            Step::Count => (record | 0x0200, 0),
            Step::Entry { sub, .. } => (record | 0x0200, sub),
            Step::Done | Step::Failed => return None,
        })
    }

    /// Takes the data read; `None` if the node refused it.
    pub fn found(&mut self, data: Option<&[u8]>) {
        let word = data.and_then(|data| <[u8; 4]>::try_from(data).ok()).map(u32::from_le_bytes);
        let half = data.and_then(|data| <[u8; 2]>::try_from(data).ok()).map(u16::from_le_bytes);
        let byte = data.and_then(|data| <[u8; 1]>::try_from(data).ok()).map(|[byte]| byte);
        let is_tpdo = self.pdo.record >= 0x1800;
        self.step = match (self.step, word, half, byte) {
            (Step::CobId, Some(cob_id), ..) => {
                self.pdo.cob_id = cob_id;
                Step::Kind
            }
            (Step::Kind, _, _, Some(kind)) => {
                self.pdo.kind = kind;
                if is_tpdo { Step::Inhibit } else { Step::EventTimer }
            }
            (Step::Inhibit, _, inhibit, _) => {
                self.pdo.inhibit = inhibit;
                Step::EventTimer
            }
            (Step::EventTimer, _, timer, _) => {
                self.pdo.event_timer = timer;
                Step::Count
            }
            (Step::Count, _, _, Some(0)) => Step::Done,
            (Step::Count, _, _, Some(count)) if usize::from(count) <= MAX_ENTRIES => Step::Entry { sub: 1, count },
            (Step::Entry { sub, count }, Some(entry), ..) => {
                self.pdo.entries.push(entry);
                if sub < count { Step::Entry { sub: sub + 1, count } } else { Step::Done }
            }
            (Step::Done, ..) => Step::Done,
            _ => Step::Failed,
        };
    }

    /// The PDO, after all reads; `None` if there is no such PDO, or an invalid one.
    #[must_use]
    pub fn finish(self) -> Option<Pdo> {
        (self.step == Step::Done).then_some(self.pdo)
    }
}
