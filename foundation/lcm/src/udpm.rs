//! The wire of UDPM: one datagram in, its parts out; a message in, its datagrams out. Stateless.
//!
//! Layout: LCM `docs/content/udp-multicast-protocol.md`. All integers are big-endian.
//!
//! | short | fragment |
//! |---|---|
//! | magic `LC02`, sequence number | magic `LC03`, sequence number, message size, offset: 32 bits each |
//! | | number of this fragment, count of fragments: 16 bits each |
//! | channel, NUL, payload | fragment 0: channel, NUL, data; the others: data |
//!
//! ```
//! use lcm::udpm::{DATAGRAM_MAX, Datagram, Message, Short, decode};
//!
//! let message = Message::new(7, "POSE", b"payload", DATAGRAM_MAX).unwrap();
//! assert_eq!(message.count(), 1);
//! let (header, payload) = message.datagram(0);
//! let datagram = [&header[..], payload].concat();
//! assert_eq!(decode(&datagram), Ok(Datagram::Short(Short { sequence: 7, channel: "POSE", payload })));
//! ```

mod message;

use core::fmt;
pub use message::{EncodeError, Header, Message};

/// First four bytes of a short message, `LC02`.
pub const SHORT_MAGIC: u32 = 0x4c43_3032;
/// First four bytes of a fragment, `LC03`.
pub const FRAGMENT_MAGIC: u32 = 0x4c43_3033;
/// Longest channel name in bytes, without its NUL.
pub const CHANNEL_MAX: usize = 63;
/// Largest sum of channel name, NUL and payload that goes out as a short message.
pub const SHORT_MAX: usize = 65_499;
/// Largest datagram: what IPv4 carries in one UDP packet.
pub const DATAGRAM_MAX: usize = 65_507;
/// Smallest datagram that [`Message::new`] splits into: what IPv4 promises to carry, 576 bytes, without its header and
/// UDP's.
pub const DATAGRAM_MIN: usize = 548;
/// Largest message that receivers accept, in payload bytes; `liblcm` draws the same line.
pub const MESSAGE_MAX: u32 = 1 << 28;

/// Offset of the channel name in a short message.
pub(crate) const CHANNEL_AT: usize = SHORT_HEADER;

const SHORT_HEADER: usize = 8;
const FRAGMENT_HEADER: usize = 20;

/// A whole message in one datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Short<'a> {
    /// The publisher's number of this message.
    pub sequence: u32,
    /// At most [`CHANNEL_MAX`] bytes; may be empty.
    pub channel: &'a str,
    /// Payload; may be empty.
    pub payload: &'a [u8],
}

/// A piece of a message. `offset + data.len() <= total` and `number < count` hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fragment<'a> {
    /// The publisher's number of the message, the same in all its fragments.
    pub sequence: u32,
    /// Payload bytes of the whole message, at most [`MESSAGE_MAX`].
    pub total: u32,
    /// Offset of `data` in the payload.
    pub offset: u32,
    /// Which fragment this is, from 0.
    pub number: u16,
    /// Number of them.
    pub count: u16,
    /// The channel, which fragment 0 alone carries.
    pub channel: Option<&'a str>,
    /// Piece of the payload.
    pub data: &'a [u8],
}

/// A decoded datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Datagram<'a> {
    /// A whole message.
    Short(Short<'a>),
    /// A piece of one.
    Fragment(Fragment<'a>),
}

impl Datagram<'_> {
    /// The publisher's number of the message.
    #[must_use]
    pub fn sequence(&self) -> u32 {
        match self {
            Self::Short(short) => short.sequence,
            Self::Fragment(fragment) => fragment.sequence,
        }
    }
}

/// Why a datagram is not one of LCM's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// `len` bytes do not hold the header.
    TooShort {
        /// Length of the datagram.
        len: usize,
    },
    /// The first four bytes are neither of the two magic numbers.
    Magic(u32),
    /// The datagram ends within the channel name.
    ChannelUnterminated,
    /// No NUL within the first 64 bytes of the name.
    ChannelTooLong,
    /// The channel name is not UTF-8.
    ChannelNotUtf8,
    /// A fragment's number is not below the count of fragments.
    FragmentNumber {
        /// The fragment's number.
        number: u16,
        /// The announced count.
        count: u16,
    },
    /// A fragment announces more than [`MESSAGE_MAX`] bytes.
    MessageTooLong {
        /// The announced size.
        total: u32,
    },
    /// A fragment reaches beyond the end of its message.
    BeyondEnd {
        /// End of its data.
        end: u64,
        /// The announced size.
        total: u32,
    },
}

