//! Why bytes are no message, and why a value makes none.

use std::fmt;

/// Why bytes are not a message of a type; what `lcm::codec::DecodeError` is for generated code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// No type has this fingerprint.
    Unknown {
        /// The message's fingerprint.
        found: u64,
    },
    /// It is another type, or another version of the type.
    Fingerprint {
        /// The type's fingerprint.
        expected: u64,
        /// The message's.
        found: u64,
    },
    /// The bytes end within the message.
    Truncated {
        /// How many more were needed for the next member.
        needed: usize,
        /// How many were left.
        left: usize,
    },
    /// An array length that is negative or for which the bytes left cannot suffice.
    Count {
        /// The length.
        count: i64,
        /// The greatest that the rest of the message allows.
        max: usize,
    },
    /// A string length that is not positive (it includes the NUL) or above the bytes that are left.
    StringLength {
        /// The length.
        len: i32,
        /// How many bytes were left.
        left: usize,
    },
    /// A string does not end with a NUL.
    Unterminated,
    /// A string holds a NUL before its end.
    InnerNul,
    /// A string is not UTF-8.
    NotUtf8 {
        /// How many of its bytes are.
        valid_up_to: usize,
    },
    /// Bytes follow the message.
    LeftOver {
        /// How many.
        extra: usize,
    },
    /// A recursive value nests deeper than [`MAX_DEPTH`](super::MAX_DEPTH).
    Depth {
        /// The greatest allowed depth.
        max: usize,
    },
}

impl fmt::Display for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { found } => write!(f, "unknown type: fingerprint {found:016x}"),
            Self::Fingerprint { expected, found } => {
                write!(f, "another type: fingerprint {found:016x} where {expected:016x} is expected")
            }
            Self::Truncated { needed, left } => write!(f, "truncated: {needed} bytes needed, {left} left"),
            Self::Count { count, max } => write!(f, "array length {count} where 0 to {max} are possible"),
            Self::StringLength { len, left } => write!(f, "string length {len} with {left} bytes left"),
            Self::Unterminated => write!(f, "string without a final NUL"),
            Self::InnerNul => write!(f, "string with a NUL inside"),
            Self::NotUtf8 { valid_up_to } => write!(f, "string is not UTF-8 after {valid_up_to} bytes"),
            Self::LeftOver { extra } => write!(f, "{extra} bytes left over"),
            Self::Depth { max } => write!(f, "nested deeper than {max}"),
        }
    }
}

impl std::error::Error for DecodeError {}

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
