//! The robot as a node of ROS 2: messages of the bus and datagrams in, messages and datagrams out. It owns no port and
//! no clock.

#[cfg(test)]
mod tests;

use crate::drive::{self, Drive};
use crate::incoming::{self, Command, Input};
use crate::outgoing::{self, Outgoing};
use crate::servers::{self, Effect, Servers, Time};
use crate::topics::{Quality, Topic};
use base::{Epoch, Instant, earliest};
use lcm_gen::cdr::Writer;
use messages::Message;
use rtps::{Counters, Guid, Participant, Qos, ReaderId, Transmit, WriterId};
use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddrV4;

/// Writers at most: of each sensor one.
const WRITERS_MAX: usize = 256;
/// Messages for the bus, and notes, that wait at most.
const WAITING_MAX: usize = 16;

/// What the node is.
#[derive(Clone, Debug)]
pub struct Config {
    /// Its name: that of the robot, as ROS takes it.
    pub name: String,
    /// Prefix of its topics, empty or as `/robot1`.
    pub namespace: String,
    /// The participant.
    pub participant: rtps::Config,
    /// What is told.
    pub outgoing: outgoing::Config,
    /// Topics whose content does not change: `/map`, `/robot_description`.
    pub fixed: Vec<(Topic, Vec<u8>)>,
    /// How ROS drives; `None`: it may not command.
    pub drive: Option<drive::Config>,
    /// Actions, services and parameters.
    pub servers: servers::Config,
    /// Time of the messages.
    pub epoch: Epoch,
}

/// The node.
#[derive(Debug)]
pub struct Node {
    namespace: String,
    name: String,
    participant: Participant,
    outgoing: Outgoing,
    epoch: Epoch,
    /// Writers by the names of their topics; `None`: there are too many.
    writers: BTreeMap<String, Option<WriterId>>,
    readers: Vec<(ReaderId, Input)>,
    /// Tells which endpoints are this node's, as `ros2 node info` shows it.
    graph: Option<WriterId>,
    graph_is_old: bool,
    drive: Option<Drive>,
    servers: Servers,
    /// The module may act: it is not in PAUSE or STOP.
    acts: bool,
    messages: VecDeque<Message>,
    notes: VecDeque<String>,
}

