//! The wire of UDPM: one datagram in, its parts out, and the header of a short message. Stateless.
//!
//! Layout: LCM `docs/content/udp-multicast-protocol.md`. All integers are big-endian.
//!
//! | short | fragment |
//! |---|---|
//! | magic `LC02`, sequence number | magic `LC03`, sequence number, message size, offset: 32 bits each |
//! | | number of this fragment, count of fragments: 16 bits each |
//! | channel, NUL, payload | fragment 0: channel, NUL, data; the others: data |

use core::fmt;

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
/// Smallest datagram that [`Message::new`] splits into: what IPv4 promises to carry, 576 bytes, without its header and UDP's.
pub const DATAGRAM_MIN: usize = 548;
/// Largest message that receivers accept, in payload bytes; `liblcm` draws the same line.
pub const MESSAGE_MAX: u32 = 1 << 28;

/// Where the channel name of a short message begins.
pub(crate) const CHANNEL_AT: usize = SHORT_HEADER;

const SHORT_HEADER: usize = 8;
const FRAGMENT_HEADER: usize = 20;

/// Why a message was not encoded. The caller's mistake; nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The channel has no name.
    ChannelEmpty,
    /// The name has `len` bytes, more than [`CHANNEL_MAX`].
    ChannelTooLong {
        /// Its length in bytes.
        len: usize,
    },
    /// The name holds a NUL, which would end it on the wire.
    ChannelHasNul,
    /// The payload is longer than [`MESSAGE_MAX`], or takes more than 65535 fragments of the size asked for.
    MessageTooLong {
        /// Its length in bytes.
        len: usize,
        /// The longest that can be sent.
        max: usize,
    },
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ChannelEmpty => write!(f, "the channel has no name"),
            Self::ChannelTooLong { len } => {
                write!(f, "a channel name of {len} bytes; at most {CHANNEL_MAX}")
            }
            Self::ChannelHasNul => write!(f, "a NUL in the channel name"),
            Self::MessageTooLong { len, max } => write!(f, "a message of {len} bytes; at most {max}"),
        }
    }
}

impl core::error::Error for EncodeError {}

/// A message to be sent: one datagram, or the fragments of it.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    sequence: u32,
    channel: &'a str,
    payload: &'a [u8],
    /// The largest datagram to make.
    size: usize,
}

impl<'a> Message<'a> {
    /// Message number `sequence` on `channel`, in datagrams of at most `size` bytes, which is held within
    /// [`DATAGRAM_MIN`] and [`DATAGRAM_MAX`].
    ///
    /// # Errors
    /// The name is empty, too long or holds a NUL, or the payload is too long.
    pub fn new(sequence: u32, channel: &'a str, payload: &'a [u8], size: usize) -> Result<Self, EncodeError> {
        check_channel(channel)?;
        let size = size.clamp(DATAGRAM_MIN, DATAGRAM_MAX);
        let max = (usize::from(u16::MAX) * (size - FRAGMENT_HEADER) - CHANNEL_MAX - 1).min(MESSAGE_MAX as usize);
        if payload.len() > max {
            return Err(EncodeError::MessageTooLong { len: payload.len(), max });
        }
        Ok(Self { sequence, channel, payload, size })
    }

    /// How many datagrams it takes.
    #[must_use]
    pub fn count(&self) -> usize {
        if self.is_short() { 1 } else { (self.named() + self.payload.len()).div_ceil(self.piece()) }
    }

    /// Datagram `number` of [`Message::count`]: its header and what follows.
    #[must_use]
    pub fn datagram(&self, number: usize) -> (Header, &'a [u8]) {
        if self.is_short() {
            let mut header = Header::default();
            header.push(&SHORT_MAGIC.to_be_bytes());
            header.push(&self.sequence.to_be_bytes());
            header.push_channel(self.channel);
            return (header, self.payload);
        }
        // In the row of name, NUL and payload each fragment carries one piece; fragment 0 the name.
        let start = (number * self.piece()).saturating_sub(self.named());
        let end = ((number + 1) * self.piece() - self.named()).min(self.payload.len());
        let mut header = Header::default();
        header.push(&FRAGMENT_MAGIC.to_be_bytes());
        header.push(&self.sequence.to_be_bytes());
        header.push(&(self.payload.len() as u32).to_be_bytes());
        header.push(&(start as u32).to_be_bytes());
        header.push(&(number as u16).to_be_bytes());
        header.push(&(self.count() as u16).to_be_bytes());
        if number == 0 {
            header.push_channel(self.channel);
        }
        (header, &self.payload[start..end])
    }

    /// Whether one datagram holds it. `liblcm` sends up to [`SHORT_MAX`] bytes of name, NUL and payload this way.
    fn is_short(&self) -> bool {
        SHORT_HEADER + self.named() + self.payload.len() <= self.size
    }

    fn named(&self) -> usize {
        self.channel.len() + 1
    }

