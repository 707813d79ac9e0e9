//! How fast the time of a simulated robot passes beside that of its viewers.

use base::{Duration, Instant};

/// Rate below which values age by the robot's time; above it the difference is that of a busy computer.
const SLOW: f64 = 0.9;
/// Viewers' time for which a rate is valid: `SIM_DATA_CLOCK` comes once a second even while time stands still. Then
/// values age as those of a robot, so that one that has ended is not taken for one that stands still.
const VALID: Duration = Duration::from_millis(2500);

/// True for a rate of `SIM_DATA_CLOCK` by which values age.
pub(crate) fn is_slow(rate: f64) -> bool {
    (0.0..SLOW).contains(&rate)
}

/// The robot's time as a function of that of its viewers. It never goes back, and never passes faster than that.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    /// The viewers' instant of the last rate, and the robot's.
    anchor: (Instant, Instant),
    rate: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self { anchor: (Instant::ZERO, Instant::ZERO), rate: 1.0 }
    }
}

impl Pace {
    /// The simulation has announced a rate at the viewers' instant `real`.
    pub(crate) fn on_rate(&mut self, real: Instant, rate: f64) {
        let real = real.max(self.anchor.0);
        self.anchor = (real, self.at(real));
        self.rate = if is_slow(rate) { rate.abs() } else { 1.0 };
    }

    /// The robot's instant at the viewers' instant `real`.
    pub(crate) fn at(&self, real: Instant) -> Instant {
        let (since, from) = self.anchor;
        let passed = real.since(since);
        let slow = passed.min(VALID);
        from + slow.mul_f64(self.rate) + (passed - slow)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> Instant = Instant::from_millis;

    #[test]
    fn time_passes_by_the_rate_until_no_rate_comes_any_more() {
        let mut pace = Pace::default();
        assert_eq!(pace.at(MS(5000)), MS(5000));
        pace.on_rate(MS(10_000), 0.2);
        assert_eq!([10_000, 11_000].map(|ms| pace.at(MS(ms))), [MS(10_000), MS(10_200)]);
        pace.on_rate(MS(11_000), 0.0);
        assert_eq!([11_000, 13_500, 14_500].map(|ms| pace.at(MS(ms))), [MS(10_200), MS(10_200), MS(11_200)]);
        pace.on_rate(MS(13_000), 20.0);
        assert_eq!(pace.at(MS(14_000)), MS(11_200), "never faster than the viewers'");
        // Messages are in the order of the bus, not of their instants.
        pace.on_rate(MS(12_000), 0.5);
        assert_eq!(pace.at(MS(13_000)), MS(10_200), "never back");
    }

    #[test]
    fn a_rate_that_is_no_slow_one_is_that_of_a_robot() {
        for rate in [f64::NAN, f64::NEG_INFINITY, -1.0, 0.9, 1.0, 1000.0, f64::INFINITY] {
            let mut pace = Pace::default();
            pace.on_rate(MS(1000), rate);
            assert_eq!(pace.at(MS(3000)), MS(3000), "{rate}");
        }
        assert!(is_slow(0.0) && is_slow(-0.0) && is_slow(0.05));
    }
}
