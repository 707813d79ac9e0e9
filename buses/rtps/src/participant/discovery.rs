//! Discovery: participants by their announcements (8.5.3), endpoints by what they tell of them (8.5.4), and which of
//! them belong together.

use super::{DISCOVERY, Named, Participant, Remote};
use crate::guid::{Entity, Guid, Prefix};
use crate::parameters::{EndpointData, ParticipantData, key_of};
use crate::reader;
use crate::wire::{Builder, Data};
use alloc::vec::Vec;
use base::{Duration, Instant};
use core::net::SocketAddrV4;

/// Shortest time between two answers to the announcements of a participant.
const ANSWER_PERIOD: Duration = Duration::from_millis(50);

impl Participant {
    pub(super) fn on_participant(&mut self, now: Instant, from: SocketAddrV4, source: Prefix, data: &Data<'_>) {
        if data.gone {
            let guid = data.key.or_else(|| key_of(data.payload));
            if guid.is_some_and(|guid| guid.prefix == source) {
                self.forget(source);
            }
            return;
        }
        let Some(theirs) = ParticipantData::decode(data.payload) else {
            self.counters.malformed += 1;
            return;
        };
        if theirs.prefix != source || theirs.domain.is_some_and(|domain| domain != self.config.domain) {
            return;
        }
        let (Some(metatraffic), Some(default)) = (choose(from, &theirs.metatraffic), choose(from, &theirs.default))
        else {
            return;
        };
        let lease = theirs.lease.min(self.config.limits.lease);
        if let Some(known) = self.remotes.iter_mut().find(|remote| remote.prefix == source) {
            if (known.metatraffic, known.default) == (metatraffic, default) {
                (known.lease, known.until) = (lease, now + lease);
                // While it starts, a program may announce itself before it listens, and miss the answer.
                let has_answered = self.publications.hears(source) && self.subscriptions.hears(source);
                if !has_answered && known.answered + ANSWER_PERIOD <= now {
                    known.answered = now;
                    self.announce(metatraffic);
                }
                return;
            }
            // It is reached elsewhere now: all begins anew.
            self.forget(source);
        }
        if self.remotes.len() >= self.config.limits.participants {
            self.counters.refused += 1;
            return;
        }
        // It may not know this one yet.
        self.announce(metatraffic);
        let own = self.config.prefix;
        let mut proxy = |writer, reader| {
            let guid = Guid { prefix: source, entity: writer };
            let mut proxy = reader::Proxy::new(guid, metatraffic, DISCOVERY, DISCOVERY, false);
            proxy.greet(own, reader, &mut self.out);
            proxy
        };
        let publications = proxy(Entity::PUBLICATIONS_WRITER, Entity::PUBLICATIONS_READER);
        let subscriptions = proxy(Entity::SUBSCRIPTIONS_WRITER, Entity::SUBSCRIPTIONS_READER);
        let until = now + lease;
        let endpoints = Vec::new();
        let (prefix, vendor) = (source, theirs.vendor);
        let remote = Remote {
            prefix,
            vendor,
            lease,
            until,
            answered: now,
            metatraffic,
            default,
            publications,
            subscriptions,
            endpoints,
        };
        self.remotes.push(remote);
        let reader = |entity| Guid { prefix: source, entity };
        self.publications.add(now, reader(Entity::PUBLICATIONS_READER), metatraffic, DISCOVERY, &mut self.out);
        self.subscriptions.add(now, reader(Entity::SUBSCRIPTIONS_READER), metatraffic, DISCOVERY, &mut self.out);
    }

