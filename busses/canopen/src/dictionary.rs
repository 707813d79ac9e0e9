//! The object dictionary of a node: what exists, who may do what to it, and the values.

use crate::{Abort, Payload};
use alloc::vec::Vec;
use core::ops::RangeInclusive;

/// The longest text or domain a dictionary takes, in bytes.
pub const MAX_BYTES: usize = 4096;

/// What an object holds (CiA 301, Table 44; 64-bit numbers and floats are not spoken).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the description
pub enum DataType {
    Bool,
    I8,
    I16,
    I32,
    U8,
    U16,
    U32,
    /// Visible string.
    Text,
    /// Anything, up to [`MAX_BYTES`].
    Domain,
}

impl DataType {
    /// Bytes on the wire; `None` when that varies.
    #[must_use]
    pub const fn width(self) -> Option<usize> {
        Some(match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 => 4,
            Self::Text | Self::Domain => return None,
        })
    }

    const fn range(self) -> (i64, i64) {
        match self {
            Self::Bool => (0, 1),
            Self::I8 => (i8::MIN as i64, i8::MAX as i64),
            Self::I16 => (i16::MIN as i64, i16::MAX as i64),
            Self::I32 => (i32::MIN as i64, i32::MAX as i64),
            Self::U8 => (0, u8::MAX as i64),
            Self::U16 => (0, u16::MAX as i64),
            Self::U32 => (0, u32::MAX as i64),
            Self::Text | Self::Domain => (0, 0),
        }
    }

    /// `value` as it reads back from an object of this type: cut to its width, then sign-extended.
    const fn wrap(self, value: i64) -> i64 {
        match self {
            Self::Bool => (value != 0) as i64,
            Self::I8 => value as i8 as i64,
            Self::I16 => value as i16 as i64,
            Self::I32 => value as i32 as i64,
            Self::U8 => value as u8 as i64,
            Self::U16 => value as u16 as i64,
            Self::U32 => value as u32 as i64,
            Self::Text | Self::Domain => 0,
        }
    }
}

/// Who may do what to an object by SDO and PDO. The application may do everything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the description
pub enum Access {
    Const,
    ReadOnly,
    WriteOnly,
    ReadWrite,
}

impl Access {
    const fn reads(self) -> bool {
        !matches!(self, Self::WriteOnly)
    }

    const fn writes(self) -> bool {
        matches!(self, Self::WriteOnly | Self::ReadWrite)
    }
}

/// One object of a static table, built by chained calls.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    index: u16,
    sub: u8,
    data_type: DataType,
    access: Access,
    mappable: bool,
    plus_node_id: bool,
    value: i64,
    text: &'static str,
    low: i64,
    high: i64,
}

impl Entry {
    /// An object with `value` as its default.
    #[must_use]
    pub const fn new(index: u16, sub: u8, data_type: DataType, access: Access, value: i64) -> Self {
        let (low, high) = data_type.range();
        let value = data_type.wrap(value);
        Self { index, sub, data_type, access, mappable: false, plus_node_id: false, value, text: "", low, high }
    }

    /// May be mapped into a PDO, in the directions its access allows.
    #[must_use]
    pub const fn mappable(self) -> Self {
        Self { mappable: true, ..self }
    }

    /// Writes outside `low..=high` are refused.
    #[must_use]
    pub const fn limits(self, low: i64, high: i64) -> Self {
        Self { low, high, ..self }
    }

    /// The default is `$NODEID` plus the given value.
    #[must_use]
    pub const fn plus_node_id(self) -> Self {
        Self { plus_node_id: true, ..self }
    }

    /// The default of a text.
    #[must_use]
    pub const fn text(self, text: &'static str) -> Self {
        Self { text, ..self }
    }

    /// Index and sub-index.
    #[must_use]
    pub const fn key(&self) -> (u16, u8) {
        (self.index, self.sub)
    }
}

