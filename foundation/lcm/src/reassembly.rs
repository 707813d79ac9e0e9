//! Large messages from their fragments, in any order, within limits on memory and time.
//! Senders may announce anything, so memory is allocated as data arrives, not as announced; a duplicate fragment counts
//! once; dropped messages are counted. Once fragment 0 has named an unwanted channel, the rest of the message costs
//! only a look at its header.

use crate::udpm::{self, DATAGRAM_MAX, Datagram, MESSAGE_MAX};
use core::net::SocketAddrV4;
use core::ops::Range;
use std::mem;

/// Limits of incomplete messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Maximum number of them.
    pub messages: usize,
    /// Number of bytes all of them may hold; at least one message of [`MESSAGE_MAX`] and a datagram fit.
    pub bytes: usize,
    /// Time after its last fragment at which a message is dropped, ns.
    pub age_ns: i64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { messages: 64, bytes: MESSAGE_MAX as usize + (16 << 20), age_ns: 500_000_000 }
    }
}

/// Room for a datagram, which may become room for a whole message.
#[derive(Debug)]
pub struct Buffer(Vec<u8>);

impl Buffer {
    /// Room for two datagrams, so that a message a little larger than one needs no other.
    const SIZE: usize = 2 * DATAGRAM_MAX;

    /// Buffer for the next datagram.
    pub fn room(&mut self) -> &mut [u8] {
        &mut self.0[..DATAGRAM_MAX]
    }

    /// Content of the buffer.
    #[must_use]
    pub fn bytes(&self, range: Range<usize>) -> &[u8] {
        &self.0[range]
    }

    /// Makes it at least `end` bytes long, of at most `max`. What was never written costs no memory, however far away
    /// `end` is.
    fn grow(&mut self, end: usize, max: usize) {
        let len = self.0.len();
        if end <= len {
        } else if end <= 2 * len {
            self.0.resize((2 * len).min(max).max(end), 0);
        } else {
            // The system gives zeroed memory page by page as it is written; `resize` would write all of it.
            let mut whole = vec![0; max];
            whole[..len].copy_from_slice(&self.0);
            self.0 = whole;
        }
    }
}

impl Default for Buffer {
    fn default() -> Self {
        Self(vec![0; Self::SIZE])
    }
}

/// Result of a fragment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Completes its message: it is in [`Reassembly::complete`].
    Complete,
    /// Others are missing.
    Incomplete,
    /// Belongs to a message on an unwanted channel, which it names.
    Unwanted,
    /// Belongs to a message that is complete, unwanted or dropped, or is a duplicate.
    Needless,
}

/// A fragment of a wanted message; its data are still in the datagram.
struct Piece {
    /// Sender and sequence number of the message.
    key: (SocketAddrV4, u32),
    /// Index of the message with this key, where there is one.
    known: Option<usize>,
    /// Payload bytes and fragments of the message.
    total: usize,
    count: u16,
    number: u16,
    /// Channel of the message, in its fragment 0.
    channel: Option<String>,
    /// Bytes of the datagram that are data, and their place in the payload.
    data: Range<usize>,
    offset: usize,
}

/// A message, of which fragments are missing or none is.
#[derive(Debug)]
struct Partial {
    from: SocketAddrV4,
    sequence: u32,
    total: usize,
    channel: Option<String>,
    buffer: Buffer,
    /// Start of the payload in the buffer.
    start: usize,
    /// A bit for each fragment: of the first 64, and of the others.
    seen: (u64, Vec<u64>),
    count: u16,
    missing: u16,
    /// Payload bytes that came.
    held: usize,
    /// Time when its last fragment came.
    touched: i64,
}

impl Partial {
    /// Sender and sequence number.
    fn key(&self) -> (SocketAddrV4, u32) {
        (self.from, self.sequence)
    }

    /// True if the piece announces the same message.
    fn agrees(&self, piece: &Piece) -> bool {
        (self.total, self.count) == (piece.total, piece.count)
    }

    /// Puts a piece where it belongs; [`udpm::Fragment`] has made sure that it lies within the message.
    fn put(&mut self, place: usize, data: &[u8]) {
        let place = self.start + place;
        self.buffer.grow(place + data.len(), self.start + self.total);
        self.buffer.0[place..place + data.len()].copy_from_slice(data);
    }