    /// News of an endpoint, from the participant at `place`.
    pub(super) fn on_endpoint(&mut self, now: Instant, place: usize, data: &Data<'_>) {
        let limits = self.config.limits;
        let remote = &mut self.remotes[place];
        let proxy = remote.discovery(data.writer);
        if !proxy.expects(data.number) || data.payload.len() > limits.sample {
            return;
        }
        proxy.take(data.number);
        let (prefix, default) = (remote.prefix, remote.default);
        if data.gone {
            let guid = data.key.or_else(|| key_of(data.payload)).filter(|guid| guid.prefix == prefix);
            if let Some(guid) = guid.filter(|guid| guid.entity != Entity::PARTICIPANT) {
                remote.endpoints.retain(|endpoint| endpoint.guid != guid);
                self.unmatch(guid);
            }
            return;
        }
        let Some(theirs) = EndpointData::decode(data.payload) else {
            self.counters.malformed += 1;
            return;
        };
        // One speaks of one's own endpoints only, and of writers and readers where they belong.
        let is_publication = data.writer == Entity::PUBLICATIONS_WRITER;
        if theirs.guid.prefix != prefix || is_reader(theirs.guid) == is_publication {
            return;
        }
        if let Some(known) = remote.endpoints.iter().position(|known| known.guid == theirs.guid) {
            if remote.endpoints[known] == theirs {
                return;
            }
            remote.endpoints.swap_remove(known);
        } else if remote.endpoints.len() >= limits.endpoints {
            self.counters.refused += 1;
            return;
        }
        remote.endpoints.push(theirs.clone());
        self.unmatch(theirs.guid);
        let to = theirs.unicast.first().copied().unwrap_or(default);
        self.match_endpoint(now, &theirs, to);
    }

    fn match_endpoint(&mut self, now: Instant, theirs: &EndpointData, to: SocketAddrV4) {
        let limits = self.config.limits;
        let is_named = |topic: &str, type_name: &str| theirs.topic == topic && theirs.type_name == type_name;
        if is_reader(theirs.guid) {
            for Named { topic, type_name, endpoint: writer } in &mut self.writers {
                let fits = is_named(topic, type_name) && !theirs.is_special && writer.qos().satisfies(theirs.qos);
                if fits && writer.matched() >= limits.matches {
                    self.counters.refused += 1;
                } else if fits {
                    writer.add(now, theirs.guid, to, theirs.qos, &mut self.out);
                }
            }
            return;
        }
        for Named { topic, type_name, endpoint: reader } in &mut self.readers {
            let fits = is_named(topic, type_name) && !theirs.is_special && theirs.qos.satisfies(reader.qos);
            if fits && reader.proxies.len() >= limits.matches {
                self.counters.refused += 1;
            } else if fits {
                let mut proxy = reader::Proxy::new(theirs.guid, to, reader.qos, theirs.qos, reader.is_request);
                proxy.greet(self.config.prefix, reader.entity, &mut self.out);
                reader.proxies.push(proxy);
            }
        }
    }

    fn unmatch(&mut self, guid: Guid) {
        self.writers.iter_mut().for_each(|writer| writer.endpoint.remove(guid));
        self.readers.iter_mut().for_each(|reader| reader.endpoint.remove(guid));
    }

    pub(super) fn forget(&mut self, prefix: Prefix) {
        let guid = Guid { prefix, entity: Entity::PARTICIPANT };
        self.remotes.retain(|remote| remote.prefix != prefix);
        self.publications.remove(guid);
        self.subscriptions.remove(guid);
        self.unmatch(guid);
    }

    pub(super) fn announce(&mut self, to: SocketAddrV4) {
        let mut message = Builder::new(self.config.prefix);
        message.data(Entity::SPDP_READER, Entity::SPDP_WRITER, 1, None, &self.announcement);
        self.out.push(to, message.build());
    }
}

/// Readers of users have the kinds 4 and 7.
pub(super) fn is_reader(guid: Guid) -> bool {
    matches!(guid.entity.0[3] & 0x0f, 4 | 7)
}

/// Where one of several addresses is reached: that by which it reached us, else the first.
fn choose(from: SocketAddrV4, locators: &[SocketAddrV4]) -> Option<SocketAddrV4> {
    locators.iter().find(|locator| locator.ip() == from.ip()).or(locators.first()).copied()
}
