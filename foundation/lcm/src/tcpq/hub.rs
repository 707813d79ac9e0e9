//! The hub of TCPQ as an engine: bytes of clients in, bytes for clients out. Knows no socket and no clock.
//!
//! Each published message goes once to each client of which at least one expression matches its channel as a whole
//! ([`Pattern`]), also to the publisher. It is stored once, however many wait for it.
//!
//! No client can stall another: what is to be written to one waits in an outbox of its own, and when that is full the
//! oldest whole messages in it are dropped and counted. The official hub writes to each in turn and waits. A hub with
//! [`Overflow::Wait`] drops nothing: its host reads no client while [`Hub::is_full`], so publishers wait for the
//! slowest client, which the host disconnects if it takes nothing at all.
//! The host, after any input: drains [`Hub::poll_pending`] until `None`, writes to each client what [`Hub::poll_tx`]
//! returns, and reports to [`Hub::handle_tx`] the number of bytes taken; the rest is written when the connection takes
//! more.
//!
//! ```
//! use lcm::tcpq::{Peer, hello, hub::{Hub, Limits}, publish_header, subscribe};
//!
//! let mut hub = Hub::new(Limits::default());
//! let client = hub.connect().unwrap();
//! let message = [&publish_header("POSE", 7)[..], b"payload"].concat();
//! hub.handle_rx(client, &[&subscribe("POSE")[..], &message].concat()).unwrap();
//! assert_eq!(hub.poll_pending(), Some(client));
//! let pieces: Vec<&[u8]> = hub.poll_tx(client).collect();
//! assert_eq!(pieces, [&hello(Peer::Hub)[..], &message]);
//! ```

use super::{DecodeError, Decoder, Message, Outbox, Peer, hello};
use crate::subscription::Pattern;
use regex_lite::RegexBuilder;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Maximum number of channels with cached routes; beyond it the cache is rebuilt.
const ROUTES_MAX: usize = 1024;
/// Bytes of a compiled expression, by which memory and the time that matching a name takes are bounded: what one costs
/// at least and at most (1024 plain characters take as much), and all of a client.
const EXPRESSION: (usize, usize) = (1 << 10, 32 << 10);
const EXPRESSIONS_MAX: usize = 256 << 10;

/// Limits of a hub.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients at a time.
    pub clients: usize,
    /// Subscriptions of a client; their compiled expressions are limited to 256 KiB together.
    pub subscriptions: usize,
    /// Payload bytes of a message.
    pub message: usize,
    /// Maximum size of waiting output for one client, with 64 bytes added for each message; one message is accepted
    /// regardless of its size.
    pub queue: usize,
    /// What happens when that is reached.
    pub overflow: Overflow,
}

/// What a hub does when too much waits for a client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overflow {
    /// The oldest messages for that client are dropped.
    #[default]
    DropOldest,
    /// Nothing is dropped, and [`Hub::is_full`] is true: the host reads no more until the client has taken some.
    Wait,
}

impl Default for Limits {
    /// 64 clients, 256 subscriptions each, messages of 16 MiB, 16 MiB waiting for each client, the oldest dropped.
    fn default() -> Self {
        Self { clients: 64, subscriptions: 256, message: 16 << 20, queue: 16 << 20, overflow: Overflow::DropOldest }
    }
}

/// Connection; identifiers are never reused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientId(pub u64);

/// Counters of the hub; all but `clients` only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Clients that are connected now.
    pub clients: usize,
    /// Clients that there have been.
    pub accepted: u64,
    /// Connections that were one too many.
    pub refused: u64,
    /// Clients whose stream made no sense.
    pub malformed: u64,
    /// Messages that clients have published.
    pub published: u64,
    /// Messages written to clients; one that two clients wanted is two.
    pub delivered: u64,
    /// Messages dropped because too many waited for a client.
    pub dropped: u64,
    /// Messages skipped for their channel (too long, not UTF-8) and subscriptions refused (no expression, a huge one,
    /// one too many).
    pub unusable: u64,
}

