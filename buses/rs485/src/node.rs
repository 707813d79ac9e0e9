//! What the master knows of each node: its error counter (`docs/facts/boards.md` 2, after the CAN node's) and
//! statistics.

use base::Duration;

/// Health of a node. Values are those of `lowlevel.node_t.state`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(i32)]
pub enum Health {
    /// Error counter below 96.
    #[default]
    Ok = 0,
    /// Error counter at 96 or more.
    Degraded = 1,
    /// The counter reached 128 and no good answer came since.
    Lost = 2,
}

/// A change of a node's health.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    Degraded,
    Recovered,
    Lost,
    Back,
}

const FAILED: u8 = 8;
const DEGRADED: u8 = 96;
const LOST: u8 = 128;

/// The error counter of one node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ErrorCounter {
    count: u8,
    lost: bool,
    /// True if degradation has been reported since the counter was last at 0.
    warned: bool,
}

impl ErrorCounter {
    pub(crate) fn health(self) -> Health {
        match self.count {
            _ if self.lost => Health::Lost,
            DEGRADED.. => Health::Degraded,
            _ => Health::Ok,
        }
    }

    pub(crate) fn value(self) -> u8 {
        self.count
    }

    pub(crate) fn failed(&mut self) -> Option<Change> {
        self.count = self.count.saturating_add(FAILED).min(LOST);
        match self.count {
            LOST if !self.lost => {
                self.lost = true;
                Some(Change::Lost)
            }
            DEGRADED.. if !self.warned => {
                self.warned = true;
                Some(Change::Degraded)
            }
            _ => None,
        }
    }

    pub(crate) fn good(&mut self) -> Option<Change> {
        if self.lost {
            // As a CAN node after bus-off: with counter 127 the next failure would lose it again.
            *self = Self::default();
            return Some(Change::Back);
        }
        self.count = self.count.saturating_sub(1);
        let recovered = self.count == 0 && self.warned;
        self.warned &= !recovered;
        recovered.then_some(Change::Recovered)
    }
}

/// Counters of one node since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Requests put on the wire for the first time.
    pub requests: u64,
    /// Requests put on the wire again.
    pub retries: u64,
    /// Attempts that nothing answered in time.
    pub timeouts: u64,
    /// Attempts whose answer was damaged, or answered that the request was.
    pub crc_errors: u64,
    /// Transactions that failed, after all their retries.
    pub failures: u64,
    /// Permitted unsolicited messages of the node.
    pub unasked: u64,
    /// Round trips since the start.
    pub round_trips: RoundTrips,
}

/// Times from a request's first word to the last word of its answer (status OK, ERROR or UNKINSTR).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RoundTrips {
    count: u64,
    min: Duration,
    max: Duration,
    sum: Duration,
}

impl RoundTrips {
    /// Number of them.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The shortest; none when there was none.
    #[must_use]
    pub fn min(&self) -> Option<Duration> {
        (self.count > 0).then_some(self.min)
    }

    /// Their mean; none when there was none.
    #[must_use]
    pub fn mean(&self) -> Option<Duration> {
        let nanos = self.sum.as_nanos().checked_div(u128::from(self.count))?;
        Some(Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX)))
    }

    /// The longest; none when there was none.
    #[must_use]
    pub fn max(&self) -> Option<Duration> {
        (self.count > 0).then_some(self.max)
    }

    pub(crate) fn add(&mut self, round_trip: Duration) {
        self.min = if self.count == 0 { round_trip } else { self.min.min(round_trip) };
        self.max = self.max.max(round_trip);
        self.sum = self.sum.saturating_add(round_trip);
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_failures_degrade_sixteen_lose_and_one_answer_brings_back() {
        let mut counter = ErrorCounter::default();
        for failure in 1..=20 {
            let change = match failure {
                12 => Some(Change::Degraded),
                16 => Some(Change::Lost),
                _ => None,
            };
            assert_eq!(counter.failed(), change, "failure {failure}");
        }
        assert_eq!((counter.value(), counter.health()), (128, Health::Lost));
        assert_eq!(counter.good(), Some(Change::Back));
        assert_eq!((counter.value(), counter.health()), (0, Health::Ok));
    }

    #[test]
    fn degradation_is_said_once_until_the_counter_was_at_zero() {
        let mut counter = ErrorCounter::default();
        let said = (0..12).filter_map(|_| counter.failed()).count();
        assert_eq!(said, 1);
        assert_eq!((counter.good(), counter.health()), (None, Health::Ok));
        assert_eq!((counter.failed(), counter.health()), (None, Health::Degraded));
        let last = (0..103).map(|_| counter.good()).last().flatten();
        assert_eq!((last, counter.value()), (Some(Change::Recovered), 0));
        assert_eq!(counter.good(), None);
    }

    #[test]
    fn the_mean_lies_between_the_shortest_and_the_longest() {
        let mut trips = RoundTrips::default();
        assert_eq!((trips.min(), trips.mean(), trips.max()), (None, None, None));
        for ms in [3, 1, 5] {
            trips.add(Duration::from_millis(ms));
        }
        let times = [trips.min(), trips.mean(), trips.max()];
        assert_eq!(times, [1, 3, 5].map(|ms| Some(Duration::from_millis(ms))));
    }
}