    /// Notes a fragment; false if it was there before.
    fn note(&mut self, number: u16) -> bool {
        let word = match usize::from(number / 64).checked_sub(1) {
            None => &mut self.seen.0,
            Some(word) => &mut self.seen.1[word],
        };
        let bit = 1 << (number % 64);
        let new = *word & bit == 0;
        *word |= bit;
        self.missing -= u16::from(new);
        new
    }
}

/// A message that is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Complete<'a> {
    /// Channel.
    pub channel: &'a str,
    /// Payload.
    pub payload: &'a [u8],
}

/// Maximum number of messages that are remembered as done.
const DONE_MAX: usize = 64;
/// Maximum number of buffers kept for reuse, each of at most [`SPARE_SIZE`] bytes.
const SPARE_MAX: usize = 2;
const SPARE_SIZE: usize = 1 << 20;

/// Messages that need no more fragments, so that late ones begin no new message; the oldest is forgotten. Sequence
/// numbers apart from senders: the look for one is done sixteen at a time.
#[derive(Debug, Default)]
struct Done {
    sequences: Vec<u32>,
    from: Vec<SocketAddrV4>,
    next: usize,
}

impl Done {
    fn contains(&self, (from, sequence): (SocketAddrV4, u32)) -> bool {
        self.sequences.contains(&sequence)
            && self.sequences.iter().zip(&self.from).any(|(known, sender)| (*known, *sender) == (sequence, from))
    }

    fn push(&mut self, (from, sequence): (SocketAddrV4, u32)) {
        if self.sequences.len() < DONE_MAX {
            self.sequences.push(sequence);
            self.from.push(from);
        } else {
            (self.sequences[self.next], self.from[self.next]) = (sequence, from);
            self.next = (self.next + 1) % DONE_MAX;
        }
    }
}

/// Incomplete messages.
#[derive(Debug, Default)]
pub struct Reassembly {
    limits: Limits,
    partials: Vec<Partial>,
    complete: Option<Partial>,
    done: Done,
    spare: Vec<Buffer>,
    given_up: u64,
}