    /// What a fragment holds behind its header.
    fn piece(&self) -> usize {
        self.size - FRAGMENT_HEADER
    }
}

/// What stands in a datagram before the payload.
#[derive(Clone, Copy, Debug)]
pub struct Header {
    bytes: [u8; FRAGMENT_HEADER + CHANNEL_MAX + 1],
    len: usize,
}

impl Default for Header {
    fn default() -> Self {
        Self { bytes: [0; FRAGMENT_HEADER + CHANNEL_MAX + 1], len: 0 }
    }
}

impl Header {
    fn push(&mut self, bytes: &[u8]) {
        self.bytes[self.len..][..bytes.len()].copy_from_slice(bytes);
        self.len += bytes.len();
    }

    fn push_channel(&mut self, channel: &str) {
        self.push(channel.as_bytes());
        self.push(&[0]);
    }
}

impl core::ops::Deref for Header {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

fn check_channel(channel: &str) -> Result<(), EncodeError> {
    match channel.len() {
        0 => Err(EncodeError::ChannelEmpty),
        len if len > CHANNEL_MAX => Err(EncodeError::ChannelTooLong { len }),
        _ if channel.contains('\0') => Err(EncodeError::ChannelHasNul),
        _ => Ok(()),
    }
}

/// A whole message in one datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Short<'a> {
    /// The publisher's number of this message.
    pub sequence: u32,
    /// At most [`CHANNEL_MAX`] bytes; may be empty.
    pub channel: &'a str,
    /// Whatever follows; may be empty.
    pub payload: &'a [u8],
}

/// A piece of a message. `offset + data.len() <= total` and `number < count` hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fragment<'a> {
    /// The publisher's number of the message, the same in all its fragments.
    pub sequence: u32,
    /// Payload bytes of the whole message, at most [`MESSAGE_MAX`].
    pub total: u32,
    /// Where `data` belongs in the payload.
    pub offset: u32,
    /// Which fragment this is, from 0.
    pub number: u16,
    /// How many there are, at least 1.
    pub count: u16,
    /// The channel, which fragment 0 alone carries.
    pub channel: Option<&'a str>,
    /// This piece of the payload.
    pub data: &'a [u8],
}

/// One datagram, understood.
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
        /// Where its data would end.
        end: u64,
        /// The announced size.
        total: u32,
    },
}

impl DecodeError {
    /// Its name, without what differs from datagram to datagram.
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
mod tests {
    use super::*;

    fn fragment(total: u32, offset: u32, number: u16, count: u16, rest: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::from(FRAGMENT_MAGIC.to_be_bytes());
        for word in [7, total, offset] {
            bytes.extend(word.to_be_bytes());
        }
        bytes.extend(number.to_be_bytes());
        bytes.extend(count.to_be_bytes());
        bytes.extend(rest);
        bytes
    }

    fn short(rest: &[u8]) -> Vec<u8> {
        [b"LC02\0\0\0\x07", rest].concat()
    }

    #[test]
    fn what_is_too_short_for_a_header_is_refused() {
        for len in 0..8 {
            assert_eq!(decode(&short(b"")[..len]), Err(DecodeError::TooShort { len }));
        }
        let whole = fragment(1, 0, 1, 2, b"");
        for len in 8..20 {
            assert_eq!(decode(&whole[..len]), Err(DecodeError::TooShort { len }));
        }
        assert!(decode(&whole).is_ok());
    }

    #[test]
    fn what_does_not_start_with_the_magic_is_refused() {
        assert_eq!(decode(b"LC04\0\0\0\0A\0"), Err(DecodeError::Magic(0x4c43_3034)));
    }

    #[test]
    fn a_channel_name_ends_within_64_bytes_and_is_utf_8() {
        assert_eq!(decode(&short(b"")), Err(DecodeError::ChannelUnterminated));
        assert_eq!(decode(&short(&[b'c'; 63])), Err(DecodeError::ChannelUnterminated));
        assert_eq!(decode(&short(&[b'c'; 64])), Err(DecodeError::ChannelTooLong));
        assert_eq!(decode(&short(&[&[b'c'; 64][..], b"\0"].concat())), Err(DecodeError::ChannelTooLong));
        assert_eq!(decode(&short(b"\xff\0")), Err(DecodeError::ChannelNotUtf8));
        let name = "c".repeat(63);
        let longest = Short { sequence: 7, channel: &name, payload: b"" };
        assert_eq!(decode(&short(&[name.as_bytes(), b"\0"].concat())), Ok(Datagram::Short(longest)));
        let empty = Short { sequence: 7, channel: "", payload: b"x" };
        assert_eq!(decode(&short(b"\0x")), Ok(Datagram::Short(empty)));
    }