impl DecodeError {
    /// Name, without what differs from datagram to datagram.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::TooShort { .. } => "TooShort",
            Self::Magic(_) => "Magic",
            Self::ChannelUnterminated => "ChannelUnterminated",
            Self::ChannelTooLong => "ChannelTooLong",
            Self::ChannelNotUtf8 => "ChannelNotUtf8",
            Self::FragmentNumber { .. } => "FragmentNumber",
            Self::MessageTooLong { .. } => "MessageTooLong",
            Self::BeyondEnd { .. } => "BeyondEnd",
        }
    }
}

impl fmt::Display for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShort { len } => write!(f, "{len} bytes do not hold an LCM header"),
            Self::Magic(magic) => write!(f, "the magic number {magic:#010x} is not LCM's"),
            Self::ChannelUnterminated => write!(f, "the channel name has no end"),
            Self::ChannelTooLong => {
                write!(f, "the channel name is longer than {CHANNEL_MAX} bytes")
            }
            Self::ChannelNotUtf8 => write!(f, "the channel name is not UTF-8"),
            Self::FragmentNumber { number, count } => {
                write!(f, "fragment {number} of {count}, counted from 0")
            }
            Self::MessageTooLong { total } => {
                write!(f, "a message of {total} bytes; at most {MESSAGE_MAX}")
            }
            Self::BeyondEnd { end, total } => {
                write!(f, "a fragment up to byte {end} of a message of {total}")
            }
        }
    }
}

impl core::error::Error for DecodeError {}

/// Takes a datagram apart. Accepts fragments of any size, as the sender alone chooses it.
///
/// # Errors
/// It is not one of LCM's; see [`DecodeError`].
pub fn decode(datagram: &[u8]) -> Result<Datagram<'_>, DecodeError> {
    let too_short = DecodeError::TooShort { len: datagram.len() };
    let (head, rest) = datagram.split_first_chunk::<SHORT_HEADER>().ok_or(too_short)?;
    let sequence = u32_at(head, 4);
    match u32_at(head, 0) {
        SHORT_MAGIC => {
            let (channel, payload) = split_channel(rest)?;
            Ok(Datagram::Short(Short { sequence, channel, payload }))
        }
        FRAGMENT_MAGIC => {
            let (head, rest) = datagram.split_first_chunk::<FRAGMENT_HEADER>().ok_or(too_short)?;
            decode_fragment(head, rest).map(Datagram::Fragment)
        }
        magic => Err(DecodeError::Magic(magic)),
    }
}

fn decode_fragment<'a>(head: &[u8; FRAGMENT_HEADER], rest: &'a [u8]) -> Result<Fragment<'a>, DecodeError> {
    let (total, offset) = (u32_at(head, 8), u32_at(head, 12));
    let (number, count) = (u16_at(head, 16), u16_at(head, 18));
    if number >= count {
        return Err(DecodeError::FragmentNumber { number, count });
    }
    if total > MESSAGE_MAX {
        return Err(DecodeError::MessageTooLong { total });
    }
    let (channel, data) = match number {
        0 => split_channel(rest).map(|(channel, data)| (Some(channel), data))?,
        _ => (None, rest),
    };
    // In 64 bits: liblcm up to 1.5.2 added these in 32, wrapped, and wrote where it should not.
    let end = u64::from(offset) + data.len() as u64;
    if end > u64::from(total) {
        return Err(DecodeError::BeyondEnd { end, total });
    }
    Ok(Fragment { sequence: u32_at(head, 4), total, offset, number, count, channel, data })
}

/// Splits `channel NUL rest`.
fn split_channel(bytes: &[u8]) -> Result<(&str, &[u8]), DecodeError> {
    let window = &bytes[..bytes.len().min(CHANNEL_MAX + 1)];
    let Some(len) = window.iter().position(|&byte| byte == 0) else {
        let cut = window.len() <= CHANNEL_MAX;
        return Err(if cut { DecodeError::ChannelUnterminated } else { DecodeError::ChannelTooLong });
    };
    let channel = core::str::from_utf8(&bytes[..len]).map_err(|_| DecodeError::ChannelNotUtf8)?;
    Ok((channel, &bytes[len + 1..]))
}

fn u32_at<const N: usize>(head: &[u8; N], at: usize) -> u32 {
    u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]])
}

fn u16_at<const N: usize>(head: &[u8; N], at: usize) -> u16 {
    u16::from_be_bytes([head[at], head[at + 1]])
}

#[cfg(test)]
mod tests;
