//! The node side of CiA 301: NMT slave, SDO server, heartbeats, emergencies and PDOs, driven by its object
//! dictionary. What an emulated drive is made of.
//!
//! The application sets objects as its device changes and reads them when [`NodeEvent::ObjectWritten`] says so;
//! after setting, call [`Node::handle_timeout`]: what was set together leaves together.

mod heartbeat;
mod objects;
mod pdo;
#[cfg(test)]
mod tests;

use crate::wire::{self, Emergency, NmtCommand, NmtState, Service};
use crate::{Dictionary, sdo};
use base::can::{Frame, Id};
use base::{Duration, Instant, Queue};
use heartbeat::{Consumers, Producer};
use objects::Guarded;
use pdo::Pdos;

/// What happened to a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeEvent {
    /// An object was written by SDO or PDO and holds the value now. All objects of one PDO hold theirs before the
    /// first of them is reported, and its controlword (0x6040) is reported last.
    ObjectWritten {
        /// The object's index.
        index: u16,
        /// The object's sub-index.
        sub: u8,
    },
    /// The NMT state changed.
    NmtState(NmtState),
    /// A node that 0x1016 watches fell silent.
    HeartbeatLost {
        /// Which.
        node: u8,
    },
    /// A node that was lost is heard again.
    HeartbeatBack {
        /// Which.
        node: u8,
    },
    /// NMT reset node: the objects have their power-on values; the device starts anew.
    ResetApplication,
    /// A received PDO is shorter than its mapping and was not processed; an emergency 0x8210 was sent.
    PdoTooShort {
        /// 1 for the PDO of 0x1400.
        number: u16,
    },
}

/// Where the node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Off,
    Booting { until: Instant },
    Running(NmtState),
}

/// A CANopen node.
pub struct Node {
    dictionary: Dictionary,
    boot_time: Duration,
    phase: Phase,
    server: sdo::Server,
    producer: Producer,
    consumers: Consumers,
    pdos: Pdos,
    tx: Queue<Frame, 64>,
    events: Queue<NodeEvent, 64>,
}

impl Node {
    /// A node that is switched off. It takes `boot_time` from power or reset to its boot-up message.
    #[must_use]
    pub fn new(dictionary: Dictionary, boot_time: Duration) -> Self {
        let pdos = Pdos::new(&dictionary);
        Self {
            dictionary,
            boot_time,
            phase: Phase::Off,
            server: sdo::Server::new(Duration::from_secs(2)),
            producer: Producer::default(),
            consumers: Consumers::default(),
            pdos,
            tx: Queue::new(),
            events: Queue::new(),
        }
    }

    /// Without SDO block transfers, as the drives of the robot.
    #[must_use]
    pub fn without_block(self) -> Self {
        Self { server: self.server.without_block(), ..self }
    }

    /// The node id.
    #[must_use]
    pub fn id(&self) -> u8 {
        self.dictionary.node()
    }

    /// The NMT state; `None` when switched off.
    #[must_use]
    pub fn nmt_state(&self) -> Option<NmtState> {
        match self.phase {
            Phase::Off => None,
            Phase::Booting { .. } => Some(NmtState::Initialising),
            Phase::Running(state) => Some(state),
        }
    }

    /// Switches the node on: all objects get their power-on values, the boot-up message follows.
    pub fn power_on(&mut self, now: Instant) {
        self.power_off();
        self.dictionary.reset(0x0000..=0xFFFF);
        self.boot(now);
    }

    /// Switches the node off, without a word.
    pub fn power_off(&mut self) {
        self.phase = Phase::Off;
        self.tx.clear();
        self.events.clear();
        self.server.reset();
    }

    fn boot(&mut self, now: Instant) {
        self.phase = Phase::Booting { until: now + self.boot_time };
        self.server.reset();
        self.producer.stop();
        self.consumers.stop();
        self.pdos.reload(&self.dictionary);
        self.events.push(NodeEvent::NmtState(NmtState::Initialising));
    }

    fn finish_boot(&mut self, now: Instant) {
        self.tx.push(wire::heartbeat(self.id(), NmtState::Initialising));
        self.producer.configure(self.number(0x1017, 0), now, false);
        self.consumers.configure(&self.dictionary);
        self.enter(now, NmtState::PreOperational);
    }

    fn enter(&mut self, now: Instant, state: NmtState) {
        if self.phase == Phase::Running(state) {
            return;
        }
        self.phase = Phase::Running(state);
        if state == NmtState::Stopped {
            self.server.reset();
        }
        if state == NmtState::Operational {
            self.pdos.start(now);
        }
        self.events.push(NodeEvent::NmtState(state));
    }

