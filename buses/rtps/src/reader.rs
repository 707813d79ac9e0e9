//! A reader, and what it has of each writer (8.4.10, 8.4.12). Samples of a reliable writer are taken in order: one that
//! comes too early is asked for again when its turn has come, so that nothing has to be kept.

use crate::guid::{Entity, Guid, Prefix, SampleIdentity};
use crate::outbox::Outbox;
use crate::qos::{Qos, Reliability};
use crate::wire::{AckNack, Builder, DataFrag, Gap, Heartbeat, Set};
use alloc::vec;
use alloc::vec::Vec;
use core::net::SocketAddrV4;

/// A writer of another participant, as one reader knows it.
#[derive(Debug)]
pub(crate) struct Proxy {
    pub guid: Guid,
    to: SocketAddrV4,
    is_reliable: bool,
    /// What it sent before it was known here is taken, too, as far as it does not say that it is for others.
    takes_earlier: bool,
    /// Number of the next sample; `None`: not known yet.
    expected: Option<i64>,
    acks: i32,
    heartbeat: Option<i32>,
    assembly: Option<Assembly>,
}

/// A sample whose fragments arrive.
#[derive(Debug)]
struct Assembly {
    number: i64,
    size: u16,
    bytes: Vec<u8>,
    has: Vec<bool>,
    /// The sample that it answers, from the first fragment that says so.
    related: Option<SampleIdentity>,
}

impl Proxy {
    /// `is_request`: as [`Reader::is_request`].
    pub fn new(guid: Guid, to: SocketAddrV4, own: Qos, offered: Qos, is_request: bool) -> Self {
        let is_reliable = own.reliability == Reliability::Reliable && offered.reliability == Reliability::Reliable;
        let takes_earlier = is_request || (own.transient_local && offered.transient_local);
        Self { guid, to, is_reliable, takes_earlier, expected: None, acks: 0, heartbeat: None, assembly: None }
    }

    /// Asks the writer what it has, as soon as it is known.
    pub fn greet(&mut self, own: Prefix, reader: Entity, out: &mut Outbox) {
        if self.is_reliable {
            self.answer(own, reader, Set::empty(1), false, out);
        }
    }

    /// True if this sample is the next one.
    pub fn expects(&self, number: i64) -> bool {
        match self.expected {
            Some(expected) if self.is_reliable => number == expected,
            Some(expected) => number >= expected,
            // What it sent before comes first.
            None => !(self.is_reliable && self.takes_earlier),
        }
    }

    /// The sample is taken.
    pub fn take(&mut self, number: i64) {
        self.expected = Some(number.saturating_add(1));
        self.assembly = None;
    }

    /// The sample is left out; false: it is not the next one.
    pub fn skip(&mut self, number: i64) -> bool {
        let is_next = self.expects(number);
        if is_next {
            self.take(number);
        }
        is_next
    }

    /// A fragment of a sample that is not too long; the whole sample, and the one that it answers, with the last
    /// one that was missing.
    pub fn assemble(&mut self, frag: &DataFrag<'_>) -> Option<(Vec<u8>, Option<SampleIdentity>)> {
        let sample = frag.sample as usize;
        if !self.expects(frag.number) {
            return None;
        }
        let size = usize::from(frag.size);
        let count = sample.div_ceil(size);
        let is_same =
            |kept: &Assembly| kept.number == frag.number && kept.size == frag.size && kept.bytes.len() == sample;
        if self.assembly.as_ref().is_none_or(|kept| !is_same(kept)) {
            // An older one that is not complete is lost.
            let (bytes, has) = (vec![0; sample], vec![false; count]);
            self.assembly = Some(Assembly { number: frag.number, size: frag.size, bytes, has, related: None });
        }
        let kept = self.assembly.as_mut()?;
        kept.related = kept.related.or(frag.related);
        let mut payload = frag.payload;
        for n in (frag.first as usize - 1)..count {
            let at = n * size;
            let length = size.min(sample - at);
            let Some((part, rest)) = payload.split_at_checked(length) else { break };
            kept.bytes[at..at + length].copy_from_slice(part);
            kept.has[n] = true;
            payload = rest;
        }
        if kept.has.iter().any(|has| !has) {
            return None;
        }
        self.assembly.take().map(|whole| (whole.bytes, whole.related))
    }

    pub fn on_heartbeat(&mut self, own: Prefix, reader: Entity, heartbeat: &Heartbeat, out: &mut Outbox) {
        let Heartbeat { first, last, count, is_final, .. } = *heartbeat;
        if !self.is_reliable || self.heartbeat == Some(count) {
            return;
        }
        self.heartbeat = Some(count);
        let start = if self.takes_earlier { first } else { last.saturating_add(1) };
        let expected = self.expected.unwrap_or(start).max(first);
        self.expected = Some(expected);
        let missing = Set::span(expected, last);
        if !missing.is_empty() || !is_final {
            self.answer(own, reader, missing, true, out);
        }
    }

    /// Samples will not come.
    pub fn on_gap(&mut self, gap: &Gap) {
        let Some(mut expected) = self.expected.filter(|expected| *expected >= gap.start) else { return };
        expected = expected.max(gap.more.base);
        for number in gap.more.iter() {
            if number == expected {
                expected = expected.saturating_add(1);
            }
        }
        self.expected = Some(expected);
    }

    fn answer(&mut self, own: Prefix, reader: Entity, missing: Set, is_final: bool, out: &mut Outbox) {
        self.acks = self.acks.wrapping_add(1);
        let mut message = Builder::to(own, self.guid.prefix);
        message.acknack(&AckNack { reader, writer: self.guid.entity, missing, count: self.acks, is_final });
        out.push(self.to, message.build());
    }
}

#[derive(Debug)]
pub(crate) struct Reader {
    pub entity: Entity,
    pub qos: Qos,
    /// It reads requests: a client sends one as soon as it knows this reader, which may not know the client's writer
    /// yet. What is older than that is the writer's to leave out (8.4.7.5), as it does for each volatile reader.
    pub is_request: bool,
    pub proxies: Vec<Proxy>,
}

impl Reader {
    /// A writer, or all of a participant, is gone.
    pub fn remove(&mut self, guid: Guid) {
        let is_gone = |proxy: &Proxy| match guid.entity {
            Entity::PARTICIPANT => proxy.guid.prefix == guid.prefix,
            _ => proxy.guid == guid,
        };
        self.proxies.retain(|proxy| !is_gone(proxy));
    }
}
