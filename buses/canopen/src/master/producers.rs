//! SYNC and TIME: frames on an absolute grid.

use super::{MasterConfig, Spread};
use crate::wire::{self, TimeOfDay};
use base::can::Frame;
use base::{Epoch, Instant, Ticker};

/// SYNC, with or without its counter.
pub(super) struct Sync {
    ticker: Ticker,
    overflow: Option<u8>,
    counter: u8,
    /// Latency of SYNC.
    jitter: Spread,
}

impl Sync {
    pub(super) fn new(now: Instant, config: &MasterConfig) -> Option<Self> {
        let ticker = Ticker::new(now, config.sync?);
        Some(Self { ticker, overflow: config.sync_overflow, counter: 0, jitter: Spread::default() })
    }

    /// The frame that is due. One that was missed is not made up for: two at once would move the drives twice.
    pub(super) fn due(&mut self, now: Instant) -> Option<Frame> {
        let late = now.since(self.ticker.next());
        if !self.ticker.due(now) {
            return None;
        }
        self.jitter.add(late);
        Some(match self.overflow {
            None => wire::sync(),
            Some(overflow) => {
                self.counter = self.counter % overflow + 1;
                wire::sync_counted(self.counter)
            }
        })
    }

    pub(super) fn next(&self) -> Instant {
        self.ticker.next()
    }

    pub(super) fn jitter(&self) -> Spread {
        self.jitter
    }
}

/// TIME, as soon as the wall clock is known.
pub(super) struct Time {
    ticker: Ticker,
    epoch: Option<Epoch>,
}

impl Time {
    pub(super) fn new(config: &MasterConfig) -> Option<Self> {
        Some(Self { ticker: Ticker::new(Instant::NEVER, config.time?), epoch: None })
    }

    /// Sets the wall clock: `unix_us` microseconds since 1970-01-01 UTC at `now`.
    pub(super) fn set(&mut self, now: Instant, unix_us: i64) {
        if self.epoch.is_none() {
            self.ticker = Ticker::new(now, self.ticker.period());
        }
        let since_start = i64::try_from(now.as_nanos() / 1000).unwrap_or(i64::MAX);
        self.epoch = Some(Epoch { offset_us: unix_us.saturating_sub(since_start) });
    }

    pub(super) fn due(&mut self, now: Instant) -> Option<Frame> {
        let epoch = self.epoch?;
        self.ticker.due(now).then(|| wire::time(TimeOfDay::from_unix_us(epoch.timestamp(now))))
    }

    pub(super) fn next(&self) -> Option<Instant> {
        self.epoch.map(|_| self.ticker.next())
    }
}
