//! What all nodes of a master share.

use super::outbox::Outbox;
use super::{Event, MasterConfig};
use base::Queue;

pub(super) struct Shared {
    pub(super) config: MasterConfig,
    pub(super) outbox: Outbox,
    pub(super) events: Queue<Event, 256>,
    /// Mandatory nodes that are not configured, and those that are not Operational.
    pub(super) unconfigured: usize,
    pub(super) missing: usize,
    /// Nodes that were held back may start.
    pub(super) release: bool,
}

impl Shared {
    pub(super) fn new(config: MasterConfig, mandatory: usize) -> Self {
        let outbox = Outbox::new(config.bit_rate);
        let events = Queue::new();
        Self { config, outbox, events, unconfigured: mandatory, missing: mandatory, release: false }
    }
}
