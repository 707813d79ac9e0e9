//! Where each object lies in a PDO.

use super::{MAX_ENTRIES, Mapped};
use crate::dictionary::DataType;
use crate::eds::{Eds, same_name};
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::fmt;

/// The data of one PDO.
pub type Data = heapless::Vec<u8, 8>;

/// Why a mapping makes no PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayoutError {
    /// More than [`MAX_ENTRIES`].
    TooManyEntries {
        /// Number of them.
        count: usize,
    },
    /// More than 64 bits (abort code 0x06040042).
    TooLong {
        /// Number of them.
        bits: usize,
    },
    /// An entry of no bits.
    NoBits {
        /// Sub-index in the mapping record.
        sub: usize,
    },
}

impl fmt::Display for LayoutError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooManyEntries { count } => write!(f, "{count} entries in a mapping of at most {MAX_ENTRIES}"),
            Self::TooLong { bits } => write!(f, "{bits} bits in a PDO of at most 64"),
            Self::NoBits { sub } => write!(f, "entry {sub} of the mapping has no bits"),
        }
    }
}

impl core::error::Error for LayoutError {}

/// Why a value was not put into a PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PackError {
    /// The PDO has no such object.
    Unknown,
    /// The value does not fit: nothing is cut off, since it may move a drive.
    OutOfRange {
        /// The value.
        value: i64,
        /// The bits it has.
        bits: u8,
    },
}

impl fmt::Display for PackError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("no such object in the PDO"),
            Self::OutOfRange { value, bits } => write!(f, "{value} does not fit into {bits} bits"),
        }
    }
}

impl core::error::Error for PackError {}

/// Which object of a PDO is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key<'a> {
    /// The n-th item, from 0.
    At(usize),
    /// Index and sub-index.
    Object(u16, u8),
    /// The name; case, spaces, dashes and underscores do not count.
    Name(&'a str),
}

impl From<usize> for Key<'_> {
    fn from(at: usize) -> Self {
        Self::At(at)
    }
}

impl From<(u16, u8)> for Key<'_> {
    fn from((index, sub): (u16, u8)) -> Self {
        Self::Object(index, sub)
    }
}

impl<'a> From<&'a str> for Key<'a> {
    fn from(name: &'a str) -> Self {
        Self::Name(name)
    }
}

/// One object of a PDO.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// Which object, how many bits.
    pub mapped: Mapped,
    /// Bits before it. The first bit of a frame is bit 0 of byte 0.
    pub offset: u8,
    /// Name; may be empty.
    pub name: String,
    /// Type; `None`: not known, then it counts as unsigned.
    pub data_type: Option<DataType>,
}

impl Item {
    const fn mask(&self) -> u64 {
        u64::MAX >> (64 - self.mapped.bits)
    }

    fn is_signed(&self) -> bool {
        self.data_type.is_some_and(DataType::is_signed)
    }

    /// The value in a frame; 0 is read beyond its end.
    fn get(&self, frame: u64) -> i64 {
        let (value, unused) = (frame >> self.offset & self.mask(), 64 - self.mapped.bits);
        if self.is_signed() { (value << unused) as i64 >> unused } else { value as i64 }
    }

    fn set(&self, frame: u64, value: i64) -> Result<u64, PackError> {
        let bits = self.mapped.bits;
        // A type that is not known takes both.
        let signed = (i64::MIN >> (64 - bits)..=i64::MAX >> (64 - bits)).contains(&value);
        let unsigned = value as u64 <= self.mask();
        let fits = match self.data_type {
            Some(_) if self.is_signed() => signed,
            Some(_) => unsigned,
            None => signed || unsigned,
        };
        if !fits {
            return Err(PackError::OutOfRange { value, bits });
        }
        Ok(frame & !(self.mask() << self.offset) | (value as u64 & self.mask()) << self.offset)
    }

    /// A value as text, after its type: `1.5` for a REAL.
    #[must_use]
    pub fn show(&self, value: i64) -> String {
        let data_type = self.data_type.filter(|data_type| data_type.bits() == Some(self.mapped.bits));
        match data_type.and_then(DataType::width).zip(data_type) {
            Some((width, data_type)) => data_type.show(&value.to_le_bytes()[..width]),
            None if self.is_signed() => DataType::I64.show(&value.to_le_bytes()),
            None => DataType::U64.show(&value.to_le_bytes()),
        }
    }
}

/// Content of a PDO, in order.
///
/// Values are `i64`: sign-extended where the type is an INTEGER, the bit pattern of a REAL.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    items: Vec<Item>,
    bits: usize,
}

