//! Why a message could not be written or read.

use core::fmt;

/// Why a value cannot be encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The caller's slice is too short.
    NoRoom {
        /// Number of bytes the message takes.
        needed: usize,
        /// Number of them.
        room: usize,
    },
    /// A string holds a NUL, which LCM ends strings with.
    Nul {
        /// The string's member.
        member: &'static str,
    },
    /// An array's length does not fit its length member, or a string's length (with its NUL) an `int32_t`.
    TooLong {
        /// The length member, or the string's.
        member: &'static str,
        /// The length.
        len: usize,
        /// The greatest that fits.
        max: usize,
    },
    /// Length of an array that contradicts its length member, or another array of the same length member.
    Length {
        /// The array's member.
        member: &'static str,
        /// Expected length.
        expected: usize,
        /// Actual length.
        found: usize,
    },
    /// A length member is negative.
    Negative {
        /// The length member.
        member: &'static str,
        /// Value.
        value: i64,
    },
    /// A recursive value nests deeper than [`MAX_DEPTH`](super::MAX_DEPTH).
    Depth {
        /// The greatest allowed depth.
        max: usize,
    },
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoRoom { needed, room } => write!(f, "{needed} bytes needed, room for {room}"),
            Self::Nul { member } => write!(f, "`{member}` contains a NUL character, the end of a string in LCM"),
            Self::TooLong { member, len, max } => {
                write!(f, "`{member}`: length {len} is above {max}")
            }
            Self::Length { member, expected, found } => {
                write!(f, "`{member}` has {found} elements where {expected} are expected")
            }
            Self::Negative { member, value } => write!(f, "length `{member}` is negative: {value}"),
            Self::Depth { max } => write!(f, "nested deeper than {max}"),
        }
    }
}

impl core::error::Error for EncodeError {}

/// Why bytes are not a message of the expected type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// Fingerprint of another type, or of another version of the type.
    Fingerprint {
        /// The type's fingerprint.
        expected: u64,
        /// The message's.
        found: u64,
    },
    /// The bytes end within the message.
    Truncated {
        /// Number of bytes missing for the next member.
        needed: usize,
        /// Number of bytes left.
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
        /// Number of bytes that were left.
        left: usize,
    },
    /// A string does not end with a NUL.
    Unterminated,
    /// A string holds a NUL before its end.
    InnerNul,
    /// A string is not UTF-8.
    NotUtf8 {
        /// Number of valid UTF-8 bytes at its start.
        valid_up_to: usize,
    },
    /// Bytes follow the message.
    LeftOver {
        /// Number of them.
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
            Self::Fingerprint { expected, found } => {
                write!(f, "another type: fingerprint {found:016x} where {expected:016x} is expected")
            }
            Self::Truncated { needed, left } => {
                write!(f, "truncated: {needed} bytes needed, {left} left")
            }
            Self::Count { count, max } => {
                write!(f, "array length {count} where 0 to {max} are possible")
            }
            Self::StringLength { len, left } => {
                write!(f, "string length {len} with {left} bytes left")
            }
            Self::Unterminated => write!(f, "string without a final NUL"),
            Self::InnerNul => write!(f, "string with a NUL inside"),
            Self::NotUtf8 { valid_up_to } => {
                write!(f, "string is not UTF-8 after {valid_up_to} bytes")
            }
            Self::LeftOver { extra } => write!(f, "{extra} bytes left over"),
            Self::Depth { max } => write!(f, "nested deeper than {max}"),
        }
    }
}

impl core::error::Error for DecodeError {}
