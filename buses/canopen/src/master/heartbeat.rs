//! The master's own heartbeat, and the detection of a second sender of it.

use super::MasterConfig;
use base::{Duration, Instant, Ticker};

/// A second master is reported at most this often.
const REPORT_EVERY: Duration = Duration::from_secs(10);

pub(super) struct OwnHeartbeat {
    ticker: Ticker,
    returns: bool,
    /// Number of own heartbeats that may still be received back.
    owed: u8,
    quiet_until: Instant,
}

impl OwnHeartbeat {
    pub(super) fn new(now: Instant, config: &MasterConfig) -> Self {
        let ticker = Ticker::new(now, config.heartbeat);
        Self { ticker, returns: config.own_frames_return, owed: 0, quiet_until: now }
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

    /// A heartbeat with our id; true when a second master is to be reported.
    pub(super) fn heard(&mut self, now: Instant) -> bool {
        if self.owed > 0 {
            self.owed -= 1;
            return false;
        }
        let report = self.quiet_until <= now;
        if report {
            self.quiet_until = now + REPORT_EVERY;
        }
        report
    }
}
