//! At most one authority at a time (docs/design.md, section 4): `LL_DATA_MOTION.source` names an active source, which
//! keeps the motion until it is silent, a higher priority commands, or the robot is stopped; and the set-points follow
//! its commands.

use super::Verdict;
use super::facts::{DELAY_MAX, Facts, SetPoint};
use base::{Duration, Instant};
use messages::lowlevel;

/// Holder of the motion.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// Number of the source, and the times of its first and last report.
    holder: Option<(u64, Instant, Instant)>,
}

impl Rule {
    /// An RPDO4 that does not move the robot has left the wire.
    pub fn on_still(&mut self, set_point: SetPoint) {
        if set_point.is_stop() {
            self.holder = None;
        }
    }

    /// Processes the driver's report of the holder.
    pub fn on_motion(&mut self, now: Instant, motion: &lowlevel::DataMotion, facts: &Facts) -> Verdict {
        let before = self.holder.take();
        if motion.source.is_empty() || !motion.reason.is_empty() || facts.is_disturbed(now) {
            return Ok(());
        }
        let own = facts.sources.iter().filter(|source| source.name == motion.source && source.lives(now, DELAY_MAX));
        let Some(named) = own.max_by_key(|source| source.priority) else {
            return Err(format!("{} is said to move the robot, but is silent", motion.source));
        };
        let began = before.filter(|(id, ..)| *id == named.id).map_or(now, |(_, began, _)| began);
        self.holder = Some((named.id, began, now));
        let Some((id, _, since)) = before.filter(|(id, ..)| *id != named.id) else { return Ok(()) };
        let other = facts.sources.by_id(id).filter(|other| other.lives(now, Duration::ZERO) && other.unbroken <= since);
        match other {
            Some(other) if other.priority >= named.priority => Err(format!(
                "{} ({}) takes the motion from {} ({}), which has not let go",
                named.name, named.priority, other.name, other.priority
            )),
            _ => Ok(()),
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        // A frame of the source before it may still be queued.
        let held = self.holder.filter(|(_, began, _)| now.since(*began) > facts.slack(now));
        let Some((id, _, since)) = held else { return Ok(()) };
        let Some(holder) = facts.sources.by_id(id) else { return Ok(()) };
        let holds = holder.lives(now, Duration::ZERO) && holder.unbroken <= since;
        let overruled = facts.sources.iter().any(|other| other.priority > holder.priority && other.served() >= since);
        if holds && !overruled && !facts.asks(now, holder, speed) {
            return Err(format!("{speed:.3} m/s, but {} holds the motion and does not ask for that", holder.name));
        }
        Ok(())
    }
}
