//! The master: heartbeat, guarding, NMT, SYNC and TIME, the boot-up of each node after CiA 302-2, SDO on demand, PDOs.
//!
//! A node that was lost is booted again for ever, at a calm rate. No PDO leaves for a node before it is Booted, and
//! what waits for a node that was lost is thrown away: no stale command reaches a drive that comes back.

mod census;
mod channel;
mod commands;
mod config;
mod duplicate;
mod events;
mod heartbeat;
mod outbox;
mod peer;
mod peers;
mod plan;
mod producers;
mod rival;
mod shared;
mod stats;
mod strangers;
#[cfg(test)]
mod tests;

pub use crate::write::{ConfigWrite, How};
pub use config::{ConfigError, Expect, Farewell, Guarding, MasterConfig, NodeConfig, PdoMapping, Stamp};
pub use events::{BootError, Event, Foreign, LostReason, PdoError, RequestError, State, Step, Ticket};
pub use stats::{Jitter, RoundTrip, Spread, Stats};

use crate::wire::{self, NmtState, Service};
use base::can::Frame;
use base::{Instant, earliest};
use census::Census;
use heartbeat::OwnHeartbeat;
use peer::Peer;
use peers::Peers;
use producers::{Sync, Time};
use rival::Rival;
use shared::Shared;
use strangers::Strangers;

/// Addressee of an NMT command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// All nodes; never the master itself.
    All,
    /// One node, configured or not.
    Node(u8),
}

/// A CANopen master. Its first [`Self::handle_timeout`] starts it.
pub struct Master {
    shared: Shared,
    peers: Peers,
    strangers: Strangers,
    census: Census,
    state: NmtState,
    heartbeat: Option<OwnHeartbeat>,
    sync: Option<Sync>,
    time: Option<Time>,
    rival: Rival,
    tickets: u32,
    foreign: u32,
}

impl Master {
    /// A master for these nodes.
    ///
    /// # Errors
    /// What is wrong with the configuration.
    pub fn new(config: MasterConfig, nodes: &[NodeConfig]) -> Result<Self, ConfigError> {
        config.check(nodes)?;
        let mandatory = nodes.iter().filter(|node| node.mandatory).count();
        Ok(Self {
            peers: Peers::new(&config, nodes),
            strangers: Strangers::new(config.sdo_timeout),
            census: Census::new(&config),
            state: NmtState::Operational,
            heartbeat: None,
            sync: None,
            time: Time::new(&config),
            rival: Rival::new(&config),
            tickets: 0,
            foreign: 0,
            shared: Shared::new(config, mandatory),
        })
    }

