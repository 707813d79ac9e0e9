//! One transfer on an I2C bus or SMBus, and what came of it: the words between drivers, hosts and the simulator.
//!
//! Which bus, who drives its two lines and how fast is the host's affair; SMBus commands, PEC and chips belong to crate
//! `i2c`. Clauses: UM10204 rev. 6 (I2C), SMBus 3.2.

pub mod codec;

use core::fmt;

/// The most bytes of one direction of a transfer: command, length, 32 bytes of a block, PEC, and one to spare.
pub const MAX: usize = 36;

/// Bytes of one direction, at most [`MAX`].
pub type Bytes = heapless::Vec<u8, MAX>;

/// A 7-bit address; its place on the wire is the upper seven bits of the first byte.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address(u8);

impl Address {
    /// The address `seven`, 0x00..=0x7F; `None` beyond, which is most often the 8-bit form of a data sheet.
    #[must_use]
    pub const fn new(seven: u8) -> Option<Self> {
        if seven < 0x80 { Some(Self(seven)) } else { None }
    }

    /// The seven bits, 0x00..=0x7F.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }

    /// True if UM10204 table 3 keeps it for other things than a chip: 0x00..=0x07 and 0x78..=0x7F.
    #[must_use]
    pub const fn reserved(self) -> bool {
        self.0 < 0x08 || self.0 > 0x77
    }
}

impl fmt::Debug for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#04x}", self.0)
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

/// Read part of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Read {
    /// No read: the transfer is a write.
    None,
    /// Number of bytes, at most [`MAX`].
    Exactly(u8),
    /// SMBus block: the first byte gives the number that follows, 1..=32, then `extra` more (1: a PEC). Another length
    /// ends the transfer after that byte, which is then all that is read; Linux: `I2C_M_RECV_LEN`.
    Block {
        /// Bytes behind the block, at most 3.
        extra: u8,
    },
}

/// START, the bytes written, then, if anything is to be read, a repeated START and the bytes read, STOP.
///
/// With nothing to write, [`Read::None`] is SMBus quick command with the write bit, `Read::Exactly(0)` with the read
/// bit, and any other read begins with the START.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Transfer {
    /// The chip.
    pub address: Address,
    /// Bytes to write.
    pub write: Bytes,
    /// Read after the write.
    pub read: Read,
}

impl Transfer {
    /// True if anything is read, by a part of the transfer with the read bit.
    #[must_use]
    pub fn reads(&self) -> bool {
        self.read != Read::None
    }

    /// True if the first address byte has the read bit: nothing is written before.
    #[must_use]
    pub fn begins_with_read(&self) -> bool {
        self.reads() && self.write.is_empty()
    }
}

/// Bytes read, empty after a write; or the error.
pub type Outcome = Result<Bytes, Error>;

/// Why a transfer failed. In each case but [`Error::Arbitration`] the master has ended it with a STOP if it could.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Error {
    /// Address not acknowledged.
    NoAddress,
    /// A byte written was not acknowledged.
    NoData {
        /// Which, from 0.
        at: u8,
    },
    /// Another master won the bus; the lines are its own.
    Arbitration,
    /// SCL was held low for longer than the time limit.
    Stretched,
    /// SDA is held low, even after nine clocks; or SCL is.
    Stuck,
    /// Other error of the adapter.
    Other,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoAddress => f.write_str("nobody answers at this address"),
            Self::NoData { at } => write!(f, "the chip refused byte {at} of what was written"),
            Self::Arbitration => f.write_str("another master took the bus"),
            Self::Stretched => f.write_str("a chip held the clock low for too long"),
            Self::Stuck => f.write_str("a line of the bus is held low, and nine clocks did not free it"),
            Self::Other => f.write_str("the adapter failed"),
        }
    }
}

impl core::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    #[test]
    fn an_address_has_seven_bits_and_some_are_kept() {
        assert_eq!(Address::new(0x80), None);
        let reserved = |seven| Address::new(seven).unwrap().reserved();
        assert_eq!([0x00, 0x07, 0x08, 0x77, 0x78, 0x7F].map(reserved), [true, true, false, false, true, true]);
        assert_eq!(Address::new(0x18).unwrap().to_string(), "0x18");
    }

    #[test]
    fn only_a_transfer_that_writes_nothing_begins_with_the_read_bit() {
        let transfer = |write: &[u8], read| Transfer {
            address: Address::new(0x18).unwrap(),
            write: Bytes::from_slice(write).unwrap(),
            read,
        };
        assert!(!transfer(&[], Read::None).begins_with_read(), "quick write");
        assert!(transfer(&[], Read::Exactly(0)).begins_with_read(), "quick read");
        assert!(!transfer(&[0], Read::Exactly(1)).begins_with_read(), "read byte");
    }
}
