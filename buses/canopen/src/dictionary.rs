//! The object dictionary of a node: what exists, who may do what to it, and the values.

mod data_type;
mod entry;
mod time;

use crate::{Abort, Payload};
use alloc::vec::Vec;
use core::ops::RangeInclusive;

pub(crate) use data_type::integer;
pub use data_type::{DataType, ParseError};
pub use entry::{Access, Entry};

/// The longest text or domain a dictionary takes, in bytes; a transfer may carry more.
pub const MAX_BYTES: usize = 1 << 18;

struct Slot {
    entry: Entry,
    /// A number, or the bit pattern of a REAL or a time.
    value: i64,
    /// Value of a text, a domain or an octet string.
    bytes: Payload,
    default: (i64, Payload),
    /// Value after a reset: the default, or the stored one.
    power_on: (i64, Payload),
}

/// The objects of one node, sorted, with their values.
pub struct Dictionary {
    node: u8,
    slots: Vec<Slot>,
}

impl Dictionary {
    /// Without objects, of the node with this id (1..=127, kept in that range).
    #[must_use]
    pub fn new(node: u8) -> Self {
        Self { node: node.clamp(1, 127), slots: Vec::new() }
    }

    /// The node id.
    #[must_use]
    pub fn node(&self) -> u8 {
        self.node
    }

    /// With these objects added; one that exists already is replaced.
    #[must_use]
    pub fn with(mut self, entries: &[Entry]) -> Self {
        for entry in entries {
            self.add(*entry, Payload::from(entry.text.as_bytes()));
        }
        self
    }

    /// Adds or replaces an object; `bytes`: the default of what is no number.
    pub(crate) fn add(&mut self, entry: Entry, bytes: Payload) {
        let id = if entry.plus_node_id { i64::from(self.node) } else { 0 };
        let default = (entry.data_type.wrap(entry.value.wrapping_add(id)), bytes);
        let (value, bytes) = default.clone();
        let slot = Slot { entry, value, bytes, power_on: default.clone(), default };
        match self.slots.binary_search_by_key(&entry.key(), |slot| slot.entry.key()) {
            Ok(at) => self.slots[at] = slot,
            Err(at) => self.slots.insert(at, slot),
        }
    }

    /// With the records of RPDO `number` (1..=512): COB-ID with the node's id added, type 255, mapping in the form
    /// of 0x1600. `event_timer` says whether sub-index 5 exists.
    #[must_use]
    pub fn with_rpdo(self, number: u16, cob_id: u32, mapping: &[u32], event_timer: bool) -> Self {
        let index = 0x1400 + number.clamp(1, 512) - 1;
        let high = if event_timer { 5 } else { 2 };
        self.with_pdo(index, high, cob_id, mapping)
    }

    /// With the records of TPDO `number`; see [`Self::with_rpdo`].
    #[must_use]
    pub fn with_tpdo(self, number: u16, cob_id: u32, mapping: &[u32], event_timer: bool) -> Self {
        let index = 0x1800 + number.clamp(1, 512) - 1;
        let high = if event_timer { 5 } else { 3 };
        self.with_pdo(index, high, cob_id, mapping).with(&[Entry::new(index, 3, DataType::U16, Access::ReadWrite, 0)])
    }

    fn with_pdo(self, index: u16, high: u8, cob_id: u32, mapping: &[u32]) -> Self {
        use Access::{ReadOnly, ReadWrite};
        use DataType::{U8, U16, U32};
        let map = index + 0x200;
        let mut all = self.with(&[
            Entry::new(index, 0, U8, ReadOnly, i64::from(high)),
            Entry::new(index, 1, U32, ReadWrite, i64::from(cob_id)).plus_node_id(),
            Entry::new(index, 2, U8, ReadWrite, 255),
            Entry::new(map, 0, U8, ReadWrite, mapping.len().min(8) as i64),
        ]);
        if high >= 5 {
            all = all.with(&[Entry::new(index, 5, U16, ReadWrite, 0)]);
        }
        for sub in 1..=8 {
            let mapped = mapping.get(usize::from(sub) - 1).copied().unwrap_or(0);
            all = all.with(&[Entry::new(map, sub, U32, ReadWrite, i64::from(mapped))]);
        }
        all
    }

