//! Writing a log.

use super::{CHANNEL_MAX, Event, HEADER, Reader, SYNC};
use std::fmt;
use std::io::{self, Read, Seek, SeekFrom, Write};

/// Why an event was not written.
#[derive(Debug)]
pub enum WriteError {
    /// A channel of `len` bytes; a log holds 1 to [`CHANNEL_MAX`].
    Channel {
        /// Length in bytes.
        len: usize,
    },
    /// Data of `len` bytes, for which the log has no number.
    TooLong {
        /// Length in bytes.
        len: usize,
    },
    /// Writing failed; the log may contain a part of the event.
    Io(io::Error),
}

impl fmt::Display for WriteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Channel { len } => {
                write!(f, "event log: a channel name of {len} bytes; 1 to {CHANNEL_MAX} are possible")
            }
            Self::TooLong { len } => write!(f, "event log: a message of {len} bytes; at most {}", i32::MAX),
            Self::Io(error) => write!(f, "event log: {error}"),
        }
    }
}

impl std::error::Error for WriteError {}

impl From<io::Error> for WriteError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Writes a log, byte for byte as `lcm-logger` does. Each event is one call of [`Write::write_all`].
#[derive(Debug)]
pub struct Writer<W> {
    inner: W,
    next: i64,
    scratch: Vec<u8>,
}

impl<W: Write> Writer<W> {
    /// A new log; its first event has number 0.
    pub fn new(inner: W) -> Self {
        Self { inner, next: 0, scratch: Vec::new() }
    }

    /// Adds an event with the next number, received at `timestamp_us` (µs since 1970); returns the number.
    ///
    /// # Errors
    /// The channel or the data cannot be in a log: nothing was written; or writing failed.
    pub fn write(&mut self, timestamp_us: i64, channel: &str, payload: &[u8]) -> Result<i64, WriteError> {
        let number = self.next;
        self.write_event(&Event { number, timestamp_us, channel, payload })?;
        Ok(number)
    }

    /// Adds an event as it is, with its number, to copy from another log; numbers go on from there.
    ///
    /// # Errors
    /// As [`Writer::write`].
    pub fn write_event(&mut self, event: &Event<'_>) -> Result<(), WriteError> {
        let channel_len = event.channel.len();
        if !(1..=CHANNEL_MAX).contains(&channel_len) {
            return Err(WriteError::Channel { len: channel_len });
        }
        let data_len = event.payload.len();
        let data_word = i32::try_from(data_len).map_err(|_| WriteError::TooLong { len: data_len })?;
        let out = &mut self.scratch;
        out.clear();
        out.reserve(HEADER + channel_len + data_len);
        out.extend_from_slice(&SYNC.to_be_bytes());
        out.extend_from_slice(&event.number.to_be_bytes());
        out.extend_from_slice(&event.timestamp_us.to_be_bytes());
        out.extend_from_slice(&(channel_len as u32).to_be_bytes());
        out.extend_from_slice(&data_word.to_be_bytes());
        out.extend_from_slice(event.channel.as_bytes());
        out.extend_from_slice(event.payload);
        self.inner.write_all(out)?;
        self.next = event.number.wrapping_add(1);
        Ok(())
    }

    /// Hands on what `inner` has buffered.
    ///
    /// # Errors
    /// Writing failed.
    pub fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }

    /// Output.
    pub fn get_mut(&mut self) -> &mut W {
        &mut self.inner
    }

    /// Returns the output. Flushes nothing.
    pub fn into_inner(self) -> W {
        self.inner
    }
}

impl<W: Read + Write + Seek> Writer<W> {
    /// Continues after the last whole event of a log, with the next number; the official library restarts at 0.
    /// Truncated or other bytes after the last whole event are overwritten; where they are longer than what is written,
    /// the owner of the file truncates it first, at [`Tail::end`](super::Tail::end).
    ///
    /// # Errors
    /// Reading or seeking failed; or this is no log: there are bytes and no event, not even the beginning of one.
    pub fn append(mut inner: W) -> io::Result<Self> {
        let tail = Reader::new(&mut inner).tail()?;
        if tail.number.is_none() {
            let mut head = Vec::new();
            Read::by_ref(&mut inner).take(4).read_to_end(&mut head)?;
            if !SYNC.to_be_bytes().starts_with(&head) {
                return Err(io::Error::new(io::ErrorKind::InvalidData, "not an LCM event log"));
            }
        }
        inner.seek(SeekFrom::Start(tail.end))?;
        Ok(Self { inner, next: tail.number.map_or(0, |number| number.wrapping_add(1)), scratch: Vec::new() })
    }
}
