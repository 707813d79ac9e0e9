//! All nodes that are configured: found by their ids, served when they are due.

use super::peer::Peer;
use super::shared::Shared;
use super::{MasterConfig, NodeConfig};
use alloc::vec::Vec;
use base::Instant;

/// Index for ids without a node.
const NONE: u8 = u8::MAX;

pub(super) struct Peers {
    all: Vec<Peer>,
    /// Time when each of them is due.
    dues: Vec<Instant>,
    /// Index of a node in both lists, by its id.
    places: [u8; 128],
}

impl Peers {
    /// The configurations were checked: ids are in range, none comes twice.
    pub(super) fn new(config: &MasterConfig, nodes: &[NodeConfig]) -> Self {
        let mut places = [NONE; 128];
        for (place, node) in (0..).zip(nodes) {
            places[usize::from(node.id & 0x7F)] = place;
        }
        let all: Vec<_> = nodes.iter().map(|node| Peer::new(node.clone(), config)).collect();
        let dues = all.iter().map(due).collect();
        Self { all, dues, places }
    }

    fn place(&self, node: u8) -> Option<usize> {
        self.places.get(usize::from(node)).filter(|place| **place != NONE).map(|place| usize::from(*place))
    }

    pub(super) fn get(&self, node: u8) -> Option<&Peer> {
        self.all.get(self.place(node)?)
    }

    /// Has a node do something; `None` when it is not configured.
    pub(super) fn with<T>(&mut self, node: u8, act: impl FnOnce(&mut Peer) -> T) -> Option<T> {
        let place = self.place(node)?;
        let peer = &mut self.all[place];
        let result = act(peer);
        self.dues[place] = due(peer);
        Some(result)
    }

    /// Has all nodes do something.
    pub(super) fn each(&mut self, mut act: impl FnMut(&mut Peer)) {
        for (peer, at) in self.all.iter_mut().zip(&mut self.dues) {
            act(peer);
            *at = due(peer);
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) {
        for (peer, at) in self.all.iter_mut().zip(&mut self.dues).filter(|(_, at)| **at <= now) {
            peer.handle_timeout(now, shared);
            *at = due(peer);
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.dues.iter().min().copied().filter(|at| *at != Instant::NEVER)
    }
}

fn due(peer: &Peer) -> Instant {
    peer.poll_timeout().unwrap_or(Instant::NEVER)
}
