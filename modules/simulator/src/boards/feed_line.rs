//! GPIO line that feeds the motors while it is active, with a relay on it.
//!
//! Power-up  it feeds the motors
//! End       of the process that owns it: the line stays as it is

use crate::faults::InjectedFault;
use base::Instant;
use base::gpio::Signal;

/// The line.
pub(crate) struct FeedLine {
    active: bool,
    /// Its owner receives no answer until this instant, and its orders have no effect.
    silent_until: Instant,
    /// It keeps its level until this instant.
    stuck_until: Instant,
}

impl Default for FeedLine {
    fn default() -> Self {
        Self { active: true, silent_until: Instant::ZERO, stuck_until: Instant::ZERO }
    }
}

impl FeedLine {
    /// Name, the target of faults.
    pub const NAME: &str = "line";

    /// True if the motors are fed.
    pub fn feeds(&self) -> bool {
        self.active
    }

    /// Answer to what the owner sends.
    pub fn answer(&mut self, now: Instant, signal: Signal) -> Option<Signal> {
        if now < self.silent_until {
            return None;
        }
        match signal {
            Signal::Level(active) if self.stuck_until <= now => self.active = active,
            Signal::Level(_) | Signal::Read => {}
        }
        Some(Signal::Level(self.active))
    }

    /// Injects a fault; false if it cannot have that.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        match injected {
            InjectedFault::Silent => self.silent_until = until,
            InjectedFault::Stuck => self.stuck_until = until,
            InjectedFault::None => (self.silent_until, self.stuck_until) = (now, now),
            _ => return false,
        }
        true
    }
}