    /// Everything about every object but its present value, to be compared.
    #[cfg(test)]
    pub(crate) fn described(&self) -> Vec<alloc::string::String> {
        let slots = self.slots.iter();
        let describe = |slot: &Slot| {
            let Entry { index, sub, data_type, access, mappable, low, high, .. } = slot.entry;
            let default = &slot.default;
            alloc::format!("{index:04X}:{sub} {data_type:?} {access:?} {mappable} {low}..={high} {default:?}")
        };
        slots.map(describe).collect()
    }

    pub(crate) fn find(&self, index: u16, sub: u8) -> Result<usize, Abort> {
        self.slots.binary_search_by_key(&(index, sub), |slot| slot.entry.key()).map_err(|at| {
            let same = |slot: &Slot| slot.entry.index == index;
            let near = self.slots.get(at).is_some_and(same) || at > 0 && same(&self.slots[at - 1]);
            if near { Abort::NO_SUB_INDEX } else { Abort::NO_OBJECT }
        })
    }

    /// Value of a numeric object, regardless of access rights; `None` if the dictionary has no such object. A REAL
    /// or a time gives its bit pattern, and so does an UNSIGNED64 beyond `i64::MAX`.
    #[must_use]
    pub fn get(&self, index: u16, sub: u8) -> Option<i64> {
        let slot = &self.slots[self.find(index, sub).ok()?];
        slot.entry.data_type.width().map(|_| slot.value)
    }

    /// Sets a numeric object, regardless of access rights, cut to its width. Returns true if the value has changed.
    pub fn set(&mut self, index: u16, sub: u8, value: i64) -> bool {
        self.find(index, sub).is_ok_and(|at| self.set_at(at, value))
    }

    /// The same at a place that [`Self::find`] gave.
    pub(crate) fn set_at(&mut self, at: usize, value: i64) -> bool {
        let slot = &mut self.slots[at];
        let value = slot.entry.data_type.wrap(value);
        core::mem::replace(&mut slot.value, value) != value
    }

    /// Sets a text or domain, regardless of access rights; cut to [`MAX_BYTES`].
    pub fn set_bytes(&mut self, index: u16, sub: u8, bytes: &[u8]) {
        if let Ok(at) = self.find(index, sub) {
            self.slots[at].bytes = Payload::from(&bytes[..bytes.len().min(MAX_BYTES)]);
        }
    }

    /// What an SDO upload answers.
    ///
    /// # Errors
    /// The abort code.
    pub fn read(&self, index: u16, sub: u8) -> Result<Payload, Abort> {
        let at = self.find(index, sub)?;
        let slot = &self.slots[at];
        if !slot.entry.access.reads() {
            return Err(Abort::WRITE_ONLY);
        }
        Ok(match slot.entry.data_type.width() {
            Some(len) => Payload::from(&slot.value.to_le_bytes()[..len]),
            None => slot.bytes.clone(),
        })
    }

    /// True if the object may be written with `size` bytes (`None`: not known yet). Gives its fixed length.
    ///
    /// # Errors
    /// The abort code.
    pub fn check_write(&self, index: u16, sub: u8, size: Option<usize>) -> Result<Option<usize>, Abort> {
        let entry = &self.slots[self.find(index, sub)?].entry;
        if !entry.access.writes() {
            return Err(Abort::READ_ONLY);
        }
        let fixed = entry.data_type.width();
        let (low, high) = (fixed.unwrap_or(0), fixed.unwrap_or(MAX_BYTES));
        match size {
            Some(size) if size > high => Err(Abort::TOO_LONG),
            Some(size) if size < low => Err(Abort::TOO_SHORT),
            _ => Ok(fixed),
        }
    }

    /// The number that `data` is for this object, within its limits; 0 for texts and domains.
    ///
    /// # Errors
    /// The abort code.
    pub fn parse(&self, index: u16, sub: u8, data: &[u8]) -> Result<i64, Abort> {
        if self.check_write(index, sub, Some(data.len()))?.is_none() {
            return Ok(0);
        }
        let entry = &self.slots[self.find(index, sub)?].entry;
        let value = entry.data_type.wrap(number(data));
        let at_most = |a, b| entry.data_type.at_most(a, b);
        match () {
            () if entry.data_type == DataType::Bool && data != [value as u8] => Err(Abort::TOO_HIGH),
            () if !at_most(value, value) => Err(Abort::RANGE), // not a number
            () if !at_most(value, entry.high) => Err(Abort::TOO_HIGH),
            () if !at_most(entry.low, value) => Err(Abort::TOO_LOW),
            () => Ok(value),
        }
    }

