//! TCPQ: LCM over TCP, through a relaying [`hub`]. This file: the wire format of a connection's two streams.
//!
//! All words are 32 bits, unsigned and big-endian. Source: LCM 1.5.3, `lcm/lcm_tcpq.c` (the client) and
//! `lcm-java/lcm/lcm/TCPService.java` (the hub); there is no other description.
//!
//! | who | at once | then any number of |
//! |---|---|---|
//! | client | [`CLIENT_MAGIC`], [`VERSION`] | publish, subscribe, unsubscribe |
//! | hub | [`HUB_MAGIC`], [`VERSION`] | publish |
//!
//! | message | words and bytes |
//! |---|---|
//! | publish | 1, length and bytes of the channel (no NUL), length and bytes of the payload |
//! | subscribe | 2, length and bytes of a regular expression |
//! | unsubscribe | 3, the same expression |
//! A stream cannot be resynchronized, so a malformed message ends the connection; the official hub skips it word by
//! word. As in that hub, clients without a hello, and any version, are accepted. Lengths are limited, unlike there.
//!
//! ```
//! use lcm::tcpq::{Decoder, Message, Peer, subscribe};
//!
//! let mut stream = Decoder::new(Peer::Client, 1 << 20);
//! let (begin, end) = (&subscribe("POSE_.*")[..9], &subscribe("POSE_.*")[9..]);
//! stream.push(begin);
//! assert_eq!(stream.next_message(), Ok(None));
//! stream.push(end);
//! assert_eq!(stream.next_message(), Ok(Some(Message::Subscribe("POSE_.*"))));
//! ```
//!
//! The official hub reads from a client before it sends it anything but the hello: what one publishes as soon as it is
//! connected may reach all but itself.

pub mod hub;
mod outbox;

use crate::udpm::CHANNEL_MAX;
use core::fmt;
pub use outbox::Outbox;

/// A client's first word.
pub const CLIENT_MAGIC: u32 = 0x2876_17fb;
/// A hub's first word.
pub const HUB_MAGIC: u32 = 0x2876_17fa;
/// Second word of both; ignored by receivers.
pub const VERSION: u32 = 0x0100;
/// Longest channel or expression in bytes that a stream goes on after.
pub const TEXT_MAX: usize = 1024;

const PUBLISH: u32 = 1;
const SUBSCRIBE: u32 = 2;
const UNSUBSCRIBE: u32 = 3;
/// A buffer that one large message has made larger is given back.
const BUFFER_KEPT: usize = 256 << 10;

/// An end of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Peer {
    /// Publishes and subscribes.
    Client,
    /// Relays.
    Hub,
}

/// Message of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message<'a> {
    /// The first one.
    Hello {
        /// Version of the sender, usually [`VERSION`].
        version: u32,
    },
    /// Publishes a message.
    Publish {
        /// At most [`CHANNEL_MAX`] bytes; may be empty.
        channel: &'a str,
        /// May be empty.
        payload: &'a [u8],
        /// Encoded message.
        wire: &'a [u8],
    },
    /// From now on the channels that match this.
    Subscribe(&'a str),
    /// Removes a subscription.
    Unsubscribe(&'a str),
    /// Unusable message; the stream continues after it.
    Unusable(Unusable),
}

/// Defect of a message that can be skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unusable {
    /// A channel of `len` bytes, more than [`CHANNEL_MAX`].
    ChannelTooLong {
        /// Length in bytes.
        len: usize,
    },
    /// A channel or an expression that is not UTF-8.
    NotUtf8,
}

/// Why a stream is not TCPQ's, or no longer. The connection cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// Wrong magic of a hub.
    Magic(u32),
    /// The next message is of no known type.
    Type(u32),
    /// A channel or an expression longer than [`TEXT_MAX`].
    TextTooLong {
        /// Length in bytes.
        len: u32,
    },
    /// There is no memory for the received part of a message.
    NoMemory {
        /// Number of bytes received.
        len: usize,
    },
    /// A payload above the limit.
    MessageTooLong {
        /// Length in bytes.
        len: u32,
        /// The limit.
        max: usize,
    },
}

impl fmt::Display for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Magic(word) => write!(f, "it begins with {word:#010x}, not as an LCM hub"),
            Self::Type(word) => write!(f, "{word:#010x} where a message must begin"),
            Self::TextTooLong { len } => write!(f, "a channel or pattern of {len} bytes; at most {TEXT_MAX}"),
            Self::NoMemory { len } => write!(f, "no memory for {len} bytes of a message"),
            Self::MessageTooLong { len, max } => write!(f, "a message of {len} bytes; at most {max}"),
        }
    }
}

impl core::error::Error for DecodeError {}

/// The messages of one stream, of which bytes come in pieces of any size.
///
/// It holds what has come of one message and what was pushed with it; a length that was announced costs nothing.
#[derive(Debug)]
pub struct Decoder {
    from: Peer,
    message_max: usize,
    begun: bool,
    buffer: Vec<u8>,
    /// Number of bytes that the system had no memory for.
    refused: Option<usize>,
    /// Start of the message returned last, and start of the next one.
    current: usize,
    next: usize,
}

impl Decoder {
    /// For the stream that comes from a client, or from a hub, with payloads of at most `message_max` bytes.
    #[must_use]
    pub fn new(from: Peer, message_max: usize) -> Self {
        Self { from, message_max, begun: false, buffer: Vec::new(), refused: None, current: 0, next: 0 }
    }

    /// Accepts payloads of at most `bytes` from now on.
    pub fn set_message_max(&mut self, bytes: usize) {
        self.message_max = bytes;
    }

