//! Event logs, as `lcm-logger` writes and `lcm-logplayer` reads them. Opens nothing: works on any
//! [`Read`], [`Write`](io::Write), [`Seek`].
//!
//! A log is one event after another; no head, no index, no checksum. All integers are big-endian.
//! Source: LCM 1.5.3, `lcm/eventlog.c`, `docs/content/log-file-format.md`.
//!
//! | offset | bytes | field |
//! |---|---|---|
//! | 0 | 4 | [`SYNC`] |
//! | 4 | 8 | number of the event, from 0 |
//! | 12 | 8 | when it was received, µs since 1970 |
//! | 20 | 4 | length of the channel, 1 to [`CHANNEL_MAX`] |
//! | 24 | 4 | length of the data, not negative |
//! | 28 | | channel without NUL, data |
//! The word [`SYNC`] may occur in data too. An event is valid if its lengths are possible and it is followed by the end
//! of the file or the next event. Invalid bytes are skipped up to the next event, and counted; the official reader
//! stops there. An event truncated by the end of the file ends the log.
//! Appending continues the numbers of the log. The official library restarts at 0, so numbers may repeat in its files.

mod writer;

use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
pub use writer::{WriteError, Writer};

/// First four bytes of an event.
pub const SYNC: u32 = 0xEDA1_DA01;
/// Bytes before the channel.
pub const HEADER: usize = 28;
/// Longest channel in a log; on the bus they are shorter.
pub const CHANNEL_MAX: usize = 999;
/// Default limit of an event's data in a [`Reader`]: the longest message.
pub const DATA_MAX: usize = crate::udpm::MESSAGE_MAX as usize;

/// Least number of bytes of a read.
const CHUNK: usize = 64 << 10;
/// Distance from the end at which the search for the last event begins, bytes.
const TAIL: u64 = 64 << 10;

/// An event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event<'a> {
    /// Number; increases by one, unless the official library has appended to the log.
    pub number: i64,
    /// Time of reception, µs since 1970.
    pub timestamp_us: i64,
    /// The message's channel.
    pub channel: &'a str,
    /// The message's payload.
    pub payload: &'a [u8],
}

/// Counters of bytes that were no events; they only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Events read.
    pub events: u64,
    /// Bytes that belong to no event.
    pub skipped: u64,
    /// Events skipped because their channel is not UTF-8.
    pub unusable: u64,
    /// Bytes of a last event that is cut short.
    pub truncated: u64,
}

/// End of a log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tail {
    /// The byte after the last whole event.
    pub end: u64,
    /// Number of that event; `None` in a log without events.
    pub number: Option<i64>,
}

/// Reads a log.
///
/// ```
/// # use lcm::eventlog::{Reader, Writer};
/// let mut log = Writer::new(Vec::new());
/// log.write(1_700_000_000_000_000, "LL_DATA_ODO", b"payload")?;
/// let bytes = log.into_inner();
/// let mut log = Reader::new(&bytes[..]);
/// while let Some(event) = log.next_event()? {
///     assert_eq!((event.number, event.channel, event.payload), (0, "LL_DATA_ODO", &b"payload"[..]));
/// }
/// # Ok::<(), lcm::eventlog::WriteError>(())
/// ```
///
/// It holds at most one event, of which the lengths are possible and the bytes are there, and what was read with it.
#[derive(Debug)]
pub struct Reader<R> {
    inner: R,
    data_max: usize,
    /// Unread bytes are `start..end`; `buffer[0]` is byte `offset` of the log.
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    offset: u64,
    /// True at the end of the input.
    eof: bool,
    /// Length of the event at `start`, if it has been found and not taken yet.
    found: Option<usize>,
    /// End of the last event, and start of the truncated remainder after it.
    event_end: u64,
    cut: Option<u64>,
    stats: Stats,
}

impl<R: Read> Reader<R> {
    /// Reads from the current position of `inner`, in large pieces: it need not be buffered.
    pub fn new(inner: R) -> Self {
        Self::with_limit(inner, DATA_MAX)
    }

    /// A reader with another limit: an event with more than `data_max` bytes of data is invalid.
    pub fn with_limit(inner: R, data_max: usize) -> Self {
        Self {
            inner,
            data_max,
            buffer: Vec::new(),
            start: 0,
            end: 0,
            offset: 0,
            eof: false,
            found: None,
            event_end: 0,
            cut: None,
            stats: Stats::default(),
        }
    }

