//! What each board says (`docs/facts/boards.md` 3 to 6): one table of instructions a board, and a typed way from and to the
//! data of its answers. Stateless, and shared by the driver and the emulated board.

pub mod psc1;
pub mod sbs1;
pub mod sd1;
pub mod so1;

use crate::frame::{RESET, VERSION};
use crate::master::{Lengths, Request};
use core::fmt;

/// One instruction of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Its number on the wire.
    pub code: u8,
    /// Its name in the board's table.
    pub name: &'static str,
    /// Which lengths a request's data may have.
    pub request: Lengths,
    /// Which lengths a good answer's data may have.
    pub answer: Lengths,
}

impl Instruction {
    /// The request of this instruction to the board at address `to`.
    #[must_use]
    pub const fn ask<'a>(&self, to: u8, data: &'a [u8]) -> Request<'a> {
        Request { to, instruction: self.code, data, no_ack: false, answer: self.answer }
    }
}

const fn instruction(code: u8, name: &'static str, answer: Lengths) -> Instruction {
    Instruction { code, name, request: Lengths::NONE, answer }
}

/// Firmware version: every board has it. Two bytes, major and minor; what may follow is the board's own.
pub const GET_VERSION: Instruction = instruction(VERSION, "version", Lengths::between(2, 26));
/// Reset: every board has it. Answered before it is done.
pub const DO_RESET: Instruction = instruction(RESET, "reset", Lengths::NONE);

/// A board's firmware version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// Changes with what the board says on the wire.
    pub major: u8,
    /// Changes with anything else.
    pub minor: u8,
}

impl Version {
    /// From the data of an answer to [`GET_VERSION`].
    #[must_use]
    pub fn parse(data: &[u8]) -> Option<Self> {
        let [major, minor, ..] = *data else {
            return None;
        };
        Some(Self { major, minor })
    }

    /// The data of an answer to [`GET_VERSION`].
    #[must_use]
    pub const fn build(self) -> [u8; 2] {
        [self.major, self.minor]
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

/// Why an answer with a right CRC and an allowed length is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Implausible {
    /// The data does not have the length that its own counts ask for.
    Layout {
        /// Data bytes of the answer.
        len: usize,
    },
    /// A value that the device cannot measure.
    Value {
        /// Which of the answer's values, from 0.
        index: usize,
        /// What it says.
        value: u32,
    },
}

impl fmt::Display for Implausible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Layout { len } => write!(f, "{len} data bytes do not fit its own counts"),
            Self::Value { index, value } => {
                write!(f, "value {index} is {value}, which it cannot measure")
            }
        }
    }
}

#[cfg(test)]
mod transcripts;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_table_names_a_code_twice_and_all_have_version_and_reset() {
        for table in [sd1::INSTRUCTIONS, so1::INSTRUCTIONS, sbs1::INSTRUCTIONS, psc1::INSTRUCTIONS] {
            for (i, instruction) in table.iter().enumerate() {
                assert!(table[..i].iter().all(|earlier| earlier.code != instruction.code), "{}", instruction.name);
            }
            assert!(table.contains(&GET_VERSION) && table.contains(&DO_RESET));
        }
        // What comes unasked is told from an answer by its instruction alone.
        let both = |unasked: &Instruction| psc1::INSTRUCTIONS.iter().any(|asked| asked.code == unasked.code);
        assert!(!psc1::UNASKED.iter().any(both));
    }

    #[test]
    fn a_version_reads_as_people_write_it() {
        assert_eq!(std::format!("{}", Version::parse(&[1, 4, 99]).unwrap()), "1.4");
        assert_eq!(Version::parse(&[1]), None);
    }
}
