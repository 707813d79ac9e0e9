//! Format of the connection: records with a length in front, and what is in them. All numbers big-endian.
//!
//! | record | bytes |
//! |---|---|
//! | hello, of the connector | length 4, [`MAGIC`] 16, nonce 32 |
//! | answer, of the listener | length 4, nonce 32, proof 32 |
//! | proof, of the connector | length 4, proof 32 |
//! | then, both ways | length 4 (of the body), body, tag 32 |
//!
//! | body | bytes |
//! |---|---|
//! | message | 1, time of publication 8, length of the channel's name 1, name, payload |
//! | ping | 2, time of sending 8 |
//! | pong | 3, time of the ping 8, of its reception 8, of this answer 8, wall clock at the answer 8 |
//! | modules | 4, number 1, and for each: length of the name 1, name, 1 if it works, else 0 |
//!
//! Times are nanoseconds on the monotonic clock of the computer that writes them; the wall clock since the UNIX epoch.

use crate::auth::TAG_LEN;

/// Begins a connection: protocol and version.
pub const MAGIC: &[u8; 16] = b"advee bridge 1\r\n";
/// Maximum length of a message's payload, bytes: the largest message that a module of the robot accepts.
pub const PAYLOAD_MAX: usize = 256 << 10;
/// Maximum length of a body, bytes.
pub const BODY_MAX: usize = PAYLOAD_MAX + 128;
/// Maximum length of a record before the session is open, bytes.
pub const HANDSHAKE_MAX: usize = 64;
/// Maximum length of a channel's name, bytes, as of LCM.
pub const CHANNEL_MAX: usize = 63;
/// Maximum number of modules in a body.
pub const MODULES_MAX: usize = 64;

const MESSAGE: u8 = 1;
const PING: u8 = 2;
const PONG: u8 = 3;
const MODULES: u8 = 4;

/// Why bytes are no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireError {
    /// A length of zero, or beyond the maximum.
    Length {
        /// Length in the record, bytes.
        len: usize,
        /// Maximum at this place, bytes.
        max: usize,
    },
    /// A body of no kind, or that does not end where it should, or a name that is no name.
    Body,
}

/// Divides a stream of bytes into records. What waits is at most one incomplete record.
#[derive(Debug, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    /// Number of bytes of `buffer` that were returned.
    taken: usize,
}

impl Decoder {
    /// Appends received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.taken);
        self.taken = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// The next record without its length, with the `tag` bytes that follow its body; `None`: not complete yet.
    ///
    /// # Errors
    /// The length is zero or above `max`. Nothing after that can be read.
    pub fn next_record(&mut self, max: usize, tag: usize) -> Result<Option<Vec<u8>>, WireError> {
        let Some((length, rest)) = self.buffer[self.taken..].split_first_chunk::<4>() else { return Ok(None) };
        let len = u32::from_be_bytes(*length) as usize;
        if !(1..=max).contains(&len) {
            return Err(WireError::Length { len, max });
        }
        let record = rest.get(..len + tag).map(<[u8]>::to_vec);
        self.taken += record.as_ref().map_or(0, |record| 4 + record.len());
        Ok(record)
    }

    /// Number of bytes that wait for the rest of their record.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.buffer.len() - self.taken
    }
}

/// Appends a record: length, body, tag.
pub fn record(out: &mut Vec<u8>, body: &[u8], tag: &[u8]) {
    out.extend((body.len() as u32).to_be_bytes());
    out.extend_from_slice(body);
    out.extend_from_slice(tag);
}

/// Number of bytes of a record with a body of this length.
#[must_use]
pub const fn record_len(body: usize) -> usize {
    4 + body + TAG_LEN
}

/// What a record of an open session holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Body<'a> {
    /// A message of the bus.
    Message {
        /// Time of its publication on the sender's bus, ns on the sender's monotonic clock.
        published: u64,
        /// Name of the channel: 1 to [`CHANNEL_MAX`] bytes.
        channel: &'a str,
        /// Encoded message, at most [`PAYLOAD_MAX`] bytes.
        payload: &'a [u8],
    },
    /// Sign of life, and a question for the time.
    Ping {
        /// Time of sending, ns.
        sent: u64,
    },
    /// Answer to a ping.
    Pong {
        /// [`Body::Ping`]'s time, on the clock of the end that asked, ns.
        sent: u64,
        /// Time of its reception, ns on the clock of the end that answers.
        received: u64,
        /// Time of the answer, likewise.
        answered: u64,
        /// Wall clock at the answer, ns since the UNIX epoch.
        wall: u64,
    },
    /// Modules that the sender's watchdog guards, and whether each works.
    Modules(Vec<(&'a str, bool)>),
}

impl<'a> Body<'a> {
    /// Appends the bytes of the body. Names that are too long, and what exceeds the maxima, are to be left out by the
    /// caller: [`Body::is_sendable`].
    pub fn encode(&self, out: &mut Vec<u8>) {
        let numbers = |out: &mut Vec<u8>, numbers: &[u64]| {
            numbers.iter().for_each(|number| out.extend(number.to_be_bytes()));
        };
        match self {
            Self::Message { published, channel, payload } => {
                out.push(MESSAGE);
                numbers(out, &[*published]);
                out.push(channel.len() as u8);
                out.extend_from_slice(channel.as_bytes());
                out.extend_from_slice(payload);
            }
            Self::Ping { sent } => {
                out.push(PING);
                numbers(out, &[*sent]);
            }
            Self::Pong { sent, received, answered, wall } => {
                out.push(PONG);
                numbers(out, &[*sent, *received, *answered, *wall]);
            }
            Self::Modules(modules) => {
                out.extend([MODULES, modules.len() as u8]);
                for (name, works) in modules {
                    out.push(name.len() as u8);
                    out.extend_from_slice(name.as_bytes());
                    out.push(u8::from(*works));
                }
            }
        }
    }

    /// True if it is within the maxima.
    #[must_use]
    pub fn is_sendable(&self) -> bool {
        match self {
            Self::Message { channel, payload, .. } => is_name(channel) && payload.len() <= PAYLOAD_MAX,
            Self::Ping { .. } | Self::Pong { .. } => true,
            Self::Modules(modules) => modules.len() <= MODULES_MAX && modules.iter().all(|(name, _)| is_name(name)),
        }
    }

    /// Reads the bytes of a body, all of them.
    ///
    /// # Errors
    /// They are not exactly one body within the maxima.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, WireError> {
        let mut rest = Reader(bytes);
        let body = match rest.byte()? {
            MESSAGE => {
                let (published, channel) = (rest.number()?, rest.name()?);
                Self::Message { published, channel, payload: std::mem::take(&mut rest.0) }
            }
            PING => Self::Ping { sent: rest.number()? },
            PONG => Self::Pong {
                sent: rest.number()?,
                received: rest.number()?,
                answered: rest.number()?,
                wall: rest.number()?,
            },
            MODULES => {
                let count = rest.byte()?;
                let module = |_| {
                    let name = rest.name()?;
                    match rest.byte()? {
                        works @ 0..=1 => Ok((name, works == 1)),
                        _ => Err(WireError::Body),
                    }
                };
                Self::Modules((0..count).map(module).collect::<Result<_, _>>()?)
            }
            _ => return Err(WireError::Body),
        };
        if rest.0.is_empty() && body.is_sendable() { Ok(body) } else { Err(WireError::Body) }
    }
}

