//! A robot without permission to move comes to a standstill.
//!
//! Bound: 200 ms until a drive without a master's heartbeat stops by itself, 300 ms, and the quick stop ramp; without
//! power, or on drives that roll on without commands, it coasts, and its speed never rises. A drive that has lost its
//! power at speed gets it back at standstill only, whatever is commanded meanwhile.
//!
//! Judged is each sample, not standstill alone: on the ramp of a quick stop the speed must fall from the moment at
//! which the stop must have begun. One that began sooner, or brakes harder, is below it all the time.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};

/// Maximum time until the stop begins, whatever initiates it.
const STOP_BEGIN_MAX: Duration = Duration::from_millis(500);
/// Speed below which it counts as standing, m/s.
const STANDSTILL_MPS: f64 = 0.02;
/// Period of the samples: that of a base on wheels is the mean of one.
const SAMPLE: Duration = Duration::from_millis(50);

/// Motion of the body.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// Last instant with a permission to move, and greatest speed since.
    permitted: Instant,
    speed_max: f64,
    speed: f64,
    /// Last instant at which the drives may have missed commands, and the speed then.
    missed: (Instant, f64),
}

impl Rule {
    /// Processes a sample of the body's speed.
    pub fn on_truth(&mut self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let speed = speed.abs();
        let before = std::mem::replace(&mut self.speed, speed);
        let until = facts.sources.iter().filter_map(super::sources::Source::moves_until).max();
        let until = until.map(|until| (until + facts.driver.late).min(facts.driver.worked(now)));
        // A drive that does not obey is the rule `feed`'s. On a disturbed bus a stop may be late without the master's
        // heartbeat being late enough to be missed.
        let until = if facts.is_disturbed(now) || facts.may_disobey(now) { Some(now) } else { until };
        if let Some(until) = until.map(|until| until.min(now)).filter(|until| *until > self.permitted) {
            (self.permitted, self.speed_max) = (until, 0.0);
        }
        self.speed_max = self.speed_max.max(speed);
        let missed = facts.missed(now);
        if missed > self.missed.0 {
            self.missed = (missed, speed);
        }
        let braking = facts.braking(self.permitted, self.speed_max, self.missed);
        let ramp = Duration::from_secs_f64(self.speed_max / braking);
        if now <= self.permitted + STOP_BEGIN_MAX {
            return Ok(());
        }
        if speed > before + STANDSTILL_MPS {
            return Err(format!("the speed rises to {speed:.3} m/s, and nobody moves it since {:?}", self.permitted));
        }
        if facts.may_roll(now) || speed <= STANDSTILL_MPS {
            return Ok(());
        }
        let braked = now.since(self.permitted + STOP_BEGIN_MAX + SAMPLE).as_secs_f64() * braking;
        // The losses of wheels that roll, of which some may stand, need not slow it down evenly.
        let brakes = braking < facts.limits.quick_stop || speed <= self.speed_max - braked + STANDSTILL_MPS;
        if now > self.permitted + STOP_BEGIN_MAX + ramp || !brakes {
            return Err(format!("{speed:.3} m/s, and nobody moves it since {:?}", self.permitted));
        }
        Ok(())
    }
}