    /// A frame from the bus, which arrives now. The master's own frames, where the bus returns them, do no harm.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        self.handle_rx_at(now, now, frame);
    }

    /// A frame from the bus that arrived at `arrived` and was read at `now`. A node's heartbeat shows that it lived
    /// when the frame arrived: one that waited to be read does not extend its life.
    pub fn handle_rx_at(&mut self, now: Instant, arrived: Instant, frame: &Frame) {
        let arrived = arrived.min(now);
        self.shared.outbox.at(now);
        self.shared.outbox.crossed(frame);
        if frame.is_remote() {
            return;
        }
        let service = Service::of(frame);
        self.count(service, frame);
        self.watch_for_rival(now, service, frame);
        match service {
            Some(Service::ErrorControl { node }) if node == self.shared.config.id => {
                self.own_heartbeat(now);
            }
            Some(Service::ErrorControl { node }) => {
                if let Some(state) = wire::decode_heartbeat(frame.data()) {
                    self.named(node, state);
                }
                self.to(node, |peer, shared| peer.heartbeat(now, arrived, frame, shared));
            }
            Some(Service::SdoResponse { node }) if self.strangers.is_asked(node) => {
                self.strangers.handle_rx(now, node, frame, &mut self.shared);
            }
            Some(Service::SdoResponse { node }) => {
                self.to(node, |peer, shared| peer.sdo_response(now, frame, shared));
            }
            Some(Service::Emergency { node }) => {
                self.to(node, |peer, shared| peer.emergency(now, frame, shared));
            }
            Some(Service::Tpdo { node, number }) => {
                self.to(node, |peer, shared| peer.tpdo(number, frame, shared));
            }
            Some(Service::SdoRequest { node }) if !self.shared.config.own_frames_return => {
                self.foreign = self.foreign.saturating_add(1);
                let _known = self.peers.with(node, Peer::asked_by_others);
            }
            // Our own frames come back, or another master's, which was reported.
            Some(
                Service::Nmt
                | Service::Sync
                | Service::Time
                | Service::Rpdo { .. }
                | Service::SdoRequest { .. }
                | Service::LssRequest
                | Service::LssResponse,
            )
            | None => self.foreign = self.foreign.saturating_add(1),
        }
        self.settle(now);
    }

    /// Reports commands to our nodes that this master did not send.
    fn watch_for_rival(&mut self, now: Instant, service: Option<Service>, frame: &Frame) {
        let ours = |node: u8| self.peers.get(node).is_some();
        let command = match service {
            Some(Service::Nmt) => {
                rival::nmt_target(frame).filter(|node| *node == 0 || ours(*node)).map(|node| Foreign::Nmt { node })
            }
            Some(Service::Sync) => Some(Foreign::Sync),
            Some(Service::Rpdo { node, .. }) if ours(node) => Some(Foreign::Rpdo { node }),
            Some(Service::SdoRequest { node }) if ours(node) => Some(Foreign::SdoRequest { node }),
            _ => None,
        };
        if let Some(command) = command.and_then(|command| self.rival.received(now, frame, command)) {
            self.shared.events.push(Event::SecondMaster { by: command });
        }
    }

    /// Counts the frames of each node, except answers to requests.
    fn count(&mut self, service: Option<Service>, frame: &Frame) {
        let node = match service {
            Some(Service::SdoResponse { node })
                if self.strangers.is_asked(node) || self.peers.get(node).is_some_and(Peer::is_asked) =>
            {
                return;
            }
            Some(
                Service::Emergency { node }
                | Service::Tpdo { node, .. }
                | Service::SdoResponse { node }
                | Service::ErrorControl { node },
            ) => node,
            None => 0,
            Some(_) if self.shared.config.own_frames_return => return,
            Some(_) => 0,
        };
        self.census.count(node, frame);
    }

    /// A node named its state.
    fn named(&mut self, node: u8, state: NmtState) {
        self.census.named(node, state);
        if self.peers.get(node).is_none() && self.census.is_new(node) {
            self.shared.events.push(Event::Stranger { node });
        }
    }

    /// Consequences for all nodes of an event of one.
    fn settle(&mut self, now: Instant) {
        if core::mem::take(&mut self.shared.release) {
            self.peers.each(|peer| peer.release(now, &mut self.shared));
        }
        self.census.judge(now, &mut self.shared);
    }

    fn to(&mut self, node: u8, act: impl FnOnce(&mut Peer, &mut Shared)) {
        if self.peers.with(node, |peer| act(peer, &mut self.shared)).is_none() {
            self.foreign = self.foreign.saturating_add(1);
        }
    }

    fn own_heartbeat(&mut self, now: Instant) {
        let Some(heartbeat) = &mut self.heartbeat else {
            return;
        };
        if heartbeat.is_foreign() && self.rival.reported(now) {
            self.shared.events.push(Event::SecondMaster { by: Foreign::Heartbeat });
        }
    }

    /// Does what is due at `now`. Late or needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.shared.outbox.at(now);
        let config = &self.shared.config;
        if self.heartbeat.is_none() {
            self.sync = Sync::new(now, config);
        }
        let heartbeat = self.heartbeat.get_or_insert_with(|| OwnHeartbeat::new(now, config));
        if heartbeat.due(now) {
            self.shared.outbox.push(wire::heartbeat(config.id, self.state));
        }
        let sync = self.sync.as_mut().and_then(|sync| sync.due(now));
        let time = self.time.as_mut().and_then(|time| time.due(now));
        if self.state != NmtState::Stopped {
            for frame in [sync, time].into_iter().flatten() {
                self.shared.outbox.push(frame);
            }
        }
        self.peers.handle_timeout(now, &mut self.shared);
        self.strangers.handle_timeout(now, &mut self.shared);
        self.settle(now);
    }

    /// The bus is down: what waits to be sent is thrown away, all nodes are lost and booted again.
    pub fn handle_bus_down(&mut self, now: Instant) {
        self.shared.outbox.at(now);
        self.shared.outbox.clear();
        self.peers.each(|peer| peer.bus_down(now, &mut self.shared));
        self.strangers.forget(&mut self.shared);
    }

    /// Next frame to send. SDO frames come after all others, limited to what the wire takes at once.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        if let Some(frame) = self.shared.outbox.pop() {
            self.rival.sent(&frame);
            return Some(frame);
        }
        while let Some(node) = self.shared.outbox.turn() {
            let said = self.peers.with(node, Peer::poll_tx).unwrap_or_else(|| self.strangers.poll_tx(node));
            if let Some(frame) = said {
                self.shared.outbox.said(&frame);
                self.rival.sent(&frame);
                return Some(frame);
            }
            self.shared.outbox.unmark(node);
        }
        None
    }

    /// Next event. To be drained after every call: a full queue loses the newest.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.shared.events.pop()
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let Some(heartbeat) = &self.heartbeat else {
            return Some(Instant::ZERO);
        };
        earliest([
            Some(heartbeat.next()),
            self.sync.as_ref().map(Sync::next),
            self.time.as_ref().and_then(Time::next),
            self.peers.poll_timeout(),
            self.strangers.poll_timeout(),
            self.shared.outbox.poll_timeout(),
        ])
    }

    /// When the next SYNC is sent; `None`: none was configured, or the first call is still to come.
    #[must_use]
    pub fn next_sync(&self) -> Option<Instant> {
        self.sync.as_ref().map(Sync::next)
    }

    /// Progress of a node; `None` if it is not configured.
    #[must_use]
    pub fn state(&self, node: u8) -> Option<State> {
        self.peers.get(node).map(Peer::state)
    }

    /// NMT state that a node, configured or not, sent last; `None` if none was received, or none since the node was
    /// lost.
    #[must_use]
    pub fn nmt_state(&self, node: u8) -> Option<NmtState> {
        self.peers.get(node).map_or_else(|| self.census.state(node), Peer::nmt_state)
    }

    /// The master's own NMT state, as in its heartbeat: Operational, until it is changed. NMT commands to nodes, a
    /// reset of all included, do not change it.
    #[must_use]
    pub fn own_state(&self) -> NmtState {
        self.state
    }

    /// Changes the master's own NMT state: PDOs are sent only while it is Operational, SYNC and TIME not while it is
    /// Stopped (CiA 301, Table 37). [`NmtState::Initialising`] is ignored.
    pub fn set_own_state(&mut self, state: NmtState) {
        if state != NmtState::Initialising {
            self.state = state;
        }
    }

    /// Greatest latency of SYNC since the master began.
    #[must_use]
    pub fn sync_jitter(&self) -> Jitter {
        self.sync.as_ref().map(Sync::jitter).unwrap_or_default()
    }

    /// Sets the wall clock: `unix_us` microseconds since 1970-01-01 UTC at `now`. TIME begins with the first call,
    /// where it is configured; to be called again after a step of the wall clock.
    pub fn set_time(&mut self, now: Instant, unix_us: i64) {
        if let Some(time) = &mut self.time {
            time.set(now, unix_us);
        }
    }

    /// Its own node id.
    #[must_use]
    pub fn id(&self) -> u8 {
        self.shared.config.id
    }

    /// A node's configuration.
    #[must_use]
    pub fn config(&self, node: u8) -> Option<&NodeConfig> {
        self.peers.get(node).map(Peer::config)
    }

    /// Counters of a node.
    #[must_use]
    pub fn stats(&self, node: u8) -> Option<&Stats> {
        self.peers.get(node).map(Peer::stats)
    }

    /// The times of a node's SDO transfers since the last call.
    pub fn take_round_trips(&mut self, node: u8) -> RoundTrip {
        self.peers.with(node, Peer::take_round_trips).unwrap_or_default()
    }

    /// Frames that are no business of ours: of other nodes, other masters, or our own come back.
    #[must_use]
    pub fn foreign_frames(&self) -> u32 {
        self.foreign
    }

    /// Number of frames and events lost because they were not drained.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.shared.outbox.dropped().saturating_add(self.shared.events.dropped())
    }
}
