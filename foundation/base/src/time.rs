//! Monotonic time in integer nanoseconds, handed to engines and modules by their host.

use core::ops::{Add, AddAssign, Sub};
pub use core::time::Duration;

/// A moment on the host's monotonic scale, in nanoseconds since an origin that the host chose.
///
/// Engines and modules are given one and never make one. Arithmetic saturates: a deadline beyond the end of
/// the scale (584 years) is never reached, and the distance to an earlier moment is zero.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(u64);

/// In seconds, as they stand in reports.
impl core::fmt::Debug for Instant {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}.{:09} s", self.0 / 1_000_000_000, self.0 % 1_000_000_000)
    }
}

impl Instant {
    /// The origin of the scale.
    pub const ZERO: Self = Self(0);
    /// A moment that never comes.
    pub const NEVER: Self = Self(u64::MAX);

    /// The moment `nanos` ns after the origin; for hosts and tests.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// The moment `millis` ms after the origin; for tests.
    #[must_use]
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// Nanoseconds since the origin.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Time passed since `earlier`; zero when `earlier` is later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// The first moment after `now` that lies a whole number of periods (each at least 1 ns) after this one, which
    /// has come. What idle processes do at the same moments of the machine's clock, it wakes up for once.
    #[must_use]
    pub fn next_on_grid(self, now: Self, period: Duration) -> Self {
        let period = nanos(period).max(1);
        let missed = now.since(self).as_nanos() as u64 / period;
        Self(self.0.saturating_add(period.saturating_mul(missed.saturating_add(1))))
    }
}

const fn nanos(duration: Duration) -> u64 {
    let n = duration.as_nanos();
    if n > u64::MAX as u128 { u64::MAX } else { n as u64 }
}

impl Add<Duration> for Instant {
    type Output = Self;
    fn add(self, duration: Duration) -> Self {
        Self(self.0.saturating_add(nanos(duration)))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, duration: Duration) {
        *self = *self + duration;
    }
}

impl Sub<Duration> for Instant {
    type Output = Self;
    fn sub(self, duration: Duration) -> Self {
        Self(self.0.saturating_sub(nanos(duration)))
    }
}

/// Where a process's monotonic scale stands against the wall clock; taken once, at its start, so that a step of
/// the wall clock never turns its timestamps back. Wall-clock time is for people and for message timestamps only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Epoch {
    /// Microseconds from the UNIX epoch to [`Instant::ZERO`].
    pub offset_us: i64,
}

impl Epoch {
    /// The timestamp of a message: microseconds since the UNIX epoch.
    #[must_use]
    pub fn timestamp(self, at: Instant) -> i64 {
        let us = i64::try_from(at.as_nanos() / 1000).unwrap_or(i64::MAX);
        self.offset_us.saturating_add(us)
    }
}

/// Periodic work with absolute deadlines: each counts from the last one, not from when it was served, and what
/// was missed is dropped, not caught up.
#[derive(Clone, Copy, Debug)]
pub struct Ticker {
    period: Duration,
    next: Instant,
}

impl Ticker {
    /// First due at `first`, then every `period` (at least 1 ns).
    #[must_use]
    pub fn new(first: Instant, period: Duration) -> Self {
        Self { period: period.max(Duration::from_nanos(1)), next: first }
    }

    /// The next deadline.
    #[must_use]
    pub fn next(&self) -> Instant {
        self.next
    }

    /// The period.
    #[must_use]
    pub fn period(&self) -> Duration {
        self.period
    }

    /// True once per deadline that has come; moves on to the first deadline after `now`.
    pub fn due(&mut self, now: Instant) -> bool {
        if now < self.next {
            return false;
        }
        self.next = self.next.next_on_grid(now, self.period);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ticker_keeps_its_grid_and_drops_what_it_missed() {
        let mut ticker = Ticker::new(Instant::from_millis(10), Duration::from_millis(10));
        assert!(!ticker.due(Instant::from_millis(9)));
        assert!(ticker.due(Instant::from_millis(12)));
        assert_eq!(ticker.next(), Instant::from_millis(20));
        assert!(ticker.due(Instant::from_millis(47)));
        assert_eq!(ticker.next(), Instant::from_millis(50));
        assert!(ticker.due(Instant::from_millis(50)));
        assert_eq!(ticker.next(), Instant::from_millis(60));
    }

    #[test]
    fn time_saturates_instead_of_wrapping() {
        assert_eq!(Instant::NEVER + Duration::from_secs(1), Instant::NEVER);
        assert_eq!(Instant::ZERO.since(Instant::NEVER), Duration::ZERO);
        assert_eq!(Epoch { offset_us: i64::MAX }.timestamp(Instant::NEVER), i64::MAX);
    }
}