/// Counters of a client; all but the last two only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClientStats {
    /// Messages that it published.
    pub published: u64,
    /// Were written to it.
    pub delivered: u64,
    /// Were dropped because too many waited for it.
    pub dropped: u64,
    /// Wait for it now.
    pub waiting: usize,
    /// Expressions that it subscribes to now.
    pub subscriptions: usize,
}

/// The hub.
#[derive(Debug, Default)]
pub struct Hub {
    /// Apart from the rest, as a message that is relayed still lies in one of them.
    streams: BTreeMap<ClientId, Decoder>,
    relay: Relay,
    next: u64,
}

#[derive(Debug, Default)]
struct Relay {
    limits: Limits,
    clients: BTreeMap<ClientId, Client>,
    /// Cached subscribers of a channel since the last change.
    routes: BTreeMap<Box<str>, Vec<ClientId>>,
    pending: VecDeque<ClientId>,
    stats: Stats,
}

#[derive(Debug, Default)]
struct Client {
    subscriptions: Vec<Subscription>,
    outbox: Outbox,
    /// Stands in `Relay::pending`.
    pending: bool,
    stats: ClientStats,
}

#[derive(Debug)]
struct Subscription {
    text: Box<str>,
    pattern: Pattern,
    cost: usize,
}

impl Hub {
    /// A hub without clients.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { relay: Relay { limits, ..Relay::default() }, ..Self::default() }
    }

    /// A client has connected; it is greeted. `None`: there are too many, close it.
    pub fn connect(&mut self) -> Option<ClientId> {
        if self.relay.clients.len() >= self.relay.limits.clients {
            self.relay.stats.refused += 1;
            return None;
        }
        let id = ClientId(self.next);
        self.next += 1;
        self.relay.stats.accepted += 1;
        self.streams.insert(id, Decoder::new(Peer::Client, self.relay.limits.message));
        let client = self.relay.clients.entry(id).or_default();
        client.outbox.push_control(&hello(Peer::Hub));
        client.notify(id, &mut self.relay.pending);
        Some(id)
    }

    /// A connection has ended; what waited for it is gone.
    pub fn disconnect(&mut self, id: ClientId) {
        self.streams.remove(&id);
        if self.relay.clients.remove(&id).is_some_and(|client| !client.subscriptions.is_empty()) {
            self.relay.routes.clear();
        }
    }

    /// A client has sent `bytes`.
    ///
    /// # Errors
    /// They make no sense: close the connection. The hub has forgotten the client already.
    pub fn handle_rx(&mut self, id: ClientId, bytes: &[u8]) -> Result<(), DecodeError> {
        let Some(stream) = self.streams.get_mut(&id) else {
            return Ok(());
        };
        stream.push(bytes);
        loop {
            match stream.next_message() {
                Ok(Some(message)) => self.relay.on_message(id, message),
                Ok(None) => return Ok(()),
                Err(error) => {
                    self.relay.stats.malformed += 1;
                    self.disconnect(id);
                    return Err(error);
                }
            }
        }
    }

    /// The next client for which something has come since it was last named here.
    pub fn poll_pending(&mut self) -> Option<ClientId> {
        while let Some(id) = self.relay.pending.pop_front() {
            if let Some(client) = self.relay.clients.get_mut(&id) {
                client.pending = false;
                return Some(id);
            }
        }
        None
    }

    /// Output waiting for a client, in order, one piece a message.
    pub fn poll_tx(&self, id: ClientId) -> impl Iterator<Item = &[u8]> {
        self.relay.clients.get(&id).into_iter().flat_map(|client| client.outbox.slices())
    }

    /// Reports that this number of bytes was written.
    pub fn handle_tx(&mut self, id: ClientId, bytes: usize) {
        if let Some(client) = self.relay.clients.get_mut(&id) {
            let ended = client.outbox.written(bytes);
            client.stats.delivered += ended;
            self.relay.stats.delivered += ended;
        }
    }

    /// True while a client has to take some of its output before the host may read on; never of a hub that drops.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.relay.limits.overflow == Overflow::Wait && self.relay.clients.keys().any(|&id| self.blocks(id))
    }

    /// True if more waits for this client than the limit.
    #[must_use]
    pub fn blocks(&self, id: ClientId) -> bool {
        self.relay.clients.get(&id).is_some_and(|client| client.outbox.cost() > self.relay.limits.queue)
    }

    /// Counters so far.
    #[must_use]
    pub fn stats(&self) -> Stats {
        Stats { clients: self.relay.clients.len(), ..self.relay.stats }
    }

    /// Counters of a client; `None` after it has gone.
    #[must_use]
    pub fn client(&self, id: ClientId) -> Option<ClientStats> {
        let client = self.relay.clients.get(&id)?;
        let (waiting, subscriptions) = (client.outbox.messages(), client.subscriptions.len());
        Some(ClientStats { waiting, subscriptions, ..client.stats })
    }
}

