//! A message to be sent, taken apart into datagrams.

use super::{
    CHANNEL_MAX, DATAGRAM_MAX, DATAGRAM_MIN, FRAGMENT_HEADER, FRAGMENT_MAGIC, MESSAGE_MAX, SHORT_HEADER, SHORT_MAGIC,
};
use core::fmt;

/// Why a message was not encoded. The caller's mistake; nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The channel has no name.
    ChannelEmpty,
    /// The name has `len` bytes, more than [`CHANNEL_MAX`].
    ChannelTooLong {
        /// Length in bytes.
        len: usize,
    },
    /// The name holds a NUL, which would end it on the wire.
    ChannelHasNul,
    /// The payload is longer than [`MESSAGE_MAX`], or takes more than 65535 fragments of the requested size.
    MessageTooLong {
        /// Length in bytes.
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

    /// Number of datagrams it takes.
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

    /// True if one datagram holds it. `liblcm` sends up to [`SHORT_MAX`] bytes of name, NUL and payload this way.
    fn is_short(&self) -> bool {
        SHORT_HEADER + self.named() + self.payload.len() <= self.size
    }

    fn named(&self) -> usize {
        self.channel.len() + 1
    }

    /// Payload size of a fragment.
    fn piece(&self) -> usize {
        self.size - FRAGMENT_HEADER
    }
}

/// Header of a datagram.
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

#[cfg(test)]
mod tests {
    use super::super::{Datagram, decode};
    use super::*;

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