    #[test]
    fn the_first_fragment_carries_the_channel_and_the_others_do_not() {
        let bytes = fragment(5, 0, 0, 2, b"BIG\0abc");
        let first =
            Fragment { sequence: 7, total: 5, offset: 0, number: 0, count: 2, channel: Some("BIG"), data: b"abc" };
        assert_eq!(decode(&bytes), Ok(Datagram::Fragment(first)));
        let bytes = fragment(5, 3, 1, 2, b"de");
        let second = Fragment { offset: 3, number: 1, channel: None, data: b"de", ..first };
        assert_eq!(decode(&bytes), Ok(Datagram::Fragment(second)));
        assert_eq!(decode(&fragment(5, 0, 0, 2, b"BIG")), Err(DecodeError::ChannelUnterminated));
    }

    #[test]
    fn a_fragment_lies_within_its_message() {
        let beyond = |end, total| Err(DecodeError::BeyondEnd { end, total });
        assert_eq!(decode(&fragment(5, 3, 1, 2, b"def")), beyond(6, 5));
        // The datagram that kills liblcm 1.3.1: offset and length wrap in 32 bits.
        assert_eq!(decode(&fragment(100, u32::MAX - 1, 1, 2, b"abcd")), beyond(0x1_0000_0002, 100));
        assert_eq!(
            decode(&fragment(MESSAGE_MAX + 1, 0, 1, 2, b"")),
            Err(DecodeError::MessageTooLong { total: MESSAGE_MAX + 1 })
        );
        assert!(decode(&fragment(MESSAGE_MAX, 0, 1, 2, b"")).is_ok());
    }

    #[test]
    fn a_fragment_is_one_of_those_announced() {
        let refused = |number, count| Err(DecodeError::FragmentNumber { number, count });
        assert_eq!(decode(&fragment(5, 0, 0, 0, b"A\0")), refused(0, 0));
        assert_eq!(decode(&fragment(5, 0, 2, 2, b"")), refused(2, 2));
    }

    /// The datagrams of a message whose payload is `len` bytes of a pattern.
    fn datagrams(channel: &str, len: usize, size: usize) -> (Vec<u8>, Vec<Vec<u8>>) {
        let payload: Vec<u8> = (0..len).map(|i| (7 * i + (i >> 8)) as u8).collect();
        let message = Message::new(3, channel, &payload, size).unwrap();
        let datagram = |number| {
            let (header, rest) = message.datagram(number);
            [&header[..], rest].concat()
        };
        let datagrams = (0..message.count()).map(datagram).collect();
        (payload, datagrams)
    }

    #[test]
    fn the_longest_short_message_is_as_long_as_the_official_one() {
        assert_eq!(datagrams("EDGE", 65_494, DATAGRAM_MAX).1.len(), 1);
        let (_, two) = datagrams("EDGE", 65_495, DATAGRAM_MAX);
        assert_eq!(two.iter().map(Vec::len).collect::<Vec<_>>(), [65_507, 20 + 13]);
    }

    #[test]
    fn fragments_of_any_size_hold_the_whole_payload_once() {
        for (channel, len, size) in
            [("A", 70_000, 600), ("C", 1000, 0), ("EDGE", 200_000, usize::MAX), ("B", 3000, 1452)]
        {
            let (payload, datagrams) = datagrams(channel, len, size);
            let mut whole: Vec<u8> = Vec::new();
            for (number, bytes) in datagrams.iter().enumerate() {
                assert!(bytes.len() <= size.clamp(DATAGRAM_MIN, DATAGRAM_MAX));
                let Ok(Datagram::Fragment(fragment)) = decode(bytes) else { panic!("{number}") };
                assert_eq!((fragment.sequence, fragment.total as usize), (3, len));
                assert_eq!((fragment.number as usize, fragment.count as usize), (number, datagrams.len()));
                assert_eq!(fragment.offset as usize, whole.len());
                assert_eq!(fragment.channel, (number == 0).then_some(channel));
                whole.extend(fragment.data);
            }
            assert!(whole == payload);
        }
    }

    #[test]
    fn what_cannot_be_sent_is_not_encoded() {
        let new = |channel: &str, len, size| Message::new(0, channel, &vec![0; len], size).map(|_| ());
        assert_eq!(new(&"C".repeat(63), 0, 0), Ok(()));
        assert_eq!(new(&"C".repeat(64), 0, 0), Err(EncodeError::ChannelTooLong { len: 64 }));
        assert_eq!(new("", 0, 0), Err(EncodeError::ChannelEmpty));
        assert_eq!(new("A\0B", 0, 0), Err(EncodeError::ChannelHasNul));
        let max = 65_535 * (548 - 20) - 64;
        assert_eq!(new("A", max, 548), Ok(()));
        assert_eq!(new("A", max + 1, 548), Err(EncodeError::MessageTooLong { len: max + 1, max }));
        let max = MESSAGE_MAX as usize;
        assert_eq!(new("A", max + 1, DATAGRAM_MAX), Err(EncodeError::MessageTooLong { len: max + 1, max }));
    }
}