/// True for a name that a channel or a module may have: 1 to [`CHANNEL_MAX`] printable ASCII characters.
fn is_name(name: &str) -> bool {
    (1..=CHANNEL_MAX).contains(&name.len()) && name.bytes().all(|byte| byte.is_ascii_graphic())
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, len: usize) -> Result<&'a [u8], WireError> {
        let (taken, rest) = self.0.split_at_checked(len).ok_or(WireError::Body)?;
        self.0 = rest;
        Ok(taken)
    }

    fn byte(&mut self) -> Result<u8, WireError> {
        self.take(1).map(|bytes| bytes[0])
    }

    fn number(&mut self) -> Result<u64, WireError> {
        let bytes = self.take(8)?;
        Ok(bytes.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    fn name(&mut self) -> Result<&'a str, WireError> {
        let len = self.byte()?;
        std::str::from_utf8(self.take(usize::from(len))?).map_err(|_| WireError::Body)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(body: &Body<'_>) -> Vec<u8> {
        let mut bytes = Vec::new();
        body.encode(&mut bytes);
        bytes
    }

    #[test]
    fn bodies_are_read_as_they_are_written() {
        let modules = vec![("camera", true), ("planner", false)];
        for body in [
            Body::Message { published: 7 << 40, channel: "HL_DATA_ACTION", payload: b"payload" },
            Body::Message { published: 0, channel: "A", payload: b"" },
            Body::Ping { sent: u64::MAX },
            Body::Pong { sent: 1, received: 2, answered: 3, wall: 4 },
            Body::Modules(modules),
            Body::Modules(Vec::new()),
        ] {
            assert_eq!(Body::decode(&bytes(&body)), Ok(body));
        }
    }

    #[test]
    fn bytes_that_are_no_body_are_refused() {
        let message = |channel| bytes(&Body::Message { published: 1, channel, payload: b"" });
        let long = "X".repeat(64);
        let ping = bytes(&Body::Ping { sent: 1 });
        for wrong in [
            vec![],
            vec![0],
            vec![5, 0, 0],
            ping[..8].to_vec(),
            [&ping[..], &[0]].concat(),
            message(""),
            message(&long),
            message("A B"),
            vec![MODULES, 2, 1, b'a', 1],
            vec![MODULES, 1, 1, b'a', 2],
            vec![MESSAGE, 0, 0, 0, 0, 0, 0, 0, 1, 9, b'A'],
        ] {
            assert_eq!(Body::decode(&wrong), Err(WireError::Body), "{wrong:?}");
        }
        let payload = vec![0; PAYLOAD_MAX + 1];
        assert!(!Body::Message { published: 1, channel: "A", payload: &payload }.is_sendable());
    }

    #[test]
    fn a_stream_comes_in_any_pieces_and_a_wrong_length_ends_it() {
        let mut stream = Vec::new();
        record(&mut stream, b"first", b"tt");
        record(&mut stream, b"second", b"uu");
        for size in 1..stream.len() {
            let (mut decoder, mut records) = (Decoder::default(), Vec::new());
            for piece in stream.chunks(size) {
                decoder.push(piece);
                while let Some(record) = decoder.next_record(16, 2).unwrap() {
                    records.push(record);
                }
            }
            assert_eq!(records, [b"firsttt".to_vec(), b"seconduu".to_vec()], "pieces of {size}");
            assert_eq!(decoder.waiting(), 0);
        }
        for len in [0, 17, usize::from(u16::MAX)] {
            let mut decoder = Decoder::default();
            decoder.push(&(len as u32).to_be_bytes());
            assert_eq!(decoder.next_record(16, 2), Err(WireError::Length { len, max: 16 }));
        }
    }
}
