//! The latest of something, and how old it is.

use base::{Duration, Instant};
use serde::Serialize;

/// The latest message of a kind.
#[derive(Clone, Debug)]
pub struct Slot<T> {
    latest: Option<(Instant, T)>,
    period: Duration,
}

/// How much a value is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Freshness {
    /// Nothing was ever heard.
    Never,
    /// It is as it should be.
    Fresh,
    /// It is older than twice its period: shown grey.
    Stale,
}

/// A value as it is shown: `age` in s, `null` while there is none; whoever shows it lets it grow older by itself.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Shown<'a, T> {
    /// s since it was heard.
    pub age: Option<f64>,
    /// It should be heard this often, s; none: it is said on change only, and never grows stale.
    pub period: Option<f64>,
    /// Whether it is.
    pub freshness: Freshness,
    /// The value itself.
    pub value: Option<&'a T>,
}

impl<T> Slot<T> {
    /// For something that is said this often; what is said on change only has no age that counts ([`Duration::MAX`]).
    #[must_use]
    pub const fn every(period: Duration) -> Self {
        Self { latest: None, period }
    }

    /// It was heard.
    pub fn put(&mut self, at: Instant, value: T) {
        self.latest = Some((at, value));
    }

    /// The latest, however old.
    #[must_use]
    pub fn get(&self) -> Option<&T> {
        self.latest.as_ref().map(|(_, value)| value)
    }

    /// The latest, unless it is stale.
    #[must_use]
    pub fn fresh(&self, now: Instant) -> Option<&T> {
        self.get().filter(|_| self.freshness(now) == Freshness::Fresh)
    }

    /// How long ago it was heard.
    #[must_use]
    pub fn age(&self, now: Instant) -> Option<Duration> {
        self.latest.as_ref().map(|(at, _)| now.since(*at))
    }

    /// How much it is worth.
    #[must_use]
    pub fn freshness(&self, now: Instant) -> Freshness {
        match self.age(now) {
            None => Freshness::Never,
            Some(age) if age > self.period.saturating_mul(2) => Freshness::Stale,
            Some(_) => Freshness::Fresh,
        }
    }

    /// As it is shown.
    #[must_use]
    pub fn shown(&self, now: Instant) -> Shown<'_, T> {
        let age = self.age(now).map(|age| age.as_secs_f64());
        let period = (self.period != Duration::MAX).then_some(self.period.as_secs_f64());
        Shown { age, period, freshness: self.freshness(now), value: self.get() }
    }
}
