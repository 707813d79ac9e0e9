//! Large messages from their fragments, in any order, within limits on memory and time.
//!
//! Every sender can announce what it likes, so: memory is taken as data comes, not as announced; a fragment that came
//! twice counts once; what is given up is counted. Once fragment 0 has named a channel that nobody wants, the rest of
//! the message costs nothing but a look at its header.

use crate::udpm::{self, DATAGRAM_MAX, Datagram, Fragment, MESSAGE_MAX};
use core::net::SocketAddrV4;
use core::ops::Range;
use std::mem;

/// What incomplete messages may cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// How many there may be at a time.
    pub messages: usize,
    /// How many bytes all of them may hold; at least one message of [`MESSAGE_MAX`] and a datagram fit.
    pub bytes: usize,
    /// How long after its last fragment a message is given up, ns.
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

    /// Where a datagram is put.
    pub fn room(&mut self) -> &mut [u8] {
        &mut self.0[..DATAGRAM_MAX]
    }

    /// What was put there.
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

/// What became of a fragment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It was the last one missing: the message is in [`Reassembly::complete`].
    Complete,
    /// Others are missing.
    Incomplete,
    /// It says that nobody wants its message.
    Unwanted,
    /// It belongs to a message that is complete, unwanted or given up, or it came twice.
    Needless,
}

/// A message, of which fragments are missing or none is.
#[derive(Debug)]
struct Partial {
    from: SocketAddrV4,
    sequence: u32,
    total: usize,
    channel: Option<String>,
    buffer: Buffer,
    /// Where the payload begins in the buffer.
    start: usize,
    /// A bit for each fragment: of the first 64, and of the others.
    seen: (u64, Vec<u64>),
    count: u16,
    missing: u16,
    /// Payload bytes that came.
    held: usize,
    /// When its last fragment came.
    touched: i64,
}

impl Partial {
    /// Whether it announces the same message.
    fn agrees(&self, fragment: &Fragment<'_>) -> bool {
        (self.total, self.count) == (fragment.total as usize, fragment.count)
    }

    /// Puts a piece where it belongs; [`Fragment`] has made sure that it lies within the message.
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
    /// Its channel.
    pub channel: &'a str,
    /// Its payload.
    pub payload: &'a [u8],
}

/// How many messages are remembered as done.
const DONE_MAX: usize = 64;
/// How many buffers wait to be used again, each of at most [`SPARE_SIZE`] bytes.
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

    /// Takes the fragment that the first `len` bytes of `datagram` are, received at `at` (ns, on any scale). The first
    /// one of a message takes the buffer over and leaves another one there.
    pub fn insert(
        &mut self,
        at: i64,
        from: SocketAddrV4,
        datagram: &mut Buffer,
        len: usize,
        wants: impl FnOnce(&str) -> bool,
    ) -> Outcome {
        self.expire(at);
        let Ok(Datagram::Fragment(fragment)) = udpm::decode(&datagram.0[..len]) else { return Outcome::Needless };
        let key = (from, fragment.sequence);
        let known = self.partials.iter().position(|partial| (partial.from, partial.sequence) == key);
        if known.is_none() && self.done.contains(key) {
            return Outcome::Needless;
        }
        if fragment.channel.is_some_and(|channel| !wants(channel)) {
            if let Some(index) = known {
                let partial = self.partials.swap_remove(index);
                self.recycle(partial.buffer);
            }
            self.done.push(key);
            return Outcome::Unwanted;
        }
        // Another message under the same number: its sender has begun anew.
        let other = known.filter(|&index| !self.partials[index].agrees(&fragment));
        let Fragment { sequence, total, count, number, .. } = fragment;
        let channel = fragment.channel.map(String::from);
        let (data, place) = (len - fragment.data.len()..len, fragment.offset as usize);
        if let Some(index) = other {
            self.give_up(index);
        }
        let index = match known {
            Some(index) if other.is_none() => {
                let partial = &mut self.partials[index];
                if !partial.note(number) {
                    return Outcome::Needless;
                }
                partial.put(place, &datagram.0[data.clone()]);
                index
            }
            _ => {
                let mut partial = Partial {
                    from,
                    sequence,
                    total: total as usize,
                    channel: None,
                    buffer: self.spare.pop().unwrap_or_default(),
                    start: data.start,
                    seen: (0, vec![0; usize::from(count).saturating_sub(1) / 64]),
                    count,
                    missing: count,
                    held: 0,
                    touched: at,
                };
                partial.note(number);
                match place {
                    0 => mem::swap(&mut partial.buffer, datagram),
                    _ => partial.put(place, &datagram.0[data.clone()]),
                }
                self.partials.push(partial);
                self.partials.len() - 1
            }
        };
        let partial = &mut self.partials[index];
        partial.channel = channel.or_else(|| partial.channel.take());
        partial.held += data.len();
        partial.touched = at;
        if partial.missing > 0 {
            self.keep_limits();
            return Outcome::Incomplete;
        }
        self.done.push(key);
        let partial = self.partials.swap_remove(index);
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

    /// How many messages were given up: too old, or too much beside others.
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
