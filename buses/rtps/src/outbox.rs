//! Datagrams that wait to be sent: bounded, and what is too much is counted.

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::SocketAddrV4;

/// A datagram to be sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Transmit {
    /// Whom to.
    pub to: SocketAddrV4,
    /// Its content.
    pub datagram: Vec<u8>,
}

/// The datagrams, oldest first.
#[derive(Debug)]
pub(crate) struct Outbox {
    queue: VecDeque<Transmit>,
    bytes: usize,
    bytes_max: usize,
    pub dropped: u64,
}

/// What a queued datagram costs beside its content, bytes.
const OVERHEAD: usize = 64;

impl Outbox {
    pub fn new(bytes_max: usize) -> Self {
        Self { queue: VecDeque::new(), bytes: 0, bytes_max, dropped: 0 }
    }

    pub fn push(&mut self, to: SocketAddrV4, datagram: Vec<u8>) {
        let bytes = datagram.len() + OVERHEAD;
        if self.bytes + bytes > self.bytes_max {
            self.dropped += 1;
            return;
        }
        self.bytes += bytes;
        self.queue.push_back(Transmit { to, datagram });
    }

    pub fn pop(&mut self) -> Option<Transmit> {
        let transmit = self.queue.pop_front()?;
        self.bytes -= transmit.datagram.len() + OVERHEAD;
        Some(transmit)
    }
}
