//! A digital output of the computer: a line of a GPIO chip.

use alloc::string::String;
use core::fmt;

/// What passes over the port of a digital output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// To the output: a request to read its level.
    Read,
    /// To the output: the level to be set, which is read back at once. From the output: the level that was read. True:
    /// active.
    Level(bool),
}

impl Signal {
    /// Encodes the signal.
    #[must_use]
    pub const fn to_byte(self) -> u8 {
        match self {
            Self::Level(active) => active as u8,
            Self::Read => 2,
        }
    }

    /// Decodes a signal.
    #[must_use]
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match byte {
            0 => Some(Self::Level(false)),
            1 => Some(Self::Level(true)),
            2 => Some(Self::Read),
            _ => None,
        }
    }
}

/// A line of a GPIO chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineId {
    /// By its number.
    Number(u32),
    /// By its name.
    Name(String),
}

impl fmt::Display for LineId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// Resistor of a chip at an input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bias {
    /// As it is.
    #[default]
    AsIs,
    /// None.
    Disabled,
    /// To the high level.
    PullUp,
    /// To the low level.
    PullDown,
}
