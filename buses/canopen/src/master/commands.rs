//! What a master is asked to do: PDOs, SDO, NMT.

use super::channel::{Demand, Transfer};
use super::{Master, PdoError, RequestError, Target, Ticket};
use crate::wire::{self, NmtCommand, NmtState, Service};
use crate::{Payload, sdo};
use base::Instant;
use base::can::Frame;

impl Master {
    /// Sends the data (at most 8 bytes) of an RPDO, numbered 1 to 4 from the node's side.
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub fn send_pdo(&mut self, node: u8, number: u8, data: &[u8]) -> Result<(), PdoError> {
        let peer = self.peers.get(node).ok_or(PdoError::UnknownNode)?;
        match () {
            () if !peer.is_operational() || self.state != NmtState::Operational => Err(PdoError::NotOperational),
            () if !(1..=4).contains(&number) => Err(PdoError::Number),
            () if data.len() > 8 => Err(PdoError::TooLong),
            () => {
                let frame = Frame::standard(Service::Rpdo { node, number }.cob_id(), data);
                if self.shared.outbox.push(frame) { Ok(()) } else { Err(PdoError::QueueFull) }
            }
        }
    }

    /// Asks any node but this one for an object, as soon as its SDO channel is free of boot-up work. The answer is
    /// `Event::SdoRead` or `Event::SdoFailed` with the ticket.
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

    /// Writes an object; see [`Self::sdo_read`]. The answer is `Event::SdoWritten` or `Event::SdoFailed`.
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
        let ticket = Ticket(self.shared.config.tickets, self.tickets);
        let demand = Demand { ticket, index, sub, transfer };
        let shared = &mut self.shared;
        match self.peers.get(node) {
            Some(_) => self.peers.with(node, |peer| peer.request(now, demand, shared)).unwrap_or(Ok(()))?,
            None => self.strangers.request(now, node, demand, shared)?,
        }
        self.tickets = self.tickets.wrapping_add(1);
        Ok(ticket)
    }

    /// Sends an NMT command. A running node that is stopped or reset by it counts as lost as soon as its heartbeat or
    /// boot-up message shows it, and is booted again.
    pub fn nmt(&mut self, target: Target, command: NmtCommand) {
        let node = match target {
            Target::All => 0,
            Target::Node(node) => node,
        };
        self.shared.outbox.push(wire::nmt(command, node));
    }

    /// Leaves the bus in order: the communication of each node that was started is reset, so that it does not miss the
    /// master's heartbeat, and no node is booted any more. Disable drives first. [`Self::has_left`] when they answer
    /// again.
    pub fn leave(&mut self, now: Instant) {
        self.shared.outbox.at(now);
        self.peers.each(|peer| peer.leave(&mut self.shared));
    }

    /// True if each node that [`Self::leave`] has reset has booted since, and so answers requests again.
    pub fn has_left(&mut self) -> bool {
        let mut all = true;
        self.peers.each(|peer| all &= peer.has_left());
        all
    }

    /// Boots a node again, from its reset; false if it is not configured. Stop a drive first: its reaction to a reset
    /// in motion is not defined.
    pub fn reboot(&mut self, now: Instant, node: u8) -> bool {
        self.shared.outbox.at(now);
        self.peers.with(node, |peer| peer.reboot(now, &mut self.shared)).is_some()
    }
}
