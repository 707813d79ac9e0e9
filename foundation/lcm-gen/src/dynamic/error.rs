//! Reasons why a value cannot be encoded.

use std::fmt;

/// Reason why a value does not match a type. Shown as `irs[3].x: expected a number, found a text`.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodeError {
    /// Path to the value: `irs[3].x`; empty for the message itself.
    pub at: String,
    /// Reason.
    pub why: Why,
}

impl EncodeError {
    /// Prefixes the path with the enclosing member.
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

/// Reason why a value cannot be encoded.
#[derive(Clone, Debug, PartialEq)]
pub enum Why {
    /// A member has no value.
    Missing,
    /// The type has no such member.
    Unknown,
    /// A member has more than one value.
    Twice,
    /// Value of another kind.
    Kind {
        /// Expected kind: `a number`.
        expected: &'static str,
        /// Kind found: `a text`.
        found: &'static str,
    },
    /// Number out of the range of its type.
    Range {
        /// Type: `int8_t`.
        ty: &'static str,
    },
    /// Name of no value of the enum.
    NoValue {
        /// Name.
        name: String,
    },
    /// The length of an array differs from its length member, or from another array with the same length member.
    Length {
        /// Expected length.
        expected: usize,
        /// Length found.
        found: usize,
    },
    /// Length that is negative or out of the range of its type.
    LengthRange {
        /// Length.
        len: i64,
    },
    /// Text that contains NUL, the terminator of strings in LCM.
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
            Self::NoValue { name } => write!(f, "{name:?} is not a value of the enum"),
            Self::Length { expected, found } => write!(f, "{found} elements where {expected} are expected"),
            Self::LengthRange { len } => write!(f, "{len} is not a possible length"),
            Self::Nul => write!(f, "contains a NUL character, the end of a string in LCM"),
            Self::TooLong => write!(f, "the message would be longer than {} MiB", super::MESSAGE_MAX >> 20),
            Self::Depth => write!(f, "nested deeper than {}", super::MAX_DEPTH),
        }
    }
}
