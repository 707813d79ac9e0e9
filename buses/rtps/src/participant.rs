//! The participant, and the way of each submessage to the endpoint that it concerns.

mod discovery;

use self::discovery::is_reader;
use crate::config::{Config, Counters, USER_DATA_MAX};
use crate::guid::{Entity, Guid, Prefix, SampleIdentity};
use crate::outbox::{Outbox, Transmit};
use crate::parameters::{EndpointData, NAME_MAX, ParticipantData, key};
use crate::qos::Qos;
use crate::reader::{self, Reader};
use crate::wire::{self, Builder, Data, Submessage, VENDOR};
use crate::writer::Writer;
use alloc::collections::VecDeque;
use alloc::string::String;
use alloc::vec::Vec;
use base::{Duration, Instant};
use core::net::SocketAddrV4;

/// Announcements in quick succession at the start.
const FIRST_ANNOUNCEMENTS: u8 = 5;
const FIRST_PERIOD: Duration = Duration::from_millis(100);
/// Samples and durability of the discovery of endpoints.
const DISCOVERY: Qos = Qos { depth: u16::MAX, ..Qos::LATCHED };

/// A writer of the participant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct WriterId(u16);

/// A reader of the participant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ReaderId(u16);

/// A received sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sample {
    /// The reader that it is for.
    pub reader: ReaderId,
    /// Who wrote it.
    pub writer: Guid,
    /// Its number among those of its writer, from 1.
    pub number: i64,
    /// What its writer says that it belongs to: of an answer the request; of a request of Fast DDS the reader of the
    /// answers, without a number.
    pub related: Option<SampleIdentity>,
    /// When its last datagram was received.
    pub at: Instant,
    /// Encapsulation and content, and up to three bytes behind it: its length is a multiple of four.
    pub payload: Vec<u8>,
}

/// Topic and type of an own endpoint.
#[derive(Debug)]
struct Named<T> {
    topic: String,
    type_name: String,
    endpoint: T,
}

/// Another participant.
#[derive(Debug)]
struct Remote {
    prefix: Prefix,
    vendor: [u8; 2],
    lease: Duration,
    until: Instant,
    /// When its announcement was last answered by an own one.
    answered: Instant,
    metatraffic: SocketAddrV4,
    default: SocketAddrV4,
    publications: reader::Proxy,
    subscriptions: reader::Proxy,
    endpoints: Vec<EndpointData>,
}

/// A participant. It reads no clock and owns no port: the caller feeds datagrams and time, then drains.
#[derive(Debug)]
pub struct Participant {
    config: Config,
    announcement: Vec<u8>,
    announce_due: Instant,
    announced: u8,
    publications: Writer,
    subscriptions: Writer,
    writers: Vec<Named<Writer>>,
    readers: Vec<Named<Reader>>,
    remotes: Vec<Remote>,
    out: Outbox,
    events: VecDeque<Sample>,
    counters: Counters,
}

impl Participant {
    /// Creates a participant, which announces itself at the next [`handle_timeout`](Self::handle_timeout).
    #[must_use]
    pub fn new(config: Config) -> Self {
        let prefix = config.prefix;
        let announcement = ParticipantData {
            prefix,
            vendor: VENDOR,
            domain: Some(config.domain),
            lease: config.lease,
            metatraffic: config.locators.clone(),
            default: config.locators.clone(),
            name: config.name.clone(),
            user_data: config.user_data.clone(),
        };
        Self {
            announcement: announcement.encode(),
            announce_due: Instant::ZERO,
            announced: 0,
            publications: Writer::new(prefix, Entity::PUBLICATIONS_WRITER, DISCOVERY),
            subscriptions: Writer::new(prefix, Entity::SUBSCRIPTIONS_WRITER, DISCOVERY),
            writers: Vec::new(),
            readers: Vec::new(),
            remotes: Vec::new(),
            out: Outbox::new(config.limits.outbox),
            events: VecDeque::new(),
            counters: Counters::default(),
            config,
        }
    }