impl Relay {
    fn on_message(&mut self, from: ClientId, message: Message<'_>) {
        match message {
            Message::Hello { .. } => {}
            Message::Publish { channel, wire, .. } => self.publish(from, channel, wire),
            Message::Subscribe(pattern) => self.subscribe(from, pattern),
            Message::Unsubscribe(pattern) => self.unsubscribe(from, pattern),
            Message::Unusable(_) => self.stats.unusable += 1,
        }
    }

    fn publish(&mut self, from: ClientId, channel: &str, wire: &[u8]) {
        self.stats.published += 1;
        if let Some(client) = self.clients.get_mut(&from) {
            client.stats.published += 1;
        }
        if !self.routes.contains_key(channel) {
            if self.routes.len() >= ROUTES_MAX {
                self.routes.clear();
            }
            let wanting = self.clients.iter().filter(|(_, client)| client.wants(channel)).map(|(&id, _)| id);
            self.routes.insert(channel.into(), wanting.collect());
        }
        let wanting = self.routes.get(channel).map(Vec::as_slice).unwrap_or_default();
        if wanting.is_empty() {
            return;
        }
        let message: Arc<[u8]> = wire.into();
        for &id in wanting {
            let Some(client) = self.clients.get_mut(&id) else { continue };
            if self.limits.overflow == Overflow::DropOldest {
                let dropped = client.outbox.make_room(message.len(), self.limits.queue);
                client.stats.dropped += dropped;
                self.stats.dropped += dropped;
            }
            client.outbox.push(message.clone(), 0);
            client.notify(id, &mut self.pending);
        }
    }

    fn subscribe(&mut self, from: ClientId, pattern: &str) {
        let Some(client) = self.clients.get_mut(&from) else { return };
        let room = client.subscriptions.len() < self.limits.subscriptions;
        let cost: usize = client.subscriptions.iter().map(|subscription| subscription.cost).sum();
        match Subscription::new(pattern).filter(|new| room && cost + new.cost <= EXPRESSIONS_MAX) {
            Some(subscription) => {
                client.subscriptions.push(subscription);
                self.routes.clear();
            }
            None => self.stats.unusable += 1,
        }
    }

    fn unsubscribe(&mut self, from: ClientId, pattern: &str) {
        let Some(client) = self.clients.get_mut(&from) else { return };
        // One of several that are equal, as each of the client's has its own end.
        if let Some(index) = client.subscriptions.iter().position(|subscription| *subscription.text == *pattern) {
            client.subscriptions.remove(index);
            self.routes.clear();
        }
    }
}

impl Client {
    fn wants(&self, channel: &str) -> bool {
        self.subscriptions.iter().any(|subscription| subscription.pattern.matches(channel))
    }

    fn notify(&mut self, id: ClientId, pending: &mut VecDeque<ClientId>) {
        if !self.pending {
            self.pending = true;
            pending.push_back(id);
        }
    }
}

impl Subscription {
    /// `None`: it is no expression, or one of an unbearable size; `(a?b?){999}` is eleven characters.
    fn new(pattern: &str) -> Option<Self> {
        let fits = |&size: &usize| RegexBuilder::new(pattern).size_limit(size).build().is_ok();
        let cost = std::iter::successors(Some(EXPRESSION.0), |size| Some(size * 2))
            .take_while(|&size| size <= EXPRESSION.1)
            .find(fits)?;
        Some(Self { text: pattern.into(), pattern: Pattern::new(pattern).ok()?, cost })
    }
}

#[cfg(test)]
mod tests;
