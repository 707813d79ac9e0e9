//! PDOs from the master's side: mapping records, values in and out of a frame by name, reading a mapping from a node
//! and changing it (CiA 301, 9.5.4). The engine of a node is in [`crate::Node`].

mod layout;
mod remap;
#[cfg(test)]
mod tests;

pub use layout::{Data, Item, Key, Layout, LayoutError, PackError};
pub use remap::{Pdo, Reading, read_plan, remap};

/// Maximum number of entries in a mapping record; 0xFE and 0xFF mark a multiplexed PDO.
pub const MAX_ENTRIES: usize = 64;

/// Bit 31 of a COB-ID: the PDO does not exist.
pub const INVALID: u32 = 1 << 31;

/// One entry of a mapping record (CiA 301, 0x1600): the object, and its number of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Mapped {
    /// The object's index; below 0x20 a dummy: that many bits of nothing.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// Length in bits, 1..=64.
    pub bits: u8,
}

impl Mapped {
    /// From the form of 0x1600.
    #[must_use]
    pub const fn new(entry: u32) -> Self {
        Self { index: (entry >> 16) as u16, sub: (entry >> 8) as u8, bits: entry as u8 }
    }

    /// In the form of 0x1600.
    #[must_use]
    pub const fn entry(self) -> u32 {
        (self.index as u32) << 16 | (self.sub as u32) << 8 | self.bits as u32
    }

    /// True if it only fills a gap: its index is the code of a data type.
    #[must_use]
    pub const fn is_dummy(self) -> bool {
        self.index < 0x20
    }
}

impl From<u32> for Mapped {
    fn from(entry: u32) -> Self {
        Self::new(entry)
    }
}

impl From<Mapped> for u32 {
    fn from(mapped: Mapped) -> Self {
        mapped.entry()
    }
}
