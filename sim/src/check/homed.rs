//! The robot is not driven before its steering is homed (docs/design.md, section 4, `LL_DATA_MOTION.homed`).

use super::Verdict;
use messages::lowlevel;

/// Last report of the driver.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// Process that reported "not homed".
    unhomed: Option<u32>,
    /// Set-point since then.
    moved: Option<f64>,
}

impl Rule {
    /// A set-point has left the wire.
    pub fn on_set_point(&mut self, speed: f64) -> Verdict {
        if self.unhomed.is_some() {
            self.moved = self.moved.or(Some(speed));
        }
        Ok(())
    }

    /// Processes the driver's report.
    pub fn on_motion(&mut self, pid: u32, motion: &lowlevel::DataMotion) -> Verdict {
        let was = self.unhomed;
        self.unhomed = (!motion.homed).then_some(pid);
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
