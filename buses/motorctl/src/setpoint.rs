//! Velocity setpoints: time limit of a command, ramp, quick stop.

use crate::config::{Axis, Timing};
use crate::event::CommandError;
use base::{Duration, Instant};

/// A late tick counts as this many periods at most: after a hang the setpoint does not jump.
const PERIODS_MAX: u32 = 2;

#[derive(Debug)]
pub(crate) struct Setpoints<const N: usize> {
    axes: [Axis; N],
    target_radps: [f64; N],
    current_radps: [f64; N],
    /// When the target goes to zero.
    until: Instant,
    ticked: Option<Instant>,
    quick_stop: bool,
}

impl<const N: usize> Setpoints<N> {
    pub(crate) fn new(axes: [Axis; N]) -> Self {
        Self {
            axes,
            target_radps: [0.0; N],
            current_radps: [0.0; N],
            until: Instant::ZERO,
            ticked: None,
            quick_stop: false,
        }
    }

    pub(crate) fn command(&mut self, until: Instant, velocity_radps: [f64; N]) -> Result<(), CommandError> {
        if self.quick_stop {
            return Err(CommandError::QuickStop);
        }
        let allowed = |(axis, velocity): (&Axis, &f64)| velocity.abs() <= axis.velocity_max_radps;
        match self.axes.iter().zip(&velocity_radps).position(|pair| !allowed(pair)) {
            Some(axis) => Err(CommandError::OutOfRange { axis }),
            None => {
                (self.target_radps, self.until) = (velocity_radps, until);
                Ok(())
            }
        }
    }

    /// Ramp to zero.
    pub(crate) fn stop(&mut self) {
        self.target_radps = [0.0; N];
    }

    /// Zero at once, and until [`Self::release`].
    pub(crate) fn quick_stop(&mut self) {
        self.quick_stop = true;
        self.zero();
    }

    pub(crate) fn release(&mut self) {
        self.quick_stop = false;
    }

    pub(crate) fn is_quick_stop(&self) -> bool {
        self.quick_stop
    }

    /// Zero at once; a quick stop stays active.
    pub(crate) fn zero(&mut self) {
        (self.target_radps, self.current_radps, self.ticked) = ([0.0; N], [0.0; N], None);
    }

    /// Setpoints to be sent now, rad/s.
    pub(crate) fn tick(&mut self, now: Instant, timing: &Timing) -> [f64; N] {
        let passed = self.ticked.map_or(Duration::ZERO, |at| now.since(at)).min(timing.period * PERIODS_MAX);
        self.ticked = Some(now);
        if self.until <= now {
            self.stop();
        }
        for ((current, target), axis) in self.current_radps.iter_mut().zip(self.target_radps).zip(&self.axes) {
            let step = axis.acceleration_radps2 * passed.as_secs_f64();
            *current += (target - *current).clamp(-step, step);
        }
        self.current_radps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: Axis = Axis { gear: 1.0, velocity_max_radps: 5.0, acceleration_radps2: 10.0 };

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    #[test]
    fn the_setpoint_follows_the_ramp_to_the_target_and_after_the_time_of_the_command_back_to_zero() {
        let (mut setpoints, timing) = (Setpoints::new([AXIS]), Timing::default());
        assert_eq!(setpoints.tick(at(0), &timing), [0.0]);
        assert_eq!(setpoints.command(at(100), [0.5]), Ok(()));
        let steps: std::vec::Vec<f64> = (1..9).map(|n| setpoints.tick(at(n * 20), &timing)[0]).collect();
        let expected = [0.2, 0.4, 0.5, 0.5, 0.3, 0.1, 0.0, 0.0];
        assert!(steps.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{steps:?}");
    }

    #[test]
    fn a_late_tick_does_not_jump() {
        let (mut setpoints, timing) = (Setpoints::new([AXIS]), Timing::default());
        setpoints.tick(at(0), &timing);
        setpoints.command(at(10_000), [5.0]).unwrap();
        assert!((setpoints.tick(at(3000), &timing)[0] - 0.4).abs() < 1e-9);
    }

    #[test]
    fn commands_out_of_range_and_during_a_quick_stop_are_refused() {
        let mut setpoints = Setpoints::new([AXIS, AXIS]);
        for wrong in [5.1, -5.1, f64::NAN, f64::INFINITY] {
            assert_eq!(setpoints.command(at(100), [5.0, wrong]), Err(CommandError::OutOfRange { axis: 1 }));
        }
        setpoints.quick_stop();
        assert_eq!(setpoints.command(at(100), [0.0, 0.0]), Err(CommandError::QuickStop));
        setpoints.release();
        assert_eq!(setpoints.command(at(100), [0.0, 0.0]), Ok(()));
    }
}
