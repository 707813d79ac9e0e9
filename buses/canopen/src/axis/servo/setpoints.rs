//! Profile position of an emulated drive: the set-point in work and the one that waits (CiA 402-2, 10.2).

use super::profile::{Limits, PositionProfile};
use crate::axis::control;

/// A target in raw counts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    target: f64,
    /// Follows the previous one without a stop (controlword bit 9).
    blends: bool,
}

#[derive(Debug, Default)]
pub(super) struct Setpoints {
    current: Option<f64>,
    next: Option<Point>,
    reached: bool,
    acknowledged: bool,
    limited: bool,
}

impl Setpoints {
    pub fn forget(&mut self) {
        *self = Self::default();
    }

    pub fn acknowledged(&self) -> bool {
        self.acknowledged
    }

    pub fn limited(&self) -> bool {
        self.limited
    }

    /// True if there is nowhere to go.
    pub fn is_there(&self) -> bool {
        self.current.is_none() || self.reached
    }

    /// Bits 4, 5, 6 and 9 of a controlword; `rising`: bit 4 has risen. An absolute target counts from `zero`, a
    /// relative one from the target before it, or from `here`; `range` is what the software limits allow.
    pub fn command(&mut self, word: u16, rising: bool, target: f64, [zero, here]: [f64; 2], range: [f64; 2]) {
        if rising && !self.acknowledged {
            let from = if word & control::RELATIVE != 0 { self.current.unwrap_or(here) } else { zero };
            let wanted = from + target;
            let target = wanted.max(range[0]).min(range[1]);
            self.limited = target != wanted;
            if word & control::CHANGE_AT_ONCE != 0 || self.is_there() {
                (self.current, self.next, self.reached) = (Some(target), None, false);
            } else {
                self.next = Some(Point { target, blends: word & control::CHANGE_ON_SETPOINT != 0 });
            }
            self.acknowledged = true;
        }
        // The buffer of one is free again when the waiting set-point is in work.
        if word & control::NEW_SETPOINT == 0 && self.next.is_none() {
            self.acknowledged = false;
        }
    }

    /// One step of the profile; `word`: the present controlword.
    pub fn step(&mut self, profile: &mut PositionProfile, limits: Limits, word: u16, dt: f64) {
        let Some(target) = self.current else {
            profile.stop(limits.deceleration, dt);
            return;
        };
        self.reached = match self.next {
            Some(Point { blends: true, .. }) => profile.pass(target, limits, dt),
            _ => profile.step(target, limits, dt),
        };
        if self.reached
            && let Some(next) = self.next.take()
        {
            (self.current, self.reached) = (Some(next.target), false);
            self.acknowledged = word & control::NEW_SETPOINT != 0;
        }
    }
}
