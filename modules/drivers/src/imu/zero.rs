//! Zero of a gyroscope: what it measures while the robot stands.

use base::{Duration, Instant};

/// Length of a measurement at standstill.
const BLOCK: Duration = Duration::from_secs(1);
/// Least number of samples in it.
const COUNT_MIN: u32 = 5;
/// A block in which a rate spans more than this is not one of standstill, rad/s: somebody moves the robot.
const SPAN_MAX_RADPS: f64 = 0.1;
/// A zero beyond this is a defect, and not learned, rad/s; the data sheets promise less than 1 °/s to 3 °/s.
pub(super) const ZERO_MAX_RADPS: f64 = 0.06;
/// Part of a block's difference that is taken over after the first one: a time constant of 10 s.
const GAIN: f64 = 0.1;

/// Result of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ZeroState {
    /// The zero was learned.
    Learned,
    /// It is beyond its bound: nothing was learned.
    Beyond,
}

/// The zero, in the frame in which the rates are given.
#[derive(Debug, Default)]
pub(super) struct Zero {
    value: Option<[f64; 3]>,
    block: Option<Block>,
}

#[derive(Debug)]
struct Block {
    since: Instant,
    count: u32,
    sum: [f64; 3],
    least: [f64; 3],
    most: [f64; 3],
}

impl Zero {
    /// The zero, rad/s; 0 until it is known.
    pub fn value(&self) -> [f64; 3] {
        self.value.unwrap_or([0.0; 3])
    }

    /// True if it was learned once.
    pub fn is_known(&self) -> bool {
        self.value.is_some()
    }

    /// Takes a rate, which is one of standstill, or not. Returns the result of a block that it ends.
    pub fn take(&mut self, at: Instant, rate: [f64; 3], stands: bool) -> Option<ZeroState> {
        if !stands {
            self.block = None;
            return None;
        }
        let block = self.block.get_or_insert(Block { since: at, count: 0, sum: [0.0; 3], least: rate, most: rate });
        block.count += 1;
        for (n, rate) in rate.into_iter().enumerate() {
            block.sum[n] += rate;
            block.least[n] = block.least[n].min(rate);
            block.most[n] = block.most[n].max(rate);
        }
        if at.since(block.since) < BLOCK || block.count < COUNT_MIN {
            return None;
        }
        let Block { count, sum, least, most, .. } = self.block.take()?;
        if least.iter().zip(most).any(|(least, most)| most - least > SPAN_MAX_RADPS) {
            return None;
        }
        let mean = sum.map(|sum| sum / f64::from(count));
        if mean.iter().any(|mean| mean.abs() > ZERO_MAX_RADPS) {
            return Some(ZeroState::Beyond);
        }
        self.value = Some(match self.value {
            None => mean,
            Some(value) => std::array::from_fn(|n| value[n] + GAIN * (mean[n] - value[n])),
        });
        Some(ZeroState::Learned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of 100 Hz for a while.
    fn pass(zero: &mut Zero, from_ms: u64, ms: u64, stands: bool, rate: impl Fn(u64) -> f64) -> Option<ZeroState> {
        let times = (from_ms..from_ms + ms).step_by(10);
        times.filter_map(|ms| zero.take(Instant::from_millis(ms), [0.0, 0.0, rate(ms)], stands)).last()
    }

    #[test]
    fn the_first_second_at_standstill_is_the_zero_and_later_ones_move_it_slowly() {
        let mut zero = Zero::default();
        assert_eq!(pass(&mut zero, 0, 5000, false, |_| 0.02), None);
        assert!(!zero.is_known() && zero.value() == [0.0; 3]);
        assert_eq!(pass(&mut zero, 5000, 1010, true, |_| 0.02), Some(ZeroState::Learned));
        assert!((zero.value()[2] - 0.02).abs() < 1e-9);
        pass(&mut zero, 10_000, 1010, true, |_| 0.03);
        assert!((zero.value()[2] - 0.021).abs() < 1e-9, "{:?}", zero.value());
        pass(&mut zero, 20_000, 40_000, true, |_| 0.03);
        assert!((zero.value()[2] - 0.03).abs() < 0.001, "{:?}", zero.value());
    }

    #[test]
    fn what_is_moved_or_turns_too_fast_is_no_zero() {
        let mut zero = Zero::default();
        let shaken = |ms: u64| if (ms / 100).is_multiple_of(2) { 0.06 } else { -0.06 };
        assert_eq!(pass(&mut zero, 0, 5000, true, shaken), None);
        assert_eq!(pass(&mut zero, 5000, 2000, true, |_| 0.07), Some(ZeroState::Beyond));
        assert!(!zero.is_known());
        // A standstill that is shorter than a block says nothing.
        assert_eq!(pass(&mut zero, 9000, 10, false, |_| 0.5), None);
        for n in 0..10 {
            assert_eq!(pass(&mut zero, 10_000 + 1000 * n, 900, true, |_| 0.01), None);
            assert_eq!(pass(&mut zero, 10_900 + 1000 * n, 100, false, |_| 0.5), None);
        }
    }
}
