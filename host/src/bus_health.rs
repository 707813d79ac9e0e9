//! Health of the LCM bus as a host sees it: whether it accepts messages, and whether received messages are lost.

use base::{Duration, Instant};
use std::mem;

/// Polling period of a bus that does not become readable: counters of lost messages are read then.
const POLL_PERIOD: Duration = Duration::from_millis(100);
/// A loss ends after this time without a lost message.
pub const LOSS_END: Duration = Duration::from_secs(10);

/// The state of a connection to the bus.
#[derive(Debug)]
pub struct BusHealth {
    /// Unread messages may be available.
    pub more: bool,
    /// Time at which all messages were last read.
    served: Instant,
    /// The last message was not accepted.
    refuses: bool,
    /// Number of messages lost since the start.
    lost: u64,
    /// End of the reported loss unless more is lost; `None` if no loss is reported.
    loss_end: Option<Instant>,
}

/// Change in the loss of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Losses {
    /// Messages were lost since the last call.
    Growing,
    /// No message was lost for [`LOSS_END`].
    Ended,
}

impl BusHealth {
    /// Creates the state of a connection that has not been read yet.
    #[must_use]
    pub fn new() -> Self {
        Self { more: true, served: Instant::ZERO, refuses: false, lost: 0, loss_end: None }
    }

    /// True if the bus is to be read although it did not become readable.
    #[must_use]
    pub fn is_due(&self, now: Instant) -> bool {
        now.since(self.served) >= POLL_PERIOD
    }

    /// All messages have been read; `lost` is the number of lost messages since the start.
    pub fn on_served(&mut self, now: Instant, lost: u64) -> Option<Losses> {
        (self.more, self.served) = (false, now);
        if lost > self.lost {
            self.lost = lost;
            self.loss_end = Some(now + LOSS_END);
            return Some(Losses::Growing);
        }
        self.loss_end.take_if(|loss_end| *loss_end <= now).map(|_| Losses::Ended)
    }

    /// Result of a publication; true if it is the first accepted message after a refusal.
    pub fn on_published(&mut self, accepted: bool) -> bool {
        mem::replace(&mut self.refuses, !accepted) && accepted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    #[test]
    fn a_quiet_bus_is_read_every_100_ms() {
        let mut health = BusHealth::new();
        assert!(health.more);
        assert_eq!(health.on_served(at(1000), 0), None);
        assert!(!health.more && !health.is_due(at(1099)) && health.is_due(at(1100)));
    }

    #[test]
    fn a_loss_ends_10_s_after_the_last_lost_message() {
        let mut health = BusHealth::new();
        assert_eq!(health.on_served(at(0), 3), Some(Losses::Growing));
        assert_eq!(health.on_served(at(9000), 4), Some(Losses::Growing));
        assert_eq!(health.on_served(at(18_999), 4), None);
        assert_eq!(health.on_served(at(19_000), 4), Some(Losses::Ended));
        assert_eq!(health.on_served(at(60_000), 4), None, "once");
    }

    #[test]
    fn acceptance_after_refusal_is_reported_once() {
        let mut health = BusHealth::new();
        let published = [true, false, false, true, true].map(|accepted| health.on_published(accepted));
        assert_eq!(published, [false, false, false, true, false]);
    }
}