    /// A frame from the bus. Its own frames and those of others do no harm.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        let Phase::Running(state) = self.phase else {
            return;
        };
        let (Id::Standard(id), false) = (frame.id(), frame.is_remote()) else {
            return;
        };
        let service = Service::of(frame);
        // CiA 301, Table 37: which services live in which state.
        match (service, state) {
            (Some(Service::Nmt), _) => self.nmt(now, frame.data()),
            (Some(Service::ErrorControl { node }), _) => {
                self.error_control(now, node, frame.data());
            }
            (_, NmtState::Stopped | NmtState::Initialising) => {}
            (Some(Service::SdoRequest { node }), _) if node == self.id() => {
                self.sdo(now, frame.data());
            }
            (Some(Service::Sync), _) => self.sync(now, state),
            (_, NmtState::Operational) => self.rpdo(id, frame.data()),
            (_, NmtState::PreOperational) => {}
        }
    }

    fn nmt(&mut self, now: Instant, data: &[u8]) {
        let Some((command, node)) = wire::decode_nmt(data) else {
            return;
        };
        if node != 0 && node != self.id() {
            return;
        }
        match command {
            NmtCommand::Start => self.enter(now, NmtState::Operational),
            NmtCommand::Stop => self.enter(now, NmtState::Stopped),
            NmtCommand::EnterPreOperational => self.enter(now, NmtState::PreOperational),
            NmtCommand::ResetCommunication => {
                self.dictionary.reset(0x1000..=0x1FFF);
                self.boot(now);
                self.handle_timeout(now);
            }
            NmtCommand::ResetNode => {
                self.dictionary.reset(0x0000..=0xFFFF);
                self.events.push(NodeEvent::ResetApplication);
                self.boot(now);
                self.handle_timeout(now);
            }
        }
    }

    fn error_control(&mut self, now: Instant, node: u8, data: &[u8]) {
        let Some(state) = wire::decode_heartbeat(data) else {
            return;
        };
        if self.consumers.heard(now, node, state) {
            self.events.push(NodeEvent::HeartbeatBack { node });
        }
    }

    fn sdo(&mut self, now: Instant, data: &[u8]) {
        let mut guarded =
            Guarded { dictionary: &mut self.dictionary, phase: self.phase, pdos: &self.pdos, written: None };
        let answer = self.server.handle_rx(now, data, &mut guarded);
        let written = guarded.written;
        if let Some(answer) = answer {
            self.tx.push(Frame::standard(Service::SdoResponse { node: self.id() }.cob_id(), &answer));
        }
        if let Some((index, sub)) = written {
            self.written(now, index, sub);
        }
    }

    /// What the node itself does when an object was written; then the application is told.
    fn written(&mut self, now: Instant, index: u16, sub: u8) {
        match (index, sub) {
            (0x1003, 0) => self.clear_history(),
            (0x1010, _) => {
                self.dictionary.set(index, sub, 1);
                self.dictionary.store();
            }
            (0x1011, _) => {
                self.dictionary.set(index, sub, 1);
                self.dictionary.restore();
            }
            (0x1016, _) => self.consumers.configure(&self.dictionary),
            (0x1017, _) => self.producer.configure(self.number(0x1017, 0), now, true),
            (0x1400..=0x1BFF, _) => self.pdos.configure(&self.dictionary, index, now),
            _ => {}
        }
        self.pdos.touch(&self.dictionary, index, sub);
        self.events.push(NodeEvent::ObjectWritten { index, sub });
    }

    fn sync(&mut self, now: Instant, state: NmtState) {
        if state != NmtState::Operational {
            return;
        }
        // Outputs first: a TPDO of this SYNC may carry what an RPDO brought.
        while let Some(number) = self.pdos.take_buffered() {
            self.apply(number);
        }
        self.pdos.sync(now, &self.dictionary, &mut self.tx);
    }

    fn rpdo(&mut self, id: u16, data: &[u8]) {
        while let Some(outcome) = self.pdos.receive(id, data) {
            match outcome {
                pdo::Received::Apply(number) => self.apply(number),
                pdo::Received::Buffered => {}
                pdo::Received::TooShort(number) => {
                    self.events.push(NodeEvent::PdoTooShort { number });
                    let register = self.number(0x1001, 0) as u8 | 0x10;
                    self.emergency(0x8210, register, [0; 5]);
                }
            }
        }
    }

    fn apply(&mut self, number: usize) {
        let written = self.pdos.apply(number, &mut self.dictionary);
        let keys = || written.iter().map(|at| self.dictionary.key_at(*at));
        for key in keys() {
            self.pdos.touch(&self.dictionary, key.0, key.1);
        }
        let (last, first): (heapless::Vec<_, 8>, heapless::Vec<_, 8>) =
            (keys().filter(|key| key.0 == 0x6040).collect(), keys().filter(|key| key.0 != 0x6040).collect());
        for (index, sub) in first.into_iter().chain(last) {
            self.events.push(NodeEvent::ObjectWritten { index, sub });
        }
    }

    /// Sends an emergency and remembers it in 0x1003; `code` 0: an error went away. `register` becomes 0x1001.
    /// Nothing is sent where the NMT state forbids it.
    pub fn emergency(&mut self, code: u16, register: u8, info: [u8; 5]) {
        self.dictionary.set(0x1001, 0, i64::from(register));
        self.pdos.touch(&self.dictionary, 0x1001, 0);
        if code != 0 {
            self.remember(code, info);
        }
        let talks = matches!(self.phase, Phase::Running(NmtState::Operational | NmtState::PreOperational));
        let cob_id = self.dictionary.get(0x1014, 0).unwrap_or(0x80 + i64::from(self.id()));
        if talks && cob_id & 1 << 31 == 0 {
            let data = Emergency { code, register, info }.encode();
            self.tx.push(Frame::standard(cob_id as u16, &data));
        }
    }

    /// The newest error moves to the front of 0x1003.
    fn remember(&mut self, code: u16, info: [u8; 5]) {
        let room = (1..=254).take_while(|sub| self.dictionary.get(0x1003, *sub).is_some()).count() as u8;
        for sub in (1..room).rev() {
            let older = self.number(0x1003, sub);
            self.dictionary.set(0x1003, sub + 1, older);
        }
        let [low, high, ..] = info;
        self.dictionary.set(0x1003, 1, i64::from(u16::from_le_bytes([low, high])) << 16 | i64::from(code));
        let count = self.number(0x1003, 0) + 1;
        self.dictionary.set(0x1003, 0, count.min(i64::from(room)));
    }

    fn clear_history(&mut self) {
        for sub in 1..=254 {
            if self.dictionary.get(0x1003, sub).is_none() {
                break;
            }
            self.dictionary.set(0x1003, sub, 0);
        }
    }

    /// Does what is due at `now`: boot-up, heartbeats, PDOs, lost heartbeats. Late or needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        if let Phase::Booting { until } = self.phase
            && until <= now
        {
            self.finish_boot(now);
        }
        let Phase::Running(state) = self.phase else {
            return;
        };
        if self.producer.due(now) {
            self.tx.push(wire::heartbeat(self.id(), state));
        }
        while let Some(node) = self.consumers.take_lost(now) {
            self.events.push(NodeEvent::HeartbeatLost { node });
            self.communication_error(now);
        }
        if let Some(answer) = self.server.handle_timeout(now) {
            self.tx.push(Frame::standard(Service::SdoResponse { node: self.id() }.cob_id(), &answer));
        }
        if self.phase == Phase::Running(NmtState::Operational) {
            self.pdos.send_due(now, &self.dictionary, &mut self.tx);
        }
    }

    /// CiA 301, 0x1029:1. A device without the object (EPOS) keeps its state and reacts by itself.
    fn communication_error(&mut self, now: Instant) {
        let operational = self.phase == Phase::Running(NmtState::Operational);
        match self.dictionary.get(0x1029, 1) {
            Some(0) if operational => self.enter(now, NmtState::PreOperational),
            Some(2) => self.enter(now, NmtState::Stopped),
            _ => {}
        }
    }

    /// A frame to send. The segments of a block that is read come last, one by one.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        let segment = |data: [u8; 8]| Frame::standard(Service::SdoResponse { node: self.dictionary.node() }.cob_id(), &data);
        self.tx.pop().or_else(|| self.server.poll_tx().map(segment))
    }

    /// What happened.
    pub fn poll_event(&mut self) -> Option<NodeEvent> {
        self.events.pop()
    }

    /// When to call [`Self::handle_timeout`]; a past moment means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let state = match self.phase {
            Phase::Off => return None,
            Phase::Booting { until } => return Some(until),
            Phase::Running(state) => state,
        };
        let pdos = (state == NmtState::Operational).then(|| self.pdos.poll_timeout()).flatten();
        [self.producer.next(), self.consumers.next(), self.server.poll_timeout(), pdos].into_iter().flatten().min()
    }

    /// The value of a number; `None` when there is no such number.
    #[must_use]
    pub fn get(&self, index: u16, sub: u8) -> Option<i64> {
        self.dictionary.get(index, sub)
    }

    fn number(&self, index: u16, sub: u8) -> i64 {
        self.get(index, sub).unwrap_or(0)
    }

    /// Sets a number, cut to its width. When it changes, the event-driven PDOs that carry it are sent at the next
    /// [`Self::handle_timeout`].
    pub fn set(&mut self, index: u16, sub: u8, value: i64) {
        if self.dictionary.set(index, sub, value) {
            self.pdos.touch(&self.dictionary, index, sub);
        }
    }

    /// The objects, to read.
    #[must_use]
    pub fn dictionary(&self) -> &Dictionary {
        &self.dictionary
    }

    /// Sets a text or domain.
    pub fn set_bytes(&mut self, index: u16, sub: u8, bytes: &[u8]) {
        self.dictionary.set_bytes(index, sub, bytes);
    }
}
