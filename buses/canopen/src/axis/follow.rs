//! Watch over an axis that is asked to move: at least a quarter of the target speed must be reached within twice the
//! time of the ramp and a second. It finds an axis that stands, creeps, or runs the other way round, in whatever mode
//! and for whatever reason; one that is slower for a limit of its current or voltage follows.

use base::{Duration, Instant};

/// Part of the target speed that must be reached.
const PART: f64 = 0.25;
/// Time allowed beyond the ramp.
const REACTION: Duration = Duration::from_secs(1);

/// Properties of the axis, in the caller's unit of speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowConfig {
    /// Slower one of the ramps of acceleration and deceleration, per second.
    pub ramp: f64,
    /// Targets below this are not judged: the resolution of the measured speed.
    pub least: f64,
}

/// An axis does not follow its target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotFollowing {
    /// Commanded speed.
    pub target: f64,
    /// Measured speed.
    pub measured: f64,
}

/// The watch over one axis.
#[derive(Clone, Copy, Debug)]
pub struct Follow {
    config: FollowConfig,
    target: f64,
    measured: f64,
    /// The axis must have reached its part by then; absent while it is not asked to move.
    until: Option<Instant>,
}

impl Follow {
    /// An axis that is not asked to move.
    #[must_use]
    pub fn new(config: FollowConfig) -> Self {
        Self { config, target: 0.0, measured: 0.0, until: None }
    }

    /// The target in force; `None` while the axis is not enabled, or stops.
    pub fn command(&mut self, now: Instant, target: Option<f64>) {
        let Some(target) = target.filter(|target| libm::fabs(*target) >= self.config.least) else {
            self.until = None;
            return;
        };
        let turned = (target < 0.0) != (self.target < 0.0);
        self.target = target;
        if self.until.is_none() || turned {
            self.arm(now);
        }
    }

    /// A measured speed. Returns the alarm once, and again after as long a time.
    pub fn measure(&mut self, now: Instant, speed: f64) -> Option<NotFollowing> {
        self.measured = speed;
        let until = self.until?;
        if speed * self.target.signum() >= PART * libm::fabs(self.target) {
            self.arm(now);
            return None;
        }
        if now < until {
            return None;
        }
        self.arm(now);
        Some(NotFollowing { target: self.target, measured: speed })
    }

    fn arm(&mut self, now: Instant) {
        // One that runs the other way round has to stop first.
        let change = libm::fabs(self.target) + (-self.measured * self.target.signum()).max(0.0);
        let ramp = Duration::from_secs_f64(2.0 * change / self.config.ramp.max(f64::MIN_POSITIVE));
        self.until = Some(now + REACTION + ramp.min(Duration::from_secs(60)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: FollowConfig = FollowConfig { ramp: 0.5, least: 0.05 };

    /// Commands `target` and measures what `speed` gives for the time in s, each 10 ms; the time of the first alarm.
    fn run(follow: &mut Follow, target: f64, speed: impl Fn(f64) -> f64, s: f64) -> Option<f64> {
        let begin = 100.0;
        (0..(s * 100.0) as u32).map(|step| f64::from(step) / 100.0).find(|at| {
            let now = Instant::ZERO + Duration::from_secs_f64(begin + at);
            follow.command(now, Some(target));
            follow.measure(now, speed(*at)).is_some()
        })
    }

    #[test]
    fn an_axis_that_stands_or_runs_the_wrong_way_is_told_in_its_time() {
        // Twice the ramp of 0.4 / 0.5 s, and a second.
        for speed in [0.0, 0.05, -0.4] {
            let alarm = run(&mut Follow::new(CONFIG), 0.4, |_| speed, 10.0).unwrap();
            assert!((2.6..2.7).contains(&alarm), "{speed}: {alarm}");
        }
        assert!(run(&mut Follow::new(CONFIG), -0.4, |_| 0.3, 10.0).is_some());
        // It drove, then stands.
        let alarm = run(&mut Follow::new(CONFIG), 0.4, |at| if at < 3.0 { 0.4 } else { 0.0 }, 10.0).unwrap();
        assert!((5.5..5.7).contains(&alarm), "{alarm}");
    }

    #[test]
    fn an_axis_on_its_ramp_or_at_a_limit_follows() {
        let ramp = |at: f64| (0.5 * at).min(0.8);
        assert_eq!(run(&mut Follow::new(CONFIG), 0.8, ramp, 20.0), None);
        assert_eq!(run(&mut Follow::new(CONFIG), 0.8, |at| (0.125 * at).min(0.2), 20.0), None, "a quarter of all");
        assert_eq!(run(&mut Follow::new(CONFIG), 0.02, |_| 0.0, 20.0), None, "below the resolution");
        // It turns round from full speed.
        let mut follow = Follow::new(CONFIG);
        follow.measure(Instant::ZERO, 1.2);
        assert_eq!(run(&mut follow, -0.05, |at| (1.2 - 0.5 * at).max(-0.05), 20.0), None);
        follow.command(Instant::NEVER, None);
        assert_eq!(follow.measure(Instant::NEVER, 0.0), None);
    }
}