/// Topic of the graph of ROS, and its type; it is no topic of a user's.
const GRAPH: (&str, &str) = ("ros_discovery_info", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_");

impl Node {
    /// Creates the node at the time `now`.
    #[must_use]
    pub fn new(config: Config, now: Instant) -> Self {
        let mut participant = Participant::new(config.participant);
        let mut readers = Vec::new();
        if config.drive.is_some() {
            for input in Input::ALL {
                let topic = input.topic();
                let (name, quality) = (topic.dds_name(&config.namespace), qos(topic.quality));
                let reader = participant.add_reader(now, &name, &topic.dds_type(), quality);
                readers.extend(reader.map(|reader| (reader, input)));
            }
        }
        let graph = participant.add_writer(now, GRAPH.0, GRAPH.1, Qos::LATCHED);
        let of = servers::Of { name: &config.name, namespace: &config.namespace };
        let servers = Servers::new(config.servers, &mut participant, now, of);
        let mut node = Self {
            namespace: config.namespace,
            name: config.name,
            participant,
            outgoing: Outgoing::new(config.outgoing),
            epoch: config.epoch,
            writers: BTreeMap::new(),
            readers,
            graph,
            graph_is_old: true,
            drive: config.drive.map(Drive::new),
            servers,
            acts: true,
            messages: VecDeque::new(),
            notes: VecDeque::new(),
        };
        for (topic, cdr) in &config.fixed {
            node.write(now, topic, cdr);
        }
        for topic in node.servers.topics() {
            node.writer(now, &topic);
        }
        node
    }

    /// A message of the robot's bus.
    pub fn on_bus(&mut self, now: Instant, channel: &str, data: &[u8]) {
        let listeners = self.participant.participants() > 0;
        // Lent to the translation.
        let Self { outgoing, participant, writers, namespace, graph_is_old, epoch, .. } = self;
        outgoing.translate(channel, data, listeners, &mut |topic, cdr| {
            let writer = writer(participant, writers, graph_is_old, namespace, now, topic);
            // What only those get who are there: without them it costs nothing more.
            let is_kept = matches!(topic.quality, Quality::Latched | Quality::History);
            if let Some(writer) = writer.filter(|writer| is_kept || participant.matched(*writer) > 0) {
                participant.write(now, writer, epoch.timestamp(now), cdr);
            }
        });
        let time = self.time(now);
        self.servers.on_bus(&mut self.participant, time, channel, data);
        self.carry_out(now);
    }

    fn time(&self, now: Instant) -> Time {
        Time { now, micros: self.epoch.timestamp(now) }
    }

    fn writer(&mut self, now: Instant, topic: &Topic) -> Option<WriterId> {
        let Self { participant, writers, namespace, graph_is_old, .. } = self;
        writer(participant, writers, graph_is_old, namespace, now, topic)
    }

    fn write(&mut self, now: Instant, topic: &Topic, cdr: &[u8]) {
        if let Some(writer) = self.writer(now, topic) {
            self.participant.write(now, writer, self.epoch.timestamp(now), cdr);
        }
    }

    /// Does what the servers want.
    fn carry_out(&mut self, now: Instant) {
        while let Some(effect) = self.servers.poll() {
            match effect {
                Effect::Message(message) => self.messages.push_back(message),
                Effect::Topic(topic, cdr) => self.write(now, &topic, &cdr),
                Effect::Note(text) => self.note(text),
            }
        }
    }

    /// Why a request of ROS is not obeyed now.
    fn refusal(&self) -> Option<&'static str> {
        match self.acts {
            false => Some("the module ros2 is in PAUSE or STOP"),
            true if self.messages.len() >= WAITING_MAX => Some("too many at a time"),
            true => None,
        }
    }

    /// A datagram, received at `at` from `from`.
    pub fn on_datagram(&mut self, now: Instant, at: Instant, from: SocketAddrV4, datagram: &[u8]) {
        self.participant.handle_rx(at, from, datagram);
        let time = self.time(now);
        self.servers.flush(&mut self.participant, time);
        while let Some(sample) = self.participant.poll_event() {
            let (refusal, was_active) = (self.refusal(), self.servers.is_active());
            if self.servers.on_sample(&mut self.participant, time, &sample, self.acts, refusal) {
                if was_active && !self.servers.is_active() {
                    self.silence();
                }
                self.carry_out(now);
                continue;
            }
            let input = self.readers.iter().find(|(reader, _)| *reader == sample.reader).map(|(_, input)| *input);
            if let Some(input) = input.filter(|_| self.acts && self.servers.is_active()) {
                self.on_sample(now, sample.at, input, sample.writer, &sample.payload);
            }
        }
    }

    fn on_sample(&mut self, now: Instant, at: Instant, input: Input, from: Guid, sample: &[u8]) {
        match incoming::read(input, self.epoch.timestamp(now), sample) {
            Ok(Command::Velocity(velocity)) => {
                let drive = self.drive.as_mut();
                if drive.is_some_and(|drive| !drive.on_velocity(now, at, session(from), velocity)) {
                    self.note(format!("{}: a command that waited too long is dropped", input.topic().name));
                }
            }
            Ok(Command::Message(message)) if self.messages.len() < WAITING_MAX => self.messages.push_back(*message),
            Ok(Command::Message(_)) => self.note(format!("{}: too many at a time", input.topic().name)),
            Err(refusal) => self.note(format!("{}: a message is refused: {refusal}", input.topic().name)),
        }
    }

    fn note(&mut self, text: String) {
        if self.notes.len() < WAITING_MAX && !self.notes.contains(&text) {
            self.notes.push_back(text);
        }
    }

    /// The module may act, or not any more.
    pub fn set_acts(&mut self, acts: bool) {
        self.acts = acts;
        if !acts {
            self.silence();
        }
    }

    /// Nothing that ROS commanded is sent any more.
    fn silence(&mut self) {
        if let Some(drive) = &mut self.drive {
            drive.end();
            self.messages.clear();
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.graph_is_old {
            self.graph_is_old = false;
            let graph = self.graph();
            if let Some(writer) = self.graph {
                self.participant.write(now, writer, self.epoch.timestamp(now), &graph);
            }
        }
        self.participant.handle_timeout(now);
        let time = self.time(now);
        self.servers.handle_timeout(&mut self.participant, time);
        self.carry_out(now);
        let timestamp = time.micros;
        let command = self.drive.as_mut().and_then(|drive| drive.poll(now, timestamp));
        self.messages.extend(command.map(Message::from));
    }

    /// When [`handle_timeout`](Self::handle_timeout) is to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let graph = self.graph_is_old.then_some(Instant::ZERO);
        let drive = self.drive.as_ref().and_then(Drive::poll_timeout);
        earliest([graph, drive, self.servers.poll_timeout(), self.participant.poll_timeout()])
    }

    /// The next datagram to be sent.
    pub fn poll_tx(&mut self) -> Option<Transmit> {
        self.participant.poll_tx()
    }

    /// The next message for the bus.
    pub fn poll_message(&mut self) -> Option<Message> {
        self.messages.pop_front()
    }

    /// The next note for people.
    pub fn poll_note(&mut self) -> Option<String> {
        self.notes.pop_front()
    }

    /// Tells the others that it is gone: then [`poll_tx`](Self::poll_tx) for the last time.
    pub fn leave(&mut self, now: Instant) {
        self.servers.leave(self.time(now));
        self.carry_out(now);
        self.participant.leave();
    }

    /// Counters of what was dropped.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.participant.counters()
    }

    /// `rmw_dds_common/msg/ParticipantEntitiesInfo`, as of Iron and later.
    fn graph(&self) -> Vec<u8> {
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        let gids = |to: &mut Writer<'_>, gids: &[Guid]| {
            to.count(gids.len());
            gids.iter().flat_map(|gid| gid.bytes()).for_each(|byte| to.u8(byte));
        };
        let readers = self.readers.iter().map(|(reader, _)| *reader);
        let readers = readers.chain(self.servers.endpoints().map(|(reader, _)| reader));
        let readers: Vec<Guid> = readers.map(|reader| self.participant.reader_guid(reader)).collect();
        let writers = self.writers.values().flatten().copied();
        let writers = writers.chain(self.servers.endpoints().map(|(_, writer)| writer));
        let writers: Vec<Guid> = writers.map(|writer| self.participant.writer_guid(writer)).collect();
        self.participant.guid().bytes().into_iter().for_each(|byte| to.u8(byte));
        to.count(1);
        to.string(if self.namespace.is_empty() { "/" } else { &self.namespace });
        to.string(&self.name);
        gids(&mut to, &readers);
        gids(&mut to, &writers);
        cdr
    }
}

