//! SDO channels to unconfigured nodes: made on request, removed after the answer.

use super::channel::{Channel, Demand};
use super::shared::Shared;
use super::{RequestError, Stats};
use alloc::vec::Vec;
use base::can::Frame;
use base::{Duration, Instant};

/// Nodes that are asked at a time.
const MAX: usize = 16;

pub(super) struct Strangers {
    channels: Vec<Channel>,
    timeout: Duration,
    /// Counters of all of them.
    stats: Stats,
}

impl Strangers {
    pub(super) fn new(timeout: Duration) -> Self {
        Self { channels: Vec::with_capacity(MAX), timeout, stats: Stats::default() }
    }

    fn find(&mut self, node: u8) -> Option<&mut Channel> {
        self.channels.iter_mut().find(|channel| channel.node() == node)
    }

    /// True if an answer of `node` is awaited.
    pub(super) fn is_asked(&self, node: u8) -> bool {
        self.channels.iter().any(|channel| channel.node() == node)
    }

    pub(super) fn request(
        &mut self,
        now: Instant,
        node: u8,
        demand: Demand,
        shared: &mut Shared,
    ) -> Result<(), RequestError> {
        if !self.is_asked(node) {
            self.channels.retain(|channel| !channel.is_unused());
            if self.channels.len() == MAX {
                return Err(RequestError::QueueFull);
            }
            self.channels.push(Channel::new(node, self.timeout));
        }
        let Self { channels, stats, .. } = self;
        let taken = channels.iter_mut().find(|channel| channel.node() == node).is_some_and(|channel| {
            let taken = channel.push(demand);
            channel.serve(now, stats, shared);
            taken
        });
        if taken { Ok(()) } else { Err(RequestError::QueueFull) }
    }

    pub(super) fn handle_rx(&mut self, now: Instant, node: u8, frame: &Frame, shared: &mut Shared) {
        let Self { channels, stats, .. } = self;
        if let Some(channel) = channels.iter_mut().find(|channel| channel.node() == node) {
            channel.handle_rx(now, frame.data(), shared);
            advance(now, channel, stats, shared);
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) {
        for channel in &mut self.channels {
            channel.handle_timeout(now, shared);
            advance(now, channel, &mut self.stats, shared);
        }
    }

    /// Next frame to this node. After the last one its channel is removed.
    pub(super) fn poll_tx(&mut self, node: u8) -> Option<Frame> {
        let frame = self.find(node)?.poll_tx();
        if frame.is_none() {
            self.channels.retain(|channel| channel.node() != node || !channel.is_unused());
        }
        frame
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.channels.iter().filter_map(Channel::poll_timeout).min()
    }

    /// Gives up everything that was asked.
    pub(super) fn forget(&mut self, shared: &mut Shared) {
        self.channels.iter_mut().for_each(|channel| channel.forget(shared));
        self.channels.clear();
    }
}

fn advance(now: Instant, channel: &mut Channel, stats: &mut Stats, shared: &mut Shared) {
    // All transfers here are on demand, so each result is reported.
    let _told = channel.poll_done(stats, shared);
    channel.serve(now, stats, shared);
}