struct Slot {
    entry: Entry,
    value: i64,
    bytes: Payload,
    /// What a reset brings back: the default, or what was stored.
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
            let slot = self.fresh(*entry);
            match self.slots.binary_search_by_key(&entry.key(), |slot| slot.entry.key()) {
                Ok(at) => self.slots[at] = slot,
                Err(at) => self.slots.insert(at, slot),
            }
        }
        self
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

    fn fresh(&self, entry: Entry) -> Slot {
        let id = if entry.plus_node_id { i64::from(self.node) } else { 0 };
        let value = entry.data_type.wrap(entry.value + id);
        let bytes = Payload::from(entry.text.as_bytes());
        Slot { entry, value, bytes: bytes.clone(), power_on: (value, bytes) }
    }

    pub(crate) fn find(&self, index: u16, sub: u8) -> Result<usize, Abort> {
        self.slots.binary_search_by_key(&(index, sub), |slot| slot.entry.key()).map_err(|at| {
            let same = |slot: &Slot| slot.entry.index == index;
            let near = self.slots.get(at).is_some_and(same) || at > 0 && same(&self.slots[at - 1]);
            if near { Abort::NO_SUB_INDEX } else { Abort::NO_OBJECT }
        })
    }

    /// The value of a number, whoever may read it; `None` when there is no such number.
    #[must_use]
    pub fn get(&self, index: u16, sub: u8) -> Option<i64> {
        let slot = &self.slots[self.find(index, sub).ok()?];
        slot.entry.data_type.width().map(|_| slot.value)
    }

    /// Sets a number, whoever may write it, cut to its width. Whether it is another value than before.
    pub fn set(&mut self, index: u16, sub: u8, value: i64) -> bool {
        let Ok(at) = self.find(index, sub) else {
            return false;
        };
        let slot = &mut self.slots[at];
        let value = slot.entry.data_type.wrap(value);
        core::mem::replace(&mut slot.value, value) != value
    }

    /// Sets a text or domain, whoever may write it; cut to [`MAX_BYTES`].
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

    /// Whether the object may be written with `size` bytes (`None`: not known yet). Gives its fixed length.
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
        match () {
            () if entry.data_type == DataType::Bool && data != [value as u8] => Err(Abort::TOO_HIGH),
            () if value > entry.high => Err(Abort::TOO_HIGH),
            () if value < entry.low => Err(Abort::TOO_LOW),
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
        for at in 0..self.slots.len() {
            self.slots[at].power_on = self.fresh(self.slots[at].entry).power_on;
        }
    }

    /// Where an object is that may be mapped with `len` bytes; `received`: into an RPDO.
    pub(crate) fn find_mappable(&self, index: u16, sub: u8, len: usize, received: bool) -> Result<usize, Abort> {
        let at = self.find(index, sub)?;
        let entry = &self.slots[at].entry;
        let direction = if received { entry.access.writes() } else { entry.access.reads() };
        if entry.mappable && direction && entry.data_type.width() == Some(len) {
            Ok(at)
        } else {
            Err(Abort::NOT_MAPPABLE)
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
        let fits = (slot.entry.low..=slot.entry.high).contains(&value);
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
mod tests {
    use super::*;
    use Access::{Const, ReadOnly, ReadWrite, WriteOnly};
    use DataType::{Bool, I8, I32, Text, U8, U16, U32};

    fn dictionary() -> Dictionary {
        Dictionary::new(5).with(&[
            Entry::new(0x6060, 0, I8, ReadWrite, 1),
            Entry::new(0x1008, 0, Text, Const, 0).text("EPOS"),
            Entry::new(0x1000, 0, U32, ReadOnly, 0x0002_0192),
            Entry::new(0x1018, 0, U8, ReadOnly, 4),
            Entry::new(0x1018, 1, U32, ReadOnly, 0xFB),
            Entry::new(0x2F01, 0, U16, WriteOnly, 0),
            Entry::new(0x2F02, 0, Bool, ReadWrite, 0),
            Entry::new(0x607F, 0, U32, ReadWrite, 25000).limits(1, 25000),
            Entry::new(0x60FF, 0, I32, ReadWrite, 0).mappable(),
            Entry::new(0x1014, 0, U32, ReadOnly, 0x80).plus_node_id(),
        ])
    }

    #[test]
    fn each_refusal_has_its_abort_code() {
        let mut objects = dictionary();
        for (index, sub, data, expected) in [
            (0x5000, 0, &[1][..], Abort::NO_OBJECT),
            (0x1018, 9, &[1], Abort::NO_SUB_INDEX),
            (0x1000, 0, &[1, 0, 0, 0], Abort::READ_ONLY),
            (0x1008, 0, b"x", Abort::READ_ONLY),
            (0x6060, 0, &[1, 0], Abort::TOO_LONG),
            (0x60FF, 0, &[1, 0], Abort::TOO_SHORT),
            (0x607F, 0, &[0xA9, 0x61, 0, 0], Abort::TOO_HIGH),
            (0x607F, 0, &[0, 0, 0, 0], Abort::TOO_LOW),
            (0x2F02, 0, &[2], Abort::TOO_HIGH),
        ] {
            assert_eq!(objects.write(index, sub, data), Err(expected), "{index:04X}:{sub}");
        }
        assert_eq!(objects.read(0x2F01, 0), Err(Abort::WRITE_ONLY));
        assert_eq!(objects.read(0x1018, 2), Err(Abort::NO_SUB_INDEX));
    }

    #[test]
    fn numbers_keep_their_sign_and_texts_their_bytes() {
        let mut objects = dictionary();
        objects.write(0x60FF, 0, &[0x24, 0xFA, 0xFF, 0xFF]).unwrap();
        assert_eq!(objects.get(0x60FF, 0), Some(-1500));
        assert_eq!(&*objects.read(0x60FF, 0).unwrap(), &[0x24, 0xFA, 0xFF, 0xFF]);
        objects.write(0x6060, 0, &[0xFF]).unwrap();
        assert_eq!(objects.get(0x6060, 0), Some(-1));
        assert_eq!(&*objects.read(0x1008, 0).unwrap(), b"EPOS");
        assert_eq!(objects.get(0x1014, 0), Some(0x85));
        assert!(!objects.set(0x6060, 0, 0xFF) && objects.set(0x6060, 0, 3));
    }

    #[test]
    fn stored_values_survive_a_reset_and_defaults_come_back() {
        let mut objects = dictionary();
        objects.set(0x607F, 0, 100);
        objects.store();
        objects.set(0x607F, 0, 200);
        objects.reset(0x2000..=0x9FFF);
        assert_eq!(objects.get(0x607F, 0), Some(100));
        objects.restore();
        assert_eq!(objects.get(0x607F, 0), Some(100));
        objects.reset(0x2000..=0x9FFF);
        assert_eq!(objects.get(0x607F, 0), Some(25000));
    }
}
