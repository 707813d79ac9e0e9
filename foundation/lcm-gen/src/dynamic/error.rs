//! Why a value makes no message.

use std::fmt;

/// Why a value is not one of a type. Shown as `irs[3].x: expected a number, found a text`.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodeError {
    /// Where: `irs[3].x`; empty for the message itself.
    pub at: String,
    /// What is wrong there.
    pub why: Why,
}

impl EncodeError {
    /// The same, seen from one member further out.
    pub(super) fn within(mut self, member: &str) -> Self {
        let join = if self.at.is_empty() || self.at.starts_with('[') { "" } else { "." };
        self.at = format!("{member}{join}{}", self.at);
        self
    }
}

impl From<Why> for EncodeError {
    fn from(why: Why) -> Self {
        Self { at: String::new(), why }
    }
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let join = if self.at.is_empty() { "" } else { ": " };
        write!(f, "{}{join}{}", self.at, self.why)
    }
}

impl std::error::Error for EncodeError {}

/// What is wrong with a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Why {
    /// A member has no value.
    Missing,
    /// The type has no such member.
    Unknown,
    /// A member has more than one value.
    Twice,
    /// It is something else.
    Kind {
        /// What it should be: `a number`.
        expected: &'static str,
        /// What it is: `a text`.
        found: &'static str,
    },
    /// A number that its type does not have.
    Range {
        /// The type: `int8_t`.
        ty: &'static str,
    },
    /// A name that none of the enum's values has.
    NoValue {
        /// The name.
        name: String,
    },
    /// The length of an array is not what its length member, or another array of the same length member, says.
    Length {
        /// What it should be.
        expected: usize,
        /// What it is.
        found: usize,
    },
    /// A length is negative or above what its type can say.
    LengthRange {
        /// The length.
        len: i64,
    },
    /// A text holds a NUL, which LCM ends strings with.
    Nul,
    /// The message would be longer than [`MESSAGE_MAX`](super::MESSAGE_MAX).
    TooLong,
    /// A recursive value nests deeper than [`MAX_DEPTH`](super::MAX_DEPTH).
    Depth,
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => write!(f, "missing"),
            Self::Unknown => write!(f, "no such member"),
            Self::Twice => write!(f, "given twice"),
            Self::Kind { expected, found } => write!(f, "expected {expected}, found {found}"),
            Self::Range { ty } => write!(f, "out of the range of {ty}"),
            Self::NoValue { name } => write!(f, "{name:?} is none of the enum's values"),
            Self::Length { expected, found } => write!(f, "{found} elements where {expected} are expected"),
            Self::LengthRange { len } => write!(f, "{len} is no possible length"),
            Self::Nul => write!(f, "holds a NUL character, which LCM ends strings with"),
            Self::TooLong => write!(f, "the message would be longer than {} MiB", super::MESSAGE_MAX >> 20),
            Self::Depth => write!(f, "nested deeper than {}", super::MAX_DEPTH),
        }
    }
}
