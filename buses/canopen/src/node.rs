//! The node side of CiA 301: NMT slave, SDO server, heartbeats or guarding, emergencies, SYNC, TIME and PDOs, driven by
//! its object dictionary, and if wanted a slave of CiA 305. What an emulated drive is made of.
//!
//! The application sets objects as its device changes and reads them when [`NodeEvent::ObjectWritten`] says so;
//! after setting, call [`Node::handle_timeout`]: what was set together leaves together.

mod emergency;
mod guard;
mod heartbeat;
mod layer;
mod objects;
mod pdo;
mod sync;
#[cfg(test)]
mod tests;

use crate::lss::{self, BitRate};
use crate::wire::{self, NmtCommand, NmtState, Service, TimeOfDay};
use crate::{Dictionary, sdo};
use base::can::{Frame, Id};
use base::{Duration, Instant, Queue, earliest};
use emergency::Emergencies;
use guard::Guard;
use heartbeat::{Consumers, Producer};
use objects::Guarded;
use pdo::Pdos;
use sync::Sync;

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
    /// A received PDO is longer than its mapping: its first bytes were used, and an emergency 0x8220 was sent. Reported
    /// once until one fits.
    PdoTooLong {
        /// 1 for the PDO of 0x1400.
        number: u16,
    },
    /// A received PDO missed its event timer (0x1400:5); an emergency 0x8250 was sent. Reported once until it comes
    /// again.
    PdoLate {
        /// 1 for the PDO of 0x1400.
        number: u16,
    },
    /// No guarding request of the master within the life time (0x100C, 0x100D).
    GuardLost,
    /// Guarding requests arrive again.
    GuardBack,
    /// The time of day, when 0x1012 consumes it.
    Time(TimeOfDay),
    /// LSS: switch the controller to this bit rate now. The node sends nothing for a while before and after.
    BitRate(BitRate),
    /// LSS: node id (`None`: none) and bit rate are to be stored permanently. The node itself keeps them until
    /// power-off.
    LssStored {
        /// 1 to 127.
        node_id: Option<u8>,
        /// The bit rate.
        bit_rate: BitRate,
    },
}

