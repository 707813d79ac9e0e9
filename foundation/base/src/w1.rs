//! 1-Wire: which devices are on a bus, what its thermometers measure, and how its switches are; the types between
//! drivers, hosts and the simulator.
//!
//! Who drives the line is the host's affair: on Linux the kernel's `w1_therm` and `w1_ds2413`, whose files a live host
//! reads. A 64-bit ROM code is family, 48 bits of serial number and a check (Maxim application note 27); the kernel
//! calls a device by the first two: `28-0316a2795bff`.

use crate::listed;
use core::fmt;

/// The most devices of a bus that are listed.
pub const MAX: usize = 16;

/// The ROM code of a device, which no other device in the world has.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Rom(u64);

impl Rom {
    /// The code of a family (0x28: DS18B20) and a serial number below 2^48; `None` beyond.
    #[must_use]
    pub const fn new(family: u8, serial: u64) -> Option<Self> {
        if serial < 1 << 48 { Some(Self((family as u64) << 48 | serial)) } else { None }
    }

    /// Reads what the kernel calls a device: two hexadecimal digits, `-`, twelve more, in small letters.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let (family, serial) = text.split_once('-')?;
        let digits = |text: &str, count| {
            let all = text.len() == count && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
            if all { u64::from_str_radix(text, 16).ok() } else { None }
        };
        Self::new(digits(family, 2)? as u8, digits(serial, 12)?)
    }

    /// What kind of device it is.
    #[must_use]
    pub const fn family(self) -> u8 {
        (self.0 >> 48) as u8
    }

    /// True if it is a thermometer that `w1_therm` knows: DS18S20, DS1822, DS18B20, DS1825, DS28EA00.
    #[must_use]
    pub const fn is_thermometer(self) -> bool {
        matches!(self.family(), 0x10 | 0x22 | 0x28 | 0x3B | 0x42)
    }

    /// True if it is a switch that `w1_ds2413` knows: DS2413, two channels.
    #[must_use]
    pub const fn is_switch(self) -> bool {
        self.family() == 0x3A
    }

    /// Number within the family.
    #[must_use]
    pub const fn serial(self) -> u64 {
        self.0 & ((1 << 48) - 1)
    }
}

impl fmt::Display for Rom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02x}-{:012x}", self.family(), self.serial())
    }
}

impl fmt::Debug for Rom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// What a driver asks of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Request {
    /// Which thermometers are there.
    List,
    /// What a thermometer measures; it takes most of a second.
    Temperature(Rom),
    /// How a switch is.
    Read(Rom),
    /// Latches of a switch, bit 0 of channel A, bit 1 of B: 0 conducts, 1 does not. Then it is read.
    Write(Rom, u8),
}

/// Thermometers, in order of their codes.
pub type List = heapless::Vec<Rom, MAX>;

/// What comes of a [`Request`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// These are there; further ones are left out.
    List(List),
    /// A thermometer measured so many thousandths of a degree Celsius, or why not.
    Temperature(Rom, Result<i32, Error>),
    /// How a switch is, as [`switch_state`] returns it, or why that is not known. From the simulator: the levels at its
    /// pins while its latches do not conduct, bit 0 of A, bit 1 of B.
    Switch(Rom, Result<u8, Error>),
}

/// State of a DS2413 as it answers PIO ACCESS READ, its lower half: bit 0: level at the pin of channel A, bit 1: its
/// latch; bits 2 and 3: those of B. `pins`: levels from outside; `latches`: as in [`Request::Write`]. A latch that
/// conducts pulls its pin low.
#[must_use]
pub const fn switch_state(pins: u8, latches: u8) -> u8 {
    let (levels, latches) = (pins & latches & 3, latches & 3);
    levels & 1 | (latches & 1) << 1 | (levels & 2) << 1 | (latches & 2) << 2
}

listed! {
    /// Why a thermometer does not tell its temperature.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum Error {
        /// It is not on the bus, or has just left it.
        Absent => "it is not connected",
        /// What it sent had a wrong check.
        Crc => "what it sends is damaged",
        /// What was read is no temperature that it can measure, -55 to 125 °C.
        Nonsense => "what it says is no temperature",
        /// The machine refused to read it.
        Other => "it cannot be read",
    }
}

impl core::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    #[test]
    fn a_latch_that_conducts_pulls_its_pin_low() {
        // Data sheet DS2413, table "PIO Status Bit Assignment".
        assert_eq!((switch_state(3, 3), switch_state(0, 3)), (0b1111, 0b1010));
        assert_eq!((switch_state(3, 2), switch_state(3, 1), switch_state(3, 0xFC)), (0b1100, 0b0011, 0));
        assert!(Rom::parse("3a-000000000001").unwrap().is_switch() && !Rom::new(0x28, 1).unwrap().is_switch());
    }

    #[test]
    fn a_code_is_read_as_the_kernel_writes_it_and_nothing_else_is() {
        let rom = Rom::parse("28-0316a2795bff").unwrap();
        assert_eq!((rom.family(), rom.serial()), (0x28, 0x0316_A279_5BFF));
        assert_eq!(rom.to_string(), "28-0316a2795bff");
        assert!(rom.is_thermometer() && !Rom::parse("26-000000000001").unwrap().is_thermometer());
        for text in ["", "28", "28-", "28-0316a2795bf", "28-0316a2795bfff", "28-0316A2795BFF", "+8-0316a2795bff"] {
            assert_eq!(Rom::parse(text), None, "{text}");
        }
        for text in ["28-+316a2795bff", "w1_bus_master1", "028-0316a2795bff", "28-0316a2795bf\u{e9}"] {
            assert_eq!(Rom::parse(text), None, "{text}");
        }
        assert_eq!(Rom::new(0x28, 1 << 48), None);
    }
}