/// The writer of a topic, made with its first message.
fn writer(
    participant: &mut Participant,
    writers: &mut BTreeMap<String, Option<WriterId>>,
    graph_is_old: &mut bool,
    namespace: &str,
    now: Instant,
    topic: &Topic,
) -> Option<WriterId> {
    if let Some(known) = writers.get(&topic.name) {
        return *known;
    }
    (writers.len() < WRITERS_MAX).then_some(())?;
    let made = participant.add_writer(now, &topic.dds_name(namespace), &topic.dds_type(), qos(topic.quality));
    writers.insert(topic.name.clone(), made);
    *graph_is_old = true;
    made
}

fn qos(quality: Quality) -> Qos {
    match quality {
        // It is never sent again.
        Quality::Sensor => Qos { depth: 1, ..Qos::SENSOR },
        Quality::Reliable => Qos::RELIABLE,
        Quality::Latched => Qos::LATCHED,
        Quality::History => Qos { depth: 100, ..Qos::LATCHED },
    }
}

/// Number of a publisher, as sources of motion have it: two programs of ROS that drive at a time are two.
fn session(from: Guid) -> i64 {
    let bytes = from.bytes();
    let half = |at: usize| bytes[at..at + 8].iter().fold(0_u64, |sum, byte| (sum << 8) | u64::from(*byte));
    (half(0).rotate_left(32) ^ half(8)).cast_signed()
}