impl Layout {
    /// From a mapping record's entries, in the form of 0x1600; without names and types.
    ///
    /// # Errors
    /// More than a PDO holds.
    pub fn new(entries: &[u32]) -> Result<Self, LayoutError> {
        if entries.len() > MAX_ENTRIES {
            return Err(LayoutError::TooManyEntries { count: entries.len() });
        }
        let mapped = || entries.iter().map(|entry| Mapped::new(*entry));
        if let Some(at) = mapped().position(|mapped| mapped.bits == 0) {
            return Err(LayoutError::NoBits { sub: at + 1 });
        }
        let bits = mapped().map(|mapped| usize::from(mapped.bits)).sum();
        if bits > 64 {
            return Err(LayoutError::TooLong { bits });
        }
        let mut next = 0;
        let item = |mapped: Mapped| {
            let offset = next;
            next += mapped.bits;
            Item { mapped, offset, name: String::new(), data_type: None }
        };
        Ok(Self { items: mapped().map(item).collect(), bits })
    }

    /// With the name and type of one object given by hand; nothing happens when the PDO does not have it.
    #[must_use]
    pub fn with_name(mut self, key: (u16, u8), name: &str, data_type: DataType) -> Self {
        if let Some(item) = self.items.iter_mut().find(|item| (item.mapped.index, item.mapped.sub) == key) {
            item.name = String::from(name);
            item.data_type = Some(data_type);
        }
        self
    }

    /// With names and types from a data sheet, where it has the object.
    #[must_use]
    pub fn with_names(mut self, eds: &Eds) -> Self {
        for item in &mut self.items {
            let Mapped { index, sub, .. } = item.mapped;
            if let Some((name, object)) = eds.name(index, sub).zip(eds.object(index, sub)) {
                item.name = name.to_string();
                item.data_type = Some(object.data_type);
            }
        }
        self
    }

    /// Objects, dummies among them.
    #[must_use]
    pub fn items(&self) -> &[Item] {
        &self.items
    }

    /// Bits that are used.
    #[must_use]
    pub fn bits(&self) -> usize {
        self.bits
    }

    /// Bytes of a frame.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // not a container
    pub fn len(&self) -> usize {
        self.bits.div_ceil(8)
    }

    /// The item that is meant, the first one if there are several.
    #[must_use]
    pub fn item<'a>(&self, key: impl Into<Key<'a>>) -> Option<&Item> {
        match key.into() {
            Key::At(at) => self.items.get(at),
            Key::Object(index, sub) => {
                self.items.iter().find(|item| (item.mapped.index, item.mapped.sub) == (index, sub))
            }
            Key::Name(name) => self.items.iter().find(|item| !item.name.is_empty() && same_name(&item.name, name)),
        }
    }

    /// A value out of a frame's data; `None` when the PDO has no such object or `data` is too short.
    #[must_use]
    pub fn get<'a>(&self, data: &[u8], key: impl Into<Key<'a>>) -> Option<i64> {
        let frame = self.frame(data)?;
        self.item(key).map(|item| item.get(frame))
    }

    /// Changes a value in a frame's data, of which the rest stays.
    ///
    /// # Errors
    /// No such object, or the value does not fit; nothing was changed.
    pub fn set<'a>(&self, data: &mut Data, key: impl Into<Key<'a>>, value: i64) -> Result<(), PackError> {
        let mut bytes = [0; 8];
        bytes[..data.len()].copy_from_slice(data);
        let item = self.item(key).ok_or(PackError::Unknown)?;
        let frame = item.set(u64::from_le_bytes(bytes), value)?;
        *data = self.data(frame);
        Ok(())
    }

    /// A frame's data from values; what is not given is 0. Does not allocate.
    ///
    /// # Errors
    /// No such object, or a value does not fit.
    pub fn pack<'a, K: Into<Key<'a>>>(&self, values: impl IntoIterator<Item = (K, i64)>) -> Result<Data, PackError> {
        let set = |frame, (key, value)| self.item(key).ok_or(PackError::Unknown)?.set(frame, value);
        values.into_iter().try_fold(0, set).map(|frame| self.data(frame))
    }

    /// All values of a frame in order, without dummies; `None` if the frame is shorter than the mapping (it is ignored
    /// then: CiA 301, 8210). Of a longer one the first bytes count.
    #[must_use]
    pub fn unpack(&self, data: &[u8]) -> Option<impl Iterator<Item = (&Item, i64)>> {
        let frame = self.frame(data)?;
        let items = self.items.iter().filter(|item| !item.mapped.is_dummy());
        Some(items.map(move |item| (item, item.get(frame))))
    }

    fn frame(&self, data: &[u8]) -> Option<u64> {
        let mut bytes = [0; 8];
        bytes[..self.len()].copy_from_slice(data.get(..self.len())?);
        Some(u64::from_le_bytes(bytes))
    }

    fn data(&self, frame: u64) -> Data {
        frame.to_le_bytes().into_iter().take(self.len()).collect()
    }
}
