//! Latest value of a message, with its age.

use base::{Duration, Instant};
use serde::Serialize;

/// Latest message of a kind.
#[derive(Clone, Debug)]
pub struct Slot<T> {
    latest: Option<(Instant, T)>,
    period: Duration,
}

/// Validity of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Freshness {
    /// Nothing received yet.
    Never,
    /// Current.
    Fresh,
    /// Older than twice its period: shown grey.
    Stale,
}

/// Value as shown: `age` in s, `null` without one; the display lets it grow older by itself.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Shown<'a, T> {
    /// Time since reception, s.
    pub age: Option<f64>,
    /// Expected period, s; `None` if it is sent on change only and never becomes stale.
    pub period: Option<f64>,
    /// Validity.
    pub freshness: Freshness,
    /// Value.
    pub value: Option<&'a T>,
}

impl<T> Slot<T> {
    /// Slot for a message with this period; [`Duration::MAX`] for one that is sent on change only and has no relevant
    /// age.
    #[must_use]
    pub const fn every(period: Duration) -> Self {
        Self { latest: None, period }
    }

    /// Stores a received value.
    pub fn put(&mut self, at: Instant, value: T) {
        self.latest = Some((at, value));
    }

    /// Latest value, however old.
    #[must_use]
    pub fn get(&self) -> Option<&T> {
        self.latest.as_ref().map(|(_, value)| value)
    }

    /// Latest value, unless it is stale.
    #[must_use]
    pub fn fresh(&self, now: Instant) -> Option<&T> {
        self.get().filter(|_| self.freshness(now) == Freshness::Fresh)
    }

    /// Time since reception.
    #[must_use]
    pub fn age(&self, now: Instant) -> Option<Duration> {
        self.latest.as_ref().map(|(at, _)| now.since(*at))
    }

    /// Validity at `now`.
    #[must_use]
    pub fn freshness(&self, now: Instant) -> Freshness {
        match self.age(now) {
            None => Freshness::Never,
            Some(age) if age > self.period.saturating_mul(2) => Freshness::Stale,
            Some(_) => Freshness::Fresh,
        }
    }

    /// Value as shown.
    #[must_use]
    pub fn shown(&self, now: Instant) -> Shown<'_, T> {
        let age = self.age(now).map(|age| age.as_secs_f64());
        let period = (self.period != Duration::MAX).then_some(self.period.as_secs_f64());
        Shown { age, period, freshness: self.freshness(now), value: self.get() }
    }
}
