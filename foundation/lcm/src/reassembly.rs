//! Large messages from their fragments, in any order, within limits on memory and time. Senders may announce any size,
//! so memory is used for bytes that have arrived, never for the announced size: a fragment that continues the payload
//! is appended, one that came too early is kept apart until the gap before it is closed. A message that cannot be kept
//! is given up and counted, also if the system refuses an allocation. A duplicate fragment counts once. Once fragment 0
//! has named an unwanted channel, the rest of the message costs only a look at its header.

use crate::udpm::{self, DATAGRAM_MAX, Datagram, MESSAGE_MAX};
use core::net::SocketAddrV4;
use core::ops::Range;
use std::collections::BTreeMap;
use std::mem;

/// Limits of incomplete messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Maximum number of them.
    pub messages: usize,
    /// Number of bytes that all of them may hold; a larger message is refused.
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

    /// True if it can hold a datagram, and is not so large that it is freed.
    fn is_spare(&self) -> bool {
        (Self::SIZE..=SPARE_SIZE).contains(&self.0.len())
    }

    /// A buffer for datagrams, if the system has the memory.
    fn try_new() -> Option<Self> {
        let mut buffer = Self(Vec::new());
        buffer.grow(Self::SIZE, Self::SIZE).then_some(buffer)
    }

    /// Makes it at least `end` bytes long: twice its length, of at most `max`. False if the system refuses the memory.
    fn grow(&mut self, end: usize, max: usize) -> bool {
        let len = self.0.len();
        if end <= len {
            return true;
        }
        let sizes = [(2 * len).min(max).max(end), end];
        let Some(size) = sizes.into_iter().find(|size| self.0.try_reserve_exact(size - len).is_ok()) else {
            return false;
        };
        self.0.resize(size, 0);
        true
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

/// A fragment that came before the one that it follows.
#[derive(Debug)]
struct Early {
    offset: usize,
    data: Vec<u8>,
}

/// Approximate cost of an early fragment beside its data, bytes.
const EARLY_OVERHEAD: usize = 64;
/// Length from which the datagram of fragment 0 becomes the message's buffer; a shorter one is copied, bytes.
const TAKEN_OVER_MIN: usize = 16 << 10;

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
    count: u16,
    /// Number of fragments that are in the buffer, without a gap, and of their payload bytes.
    next: u16,
    filled: usize,
    /// Those after the gap, by number.
    early: BTreeMap<u16, Early>,
    early_bytes: usize,
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

    fn has(&self, number: u16) -> bool {
        number < self.next || self.early.contains_key(&number)
    }

    /// True if every announced fragment has arrived, which does not mean that they form a message.
    fn is_full(&self) -> bool {
        usize::from(self.next) + self.early.len() == usize::from(self.count)
    }

    /// Number of bytes that it occupies.
    fn bytes(&self) -> usize {
        self.buffer.0.len() + self.early_bytes
    }

    /// True if the piece is the next one, at the end of those before.
    fn continues(&self, number: u16, offset: usize) -> bool {
        (self.next, self.filled) == (number, offset)
    }

    /// Inserts a fragment that is not there yet; false if the system refuses the memory.
    fn put(&mut self, number: u16, offset: usize, data: &[u8]) -> bool {
        if !self.continues(number, offset) {
            return self.put_early(number, offset, data);
        }
        self.append(data) && self.put_waiting()
    }

    /// Appends the fragments that waited for the one inserted last.
    fn put_waiting(&mut self) -> bool {
        while let Some(entry) = self.early.first_entry().filter(|entry| {
            let Early { offset, .. } = entry.get();
            (self.next, self.filled) == (*entry.key(), *offset)
        }) {
            let early = entry.remove();
            self.early_bytes -= early.data.len() + EARLY_OVERHEAD;
            if !self.append(&early.data) {
                return false;
            }
        }
        true
    }

    /// [`udpm::Fragment`] has made sure that the data lie within the message.
    fn append(&mut self, data: &[u8]) -> bool {
        let place = self.start + self.filled;
        if !self.buffer.grow(place + data.len(), self.start + self.total) {
            return false;
        }
        self.buffer.0[place..place + data.len()].copy_from_slice(data);
        self.advance(data.len());
        true
    }

    /// The next fragment, of `len` bytes, is in the buffer.
    fn advance(&mut self, len: usize) {
        self.next += 1;
        self.filled += len;
    }

    fn put_early(&mut self, number: u16, offset: usize, data: &[u8]) -> bool {
        let mut kept = Vec::new();
        if kept.try_reserve_exact(data.len()).is_err() {
            return false;
        }
        kept.extend_from_slice(data);
        self.early_bytes += data.len() + EARLY_OVERHEAD;
        self.early.insert(number, Early { offset, data: kept });
        true
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

    /// Applies these limits from now on.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
        self.keep_limits();
    }

    /// Takes the fragment in the first `len` bytes of `datagram`, received at `at` (ns, on any scale). The first one of
    /// a message may take the buffer over and leave another one. `wants` decides by the channel and the size of the
    /// whole message, bytes.
    pub fn insert(
        &mut self,
        at: i64,
        from: SocketAddrV4,
        datagram: &mut Buffer,
        len: usize,
        wants: impl FnOnce(&str, usize) -> bool,
    ) -> Outcome {
        self.expire(at);
        let piece = match self.validate(from, &datagram.0[..len], wants) {
            Ok(piece) => piece,
            Err(outcome) => return outcome,
        };
        let Some(index) = self.place(at, piece, datagram) else { return Outcome::Needless };
        if self.partials[index].is_full() {
            return self.finish(index);
        }
        self.keep_limits();
        Outcome::Incomplete
    }

    /// Checks that a datagram is a fragment of a message that is wanted and not done; else what it is.
    fn validate(
        &mut self,
        from: SocketAddrV4,
        datagram: &[u8],
        wants: impl FnOnce(&str, usize) -> bool,
    ) -> Result<Piece, Outcome> {
        let Ok(Datagram::Fragment(fragment)) = udpm::decode(datagram) else { return Err(Outcome::Needless) };
        let key = (from, fragment.sequence);
        let known = self.partials.iter().position(|partial| partial.key() == key);
        if known.is_none() && self.done.contains(key) {
            return Err(Outcome::Needless);
        }
        let total = fragment.total as usize;
        if fragment.channel.is_some_and(|channel| !wants(channel, total)) {
            if let Some(index) = known {
                let partial = self.partials.swap_remove(index);
                self.recycle(partial.buffer);
            }
            self.done.push(key);
            return Err(Outcome::Unwanted);
        }
        if known.is_none() && total.saturating_add(DATAGRAM_MAX) > self.limits.bytes {
            // Counted once its fragment 0 says that it is wanted here.
            if fragment.channel.is_some() {
                self.given_up += 1;
                self.done.push(key);
            }
            return Err(Outcome::Needless);
        }
        Ok(Piece {
            key,
            known,
            total,
            count: fragment.count,
            number: fragment.number,
            channel: fragment.channel.map(String::from),
            data: datagram.len() - fragment.data.len()..datagram.len(),
            offset: fragment.offset as usize,
        })
    }

    /// Inserts a fragment into its message, which it may begin; returns the index of the message, or `None` for a
    /// duplicate or if there is no memory.
    fn place(&mut self, at: i64, piece: Piece, datagram: &mut Buffer) -> Option<usize> {
        let index = match piece.known {
            Some(index) if self.partials[index].agrees(&piece) => index,
            // Another message with the same number: its sender has restarted.
            Some(index) => {
                self.give_up(index);
                self.begin(&piece)
            }
            None => self.begin(&piece),
        };
        let partial = &mut self.partials[index];
        if partial.has(piece.number) {
            return None;
        }
        let (first, len) = (piece.number == 0 && partial.continues(0, piece.offset), piece.data.len());
        let taken_over = first && len >= TAKEN_OVER_MIN;
        let another = if taken_over { self.spare.pop().or_else(Buffer::try_new) } else { None };
        let put = match another {
            Some(another) => {
                partial.start = piece.data.start;
                partial.buffer = mem::replace(datagram, another);
                partial.advance(len);
                partial.put_waiting()
            }
            None => {
                if let Some(spare) = self.spare.pop_if(|_| first && partial.buffer.0.is_empty()) {
                    partial.buffer = spare;
                }
                partial.put(piece.number, piece.offset, &datagram.0[piece.data.clone()])
            }
        };
        partial.channel = piece.channel.or_else(|| partial.channel.take());
        partial.touched = at;
        if !put {
            self.done.push(piece.key);
            self.give_up(index);
            return None;
        }
        Some(index)
    }

    /// Begins a message, which has no fragments yet; returns its index.
    fn begin(&mut self, piece: &Piece) -> usize {
        let &Piece { key: (from, sequence), total, count, .. } = piece;
        self.partials.push(Partial {
            from,
            sequence,
            total,
            channel: None,
            buffer: Buffer(Vec::new()),
            start: 0,
            count,
            next: 0,
            filled: 0,
            early: BTreeMap::new(),
            early_bytes: 0,
            touched: 0,
        });
        self.partials.len() - 1
    }

    /// Completes a message of which all fragments have come.
    fn finish(&mut self, index: usize) -> Outcome {
        let partial = self.partials.swap_remove(index);
        self.done.push(partial.key());
        if partial.filled != partial.total || !partial.early.is_empty() {
            // All announced fragments have arrived, but not all bytes: some fragments overlap, others are missing.
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
            if complete.buffer.is_spare() {
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
        self.partials.iter().map(Partial::bytes).sum()
    }

    fn expire(&mut self, at: i64) {
        let age = self.limits.age_ns;
        while let Some(old) = self.partials.iter().position(|partial| at.saturating_sub(partial.touched) > age) {
            self.give_up(old);
        }
    }

    /// Gives up messages beyond the limits: first those whose channel is not known yet, and of each kind the oldest
    /// first.
    fn keep_limits(&mut self) {
        while self.partials.len() > self.limits.messages || self.bytes() > self.limits.bytes {
            let age = |(_, partial): &(usize, &Partial)| (partial.channel.is_some(), partial.touched);
            let Some((index, _)) = self.partials.iter().enumerate().min_by_key(age) else { return };
            self.give_up(index);
        }
    }

    fn give_up(&mut self, index: usize) {
        let partial = self.partials.swap_remove(index);
        self.given_up += 1;
        self.recycle(partial.buffer);
    }

    fn recycle(&mut self, buffer: Buffer) {
        if self.spare.len() < SPARE_MAX && buffer.is_spare() {
            self.spare.push(buffer);
        }
    }
}

#[cfg(test)]
mod tests;