/// Progress of the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Off,
    Booting {
        until: Instant,
    },
    /// No node id: only LSS is received.
    Unconfigured,
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
    guard: Guard,
    sync: Sync,
    emergencies: Emergencies,
    pdos: Pdos,
    lss: Option<lss::Slave>,
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
            guard: Guard::default(),
            sync: Sync::default(),
            emergencies: Emergencies::default(),
            pdos,
            lss: None,
            tx: Queue::new(),
            events: Queue::new(),
        }
    }

    /// Without SDO block transfers, as the drives of the robot.
    #[must_use]
    pub fn without_block(self) -> Self {
        Self { server: self.server.without_block(), ..self }
    }

    /// The node id; [`lss::UNCONFIGURED`] when it has none.
    #[must_use]
    pub fn id(&self) -> u8 {
        self.lss.as_ref().map_or(Some(self.dictionary.node()), lss::Slave::node_id).unwrap_or(lss::UNCONFIGURED)
    }

    /// The NMT state; `None` when switched off.
    #[must_use]
    pub fn nmt_state(&self) -> Option<NmtState> {
        match self.phase {
            Phase::Off => None,
            Phase::Booting { .. } | Phase::Unconfigured => Some(NmtState::Initialising),
            Phase::Running(state) => Some(state),
        }
    }

    /// Switches the node on: all objects get their power-on values, the boot-up message follows.
    pub fn power_on(&mut self, now: Instant) {
        self.power_off();
        if let Some(lss) = &mut self.lss {
            lss.power_on();
        }
        self.dictionary.reset(0x0000..=0xFFFF);
        self.boot(now);
    }

    /// Switches the node off, without a word.
    pub fn power_off(&mut self) {
        self.phase = Phase::Off;
        self.tx.clear();
        self.events.clear();
        self.server.reset();
        self.emergencies.clear();
    }

    fn boot(&mut self, now: Instant) {
        self.phase = Phase::Booting { until: now + self.boot_time };
        self.server.reset();
        self.producer.stop();
        self.consumers.stop();
        self.sync.stop();
        self.emergencies.clear();
        // A node id that was set by LSS comes into use here, and with it the identifiers.
        match self.lss.as_mut().map(lss::Slave::activate_node_id) {
            Some(Some(node)) => self.dictionary.renumber(node),
            Some(None) => self.phase = Phase::Unconfigured,
            None => {}
        }
        self.pdos.reload(&self.dictionary);
        self.events.push(NodeEvent::NmtState(NmtState::Initialising));
    }

    fn finish_boot(&mut self, now: Instant) {
        self.tx.push(wire::heartbeat(self.id(), NmtState::Initialising));
        self.producer.configure(self.number(0x1017, 0), now, false);
        self.consumers.configure(&self.dictionary);
        self.guard.restart(&self.dictionary);
        self.enter(now, NmtState::PreOperational);
        // CiA 302-2, 0x1F80: bit 2 keeps a slave from starting itself.
        if self.get(0x1F80, 0).is_some_and(|startup| startup & 1 << 2 == 0) {
            self.enter(now, NmtState::Operational);
        }
    }

    fn enter(&mut self, now: Instant, state: NmtState) {
        if self.phase == Phase::Running(state) {
            return;
        }
        let silent = !matches!(self.phase, Phase::Running(NmtState::PreOperational | NmtState::Operational));
        self.phase = Phase::Running(state);
        match state {
            NmtState::Stopped => {
                self.server.reset();
                self.sync.stop();
                self.emergencies.clear();
            }
            _ if silent => self.sync.configure(&self.dictionary, now),
            _ => {}
        }
        if state == NmtState::Operational {
            self.pdos.start(now, &self.dictionary);
        }
        self.events.push(NodeEvent::NmtState(state));
    }

    /// A frame from the bus. Its own frames and those of others do no harm.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        let service = Service::of(frame);
        if service == Some(Service::LssRequest) {
            return self.layer_setting(now, frame);
        }
        let (Phase::Running(state), Id::Standard(id)) = (self.phase, frame.id()) else {
            return;
        };
        if frame.is_remote() {
            self.remote(now, state, service, id);
        } else {
            self.serve(now, state, service, id, frame);
        }
        self.hush(now);
    }

    fn serve(&mut self, now: Instant, state: NmtState, service: Option<Service>, id: u16, frame: &Frame) {
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
            _ if id == self.sync.cob_id() => self.receive_sync(now, state, frame.data()),
            _ if self.consumes_time(id) => {
                if let Some(time) = TimeOfDay::decode(frame.data()) {
                    self.events.push(NodeEvent::Time(time));
                }
            }
            (_, NmtState::Operational) => self.rpdo(now, id, frame.data()),
            (_, NmtState::PreOperational) => {}
        }
    }

    fn consumes_time(&self, id: u16) -> bool {
        let cob_id = self.number(0x1012, 0);
        cob_id & 1 << 31 != 0 && cob_id & 0x7FF == i64::from(id)
    }

    /// Remote frames ask for the state (node guarding) or a PDO.
    fn remote(&mut self, now: Instant, state: NmtState, service: Option<Service>, id: u16) {
        match service {
            // Heartbeats exclude guarding.
            Some(Service::ErrorControl { node }) if node == self.id() && self.number(0x1017, 0) == 0 => {
                let (toggle, back) = self.guard.asked(now);
                self.tx.push(wire::guard_answer(node, state, toggle));
                if back {
                    self.events.push(NodeEvent::GuardBack);
                }
            }
            _ if state == NmtState::Operational => self.pdos.remote(now, id, &self.dictionary, &mut self.tx),
            _ => {}
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
        let mut guarded = Guarded { dictionary: &mut self.dictionary, phase: self.phase, written: None };
        let answer = self.server.handle_rx(now, data, &mut guarded);
        let written = guarded.written;
        if let Some(answer) = answer {
            self.tx.push(Frame::standard(Service::SdoResponse { node: self.id() }.cob_id(), &answer));
        }
        if let Some((index, sub)) = written {
            self.written(now, index, sub);
        }
    }

    /// The node's own reaction to a written object, before the application is informed.
    fn written(&mut self, now: Instant, index: u16, sub: u8) {
        match (index, sub) {
            (0x1003, 0) => emergency::clear_history(&mut self.dictionary),
            (0x1005 | 0x1006 | 0x1019, 0) => self.sync.configure(&self.dictionary, now),
            (0x100C | 0x100D, 0) => self.guard.configure(&self.dictionary),
            (0x1010, _) => {
                self.dictionary.set(index, sub, 1);
                self.dictionary.store();
            }
            (0x1011, _) => {
                self.dictionary.set(index, sub, 1);
                self.dictionary.restore();
            }
            (0x1016, _) => self.consumers.configure(&self.dictionary),
            (0x1017, _) => {
                self.producer.configure(self.number(0x1017, 0), now, true);
                self.guard.configure(&self.dictionary);
            }
            (0x1400..=0x1BFF, _) => self.pdos.configure(&self.dictionary, index, now),
            _ => {}
        }
        // 0x1020 identifies a configuration: any other write invalidates it, except process data.
        if !matches!(index, 0x1003 | 0x1010 | 0x1011 | 0x1020) && !self.dictionary.is_mappable(index, sub) {
            self.dictionary.set(0x1020, 1, 0);
            self.dictionary.set(0x1020, 2, 0);
        }
        self.pdos.touch(&self.dictionary, index, sub);
        self.events.push(NodeEvent::ObjectWritten { index, sub });
    }

    fn receive_sync(&mut self, now: Instant, state: NmtState, data: &[u8]) {
        let (counter, unexpected) = self.sync.receive(data);
        if unexpected {
            self.communication_emergency(0x8240);
        }
        self.synchronise(now, state, counter);
    }

    fn synchronise(&mut self, now: Instant, state: NmtState, counter: u8) {
        if state != NmtState::Operational {
            return;
        }
        // Outputs first: a TPDO of this SYNC may carry what an RPDO brought.
        while let Some(number) = self.pdos.take_buffered() {
            self.apply(number);
        }
        self.pdos.sync(now, counter, &self.dictionary, &mut self.tx);
    }

    fn rpdo(&mut self, now: Instant, id: u16, data: &[u8]) {
        while let Some(outcome) = self.pdos.receive(now, id, data) {
            let too_long = match outcome {
                pdo::Received::Apply(number, too_long) => {
                    self.apply(number);
                    too_long
                }
                pdo::Received::Buffered(too_long) => too_long,
                pdo::Received::TooShort(number) => {
                    self.events.push(NodeEvent::PdoTooShort { number });
                    self.communication_emergency(0x8210);
                    None
                }
            };
            if let Some(number) = too_long {
                self.events.push(NodeEvent::PdoTooLong { number });
                self.communication_emergency(0x8220);
            }
        }
    }

    fn apply(&mut self, number: usize) {
        let written = self.pdos.apply(number, &mut self.dictionary);
        for at in &written {
            self.pdos.touch_at(*at);
        }
        let keys = || written.iter().map(|at| self.dictionary.key_at(*at));
        let (last, first): (heapless::Vec<_, 64>, heapless::Vec<_, 64>) =
            (keys().filter(|key| key.0 == 0x6040).collect(), keys().filter(|key| key.0 != 0x6040).collect());
        for (index, sub) in first.into_iter().chain(last) {
            self.events.push(NodeEvent::ObjectWritten { index, sub });
        }
    }

    /// Does what is due at `now`: boot-up, heartbeats, SYNC, PDOs, emergencies, and what has not come in its time. Late
    /// or needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.phase != Phase::Off
            && let Some(lss) = &mut self.lss
        {
            lss.handle_timeout(now);
            self.obey_lss(now);
        }
        self.serve_timers(now);
        self.hush(now);
    }

    fn serve_timers(&mut self, now: Instant) {
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
        if self.guard.take_lost(now) {
            self.events.push(NodeEvent::GuardLost);
            self.communication_error(now);
        }
        if let Some(answer) = self.server.handle_timeout(now) {
            self.tx.push(Frame::standard(Service::SdoResponse { node: self.id() }.cob_id(), &answer));
        }
        if let Some((sync, counter)) = self.sync.due(now) {
            self.tx.push(sync);
            self.synchronise(now, state, counter);
        }
        if self.phase == Phase::Running(NmtState::Operational) {
            while let Some(number) = self.pdos.take_late(now) {
                self.events.push(NodeEvent::PdoLate { number });
                self.communication_emergency(0x8250);
            }
            self.pdos.send_due(now, &self.dictionary, &mut self.tx);
        }
        while let Some(data) = self.emergencies.due(now, &self.dictionary) {
            self.send_emergency(&data);
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
        if let Some(frame) = self.lss.as_mut().and_then(lss::Slave::poll_tx).or_else(|| self.tx.pop()) {
            return Some(frame);
        }
        let segment = self.server.poll_tx()?;
        Some(Frame::standard(Service::SdoResponse { node: self.id() }.cob_id(), &segment))
    }

    /// Next event.
    pub fn poll_event(&mut self) -> Option<NodeEvent> {
        self.events.pop()
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let lss = self.lss.as_ref().and_then(lss::Slave::poll_timeout);
        let state = match self.phase {
            Phase::Off => return None,
            Phase::Booting { until } => return earliest([lss, Some(until)]),
            Phase::Unconfigured => return lss,
            Phase::Running(state) => state,
        };
        let pdos = (state == NmtState::Operational).then(|| self.pdos.poll_timeout()).flatten();
        earliest([
            self.consumers.next(),
            self.guard.next(),
            self.server.poll_timeout(),
            self.producer.next(),
            self.sync.next(),
            self.emergencies.next(),
            pdos,
            lss,
        ])
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
        if let Ok(at) = self.dictionary.find(index, sub)
            && self.dictionary.set_at(at, value)
        {
            self.pdos.touch_at(at);
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
