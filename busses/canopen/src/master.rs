//! The master: heartbeat, NMT, the boot-up of each node by itself (thin after CiA 302-2), SDO on demand, PDOs.
//!
//! A node that was lost is booted again for ever, at a calm rate. No PDO leaves for a node before it is Booted, and
//! what waits for a node that was lost is thrown away: no stale command reaches a drive that comes back.

mod channel;
mod config;
mod events;
mod heartbeat;
mod outbox;
mod peer;
mod plan;
mod shared;
mod stats;
mod strangers;
#[cfg(test)]
mod tests;

pub use config::{ConfigError, ConfigWrite, Expect, MasterConfig, NodeConfig, PdoMapping};
pub use events::{BootError, Event, LostReason, PdoError, RequestError, State, Step, Ticket};
pub use stats::{RoundTrip, Stats};

use crate::wire::{self, NmtCommand, NmtState, Service};
use crate::{Payload, sdo};
use alloc::vec::Vec;
use base::can::Frame;
use base::{Instant, Ticker};
use channel::{Demand, Transfer};
use heartbeat::OwnHeartbeat;
use peer::Peer;
use shared::Shared;
use strangers::Strangers;

/// Whom an NMT command addresses.
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
    peers: Vec<Peer>,
    strangers: Strangers,
    heartbeat: Option<OwnHeartbeat>,
    sync: Option<Ticker>,
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
        let peers = nodes.iter().map(|node| Peer::new(node.clone(), &config)).collect();
        let strangers = Strangers::new(config.sdo_timeout);
        Ok(Self { shared: Shared::new(config), peers, strangers, heartbeat: None, sync: None, tickets: 0, foreign: 0 })
    }

    fn peer(&self, node: u8) -> Option<&Peer> {
        self.peers.iter().find(|peer| peer.id() == node)
    }

    fn peer_mut(&mut self, node: u8) -> Option<(&mut Peer, &mut Shared)> {
        let peer = self.peers.iter_mut().find(|peer| peer.id() == node)?;
        Some((peer, &mut self.shared))
    }

    /// A frame from the bus. The master's own frames, where the bus gives them back, do no harm.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        self.shared.outbox.at(now);
        self.shared.outbox.crossed(frame);
        if frame.is_remote() {
            return;
        }
        match Service::of(frame) {
            Some(Service::ErrorControl { node }) if node == self.shared.config.id => {
                self.own_heartbeat(now);
            }
            Some(Service::ErrorControl { node }) => {
                self.to(node, |peer, shared| peer.heartbeat(now, frame, shared));
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
            // NMT, SYNC, RPDO and SDO requests are our own frames come back, or another master's.
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
    }

    fn to(&mut self, node: u8, act: impl FnOnce(&mut Peer, &mut Shared)) {
        match self.peer_mut(node) {
            Some((peer, shared)) => act(peer, shared),
            None => self.foreign = self.foreign.saturating_add(1),
        }
    }

    fn own_heartbeat(&mut self, now: Instant) {
        let Some(heartbeat) = &mut self.heartbeat else {
            return;
        };
        if heartbeat.heard(now) {
            self.shared.events.push(Event::SecondMaster);
        }
    }

    /// Does what is due at `now`. Late or needless calls do no harm.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.shared.outbox.at(now);
        let config = &self.shared.config;
        let heartbeat = self.heartbeat.get_or_insert_with(|| OwnHeartbeat::new(now, config));
        if heartbeat.due(now) {
            self.shared.outbox.push(wire::heartbeat(config.id, NmtState::Operational));
        }
        if let Some(period) = config.sync
            && self.sync.get_or_insert_with(|| Ticker::new(now, period)).due(now)
        {
            self.shared.outbox.push(wire::sync());
        }
        for peer in &mut self.peers {
            peer.handle_timeout(now, &mut self.shared);
        }
        self.strangers.handle_timeout(now, &mut self.shared);
    }

    /// The bus is down: what waits to be sent is thrown away, all nodes are lost and booted again.
    pub fn handle_bus_down(&mut self, now: Instant) {
        self.shared.outbox.at(now);
        self.shared.outbox.clear();
        for peer in &mut self.peers {
            peer.bus_down(now, &mut self.shared);
        }
        self.strangers.forget(&mut self.shared);
    }

    /// A frame to send. SDO frames come after all others, and only as many as the wire takes within a moment.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        if let Some(frame) = self.shared.outbox.pop() {
            return Some(frame);
        }
        while let Some(node) = self.shared.outbox.turn() {
            let said = match self.peers.iter_mut().find(|peer| peer.id() == node) {
                Some(peer) => peer.poll_tx(),
                None => self.strangers.poll_tx(node),
            };
            if let Some(frame) = said {
                self.shared.outbox.said(&frame);
                return Some(frame);
            }
            self.shared.outbox.unmark(node);
        }
        None
    }

    /// What happened. Drain after every call: a full queue loses the newest.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.shared.events.pop()
    }

    /// When to call [`Self::handle_timeout`]; a past moment means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let Some(heartbeat) = &self.heartbeat else {
            return Some(Instant::ZERO);
        };
        let peers = self.peers.iter().filter_map(Peer::poll_timeout).min();
        let sync = self.sync.map(|ticker| ticker.next());
        let channels = [self.strangers.poll_timeout(), self.shared.outbox.poll_timeout()];
        [Some(heartbeat.next()), sync, peers].into_iter().chain(channels).flatten().min()
    }

    /// Sends the data (at most 8 bytes) of an RPDO, numbered 1 to 4 from the node's side.
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub fn send_pdo(&mut self, node: u8, number: u8, data: &[u8]) -> Result<(), PdoError> {
        let peer = self.peer(node).ok_or(PdoError::UnknownNode)?;
        match () {
            () if !peer.is_operational() => Err(PdoError::NotOperational),
            () if !(1..=4).contains(&number) => Err(PdoError::Number),
            () if data.len() > 8 => Err(PdoError::TooLong),
            () => {
                let frame = Frame::standard(Service::Rpdo { node, number }.cob_id(), data);
                if self.shared.outbox.push(frame) { Ok(()) } else { Err(PdoError::QueueFull) }
            }
        }
    }

    /// Asks any node but this one for an object, as soon as its SDO channel is free of boot-up work. The answer is
    /// [`Event::SdoRead`] or [`Event::SdoFailed`] with the ticket.
    ///
    /// Up to 16 requests wait for a node; nodes that are not configured may be asked too, 8 of them at a time.
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub fn sdo_read(&mut self, now: Instant, node: u8, index: u16, sub: u8) -> Result<Ticket, RequestError> {
        self.request(now, node, index, sub, Transfer::Read)
    }

    /// Reads an object as a block transfer, or as another one where the node knows no block transfer; see
    /// [`Self::sdo_read`].
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub fn sdo_read_block(&mut self, now: Instant, node: u8, index: u16, sub: u8) -> Result<Ticket, RequestError> {
        self.request(now, node, index, sub, Transfer::ReadBlock)
    }

    /// Writes an object; see [`Self::sdo_read`]. The answer is [`Event::SdoWritten`] or [`Event::SdoFailed`].
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub fn sdo_write(
        &mut self,
        now: Instant,
        node: u8,
        index: u16,
        sub: u8,
        data: impl Into<Payload>,
    ) -> Result<Ticket, RequestError> {
        self.request(now, node, index, sub, Transfer::Write(data.into()))
    }

    /// Writes an object as a block transfer, or as another one where the node knows no block transfer; see
    /// [`Self::sdo_write`].
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub fn sdo_write_block(
        &mut self,
        now: Instant,
        node: u8,
        index: u16,
        sub: u8,
        data: impl Into<Payload>,
    ) -> Result<Ticket, RequestError> {
        self.request(now, node, index, sub, Transfer::WriteBlock(data.into()))
    }

    fn request(
        &mut self,
        now: Instant,
        node: u8,
        index: u16,
        sub: u8,
        transfer: Transfer,
    ) -> Result<Ticket, RequestError> {
        self.shared.outbox.at(now);
        if !(1..=127).contains(&node) || node == self.shared.config.id {
            return Err(RequestError::UnknownNode);
        }
        if let Transfer::Write(data) | Transfer::WriteBlock(data) = &transfer
            && data.len() > sdo::MAX_LEN
        {
            return Err(RequestError::TooLong);
        }
        let ticket = Ticket(self.tickets);
        let demand = Demand { ticket, index, sub, transfer };
        match self.peer_mut(node) {
            Some((peer, shared)) => peer.request(now, demand, shared)?,
            None => self.strangers.request(now, node, demand, &mut self.shared)?,
        }
        self.tickets = self.tickets.wrapping_add(1);
        Ok(ticket)
    }

    /// Sends an NMT command. A running node that is told to stop, or to reset, counts as lost when its heartbeat
    /// or boot-up message says so, and is booted again.
    pub fn nmt(&mut self, target: Target, command: NmtCommand) {
        let node = match target {
            Target::All => 0,
            Target::Node(node) => node,
        };
        self.shared.outbox.push(wire::nmt(command, node));
    }

    /// Boots a node anew, from its reset; false when it is not configured. Stop a drive first: what it does when it
    /// is reset while it turns is its own affair.
    pub fn reboot(&mut self, now: Instant, node: u8) -> bool {
        let known = self.peer_mut(node);
        known.is_some_and(|(peer, shared)| {
            peer.reboot(now, shared);
            true
        })
    }

    /// How far a node is; `None` when it is not configured.
    #[must_use]
    pub fn state(&self, node: u8) -> Option<State> {
        self.peer(node).map(Peer::state)
    }

    /// The NMT state that a node last named; `None` when it was not heard since it was lost.
    #[must_use]
    pub fn nmt_state(&self, node: u8) -> Option<NmtState> {
        self.peer(node)?.nmt_state()
    }

    /// A node's configuration.
    #[must_use]
    pub fn config(&self, node: u8) -> Option<&NodeConfig> {
        self.peer(node).map(Peer::config)
    }

    /// What was counted for a node.
    #[must_use]
    pub fn stats(&self, node: u8) -> Option<&Stats> {
        self.peer(node).map(Peer::stats)
    }

    /// Frames that are no business of ours: of other nodes, other masters, or our own come back.
    #[must_use]
    pub fn foreign_frames(&self) -> u32 {
        self.foreign
    }

    /// Frames and events lost because nobody drained them.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.shared.outbox.dropped().saturating_add(self.shared.events.dropped())
    }
}
