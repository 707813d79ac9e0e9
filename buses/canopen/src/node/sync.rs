//! SYNC on the node's side (0x1005, 0x1006, 0x1019): which identifier, whether it counts, and whether this node sends
//! it.

use crate::Dictionary;
use crate::wire::{Service, decode_sync};
use base::can::Frame;
use base::{Duration, Instant, Ticker};

const PRODUCES: i64 = 1 << 30;

pub(super) struct Sync {
    cob_id: u16,
    /// 0x1019; 0: without counter.
    overflow: u8,
    ticker: Option<Ticker>,
    /// Counter of the next SYNC that this node sends.
    counter: u8,
    /// True if an unexpected length has been reported since the last right one.
    told: bool,
}

impl Default for Sync {
    fn default() -> Self {
        Self { cob_id: Service::Sync.cob_id(), overflow: 0, ticker: None, counter: 1, told: false }
    }
}

impl Sync {
    /// From the objects. The first one this node sends comes a period later and counts 1.
    pub(super) fn configure(&mut self, dictionary: &Dictionary, now: Instant) {
        let number = |index, otherwise: u16| dictionary.get(index, 0).unwrap_or(otherwise.into());
        let (cob_id, period) = (number(0x1005, Service::Sync.cob_id()), number(0x1006, 0).unsigned_abs());
        let period = Duration::from_micros(period);
        let produces = cob_id & PRODUCES != 0 && !period.is_zero();
        *self = Self {
            cob_id: (cob_id & 0x7FF) as u16,
            overflow: number(0x1019, 0) as u8,
            ticker: produces.then(|| Ticker::new(now + period, period)),
            ..Self::default()
        };
    }

    /// NMT forbids it.
    pub(super) fn stop(&mut self) {
        self.ticker = None;
    }

    pub(super) fn cob_id(&self) -> u16 {
        self.cob_id
    }

    /// The one to send, with its counter; 0: without.
    pub(super) fn due(&mut self, now: Instant) -> Option<(Frame, u8)> {
        if !self.ticker.as_mut()?.due(now) {
            return None;
        }
        if self.overflow == 0 {
            return Some((Frame::standard(self.cob_id, &[]), 0));
        }
        let counter = self.counter;
        self.counter = if counter >= self.overflow { 1 } else { counter + 1 };
        Some((Frame::standard(self.cob_id, &[counter]), counter))
    }

    /// The counter in a received one, 0 without; and whether its length is worth telling.
    pub(super) fn receive(&mut self, data: &[u8]) -> (u8, bool) {
        let counted = decode_sync(data).flatten();
        let right = if self.overflow == 0 { data.is_empty() } else { counted.is_some() };
        let tell = !right && !self.told;
        self.told = !right;
        (counted.filter(|_| right).unwrap_or(0), tell)
    }

    pub(super) fn next(&self) -> Option<Instant> {
        self.ticker.map(|ticker| ticker.next())
    }
}