    /// Own identifier.
    #[must_use]
    pub fn guid(&self) -> Guid {
        Guid { prefix: self.config.prefix, entity: Entity::PARTICIPANT }
    }

    /// Own identifier of a writer.
    #[must_use]
    pub fn writer_guid(&self, id: WriterId) -> Guid {
        Guid { prefix: self.config.prefix, entity: Entity::writer(id.0 + 1) }
    }

    /// Own identifier of a reader.
    #[must_use]
    pub fn reader_guid(&self, id: ReaderId) -> Guid {
        Guid { prefix: self.config.prefix, entity: Entity::reader(id.0 + 1) }
    }

    /// Offers a topic; `None`: too many writers, or a name or user data that is too long. Both names are those of DDS:
    /// `rt/odom`, `nav_msgs::msg::dds_::Odometry_`.
    pub fn add_writer(&mut self, now: Instant, topic: &str, type_name: &str, qos: Qos) -> Option<WriterId> {
        let id = WriterId(u16::try_from(self.writers.len()).ok().filter(|n| *n < u16::MAX)?);
        let data = self.describe(self.writer_guid(id), topic, type_name, qos)?;
        let mut writer = Writer::new(self.config.prefix, data.guid.entity, qos);
        for remote in &self.remotes {
            for theirs in remote.endpoints.iter().filter(|theirs| is_reader(theirs.guid)) {
                if fits(&data, theirs, true) && writer.matched() < self.config.limits.matches {
                    let to = theirs.unicast.first().copied().unwrap_or(remote.default);
                    writer.add(now, theirs.guid, to, theirs.qos, &mut self.out);
                }
            }
        }
        self.writers.push(Named { topic: topic.into(), type_name: type_name.into(), endpoint: writer });
        self.publications.write(now, 0, None, &data.encode(), &mut self.out);
        Some(id)
    }

    /// Asks for a topic; as [`add_writer`](Self::add_writer).
    pub fn add_reader(&mut self, now: Instant, topic: &str, type_name: &str, qos: Qos) -> Option<ReaderId> {
        self.new_reader(now, topic, type_name, qos, false)
    }

    /// Asks for a topic of requests; as [`add_reader`](Self::add_reader). No request is lost that a client sends while
    /// it is discovered: those count that its writer meant for this reader, also if the writer was not known here yet.
    pub fn add_request_reader(&mut self, now: Instant, topic: &str, type_name: &str, qos: Qos) -> Option<ReaderId> {
        self.new_reader(now, topic, type_name, qos, true)
    }

    fn new_reader(
        &mut self,
        now: Instant,
        topic: &str,
        type_name: &str,
        qos: Qos,
        is_request: bool,
    ) -> Option<ReaderId> {
        let id = ReaderId(u16::try_from(self.readers.len()).ok().filter(|n| *n < u16::MAX)?);
        let data = self.describe(self.reader_guid(id), topic, type_name, qos)?;
        let mut reader = Reader { entity: data.guid.entity, qos, is_request, proxies: Vec::new() };
        for remote in &self.remotes {
            for theirs in remote.endpoints.iter().filter(|theirs| !is_reader(theirs.guid)) {
                if fits(&data, theirs, false) && reader.proxies.len() < self.config.limits.matches {
                    let to = theirs.unicast.first().copied().unwrap_or(remote.default);
                    let mut proxy = reader::Proxy::new(theirs.guid, to, qos, theirs.qos, is_request);
                    proxy.greet(self.config.prefix, reader.entity, &mut self.out);
                    reader.proxies.push(proxy);
                }
            }
        }
        self.readers.push(Named { topic: topic.into(), type_name: type_name.into(), endpoint: reader });
        self.subscriptions.write(now, 0, None, &data.encode(), &mut self.out);
        Some(id)
    }

    fn describe(&self, guid: Guid, topic: &str, type_name: &str, qos: Qos) -> Option<EndpointData> {
        let user_data = (self.config.endpoint_data)(type_name);
        let (topic, type_name) = (String::from(topic), String::from(type_name));
        let fits = topic.len() <= NAME_MAX && type_name.len() <= NAME_MAX && user_data.len() <= USER_DATA_MAX;
        fits.then_some(EndpointData { guid, topic, type_name, qos, user_data, is_special: false, unicast: Vec::new() })
    }

