//! A writer with its last samples, and what each reader has of them (8.4.7, 8.4.9).

use crate::guid::{Entity, Guid, Prefix, SampleIdentity};
use crate::outbox::Outbox;
use crate::qos::{Qos, Reliability};
use crate::wire::{AckNack, Builder, FRAGMENT, Heartbeat, NackFrag};
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use base::{Duration, Instant};
use core::net::SocketAddrV4;

/// Period at which a reliable reader is asked what it lacks, until it has all.
const HEARTBEAT_PERIOD: Duration = Duration::from_millis(100);
/// Samples that are sent again at one request.
const RESENT_MAX: usize = 64;
/// Time after a repetition within which further requests of that reader are older than it.
const QUIET: Duration = Duration::from_millis(5);

#[derive(Debug)]
struct Sample {
    number: i64,
    micros: i64,
    related: Option<SampleIdentity>,
    payload: Vec<u8>,
}

/// A reader of another participant.
#[derive(Debug)]
struct Proxy {
    guid: Guid,
    to: SocketAddrV4,
    is_reliable: bool,
    /// It has all up to this one, or they are not meant for it.
    acked: i64,
    /// Up to this one they are not meant for it: they are older than its interest.
    skipped: i64,
    /// It has answered.
    has_answered: bool,
    quiet_until: Instant,
}

impl Proxy {
    /// True if it is this reader, or one of this participant.
    fn is(&self, guid: Guid) -> bool {
        match guid.entity {
            Entity::PARTICIPANT => self.guid.prefix == guid.prefix,
            _ => self.guid == guid,
        }
    }
}

#[derive(Debug)]
pub(crate) struct Writer {
    prefix: Prefix,
    pub entity: Entity,
    qos: Qos,
    history: VecDeque<Sample>,
    last: i64,
    proxies: Vec<Proxy>,
    heartbeats: i32,
    heartbeat_due: Option<Instant>,
}

impl Writer {
    pub fn new(prefix: Prefix, entity: Entity, qos: Qos) -> Self {
        Self {
            prefix,
            entity,
            qos,
            history: VecDeque::new(),
            last: 0,
            proxies: Vec::new(),
            heartbeats: 0,
            heartbeat_due: None,
        }
    }

    pub fn qos(&self) -> Qos {
        self.qos
    }

    pub fn matched(&self) -> usize {
        self.proxies.len()
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.heartbeat_due
    }

    /// True if the reader, or one of the participant, listens.
    pub fn reaches(&self, guid: Guid) -> bool {
        self.proxies.iter().any(|proxy| proxy.is(guid))
    }

    /// True if a reader of the participant has answered.
    pub fn hears(&self, prefix: Prefix) -> bool {
        self.proxies.iter().any(|proxy| proxy.guid.prefix == prefix && proxy.has_answered)
    }

    /// Keeps a sample, and sends it to all readers.
    pub fn write(
        &mut self,
        now: Instant,
        micros: i64,
        related: Option<SampleIdentity>,
        payload: &[u8],
        out: &mut Outbox,
    ) {
        self.last += 1;
        while self.history.len() >= usize::from(self.qos.depth.max(1)) {
            self.history.pop_front();
        }
        self.history.push_back(Sample { number: self.last, micros, related, payload: payload.to_vec() });
        let mut sent: Vec<SocketAddrV4> = Vec::new();
        for n in 0..self.proxies.len() {
            // Readers of one address share the datagrams.
            let to = self.proxies[n].to;
            if !sent.contains(&to) {
                sent.push(to);
                let asks = self.proxies.iter().any(|proxy| proxy.to == to && proxy.is_reliable);
                let heartbeat = asks.then(|| self.heartbeat(Entity::UNKNOWN, true));
                if let Some(sample) = self.history.back() {
                    self.send(sample, to, Entity::UNKNOWN, heartbeat, out);
                }
            }
        }
        if self.heartbeat_due.is_none() && self.proxies.iter().any(|proxy| proxy.is_reliable) {
            self.heartbeat_due = Some(now + HEARTBEAT_PERIOD);
        }
    }

    /// A reader begins to listen.
    pub fn add(&mut self, now: Instant, guid: Guid, to: SocketAddrV4, asked: Qos, out: &mut Outbox) {
        self.remove(guid);
        let is_reliable = self.qos.reliability == Reliability::Reliable && asked.reliability == Reliability::Reliable;
        let skipped = if self.qos.transient_local && asked.transient_local { 0 } else { self.last };
        let proxy =
            Proxy { guid, to, is_reliable, acked: skipped, skipped, has_answered: false, quiet_until: Instant::ZERO };
        if is_reliable {
            self.ask(&proxy, out);
            self.heartbeat_due.get_or_insert(now + HEARTBEAT_PERIOD);
        } else {
            // It cannot ask.
            let owed = self.history.iter().filter(|sample| sample.number > skipped);
            owed.for_each(|sample| self.send(sample, to, guid.entity, None, out));
        }
        self.proxies.push(proxy);
    }