impl Reassembly {
    /// Within other limits than the usual.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, ..Self::default() }
    }

    /// Takes the fragment in the first `len` bytes of `datagram`, received at `at` (ns, on any scale). The first one of
    /// a message takes the buffer over and leaves another one.
    pub fn insert(
        &mut self,
        at: i64,
        from: SocketAddrV4,
        datagram: &mut Buffer,
        len: usize,
        wants: impl FnOnce(&str) -> bool,
    ) -> Outcome {
        self.expire(at);
        let piece = match self.validate(from, &datagram.0[..len], wants) {
            Ok(piece) => piece,
            Err(outcome) => return outcome,
        };
        let Some(index) = self.place(at, piece, datagram) else { return Outcome::Needless };
        if self.partials[index].missing > 0 {
            self.keep_limits();
            return Outcome::Incomplete;
        }
        self.finish(index)
    }

    /// Checks that a datagram is a fragment of a message that is wanted and not done; else what it is.
    fn validate(
        &mut self,
        from: SocketAddrV4,
        datagram: &[u8],
        wants: impl FnOnce(&str) -> bool,
    ) -> Result<Piece, Outcome> {
        let Ok(Datagram::Fragment(fragment)) = udpm::decode(datagram) else { return Err(Outcome::Needless) };
        let key = (from, fragment.sequence);
        let known = self.partials.iter().position(|partial| partial.key() == key);
        if known.is_none() && self.done.contains(key) {
            return Err(Outcome::Needless);
        }
        if fragment.channel.is_some_and(|channel| !wants(channel)) {
            if let Some(index) = known {
                let partial = self.partials.swap_remove(index);
                self.recycle(partial.buffer);
            }
            self.done.push(key);
            return Err(Outcome::Unwanted);
        }
        Ok(Piece {
            key,
            known,
            total: fragment.total as usize,
            count: fragment.count,
            number: fragment.number,
            channel: fragment.channel.map(String::from),
            data: datagram.len() - fragment.data.len()..datagram.len(),
            offset: fragment.offset as usize,
        })
    }

    /// Puts a piece into its message, which it may begin; the index of the message, or `None` for a duplicate.
    fn place(&mut self, at: i64, piece: Piece, datagram: &mut Buffer) -> Option<usize> {
        let index = match piece.known {
            Some(index) if self.partials[index].agrees(&piece) => {
                let partial = &mut self.partials[index];
                if !partial.note(piece.number) {
                    return None;
                }
                partial.put(piece.offset, &datagram.0[piece.data.clone()]);
                index
            }
            // Another message with the same number: its sender has restarted.
            Some(index) => {
                self.give_up(index);
                self.begin(&piece, datagram)
            }
            None => self.begin(&piece, datagram),
        };
        let partial = &mut self.partials[index];
        partial.channel = piece.channel.or_else(|| partial.channel.take());
        partial.held += piece.data.len();
        partial.touched = at;
        Some(index)
    }

    /// Begins a message with one of its pieces; its index.
    fn begin(&mut self, piece: &Piece, datagram: &mut Buffer) -> usize {
        let &Piece { key: (from, sequence), total, count, number, ref data, offset, .. } = piece;
        let mut partial = Partial {
            from,
            sequence,
            total,
            channel: None,
            buffer: self.spare.pop().unwrap_or_default(),
            start: data.start,
            seen: (0, vec![0; usize::from(count).saturating_sub(1) / 64]),
            count,
            missing: count,
            held: 0,
            touched: 0,
        };
        partial.note(number);
        match offset {
            0 => mem::swap(&mut partial.buffer, datagram),
            _ => partial.put(offset, &datagram.0[data.clone()]),
        }
        self.partials.push(partial);
        self.partials.len() - 1
    }

    /// Completes a message of which all fragments have come.
    fn finish(&mut self, index: usize) -> Outcome {
        let partial = self.partials.swap_remove(index);
        self.done.push(partial.key());
        if partial.held != partial.total || partial.buffer.0.len() < partial.start + partial.total {
            // All fragments that were announced, and yet not all bytes: some came more than once, others never.
            self.given_up += 1;
            self.recycle(partial.buffer);
            return Outcome::Needless;
        }
        if let Some(before) = self.complete.replace(partial) {
            self.recycle(before.buffer);
        }
        Outcome::Complete
    }

    /// The message that was completed last is no longer needed: its memory, which is in the cache, becomes `datagram`.
    pub fn reclaim(&mut self, datagram: &mut Buffer) {
        if let Some(mut complete) = self.complete.take() {
            if complete.buffer.0.len() <= SPARE_SIZE {
                mem::swap(&mut complete.buffer, datagram);
            }
            self.recycle(complete.buffer);
        }
    }

    /// The message that was completed last.
    #[must_use]
    pub fn complete(&self) -> Option<Complete<'_>> {
        let Partial { channel, buffer, start, total, .. } = self.complete.as_ref()?;
        Some(Complete { channel: channel.as_deref()?, payload: buffer.0.get(*start..start + total)? })
    }

    /// Number of messages that were given up: too old, or too much beside others.
    #[must_use]
    pub fn given_up(&self) -> u64 {
        self.given_up
    }

    /// Bytes that incomplete messages hold.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.partials.iter().map(|partial| partial.buffer.0.len()).sum()
    }

    fn expire(&mut self, at: i64) {
        let age = self.limits.age_ns;
        while let Some(old) = self.partials.iter().position(|partial| at.saturating_sub(partial.touched) > age) {
            self.give_up(old);
        }
    }

    fn keep_limits(&mut self) {
        while self.partials.len() > self.limits.messages
            || (self.bytes() > self.limits.bytes && self.partials.len() > 1)
        {
            let stalest = self.partials.iter().enumerate().min_by_key(|(_, partial)| partial.touched);
            let Some((index, _)) = stalest else { return };
            self.give_up(index);
        }
    }

    fn give_up(&mut self, index: usize) {
        let partial = self.partials.swap_remove(index);
        self.given_up += 1;
        self.recycle(partial.buffer);
    }

    fn recycle(&mut self, buffer: Buffer) {
        if self.spare.len() < SPARE_MAX && buffer.0.len() <= SPARE_SIZE {
            self.spare.push(buffer);
        }
    }
}

#[cfg(test)]
mod tests;
