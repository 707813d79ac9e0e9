//! The robot is not driven before its steering is homed (docs/design.md, section 4, `LL_DATA_MOTION.homed`).

use super::Verdict;
use super::facts::Facts;
use base::Instant;
use messages::lowlevel;

/// Last report of the driver.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// Process that reported "not homed", and when it began to.
    unhomed: Option<(u32, Instant)>,
    /// Set-point since then.
    moved: Option<f64>,
}

impl Rule {
    /// A set-point has left the wire. One that was queued before the first report does not count.
    pub fn on_set_point(&mut self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        if self.unhomed.is_some_and(|(_, since)| now.since(since) > facts.slack(now)) {
            self.moved = self.moved.or(Some(speed));
        }
        Ok(())
    }

    /// Processes the driver's report.
    pub fn on_motion(&mut self, now: Instant, pid: u32, motion: &lowlevel::DataMotion) -> Verdict {
        let was = self.unhomed;
        let known = was.filter(|(by, _)| *by == pid);
        self.unhomed = (!motion.homed).then(|| known.unwrap_or((pid, now)));
        let moved = self.moved.take();
        if motion.homed {
            return Ok(());
        }
        if motion.speed_target != 0.0 {
            return Err(format!("the target is {:.3} m/s, and the steering is not homed", motion.speed_target));
        }
        match moved {
            // Between two reports of the same process that it is not homed.
            Some(speed) if was == self.unhomed => Err(format!("{speed:.3} m/s, and the steering is not homed")),
            _ => Ok(()),
        }
    }
}