    /// Number of readers of others that hear a writer.
    #[must_use]
    pub fn matched(&self, id: WriterId) -> usize {
        self.writers.get(usize::from(id.0)).map_or(0, |writer| writer.endpoint.matched())
    }

    /// True if a writer has the reader `guid`, or one of the participant `guid`: an answer that is written before has
    /// nobody to go to.
    #[must_use]
    pub fn reaches(&self, id: WriterId, guid: Guid) -> bool {
        self.writers.get(usize::from(id.0)).is_some_and(|writer| writer.endpoint.reaches(guid))
    }

    /// Vendor of the implementation of another participant (8.3.3.1.3), as it says.
    #[must_use]
    pub fn vendor(&self, prefix: Prefix) -> Option<[u8; 2]> {
        self.remotes.iter().find(|remote| remote.prefix == prefix).map(|remote| remote.vendor)
    }

    /// Number of writers of others that a reader hears.
    #[must_use]
    pub fn matched_writers(&self, id: ReaderId) -> usize {
        self.readers.get(usize::from(id.0)).map_or(0, |reader| reader.endpoint.proxies.len())
    }

    /// Number of other participants.
    #[must_use]
    pub fn participants(&self) -> usize {
        self.remotes.len()
    }

    /// Counters since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        Counters { dropped_out: self.out.dropped, ..self.counters }
    }

    /// Writes a sample: `payload` with its encapsulation, `micros` its time, µs since the UNIX epoch.
    pub fn write(&mut self, now: Instant, id: WriterId, micros: i64, payload: &[u8]) {
        self.write_related(now, id, micros, None, payload);
    }

    /// Writes a sample that answers another one, as [`write`](Self::write).
    pub fn write_related(
        &mut self,
        now: Instant,
        id: WriterId,
        micros: i64,
        related: Option<SampleIdentity>,
        payload: &[u8],
    ) {
        if let Some(writer) = self.writers.get_mut(usize::from(id.0)) {
            writer.endpoint.write(now, micros, related, payload, &mut self.out);
        }
    }

    /// Tells the others that it is gone: the last thing to be sent.
    pub fn leave(&mut self) {
        let mut message = Builder::new(self.config.prefix);
        message.disposed(Entity::SPDP_WRITER, 2, &key(self.guid()));
        let message = message.build();
        for to in self.remotes.iter().map(|remote| remote.metatraffic) {
            self.out.push(to, message.clone());
        }
        self.remotes.clear();
    }

    /// The next datagram to be sent.
    pub fn poll_tx(&mut self) -> Option<Transmit> {
        self.out.pop()
    }

    /// The next received sample.
    pub fn poll_event(&mut self) -> Option<Sample> {
        self.events.pop_front()
    }

    /// When [`handle_timeout`](Self::handle_timeout) is to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let writers = self.writers.iter().map(|writer| &writer.endpoint);
        let heartbeats = writers.chain([&self.publications, &self.subscriptions]).filter_map(Writer::poll_timeout);
        let leases = self.remotes.iter().map(|remote| remote.until);
        heartbeats.chain(leases).chain([self.announce_due]).min()
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.announce_due <= now {
            self.announced = self.announced.saturating_add(1);
            let is_first = self.announced < FIRST_ANNOUNCEMENTS;
            self.announce_due = now + if is_first { FIRST_PERIOD } else { self.config.announce_period };
            for n in 0..self.config.announce_to.len() {
                self.announce(self.config.announce_to[n]);
            }
        }
        while let Some(n) = self.remotes.iter().position(|remote| remote.until <= now) {
            self.forget(self.remotes[n].prefix);
        }
        self.publications.handle_timeout(now, &mut self.out);
        self.subscriptions.handle_timeout(now, &mut self.out);
        self.writers.iter_mut().for_each(|writer| writer.endpoint.handle_timeout(now, &mut self.out));
    }

    /// A datagram, received at `now` from `from`. Whatever it contains, it is survived.
    pub fn handle_rx(&mut self, now: Instant, from: SocketAddrV4, datagram: &[u8]) {
        let Some((mut source, submessages)) = wire::parse(datagram) else {
            self.counters.malformed += 1;
            return;
        };
        let own = self.config.prefix;
        let mut is_for_us = true;
        for submessage in submessages {
            let Ok(submessage) = submessage else {
                self.counters.malformed += 1;
                return;
            };
            match submessage {
                Submessage::Source(prefix) => source = prefix,
                Submessage::Destination(prefix) => is_for_us = prefix == own || prefix == Prefix::default(),
                _ if !is_for_us || source == own => {}
                Submessage::Data(data) if data.writer == Entity::SPDP_WRITER => {
                    self.on_participant(now, from, source, &data);
                }
                other => self.on_submessage(now, source, other),
            }
        }
    }

    /// A submessage; those of unknown participants are ignored.
    fn on_submessage(&mut self, now: Instant, source: Prefix, submessage: Submessage<'_>) {
        let Some(place) = self.remotes.iter().position(|remote| remote.prefix == source) else { return };
        let remote = &mut self.remotes[place];
        remote.until = now + remote.lease;
        let guid = |entity| Guid { prefix: source, entity };
        match submessage {
            Submessage::Data(data) => match data.writer {
                Entity::PUBLICATIONS_WRITER | Entity::SUBSCRIPTIONS_WRITER => self.on_endpoint(now, place, &data),
                writer => {
                    // The end of an instance means nothing without keys, and takes a number.
                    let payload = (!data.gone).then_some(data.payload);
                    let identity = SampleIdentity { writer: guid(writer), number: data.number };
                    self.on_sample(now, identity, data.reader, payload, data.related);
                }
            },
            Submessage::DataFrag(frag) => match frag.writer {
                writer @ (Entity::PUBLICATIONS_WRITER | Entity::SUBSCRIPTIONS_WRITER) => {
                    let proxy = remote.discovery(writer);
                    if frag.sample as usize > self.config.limits.sample {
                        self.counters.dropped_in += u64::from(proxy.skip(frag.number));
                    } else if let Some((payload, related)) = proxy.assemble(&frag) {
                        let (reader, number) = (frag.reader, frag.number);
                        let data = Data { reader, writer, number, payload: &payload, gone: false, key: None, related };
                        self.on_endpoint(now, place, &data);
                    }
                }
                writer => {
                    for n in 0..self.readers.len() {
                        let reader = &mut self.readers[n].endpoint;
                        let is_asked = frag.reader == Entity::UNKNOWN || frag.reader == reader.entity;
                        let proxy = reader.proxies.iter_mut().find(|proxy| proxy.guid == guid(writer));
                        let Some(proxy) = proxy.filter(|_| is_asked) else { continue };
                        if frag.sample as usize > self.config.limits.sample {
                            self.counters.dropped_in += u64::from(proxy.skip(frag.number));
                        } else if let Some((payload, related)) = proxy.assemble(&frag) {
                            let identity = SampleIdentity { writer: guid(writer), number: frag.number };
                            self.offer(now, n, identity, Some(&payload), related);
                        }
                    }
                }
            },
            Submessage::Heartbeat(heartbeat) => match heartbeat.writer {
                writer @ (Entity::PUBLICATIONS_WRITER | Entity::SUBSCRIPTIONS_WRITER) => {
                    let reader = discovery_reader(writer);
                    remote.discovery(writer).on_heartbeat(self.config.prefix, reader, &heartbeat, &mut self.out);
                }
                writer => {
                    for Named { endpoint: reader, .. } in &mut self.readers {
                        let is_asked = heartbeat.reader == Entity::UNKNOWN || heartbeat.reader == reader.entity;
                        let proxy = reader.proxies.iter_mut().find(|proxy| proxy.guid == guid(writer));
                        if let Some(proxy) = proxy.filter(|_| is_asked) {
                            proxy.on_heartbeat(self.config.prefix, reader.entity, &heartbeat, &mut self.out);
                        }
                    }
                }
            },
            Submessage::Gap(gap) => match gap.writer {
                writer @ (Entity::PUBLICATIONS_WRITER | Entity::SUBSCRIPTIONS_WRITER) => {
                    remote.discovery(writer).on_gap(&gap);
                }
                writer => {
                    for Named { endpoint: reader, .. } in &mut self.readers {
                        let is_asked = gap.reader == Entity::UNKNOWN || gap.reader == reader.entity;
                        let proxy = reader.proxies.iter_mut().find(|proxy| proxy.guid == guid(writer));
                        proxy.filter(|_| is_asked).into_iter().for_each(|proxy| proxy.on_gap(&gap));
                    }
                }
            },
            Submessage::AckNack(acknack) => {
                if let Some((writer, out)) = self.own_writer(acknack.writer) {
                    writer.on_acknack(now, guid(acknack.reader), &acknack, out);
                }
            }
            Submessage::NackFrag(nack) => {
                if let Some((writer, out)) = self.own_writer(nack.writer) {
                    writer.on_nack_frag(guid(nack.reader), &nack, out);
                }
            }
            Submessage::Source(_) | Submessage::Destination(_) | Submessage::Other => {}
        }
    }

    fn own_writer(&mut self, entity: Entity) -> Option<(&mut Writer, &mut Outbox)> {
        let writer = match entity {
            Entity::PUBLICATIONS_WRITER => Some(&mut self.publications),
            Entity::SUBSCRIPTIONS_WRITER => Some(&mut self.subscriptions),
            _ => self.writers.iter_mut().map(|writer| &mut writer.endpoint).find(|writer| writer.entity == entity),
        };
        Some((writer?, &mut self.out))
    }

    fn on_sample(
        &mut self,
        now: Instant,
        identity: SampleIdentity,
        reader: Entity,
        payload: Option<&[u8]>,
        related: Option<SampleIdentity>,
    ) {
        for n in 0..self.readers.len() {
            if reader == Entity::UNKNOWN || self.readers[n].endpoint.entity == reader {
                self.offer(now, n, identity, payload, related);
            }
        }
    }

    /// A whole sample for the reader at `n`, if that listens to its writer; `None`: it has no content.
    fn offer(
        &mut self,
        now: Instant,
        n: usize,
        SampleIdentity { writer, number }: SampleIdentity,
        payload: Option<&[u8]>,
        related: Option<SampleIdentity>,
    ) {
        let reader = &mut self.readers[n].endpoint;
        let Some(proxy) = reader.proxies.iter_mut().find(|proxy| proxy.guid == writer) else { return };
        if !proxy.expects(number) {
            return;
        }
        let Some(payload) = payload.filter(|payload| payload.len() <= self.config.limits.sample) else {
            self.counters.dropped_in += u64::from(payload.is_some());
            return proxy.take(number);
        };
        // A reliable one is sent again later; it is not lost where there is no place now.
        if self.events.len() >= self.config.limits.events {
            self.counters.dropped_in += 1;
            return;
        }
        proxy.take(number);
        let (reader, payload) = (ReaderId(n as u16), payload.to_vec());
        self.events.push_back(Sample { reader, writer, number, related, at: now, payload });
    }
}

impl Remote {
    /// What is known of one of its writers of the discovery.
    fn discovery(&mut self, writer: Entity) -> &mut reader::Proxy {
        match writer {
            Entity::PUBLICATIONS_WRITER => &mut self.publications,
            _ => &mut self.subscriptions,
        }
    }
}

fn discovery_reader(writer: Entity) -> Entity {
    match writer {
        Entity::PUBLICATIONS_WRITER => Entity::PUBLICATIONS_READER,
        _ => Entity::SUBSCRIPTIONS_READER,
    }
}

fn fits(own: &EndpointData, theirs: &EndpointData, own_writes: bool) -> bool {
    let (offered, asked) = if own_writes { (own.qos, theirs.qos) } else { (theirs.qos, own.qos) };
    own.topic == theirs.topic && own.type_name == theirs.type_name && !theirs.is_special && offered.satisfies(asked)
}
