//! Protocols of the boards (`docs/facts/boards.md` 3 to 6): one table of instructions a board, and typed encoding and
//! decoding of its answers. Stateless, and shared by the driver and the emulated board. How to add one:
//! `docs/writing-a-board-driver.md`.

pub mod psc1;
pub mod sbs1;
pub mod sd1;
pub mod so1;

use crate::frame::{RESET, VERSION};
pub use crate::instruction::Instruction;
use crate::instruction::Lengths;
use core::fmt;

/// A kind of board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Name in the configuration's `driver`.
    pub name: &'static str,
    /// Addresses on the reference robot (`docs/facts/boards.md`).
    pub addresses: &'static [u8],
    /// All instructions, version and reset included.
    pub instructions: &'static [Instruction],
    /// Unsolicited messages, for [`Config::unasked`](crate::master::Config::unasked).
    pub unasked: &'static [Instruction],
}

impl Board {
    /// The instruction of that code, asked or unasked.
    #[must_use]
    pub fn instruction(&self, code: u8) -> Option<&'static Instruction> {
        self.instructions.iter().chain(self.unasked).find(|instruction| instruction.code == code)
    }
}

/// Every kind of board.
pub const BOARDS: &[Board] = &[sd1::BOARD, so1::BOARD, sbs1::BOARD, psc1::BOARD];

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
    /// Changes with the protocol on the wire.
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
        /// Value found.
        value: u32,
    },
    /// Distances that stay the same while the robot moves.
    Frozen {
        /// Way that the robot has moved meanwhile.
        millimetres: u32,
    },
    /// All sonars fell silent from one sweep to the next.
    Deaf {
        /// Number of sonars with an echo in the sweep before.
        echoes: usize,
    },
}

impl fmt::Display for Implausible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Layout { len } => write!(f, "{len} data bytes do not fit its own counts"),
            Self::Value { index, value } => {
                write!(f, "value {index} is {value}, which it cannot measure")
            }
            Self::Deaf { echoes } => {
                write!(f, "all of its sonars fell silent at once, {echoes} of them had an echo before")
            }
            Self::Frozen { millimetres } => {
                write!(f, "its distances stayed the same while the robot moved by {millimetres} mm")
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
        for board in BOARDS {
            // Unsolicited messages differ from answers by their instruction alone, so no code may occur twice.
            let codes = board.instructions.iter().chain(board.unasked).map(|instruction| instruction.code);
            for (i, code) in codes.clone().enumerate() {
                assert!(codes.clone().take(i).all(|earlier| earlier != code), "{}: {code:#04x}", board.name);
            }
            assert!(board.instructions.contains(&GET_VERSION) && board.instructions.contains(&DO_RESET));
        }
    }

    #[test]
    fn no_two_boards_have_one_name_or_address() {
        for (i, board) in BOARDS.iter().enumerate() {
            for other in &BOARDS[..i] {
                assert_ne!(board.name, other.name);
                assert!(board.addresses.iter().all(|address| !other.addresses.contains(address)));
            }
        }
        assert_eq!(psc1::BOARD.instruction(0x80), Some(&psc1::PAUSE_CHANGED));
        assert_eq!(so1::BOARD.instruction(0x80), None);
    }

    #[test]
    fn a_version_reads_as_people_write_it() {
        assert_eq!(std::format!("{}", Version::parse(&[1, 4, 99]).unwrap()), "1.4");
        assert_eq!(Version::parse(&[1]), None);
    }
}
