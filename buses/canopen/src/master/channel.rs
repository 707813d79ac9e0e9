//! The SDO channel to one node: its client, and the requests on demand that wait for it.

use super::shared::Shared;
use super::{Event, Stats, Ticket};
use crate::wire::Service;
use crate::{Payload, sdo};
use base::can::Frame;
use base::{Duration, Instant, Queue};

/// Transfer to be made.
#[derive(Clone, Debug)]
pub(super) enum Transfer {
    Read,
    ReadBlock,
    Write(Payload),
    WriteBlock(Payload),
}

/// An SDO request on demand.
pub(super) struct Demand {
    pub(super) ticket: Ticket,
    pub(super) index: u16,
    pub(super) sub: u8,
    pub(super) transfer: Transfer,
}

/// A request on demand that has the channel.
#[derive(Clone, Copy)]
struct Active {
    ticket: Ticket,
    index: u16,
    sub: u8,
    write: bool,
}

/// Result of a transfer.
pub(super) enum End {
    /// Requested on demand, and reported.
    Told,
    Given(sdo::Done),
}

pub(super) struct Channel {
    node: u8,
    client: sdo::Client,
    active: Option<Active>,
    demands: Queue<Demand, 16>,
}

impl Channel {
    pub(super) fn new(node: u8, timeout: Duration) -> Self {
        Self { node, client: sdo::Client::new(timeout), active: None, demands: Queue::new() }
    }

    pub(super) fn node(&self) -> u8 {
        self.node
    }

    /// True if a transfer can begin.
    pub(super) fn is_idle(&self) -> bool {
        self.client.is_idle()
    }

    /// True if nothing runs and nothing waits.
    pub(super) fn is_unused(&self) -> bool {
        self.is_idle() && self.demands.is_empty()
    }

    /// Takes a request; false when too many wait.
    pub(super) fn push(&mut self, demand: Demand) -> bool {
        self.demands.push(demand)
    }

    /// Begins the next request on demand, if the channel is idle.
    pub(super) fn serve(&mut self, now: Instant, stats: &mut Stats, shared: &mut Shared) {
        if !self.is_idle() {
            return;
        }
        if let Some(Demand { ticket, index, sub, transfer }) = self.demands.pop() {
            let write = matches!(transfer, Transfer::Write(_) | Transfer::WriteBlock(_));
            self.active = Some(Active { ticket, index, sub, write });
            self.begin(now, index, sub, transfer, stats, shared);
        }
    }

    /// Begins a transfer on the idle channel.
    pub(super) fn begin(
        &mut self,
        now: Instant,
        index: u16,
        sub: u8,
        transfer: Transfer,
        stats: &mut Stats,
        shared: &mut Shared,
    ) {
        stats.requests = stats.requests.saturating_add(1);
        match transfer {
            Transfer::Read => self.client.read(now, index, sub),
            Transfer::ReadBlock => self.client.read_block(now, index, sub),
            Transfer::Write(data) => self.client.write(now, index, sub, data),
            Transfer::WriteBlock(data) => self.client.write_block(now, index, sub, data),
        };
        shared.outbox.mark(self.node);
    }

    pub(super) fn handle_rx(&mut self, now: Instant, data: &[u8], shared: &mut Shared) {
        self.client.handle_rx(now, data);
        shared.outbox.mark(self.node);
    }

    pub(super) fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) {
        if self.client.poll_timeout().is_some_and(|until| until <= now) {
            self.client.handle_timeout(now);
            shared.outbox.mark(self.node);
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.client.poll_timeout()
    }

    pub(super) fn poll_tx(&mut self) -> Option<Frame> {
        let data = self.client.poll_tx()?;
        Some(Frame::standard(Service::SdoRequest { node: self.node }.cob_id(), &data))
    }

    /// Takes the result of a transfer. A transfer on demand is reported; any other result is returned.
    pub(super) fn poll_done(&mut self, stats: &mut Stats, shared: &mut Shared) -> Option<End> {
        stats.ignored = self.client.ignored();
        let done = self.client.poll_done()?;
        match done.result {
            Ok(_) => stats.succeeded(done.took),
            Err(sdo::Error::Timeout) => stats.timeouts = stats.timeouts.saturating_add(1),
            Err(_) => {}
        }
        let Some(Active { ticket, index, sub, write }) = self.active.take() else {
            return Some(End::Given(done));
        };
        let node = self.node;
        shared.events.push(match done.result {
            Ok(_) if write => Event::SdoWritten { node, ticket, index, sub },
            Ok(data) => Event::SdoRead { node, ticket, index, sub, data },
            Err(error) => Event::SdoFailed { node, ticket, index, sub, error },
        });
        Some(End::Told)
    }

    /// Aborts the transfer under way, and reports one on demand. The last frame of a finished transfer is still sent.
    pub(super) fn abandon(&mut self, shared: &mut Shared) {
        if !self.is_idle() {
            self.client.cancel();
        }
        if let Some(Active { ticket, index, sub, .. }) = self.active.take() {
            self.cancelled(ticket, index, sub, shared);
        }
    }

    /// Drops requests that were made on demand before the node was lost.
    pub(super) fn forget(&mut self, shared: &mut Shared) {
        self.abandon(shared);
        self.client.cancel();
        while let Some(Demand { ticket, index, sub, .. }) = self.demands.pop() {
            self.cancelled(ticket, index, sub, shared);
        }
    }

    fn cancelled(&self, ticket: Ticket, index: u16, sub: u8, shared: &mut Shared) {
        let error = sdo::Error::Cancelled;
        shared.events.push(Event::SdoFailed { node: self.node, ticket, index, sub, error });
    }
}
