//! No set-point is faster than the guard permits (docs/guard.md), whatever source moves the robot.
//!
//! The evidence is the bounds that the driver was served, and the set-points on the wire: at most the bound of the
//! direction of travel, or the creep speed while a second input is held, and none once the last bounds are older than
//! 150 ms. Of a robot that turns by its wheels only the latter is judged: the bounds are those of its body. A new
//! process of the driver has no bounds.

use super::Verdict;
use super::facts::Facts;
use super::sources::ROUNDING_MPS;
use base::{Duration, Instant};
use messages::lowlevel::{CmdCreep, DataGuard};
use std::collections::VecDeque;

/// Age from which bounds permit nothing; they come 20 times a second.
const VALID_FOR: Duration = Duration::from_millis(150);
/// Age up to which a second input counts as held.
const HELD_FOR: Duration = Duration::from_millis(250);
/// Number of bounds that are kept: after a hang the driver is served all that waited at once.
const KEPT: usize = 16;

/// The guard of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Guarded {
    /// The module that bounds the speed.
    pub module: String,
    /// Greatest speed by hand past the guard, m/s.
    pub creep_mps: f64,
}

/// Bounds, m/s, in force from the time at which they were served until the next ones, or until they are too old.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    served: Instant,
    until: Instant,
    forward: f64,
    backward: f64,
}

/// What the driver was served.
#[derive(Debug, Default)]
pub(super) struct Rule {
    bounds: VecDeque<Bounds>,
    /// End of the time in which a second input counts as held.
    held: Instant,
}

impl Rule {
    /// A process of the driver is started.
    pub fn on_driver(&mut self) {
        *self = Self::default();
    }

    /// The driver was served bounds of the guard that it received at `at`.
    pub fn on_guard(&mut self, now: Instant, at: Instant, guard: &DataGuard) {
        if let Some(last) = self.bounds.back_mut() {
            last.until = last.until.min(now);
        }
        if self.bounds.len() == KEPT {
            self.bounds.pop_front();
        }
        let &DataGuard { forward, backward, .. } = guard;
        self.bounds.push_back(Bounds { served: now, until: at + VALID_FOR, forward, backward });
    }

    /// The driver was served the state of a second input that it received at `at`.
    pub fn on_creep(&mut self, at: Instant, creep: &CmdCreep) {
        if creep.held {
            self.held = at + HELD_FOR;
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let Some(guard) = &facts.limits.guard else { return Ok(()) };
        let slack = facts.slack(now);
        let ramp = facts.limits.base.as_ref().map_or(Duration::ZERO, |base| base.ramp(facts.limits.speed));
        let in_force = self.bounds.iter().filter(|bounds| now.since(bounds.until) <= slack + ramp);
        if facts.limits.base.is_some() {
            return match in_force.count() {
                0 => Err(format!("{speed:.3} m/s without bounds of the guard")),
                _ => Ok(()),
            };
        }
        let bound = in_force.map(|bounds| if speed > 0.0 { bounds.forward } else { bounds.backward }).reduce(f64::max);
        let creep = if now.since(self.held) <= slack { guard.creep_mps } else { 0.0 };
        let most = bound.unwrap_or(0.0).max(creep) * facts.limits.tread_ratio;
        if speed.abs() <= most + ROUNDING_MPS {
            return Ok(());
        }
        let last = self.bounds.back().map_or(Instant::ZERO, |bounds| bounds.served);
        Err(format!("{speed:.3} m/s, and the guard permits {most:.3} m/s; its last bounds were served at {last:?}"))
    }
}