    /// Takes the next event; `None` at the end of the log.
    ///
    /// # Errors
    /// Reading failed; can be tried again.
    pub fn next_event(&mut self) -> io::Result<Option<Event<'_>>> {
        let Some(len) = self.locate()? else {
            return Ok(None);
        };
        self.found = None;
        self.stats.events += 1;
        self.start += len;
        self.event_end = self.position();
        Ok(event(&self.buffer[self.start - len..self.start]))
    }

    /// The event that [`Reader::next_event`] will give.
    ///
    /// # Errors
    /// As there.
    pub fn peek(&mut self) -> io::Result<Option<Event<'_>>> {
        let Some(len) = self.locate()? else {
            return Ok(None);
        };
        Ok(event(&self.buffer[self.start..self.start + len]))
    }

    /// Byte of the log at which the next event begins, or is searched for; 0 is the initial position of `inner`.
    pub fn position(&self) -> u64 {
        self.offset + self.start as u64
    }

    /// Counters so far.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Finds the next event that can be used, and gives its length.
    fn locate(&mut self) -> io::Result<Option<usize>> {
        if self.found.is_some() {
            return Ok(self.found);
        }
        loop {
            if !self.fill(HEADER)? {
                self.finish();
                return Ok(None);
            }
            let Some(len) = self.event_len() else {
                self.start += self.to_next_sync();
                continue;
            };
            if !self.fill(len)? {
                self.cut.get_or_insert(self.position());
                self.start += 1;
                continue;
            }
            // A sync word follows, or the end, or too few bytes to decide.
            if self.fill(len + 4)? && self.word(len) != SYNC {
                self.start += 1;
                continue;
            }
            self.stats.skipped += self.position() - self.event_end;
            self.event_end = self.position();
            self.cut = None;
            if event(&self.buffer[self.start..self.start + len]).is_some() {
                self.found = Some(len);
                return Ok(self.found);
            }
            self.stats.unusable += 1;
            self.start += len;
            self.event_end = self.position();
        }
    }

    /// The end: what lies behind the last event is an event cut short, or nothing.
    fn finish(&mut self) {
        let rest = &self.buffer[self.start..self.end];
        let end = self.offset + self.end as u64;
        let begins = |tail: &[u8]| tail.iter().zip(SYNC.to_be_bytes()).all(|(&byte, sync)| byte == sync);
        if let Some(at) = (0..rest.len()).find(|&at| begins(&rest[at..])) {
            self.cut.get_or_insert(self.position() + at as u64);
        }
        let cut = self.cut.take().unwrap_or(end);
        self.stats.skipped += cut - self.event_end;
        self.stats.truncated += end - cut;
        self.start = self.end;
        self.event_end = end;
    }

    /// The length of the event at `start`, where a header is buffered; `None`: none begins there.
    fn event_len(&self) -> Option<usize> {
        if self.word(0) != SYNC {
            return None;
        }
        let channel = usize::try_from(self.word(20)).ok().filter(|len| (1..=CHANNEL_MAX).contains(len))?;
        let data = usize::try_from(self.word(24) as i32).ok().filter(|&len| len <= self.data_max)?;
        Some(HEADER + channel + data)
    }

    /// Distance from `start` to the next possible sync word, at least 1.
    fn to_next_sync(&self) -> usize {
        let [first, ..] = SYNC.to_be_bytes();
        let rest = &self.buffer[self.start + 1..self.end];
        1 + rest.iter().position(|&byte| byte == first).unwrap_or(rest.len())
    }

    fn word(&self, at: usize) -> u32 {
        word(&self.buffer[self.start..self.end], at)
    }

    /// Reads until `len` bytes are buffered from `start` on; false: the log ends before.
    fn fill(&mut self, len: usize) -> io::Result<bool> {
        while self.end - self.start < len {
            if self.eof {
                return Ok(false);
            }
            // Compacts only when half of the buffer is used up: each byte is moved at most once.
            if self.start >= self.end - self.start {
                self.buffer.copy_within(self.start..self.end, 0);
                self.offset += self.start as u64;
                (self.start, self.end) = (0, self.end - self.start);
            }
            if self.buffer.len() - self.end < CHUNK {
                self.buffer.resize(self.end + CHUNK, 0);
            }
            match self.inner.read(&mut self.buffer[self.end..]) {
                Ok(0) => self.eof = true,
                Ok(read) => self.end += read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(true)
    }
}

impl<R: Read + Seek> Reader<R> {
    /// Continues with the first event of `timestamp_us` (µs since 1970) or later, found by bisection; in a log whose
    /// timestamps are not monotonic, with one after which they are later.
    ///
    /// # Errors
    /// Reading or seeking failed; the position is undefined then.
    pub fn seek_to_timestamp(&mut self, timestamp_us: i64) -> io::Result<()> {
        let stats = self.stats;
        let (mut low, mut high) = (0, self.inner.seek(SeekFrom::End(0))?);
        while low < high {
            let middle = low + (high - low) / 2;
            self.restart(middle)?;
            match self.next_event()? {
                Some(event) if event.timestamp_us < timestamp_us => low = self.position(),
                _ => high = middle,
            }
        }
        self.restart(low)?;
        self.stats = stats;
        Ok(())
    }

    /// End of the log, read from behind: the duration does not depend on its length. Reading continues at the start.
    ///
    /// # Errors
    /// Reading or seeking failed; the position is undefined then.
    pub fn tail(&mut self) -> io::Result<Tail> {
        let stats = self.stats;
        let len = self.inner.seek(SeekFrom::End(0))?;
        let mut tail = Tail::default();
        let mut window = TAIL;
        loop {
            let from = len.saturating_sub(window);
            self.restart(from)?;
            while let Some(event) = self.next_event()? {
                tail.number = Some(event.number);
                tail.end = self.position();
            }
            if tail.number.is_some() || from == 0 {
                break;
            }
            window = window.saturating_mul(8);
        }
        self.restart(0)?;
        self.stats = stats;
        Ok(tail)
    }

    fn restart(&mut self, position: u64) -> io::Result<()> {
        self.inner.seek(SeekFrom::Start(position))?;
        (self.start, self.end, self.offset, self.event_end) = (0, 0, position, position);
        (self.eof, self.found, self.cut) = (false, None, None);
        Ok(())
    }
}

/// The event that `bytes` are, of which the lengths were looked at; `None`: its channel is not UTF-8.
fn event(bytes: &[u8]) -> Option<Event<'_>> {
    let long = |range: Range<usize>| bytes[range].iter().fold(0, |value, &byte| value << 8 | i64::from(byte));
    let (channel, payload) = bytes[HEADER..].split_at(word(bytes, 20) as usize);
    let channel = str::from_utf8(channel).ok()?;
    Some(Event { number: long(4..12), timestamp_us: long(12..20), channel, payload })
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4].iter().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

#[cfg(test)]
mod tests;
