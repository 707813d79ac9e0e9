//! Layer setting services (CiA 305): a slave that may have no node id yet, and the master that finds slaves by their
//! 128-bit address and gives them node id and bit rate.
//!
//! Read [`wire`] first. [`Slave`] is part of a [`crate::Node`] made with [`crate::Node::with_lss`]; [`Master`] runs one
//! [`Command`] at a time. Both are sans-IO as all of this crate.
//!
//! Slaves in the configuration state all obey what is sent to "the" slave there: every command that chooses one
//! (select, find) first sends all to waiting.

mod command;
mod master;
mod scan;
mod slave;
#[cfg(test)]
mod tests;
pub mod wire;

pub use command::{Command, Event, Failure, Range, Refusal, StartError, Timing};
pub use master::Master;
pub use slave::{Slave, SlaveConfig, SlaveEvent};

use base::listed;
use core::fmt;

/// The node id on the wire of a slave that has none.
pub const UNCONFIGURED: u8 = 0xFF;

/// Address of a slave: its identity object 0x1018. The order is that of a fastscan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// Vendor id, 0x1018:1.
    pub vendor: u32,
    /// Product code, 0x1018:2.
    pub product: u32,
    /// Revision number, 0x1018:3.
    pub revision: u32,
    /// Serial number, 0x1018:4.
    pub serial: u32,
}

impl Address {
    /// From its four words, vendor first.
    #[must_use]
    pub const fn from_words([vendor, product, revision, serial]: [u32; 4]) -> Self {
        Self { vendor, product, revision, serial }
    }

    /// Four words, vendor first.
    #[must_use]
    pub const fn words(self) -> [u32; 4] {
        [self.vendor, self.product, self.revision, self.serial]
    }
}

impl fmt::Display for Address {
    /// Four words in hexadecimal, vendor first.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { vendor, product, revision, serial } = self;
        write!(f, "{vendor:08X}:{product:08X}:{revision:08X}:{serial:08X}")
    }
}

listed! {
    /// One word of an [`Address`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[allow(missing_docs)] // as in Address
    #[repr(u8)]
    pub enum Part {
        Vendor,
        Product,
        Revision,
        Serial,
    }
}

/// The state of a slave: only in the second one it is configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Mode {
    /// Accepts only selection commands.
    Waiting = 0,
    /// Obeys inquiries and settings.
    Configuration = 1,
}

listed! {
    /// A bit rate of CiA 301's table (table selector 0); as a number: its index there. Index 5, once 100 kbit/s, is
    /// reserved.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[allow(missing_docs)] // the number is in kbit/s
    #[repr(u8)]
    pub enum BitRate {
        Kbit1000 = 0,
        Kbit800 = 1,
        Kbit500 = 2,
        Kbit250 = 3,
        Kbit125 = 4,
        Kbit50 = 6,
        Kbit20 = 7,
        Kbit10 = 8,
        /// The slave detects the bit rate by itself.
        Auto = 9,
    }
}

impl BitRate {
    /// The one at an index of the table.
    #[must_use]
    pub fn from_index(index: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| *rate as u8 == index)
    }

    /// Bit rate of this number of kbit/s.
    #[must_use]
    pub fn from_kbits(kbits: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.kbits() == Some(kbits))
    }

    /// kbit/s; `None` for [`Self::Auto`].
    #[must_use]
    pub const fn kbits(self) -> Option<u16> {
        Some(match self {
            Self::Kbit1000 => 1000,
            Self::Kbit800 => 800,
            Self::Kbit500 => 500,
            Self::Kbit250 => 250,
            Self::Kbit125 => 125,
            Self::Kbit50 => 50,
            Self::Kbit20 => 20,
            Self::Kbit10 => 10,
            Self::Auto => return None,
        })
    }
}