    /// What an SDO download does.
    ///
    /// # Errors
    /// The abort code; nothing was written.
    pub fn write(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), Abort> {
        let value = self.parse(index, sub, data)?;
        let at = self.find(index, sub)?;
        let slot = &mut self.slots[at];
        match slot.entry.data_type.width() {
            Some(_) => slot.value = value,
            None => slot.bytes = Payload::from(data),
        }
        Ok(())
    }

    /// Everything within `indices` back to its power-on value.
    pub fn reset(&mut self, indices: RangeInclusive<u16>) {
        for slot in self.slots.iter_mut().filter(|slot| indices.contains(&slot.entry.index)) {
            slot.value = slot.power_on.0;
            slot.bytes = slot.power_on.1.clone();
        }
    }

    /// The present values of all writable objects become their power-on values (0x1010).
    pub fn store(&mut self) {
        for slot in self.slots.iter_mut().filter(|slot| slot.entry.access.writes()) {
            slot.power_on = (slot.value, slot.bytes.clone());
        }
    }

    /// The defaults become the power-on values (0x1011); present values stay until the next reset.
    pub fn restore(&mut self) {
        for slot in &mut self.slots {
            slot.power_on = slot.default.clone();
        }
    }

    /// Place of an object that may be mapped with this number of bits; `received`: into an RPDO. A BOOLEAN takes one
    /// bit, or a byte as in many devices.
    pub(crate) fn find_mappable(&self, index: u16, sub: u8, bits: u8, received: bool) -> Result<usize, Abort> {
        let at = self.find(index, sub)?;
        let entry = &self.slots[at].entry;
        let whole = entry.data_type.width().map(|width| width * 8) == Some(usize::from(bits));
        let fits = whole || entry.data_type == DataType::Bool && bits == 1;
        if entry.mappable && entry.access.maps(received) && fits { Ok(at) } else { Err(Abort::NOT_MAPPABLE) }
    }

    /// True if it is process data: an object that may be mapped.
    pub(crate) fn is_mappable(&self, index: u16, sub: u8) -> bool {
        self.find(index, sub).is_ok_and(|at| self.slots[at].entry.mappable)
    }

    /// The node has another id (1..=127, kept in that range): defaults that contain it follow, and so do values and
    /// power-on values that are still the default.
    pub(crate) fn renumber(&mut self, node: u8) {
        self.node = node.clamp(1, 127);
        for slot in self.slots.iter_mut().filter(|slot| slot.entry.plus_node_id) {
            let entry = &slot.entry;
            let fresh = entry.data_type.wrap(entry.value.wrapping_add(i64::from(self.node)));
            let old = core::mem::replace(&mut slot.default.0, fresh);
            for value in [&mut slot.value, &mut slot.power_on.0] {
                if *value == old {
                    *value = fresh;
                }
            }
        }
    }

    pub(crate) fn key_at(&self, at: usize) -> (u16, u8) {
        self.slots[at].entry.key()
    }

    pub(crate) fn value_at(&self, at: usize) -> i64 {
        self.slots[at].value
    }

    /// Stores a mapped number; false when it is out of its limits and the old one stays.
    pub(crate) fn store_at(&mut self, at: usize, data: &[u8]) -> bool {
        let slot = &mut self.slots[at];
        let value = slot.entry.data_type.wrap(number(data));
        let data_type = slot.entry.data_type;
        let fits = data_type.at_most(slot.entry.low, value) && data_type.at_most(value, slot.entry.high);
        if fits {
            slot.value = value;
        }
        fits
    }

    /// All indices within a range that have an object, sub-index 0.
    pub(crate) fn indices(&self, within: RangeInclusive<u16>) -> impl Iterator<Item = u16> + '_ {
        let keys = self.slots.iter().map(|slot| slot.entry.key());
        keys.filter(move |(index, sub)| *sub == 0 && within.contains(index)).map(|(index, _)| index)
    }
}

/// Up to eight little-endian bytes, without sign extension.
fn number(data: &[u8]) -> i64 {
    data.iter().take(8).rev().fold(0, |sum, byte| sum << 8 | i64::from(*byte))
}

#[cfg(test)]
mod tests;
