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
    /// A bit for each fragment.
    seen: Vec<u64>,
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
        let (word, bit) = (usize::from(number / 64), 1 << (number % 64));
        let new = self.seen[word] & bit == 0;
        self.seen[word] |= bit;
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

/// How many messages are remembered as done, so that their late fragments begin no new ones.
const DONE_MAX: usize = 64;
/// How many buffers wait to be used again, each of at most [`SPARE_SIZE`] bytes.
const SPARE_MAX: usize = 2;
const SPARE_SIZE: usize = 1 << 20;

/// Incomplete messages.
#[derive(Debug, Default)]
pub struct Reassembly {
    limits: Limits,
    partials: Vec<Partial>,
    complete: Option<Partial>,
    /// Those that need no more fragments; the oldest is overwritten.
    done: Vec<(SocketAddrV4, u32)>,
    next_done: usize,
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
        if self.done.contains(&key) {
            return Outcome::Needless;
        }
        let known = self.partials.iter().position(|partial| (partial.from, partial.sequence) == key);
        if fragment.channel.is_some_and(|channel| !wants(channel)) {
            if let Some(index) = known {
                let partial = self.partials.swap_remove(index);
                self.recycle(partial.buffer);
            }
            self.finish(key);
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
                    seen: vec![0; usize::from(count).div_ceil(64)],
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
        self.finish(key);
        let partial = self.partials.swap_remove(index);
        if partial.held != partial.total {
            // All fragments that were announced, and yet not all bytes.
            self.given_up += 1;
            self.recycle(partial.buffer);
            return Outcome::Needless;
        }
        if let Some(before) = self.complete.replace(partial) {
            self.recycle(before.buffer);
        }
        Outcome::Complete
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

    fn finish(&mut self, key: (SocketAddrV4, u32)) {
        if self.done.len() < DONE_MAX {
            self.done.push(key);
        } else {
            self.done[self.next_done] = key;
            self.next_done = (self.next_done + 1) % DONE_MAX;
        }
    }

    fn recycle(&mut self, buffer: Buffer) {
        if self.spare.len() < SPARE_MAX && buffer.0.len() <= SPARE_SIZE {
            self.spare.push(buffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::net::Ipv4Addr;

    const A: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1);
    const B: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 2);

    fn payload(len: usize) -> Vec<u8> {
        (0..len).map(|i| (7 * i + (i >> 8)) as u8).collect()
    }

    fn fragments(sequence: u32, channel: &str, len: usize, size: usize) -> Vec<Vec<u8>> {
        let payload = payload(len);
        let message = udpm::Message::new(sequence, channel, &payload, size).unwrap();
        let datagram = |number| {
            let (header, rest) = message.datagram(number);
            [&header[..], rest].concat()
        };
        (0..message.count()).map(datagram).collect()
    }

    struct Bench {
        reassembly: Reassembly,
        datagram: Buffer,
        now: i64,
    }

    impl Bench {
        fn new(limits: Limits) -> Self {
            Self { reassembly: Reassembly::new(limits), datagram: Buffer::default(), now: 0 }
        }

        fn insert(&mut self, from: SocketAddrV4, bytes: &[u8]) -> Outcome {
            self.datagram.room()[..bytes.len()].copy_from_slice(bytes);
            self.reassembly.insert(self.now, from, &mut self.datagram, bytes.len(), |channel| channel != "UNWANTED")
        }

        fn all(&mut self, from: SocketAddrV4, datagrams: &[Vec<u8>]) -> Vec<Outcome> {
            datagrams.iter().map(|bytes| self.insert(from, bytes)).collect()
        }

        fn complete(&self) -> (&str, &[u8]) {
            let Complete { channel, payload } = self.reassembly.complete().unwrap();
            (channel, payload)
        }
    }

    #[test]
    fn fragments_make_a_message_in_any_order() {
        for (len, size) in [(65_600, DATAGRAM_MAX), (10_000, 600), (1 << 20, DATAGRAM_MAX), (3_000_000, 1452)] {
            let datagrams = fragments(7, "BIG", len, size);
            let last = datagrams.len() - 1;
            let rotated: Vec<_> = [&datagrams[last / 2..], &datagrams[..last / 2]].concat();
            let backwards: Vec<_> = datagrams.iter().rev().cloned().collect();
            for order in [datagrams, rotated, backwards] {
                let mut bench = Bench::new(Limits::default());
                let outcomes = bench.all(A, &order);
                assert!(outcomes[..last].iter().all(|outcome| *outcome == Outcome::Incomplete));
                assert_eq!(outcomes[last], Outcome::Complete);
                assert!(bench.complete() == ("BIG", &payload(len)[..]), "{len} {size}");
            }
        }
    }

    #[test]
    fn a_datagram_that_comes_twice_fills_no_hole() {
        let datagrams = fragments(0, "BIG", 2000, 1000);
        let mut bench = Bench::new(Limits::default());
        assert_eq!(bench.insert(A, &datagrams[0]), Outcome::Incomplete);
        assert_eq!(bench.insert(A, &datagrams[0]), Outcome::Needless);
        assert_eq!(bench.insert(A, &datagrams[1]), Outcome::Incomplete);
        assert_eq!(bench.insert(A, &datagrams[2]), Outcome::Complete);
        assert_eq!(bench.insert(A, &datagrams[2]), Outcome::Needless, "and begins no new message");
        assert_eq!(bench.reassembly.bytes(), 0);
    }

    #[test]
    fn messages_of_many_senders_interleave() {
        let (mine, other) = (fragments(0, "X", 5000, 1000), fragments(0, "Y", 5000, 1000));
        let next = fragments(1, "Z", 5000, 1000);
        let mut bench = Bench::new(Limits::default());
        for ((mine, other), next) in mine.iter().zip(&other).zip(&next).take(mine.len() - 1) {
            bench.insert(A, mine);
            bench.insert(B, other);
            bench.insert(A, next);
        }
        let last = mine.len() - 1;
        for (from, datagrams, channel) in [(A, &next, "Z"), (B, &other, "Y"), (A, &mine, "X")] {
            assert_eq!(bench.insert(from, &datagrams[last]), Outcome::Complete);
            assert!(bench.complete() == (channel, &payload(5000)[..]));
        }
    }

    #[test]
    fn what_nobody_wants_is_not_put_together() {
        let datagrams = fragments(0, "UNWANTED", 5000, 1000);
        let mut bench = Bench::new(Limits::default());
        assert_eq!(bench.insert(A, &datagrams[3]), Outcome::Incomplete, "nobody can tell yet");
        assert_eq!(bench.insert(A, &datagrams[0]), Outcome::Unwanted);
        assert_eq!(bench.insert(A, &datagrams[1]), Outcome::Needless);
        assert_eq!((bench.reassembly.bytes(), bench.reassembly.given_up()), (0, 0));
    }

    #[test]
    fn what_does_not_come_to_an_end_is_given_up() {
        let datagrams = fragments(0, "BIG", 5000, 1000);
        let mut bench = Bench::new(Limits::default());
        bench.insert(A, &datagrams[0]);
        bench.now += 500_000_000;
        bench.insert(A, &datagrams[1]);
        bench.now += 500_000_001;
        bench.insert(B, &datagrams[0]);
        assert_eq!(bench.reassembly.given_up(), 1);
        assert_eq!(bench.insert(A, &datagrams[2]), Outcome::Incomplete, "the rest is the start of nothing");
    }

    #[test]
    fn a_sender_that_begins_anew_does_not_mix_two_messages() {
        let mut bench = Bench::new(Limits::default());
        bench.insert(A, &fragments(0, "OLD", 6000, 1000)[0]);
        let datagrams = fragments(0, "NEW", 5000, 1000);
        assert_eq!(bench.all(A, &datagrams).pop(), Some(Outcome::Complete));
        assert!(bench.complete() == ("NEW", &payload(5000)[..]));
        assert_eq!(bench.reassembly.given_up(), 1);
    }

    #[test]
    fn endless_first_fragments_cost_a_fixed_amount_of_memory() {
        let largest = MESSAGE_MAX as usize;
        let limits = Limits::default();
        let mut bench = Bench::new(limits);
        let mut first = fragments(0, "BIG", 200_000, DATAGRAM_MAX).swap_remove(0);
        first[8..12].copy_from_slice(&MESSAGE_MAX.to_be_bytes());
        let mut last = fragments(0, "BIG", 200_000, DATAGRAM_MAX).swap_remove(1);
        last[8..12].copy_from_slice(&MESSAGE_MAX.to_be_bytes());
        last[12..16].copy_from_slice(&(MESSAGE_MAX - 65_487).to_be_bytes());
        for sequence in 0..1000_u32 {
            for datagram in [&mut first, &mut last] {
                datagram[4..8].copy_from_slice(&(2 * sequence).to_be_bytes());
                bench.insert(A, datagram);
                assert!(bench.reassembly.bytes() <= limits.bytes);
            }
            last[4..8].copy_from_slice(&(2 * sequence + 1).to_be_bytes());
            bench.insert(A, &last);
            assert!(bench.reassembly.bytes() <= limits.bytes.max(largest + DATAGRAM_MAX));
        }
        assert!(bench.reassembly.partials.len() <= limits.messages);
    }

    #[test]
    fn fragments_that_lie_about_their_size_are_no_message() {
        let mut datagrams = fragments(0, "BIG", 3000, 1000);
        datagrams[1].truncate(500);
        let mut bench = Bench::new(Limits::default());
        let outcomes = bench.all(A, &datagrams);
        assert!(!outcomes.contains(&Outcome::Complete), "{outcomes:?}");
        assert_eq!(bench.reassembly.given_up(), 1);
    }
}
