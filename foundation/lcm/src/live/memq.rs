//! The in-memory provider: what is published here is received here, for tests and for programs that talk to
//! themselves. Nothing leaves the context.

use super::clock::{monotonic, realtime};
use super::{PublishError, Received, SubscribeError, check, context};
use crate::origin::{Origin, Process, Provenance};
use crate::queue::Line;
use crate::receiver::Stats;
use crate::subscription::{Pattern, Queue, SubscriptionId, Subscriptions};
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};

/// Maximum size of waiting messages, payload bytes.
const LINE_MAX: usize = 16 << 20;

/// A bus of one's own.
#[derive(Debug)]
pub struct Memq {
    /// Readable while messages wait; `rung` mirrors its state.
    bell: EventFd,
    rung: bool,
    subscriptions: Subscriptions,
    line: Line,
    stats: Stats,
}

impl Memq {
    pub(super) fn new() -> io::Result<Self> {
        let flags = EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC;
        let bell = EventFd::from_flags(flags).map_err(context("cannot make an eventfd"))?;
        let (subscriptions, stats) = Default::default();
        Ok(Self { bell, rung: false, subscriptions, line: Line::new(LINE_MAX), stats })
    }

    pub(super) fn publish(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        check(channel, payload)?;
        let from = self.provenance();
        if !self.line.push(&mut self.subscriptions, channel, payload, from) {
            self.stats.unwanted += 1;
        }
        self.stats.queue_dropped = self.line.dropped();
        self.stats.sent += 1;
        self.ring().map_err(PublishError::Io)
    }

    pub(super) fn subscribe(&mut self, pattern: &str, queue: Queue) -> Result<SubscriptionId, SubscribeError> {
        Ok(self.subscriptions.add(Pattern::new(pattern).map_err(SubscribeError::Pattern)?, queue))
    }

    pub(super) fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        self.line.forget(id);
        self.subscriptions.remove(id)
    }

    pub(super) fn set_size_max(&mut self, id: SubscriptionId, bytes: usize) -> bool {
        self.subscriptions.set_size_max(id, bytes)
    }

    /// Nothing arrives in fragments here.
    pub(super) fn set_memory_max(&mut self, _bytes: usize) {}

    pub(super) fn recv(&mut self) -> io::Result<Option<Received<'_>>> {
        // Before the last one goes, so that no error can take it along; none waits when the caller asks again.
        if self.line.is_empty() {
            self.ring()?;
        }
        let waiting = self.line.pop(&mut self.subscriptions);
        Ok(waiting.map(|waiting| {
            self.stats.received += 1;
            Received::waiting(waiting)
        }))
    }

    pub(super) fn stats(&self) -> &Stats {
        &self.stats
    }

    pub(super) fn dropped(&self, id: SubscriptionId) -> Option<u64> {
        self.subscriptions.dropped(id)
    }

    /// It is always this very process that publishes.
    fn provenance(&self) -> Provenance {
        let process = Process { pid: std::process::id(), uid: nix::unistd::geteuid().as_raw() };
        Provenance { at: realtime().0, published: Some(monotonic()), origin: Origin::Memory(process) }
    }

    /// Updates the descriptor.
    fn ring(&mut self) -> io::Result<()> {
        let waits = !self.line.is_empty();
        if waits != self.rung {
            let done = if waits { self.bell.write(1).map(drop) } else { self.bell.read().map(drop) };
            done.map_err(context("cannot use an eventfd"))?;
            self.rung = waits;
        }
        Ok(())
    }
}

impl AsFd for Memq {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.bell.as_fd()
    }
}
