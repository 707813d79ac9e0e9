//! Configuration that all motor controllers have: times, and the limits of an axis in units of its output.

use base::Duration;
use core::f64::consts::TAU;
use core::fmt;

/// Greatest command time limit that a device may have: without a command for this long it must have stopped driving.
pub const TIME_LIMIT_MAX: Duration = Duration::from_millis(200);

/// Greatest time from the last feedback to [`LostReason::Silent`](crate::LostReason::Silent).
pub const FEEDBACK_WITHIN_MAX: Duration = Duration::from_millis(100);

/// Periods of commands within one command time limit, at least: one lost command must not stop the robot.
pub(crate) const PERIODS_MIN: u32 = 4;

/// Times of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// Between two commands; default 20 ms.
    pub period: Duration,
    /// Command time limit of the device, at most [`TIME_LIMIT_MAX`], which is the default.
    pub time_limit: Duration,
    /// Age of the feedback at which the device counts as lost, at most [`FEEDBACK_WITHIN_MAX`]; default 80 ms.
    pub feedback_within: Duration,
    /// A velocity command is in force for this long; then the ramp goes to zero. Default 200 ms.
    pub command_within: Duration,
    /// Pause between a failed start-up, or a loss, and the next start-up; default 1 s.
    pub rest: Duration,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            period: Duration::from_millis(20),
            time_limit: TIME_LIMIT_MAX,
            feedback_within: Duration::from_millis(80),
            command_within: Duration::from_millis(200),
            rest: Duration::from_secs(1),
        }
    }
}

/// Limits of an axis, at the output of the gear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Motor turns for one turn of the output; negative if they turn in opposite directions.
    pub gear: f64,
    /// Greatest velocity that is accepted, rad/s.
    pub velocity_max_radps: f64,
    /// Ramp of commands and of a stop, rad/s².
    pub acceleration_radps2: f64,
}

impl Axis {
    /// Motor turns for one radian of the output.
    pub(crate) fn turns_per_rad(&self) -> f64 {
        self.gear / TAU
    }
}

/// What all motor controllers are configured with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config<const N: usize> {
    /// Times.
    pub timing: Timing,
    /// The axes of the device.
    pub axes: [Axis; N],
    /// True if the robot has a second way to stop, independent of this device (`[stop]` of `robot.toml`). A device
    /// whose command time limit cannot be proven is refused without it.
    pub second_way: bool,
}

/// What is wrong with a configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConfigError {
    /// The command time limit is zero, or above [`TIME_LIMIT_MAX`].
    TimeLimit,
    /// The period is zero, or fewer than four of it are within the command time limit.
    Period,
    /// The feedback's age is less than two periods, or above [`FEEDBACK_WITHIN_MAX`].
    FeedbackWithin,
    /// A limit of this axis is not a positive number, or its gear is zero or not a number.
    Axis {
        /// Index of the axis.
        axis: usize,
    },
    /// A figure of the device is out of its range: node id, address, counts, pole pairs, currents.
    Device,
}

/// Predicate of a sentence whose subject is the device.
impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TimeLimit => "its command time limit is zero or above 200 ms",
            Self::Period => "fewer than four periods are within its command time limit",
            Self::FeedbackWithin => "the age of its feedback is less than two periods or above 100 ms",
            Self::Axis { .. } => "its gear is zero, or a limit of its axis is not a positive number",
            Self::Device => "a figure of the device is out of its range",
        })
    }
}

impl<const N: usize> Config<N> {
    /// Axes with the default times and no second way to stop.
    #[must_use]
    pub fn new(axes: [Axis; N]) -> Self {
        Self { timing: Timing::default(), axes, second_way: false }
    }

    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        let Timing { period, time_limit, feedback_within, .. } = self.timing;
        if time_limit.is_zero() || time_limit > TIME_LIMIT_MAX {
            return Err(ConfigError::TimeLimit);
        }
        if period.is_zero() || period > time_limit / PERIODS_MIN {
            return Err(ConfigError::Period);
        }
        if feedback_within < period * 2 || feedback_within > FEEDBACK_WITHIN_MAX {
            return Err(ConfigError::FeedbackWithin);
        }
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let wrong = |axis: &Axis| {
            let limits = positive(axis.velocity_max_radps) && positive(axis.acceleration_radps2);
            !(limits && axis.gear.is_finite() && axis.gear != 0.0)
        };
        match self.axes.iter().position(wrong) {
            Some(axis) => Err(ConfigError::Axis { axis }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: Axis = Axis { gear: 10.0, velocity_max_radps: 5.0, acceleration_radps2: 2.0 };

    #[test]
    fn a_time_limit_above_200_ms_is_refused() {
        let mut config = Config::new([AXIS]);
        assert_eq!(config.check(), Ok(()));
        config.timing.time_limit = Duration::from_millis(201);
        assert_eq!(config.check(), Err(ConfigError::TimeLimit));
        config.timing.time_limit = Duration::ZERO;
        assert_eq!(config.check(), Err(ConfigError::TimeLimit));
    }

    #[test]
    fn a_period_must_fit_four_times_into_the_time_limit() {
        let mut config = Config::new([AXIS]);
        config.timing.period = Duration::from_millis(50);
        config.timing.feedback_within = Duration::from_millis(100);
        assert_eq!(config.check(), Ok(()));
        config.timing.period = Duration::from_millis(51);
        assert_eq!(config.check(), Err(ConfigError::Period));
    }

    #[test]
    fn feedback_must_be_missed_within_100_ms() {
        let mut config = Config::new([AXIS]);
        config.timing.feedback_within = Duration::from_millis(101);
        assert_eq!(config.check(), Err(ConfigError::FeedbackWithin));
    }

    #[test]
    fn figures_of_an_axis_that_are_no_numbers_are_refused() {
        for axis in [
            Axis { gear: 0.0, ..AXIS },
            Axis { gear: f64::NAN, ..AXIS },
            Axis { velocity_max_radps: -1.0, ..AXIS },
            Axis { acceleration_radps2: f64::INFINITY, ..AXIS },
        ] {
            assert_eq!(Config::new([AXIS, axis]).check(), Err(ConfigError::Axis { axis: 1 }));
        }
    }
}
