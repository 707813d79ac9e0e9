//! Plausibility of what a device measures.

use crate::GRAVITY_MPS2;
use base::{Duration, Instant};

/// Time over which gravity is judged.
pub(crate) const WINDOW: Duration = Duration::from_millis(500);
/// Values that stay the same to the last bit for this time are not measured: the noise of every sensor changes some.
const FROZEN_AFTER: Duration = Duration::from_millis(500);
/// Samples that have to be the same, too: a slow device must not count as frozen.
const FROZEN_COUNT: u32 = 5;
/// The mean acceleration of a window differs from gravity by no more than this on any wheeled robot, m/s².
const GRAVITY_TOLERANCE_MPS2: f64 = 4.0;

/// Greatest values that a device can measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Limits {
    /// m/s².
    pub acceleration_mps2: f64,
    /// rad/s.
    pub rotation_radps: f64,
}

/// What was measured in a window.
#[derive(Debug, Default)]
pub(crate) struct Judge {
    /// The last values, and since when they are the same.
    last: Option<([f64; 6], Instant, u32)>,
    /// Sum of the accelerations of this window, and their number.
    sum: [f64; 3],
    count: u32,
    /// A value of this window was out of range.
    beyond: bool,
}

impl Judge {
    /// Takes a sample; true in place of a fault that it begins at once, or ends.
    pub fn take(&mut self, at: Instant, acceleration: [f64; 3], rotation: [f64; 3], limits: Limits) -> Verdict {
        let beyond = acceleration.iter().any(|value| libm::fabs(*value) >= limits.acceleration_mps2)
            || rotation.iter().any(|value| libm::fabs(*value) >= limits.rotation_radps);
        self.beyond |= beyond;
        self.sum.iter_mut().zip(acceleration).for_each(|(sum, value)| *sum += value);
        self.count += 1;
        let [ax, ay, az] = acceleration;
        let [rx, ry, rz] = rotation;
        let values = [ax, ay, az, rx, ry, rz];
        let (since, same) = match self.last {
            Some((last, since, same)) if last == values => (since, same.saturating_add(1)),
            _ => (at, 1),
        };
        self.last = Some((values, since, same));
        Verdict { beyond, frozen: same >= FROZEN_COUNT && at.since(since) >= FROZEN_AFTER }
    }

    /// Ends a window. Returns whether what was measured in it is implausible; `None`: nothing was.
    pub fn window(&mut self) -> Option<bool> {
        let implausible = (self.count > 0).then(|| {
            let mean = self.sum.map(|sum| sum / f64::from(self.count));
            let length = libm::sqrt(mean.iter().map(|part| part * part).sum());
            self.beyond || libm::fabs(length - GRAVITY_MPS2) > GRAVITY_TOLERANCE_MPS2
        });
        (self.sum, self.count, self.beyond) = ([0.0; 3], 0, false);
        implausible
    }
}

/// What a single sample says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Verdict {
    /// A value is at the end of the range, or beyond it.
    pub beyond: bool,
    /// All values have been the same for too long.
    pub frozen: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { acceleration_mps2: 39.0, rotation_radps: 34.0 };

    fn level(judge: &mut Judge, ms: u64, az: f64) -> Verdict {
        judge.take(Instant::from_millis(ms), [0.0, 0.0, az], [0.0; 3], LIMITS)
    }

    #[test]
    fn the_same_values_for_half_a_second_are_frozen_until_one_changes() {
        let mut judge = Judge::default();
        let frozen: std::vec::Vec<bool> = (0..70).map(|n| level(&mut judge, 10 * n, 9.81).frozen).collect();
        assert_eq!(frozen.iter().position(|frozen| *frozen), Some(50));
        assert!(!level(&mut judge, 700, 9.82).frozen);
        // A few samples that come rarely are no evidence.
        let mut judge = Judge::default();
        assert!((0..4).all(|n| !level(&mut judge, 300 * n, 9.81).frozen));
    }

    #[test]
    fn gravity_must_be_that_of_earth_and_a_window_without_samples_says_nothing() {
        let mut judge = Judge::default();
        for (az, implausible) in [(9.81, false), (0.98, true), (19.6, true), (-9.81, false), (12.0, false)] {
            (0..50).for_each(|n| _ = level(&mut judge, n, az));
            assert_eq!(judge.window(), Some(implausible), "{az}");
        }
        assert_eq!(judge.window(), None);
    }
}
