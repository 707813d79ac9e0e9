//! What is counted for each node.

use base::Duration;

/// Spread of a time: from an SDO request to its last answer ([`RoundTrip`]), or the latency of SYNC ([`Jitter`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spread {
    /// The shortest.
    pub min: Duration,
    /// The longest.
    pub max: Duration,
    /// The sum of `count`.
    pub sum: Duration,
    /// Number of them.
    pub count: u32,
}

/// Times from an SDO request to its last answer.
pub type RoundTrip = Spread;
/// Latency of SYNC.
pub type Jitter = Spread;

impl Spread {
    /// The mean; zero when there was none.
    #[must_use]
    pub fn mean(&self) -> Duration {
        self.sum.checked_div(self.count).unwrap_or_default()
    }

    pub(super) fn add(&mut self, took: Duration) {
        self.min = if self.count == 0 { took } else { self.min.min(took) };
        self.max = self.max.max(took);
        self.sum = self.sum.saturating_add(took);
        self.count = self.count.saturating_add(1);
    }
}

/// Counters of a node since the master was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// SDO transfers begun.
    pub requests: u32,
    /// Transfers of the boot-up begun again because nothing answered.
    pub retries: u32,
    /// Transfers that were not answered in time.
    pub timeouts: u32,
    /// Frames that CANopen does not allow.
    pub malformed: u32,
    /// SDO answers to what was not asked, late ones among them.
    pub ignored: u32,
    /// Emergencies.
    pub emergencies: u32,
    /// PDOs taken.
    pub pdos: u32,
    /// Times booted.
    pub boots: u32,
    /// Times lost.
    pub losses: u32,
    /// SDO transfers that succeeded, since [`Master::take_round_trips`](super::Master::take_round_trips) was called.
    pub round_trip: RoundTrip,
}

impl Stats {
    pub(super) fn succeeded(&mut self, took: Duration) {
        self.round_trip.add(took);
    }
}
