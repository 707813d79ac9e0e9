//! The master's own heartbeat, and the detection of a second sender of it.

use super::MasterConfig;
use base::{Instant, Ticker};

pub(super) struct OwnHeartbeat {
    ticker: Ticker,
    returns: bool,
    /// Number of own heartbeats that may still be received back.
    owed: u8,
}

impl OwnHeartbeat {
    pub(super) fn new(now: Instant, config: &MasterConfig) -> Self {
        let ticker = Ticker::new(now, config.heartbeat);
        Self { ticker, returns: config.own_frames_return, owed: 0 }
    }

    pub(super) fn due(&mut self, now: Instant) -> bool {
        let due = self.ticker.due(now);
        if due && self.returns {
            self.owed = (self.owed + 1).min(3);
        }
        due
    }

    pub(super) fn next(&self) -> Instant {
        self.ticker.next()
    }

    /// A heartbeat with our id was received; true if this master did not send it.
    pub(super) fn is_foreign(&mut self) -> bool {
        let own = self.owed > 0;
        self.owed = self.owed.saturating_sub(1);
        !own
    }
}
