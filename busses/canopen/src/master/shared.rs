//! What all nodes of a master share.

use super::outbox::Outbox;
use super::{Event, MasterConfig};
use base::Queue;

pub(super) struct Shared {
    pub(super) config: MasterConfig,
    pub(super) outbox: Outbox,
    pub(super) events: Queue<Event, 256>,
}

impl Shared {
    pub(super) fn new(config: MasterConfig) -> Self {
        Self { outbox: Outbox::new(config.bit_rate), config, events: Queue::new() }
    }
}