    /// Takes in what has come. Messages handed out before are gone.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.next);
        (self.current, self.next) = (0, 0);
        if self.buffer.is_empty() && self.buffer.capacity() > BUFFER_KEPT {
            self.buffer = Vec::new();
        }
        if self.buffer.try_reserve(bytes.len()).is_err() {
            self.refused = Some(self.buffer.len() + bytes.len());
            return;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// The next message; `None` until more has come.
    ///
    /// # Errors
    /// The stream makes no sense; and so again at the next call.
    pub fn next_message(&mut self) -> Result<Option<Message<'_>>, DecodeError> {
        if let Some(len) = self.refused {
            return Err(DecodeError::NoMemory { len });
        }
        match parse(&self.buffer[self.next..], self.from, self.begun, self.message_max) {
            Ok((message, len)) => {
                self.begun = true;
                (self.current, self.next) = (self.next, self.next + len);
                Ok(Some(message))
            }
            Err(Stop::More) => Ok(None),
            Err(Stop::Wrong(error)) => Err(error),
        }
    }

    /// Once more the channel and the payload that [`Decoder::next_message`] gave last, if it was a published message.
    #[must_use]
    pub fn published(&self) -> Option<(&str, &[u8])> {
        match parse(&self.buffer[self.current..self.next], self.from, true, self.message_max) {
            Ok((Message::Publish { channel, payload, .. }, _)) => Some((channel, payload)),
            _ => None,
        }
    }

    /// True if [`Decoder::next_message`] returns a message or an error.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        !matches!(parse(&self.buffer[self.next..], self.from, self.begun, self.message_max), Err(Stop::More))
    }

    /// Number of bytes it holds that were not handed out.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.buffer.len() - self.next
    }
}

/// Why there is no message.
enum Stop {
    More,
    Wrong(DecodeError),
}

/// The message that `input` begins with, and its length.
fn parse(input: &[u8], from: Peer, begun: bool, message_max: usize) -> Result<(Message<'_>, usize), Stop> {
    let mut rest = Rest(input);
    let message = match (rest.word()?, from) {
        (HUB_MAGIC, Peer::Hub) | (CLIENT_MAGIC, Peer::Client) if !begun => Message::Hello { version: rest.word()? },
        (word, Peer::Hub) if !begun => return Err(Stop::Wrong(DecodeError::Magic(word))),
        (PUBLISH, _) => {
            let channel = rest.text()?;
            let len = rest.word()?;
            if len as usize > message_max {
                return Err(Stop::Wrong(DecodeError::MessageTooLong { len, max: message_max }));
            }
            let payload = rest.bytes(len as usize)?;
            let wire = &input[..input.len() - rest.0.len()];
            match str::from_utf8(channel) {
                _ if channel.len() > CHANNEL_MAX => Message::Unusable(Unusable::ChannelTooLong { len: channel.len() }),
                Ok(channel) => Message::Publish { channel, payload, wire },
                Err(_) => Message::Unusable(Unusable::NotUtf8),
            }
        }
        (SUBSCRIBE, Peer::Client) => str::from_utf8(rest.text()?).map_or(NOT_UTF8, Message::Subscribe),
        (UNSUBSCRIBE, Peer::Client) => str::from_utf8(rest.text()?).map_or(NOT_UTF8, Message::Unsubscribe),
        (word, _) => return Err(Stop::Wrong(DecodeError::Type(word))),
    };
    Ok((message, input.len() - rest.0.len()))
}

const NOT_UTF8: Message<'_> = Message::Unusable(Unusable::NotUtf8);

/// Remaining bytes.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn bytes(&mut self, len: usize) -> Result<&'a [u8], Stop> {
        let (taken, rest) = self.0.split_at_checked(len).ok_or(Stop::More)?;
        self.0 = rest;
        Ok(taken)
    }

    fn word(&mut self) -> Result<u32, Stop> {
        let (word, rest) = self.0.split_first_chunk().ok_or(Stop::More)?;
        self.0 = rest;
        Ok(u32::from_be_bytes(*word))
    }

    fn text(&mut self) -> Result<&'a [u8], Stop> {
        match self.word()? {
            len if len as usize > TEXT_MAX => Err(Stop::Wrong(DecodeError::TextTooLong { len })),
            len => self.bytes(len as usize),
        }
    }
}

/// First bytes sent by each end.
#[must_use]
pub fn hello(from: Peer) -> [u8; 8] {
    let magic = match from {
        Peer::Client => CLIENT_MAGIC,
        Peer::Hub => HUB_MAGIC,
    };
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&magic.to_be_bytes());
    bytes[4..].copy_from_slice(&VERSION.to_be_bytes());
    bytes
}

/// Header before the payload of a published message; `channel` is at most [`CHANNEL_MAX`] bytes, the payload less than
/// 4 GiB.
#[must_use]
pub fn publish_header(channel: &str, payload_len: usize) -> Vec<u8> {
    let mut out = text(PUBLISH, channel);
    out.extend_from_slice(&(payload_len as u32).to_be_bytes());
    out
}

/// Asks for the channels of an expression of at most [`TEXT_MAX`] bytes.
#[must_use]
pub fn subscribe(pattern: &str) -> Vec<u8> {
    text(SUBSCRIBE, pattern)
}

/// Takes that back.
#[must_use]
pub fn unsubscribe(pattern: &str) -> Vec<u8> {
    text(UNSUBSCRIBE, pattern)
}

fn text(kind: u32, text: &str) -> Vec<u8> {
    let mut out = Vec::with_capacity(12 + text.len());
    out.extend_from_slice(&kind.to_be_bytes());
    out.extend_from_slice(&(text.len() as u32).to_be_bytes());
    out.extend_from_slice(text.as_bytes());
    out
}

#[cfg(test)]
mod tests;