    /// A reader, or all of a participant, listens no more.
    pub fn remove(&mut self, guid: Guid) {
        self.proxies.retain(|proxy| !proxy.is(guid));
    }

    /// Readers that have not got all are asked what they lack.
    pub fn handle_timeout(&mut self, now: Instant, out: &mut Outbox) {
        if self.heartbeat_due.is_none_or(|due| due > now) {
            return;
        }
        let lacking = self.proxies.iter().any(|proxy| proxy.is_reliable && self.lacks(proxy));
        self.heartbeat_due = lacking.then(|| now + HEARTBEAT_PERIOD);
        self.heartbeats = self.heartbeats.wrapping_add(1);
        self.proxies.iter().filter(|proxy| proxy.is_reliable && self.lacks(proxy)).for_each(|proxy| {
            self.ask(proxy, out);
        });
    }

    pub fn on_acknack(&mut self, now: Instant, from: Guid, acknack: &AckNack, out: &mut Outbox) {
        let last = self.last;
        let Some(n) = self.proxies.iter().position(|proxy| proxy.guid == from && proxy.is_reliable) else { return };
        let proxy = &mut self.proxies[n];
        proxy.acked = proxy.acked.max((acknack.missing.base - 1).min(last));
        let first_answer = !core::mem::replace(&mut proxy.has_answered, true);
        let (to, skipped, quiet_until) = (proxy.to, proxy.skipped, proxy.quiet_until);
        if !acknack.missing.is_empty() {
            if now < quiet_until {
                return;
            }
            self.proxies[n].quiet_until = now + QUIET;
            let oldest = self.history.front().map_or(last + 1, |sample| sample.number).max(skipped + 1);
            if acknack.missing.base < oldest {
                let mut gap = Builder::to(self.prefix, from.prefix);
                gap.gap(from.entity, self.entity, acknack.missing.base.max(1), oldest);
                out.push(to, gap.build());
            }
            let wanted = |sample: &&Sample| acknack.missing.iter().any(|number| number == sample.number);
            let owed = self.history.iter().filter(|sample| sample.number >= oldest);
            let again: Vec<&Sample> = owed.filter(wanted).take(RESENT_MAX).collect();
            for sample in again {
                self.send(sample, to, from.entity, None, out);
            }
        }
        if self.lacks(&self.proxies[n]) || (first_answer && !acknack.is_final) {
            self.heartbeats = self.heartbeats.wrapping_add(1);
            self.ask(&self.proxies[n], out);
            self.heartbeat_due.get_or_insert(now + HEARTBEAT_PERIOD);
        }
    }

    pub fn on_nack_frag(&mut self, from: Guid, nack: &NackFrag, out: &mut Outbox) {
        let proxy = self.proxies.iter().find(|proxy| proxy.guid == from && proxy.is_reliable);
        let sample = self.history.iter().find(|sample| sample.number == nack.number);
        let (Some(proxy), Some(sample)) = (proxy, sample) else { return };
        let count = sample.payload.len().div_ceil(FRAGMENT.into());
        for fragment in nack.missing.iter() {
            let Some(n) = usize::try_from(fragment - 1).ok().filter(|n| *n < count) else { continue };
            let mut message = Builder::to(self.prefix, from.prefix);
            message.fragment(from.entity, self.entity, (sample.number, n), sample.related, &sample.payload);
            out.push(proxy.to, message.build());
        }
    }

    fn lacks(&self, proxy: &Proxy) -> bool {
        proxy.acked < self.last
    }

    /// Asks a reader what it lacks.
    fn ask(&self, proxy: &Proxy, out: &mut Outbox) {
        let mut message = Builder::to(self.prefix, proxy.guid.prefix);
        message.heartbeat(&self.heartbeat_now(proxy.guid.entity, false));
        out.push(proxy.to, message.build());
    }

    fn heartbeat(&mut self, reader: Entity, is_final: bool) -> Heartbeat {
        self.heartbeats = self.heartbeats.wrapping_add(1);
        self.heartbeat_now(reader, is_final)
    }

    fn heartbeat_now(&self, reader: Entity, is_final: bool) -> Heartbeat {
        let first = self.history.front().map_or(self.last + 1, |sample| sample.number);
        Heartbeat { reader, writer: self.entity, first, last: self.last, count: self.heartbeats, is_final }
    }

    fn send(&self, sample: &Sample, to: SocketAddrV4, reader: Entity, heartbeat: Option<Heartbeat>, out: &mut Outbox) {
        let Sample { number, micros, related, payload } = sample;
        let count = payload.len().div_ceil(FRAGMENT.into()).max(1);
        for n in 0..count {
            let mut message = Builder::new(self.prefix);
            message.timestamp(*micros);
            match count {
                1 => message.data(reader, self.entity, *number, *related, payload),
                _ => message.fragment(reader, self.entity, (*number, n), *related, payload),
            }
            if let Some(heartbeat) = heartbeat.as_ref().filter(|_| n + 1 == count) {
                message.heartbeat(heartbeat);
            }
            out.push(to, message.build());
        }
    }
}
