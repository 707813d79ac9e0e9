//! LSS on a node: who sets its id and bit rate, and what follows.

use super::{Node, NodeEvent, Phase};
use crate::lss::{Address, BitRate, Slave, SlaveConfig, SlaveEvent};
use base::Instant;
use base::can::Frame;

impl Node {
    /// With an LSS slave, whose address is the identity object 0x1018. `node_id` is that of the first power-on: `None`,
    /// and the node is silent until it is given one. `bit_rates`: what it can be set to.
    #[must_use]
    pub fn with_lss(mut self, node_id: Option<u8>, bit_rate: BitRate, bit_rates: &'static [BitRate]) -> Self {
        let address = Address::from_words([1, 2, 3, 4].map(|sub| self.number(0x1018, sub) as u32));
        self.lss = Some(Slave::new(SlaveConfig { address, node_id, bit_rate, bit_rates, stores: true }));
        self
    }

    /// A frame for the LSS slave.
    pub(super) fn layer_setting(&mut self, now: Instant, frame: &Frame) {
        if matches!(self.phase, Phase::Unconfigured | Phase::Running(_))
            && let Some(lss) = &mut self.lss
        {
            lss.handle_rx(now, frame);
        }
        self.obey_lss(now);
        self.hush(now);
    }

    pub(super) fn obey_lss(&mut self, now: Instant) {
        while let Some((lss, event)) = self.lss.as_mut().and_then(|lss| lss.poll_event().map(|event| (lss, event))) {
            match event {
                SlaveEvent::NodeIdAssigned => {
                    self.dictionary.reset(0x1000..=0x1FFF);
                    self.boot(now);
                    self.handle_timeout(now);
                }
                SlaveEvent::BitRate(rate) => {
                    self.events.push(NodeEvent::BitRate(rate));
                }
                SlaveEvent::Store { node_id, bit_rate } => {
                    lss.stored(true);
                    self.events.push(NodeEvent::LssStored { node_id, bit_rate });
                }
            }
        }
    }

    /// Around a change of the bit rate nothing is sent, not even later.
    pub(super) fn hush(&mut self, now: Instant) {
        if self.lss.as_ref().is_some_and(|lss| lss.is_quiet(now)) {
            self.tx.clear();
            self.server.reset();
        }
    }
}
