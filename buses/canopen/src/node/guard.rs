//! Node guarding and life guarding, the node's side (CiA 301, 7.2.8.2.2.1): the master asks for the state by remote
//! frame and the node watches that it does. Heartbeats (0x1017) exclude it.

use crate::Dictionary;
use base::{Duration, Instant};

#[derive(Clone, Copy, Default, PartialEq)]
enum Watch {
    /// No request yet: monitoring starts with the first.
    #[default]
    Unasked,
    Alive {
        until: Instant,
    },
    Lost,
}

#[derive(Default)]
pub(super) struct Guard {
    /// 0x100C times 0x100D; zero: the node watches nothing.
    life: Duration,
    /// Toggle bit of the next answer.
    toggle: bool,
    watch: Watch,
}

impl Guard {
    /// Reset communication: the first answer has toggle 0.
    pub(super) fn restart(&mut self, dictionary: &Dictionary) {
        *self = Self::default();
        self.configure(dictionary);
    }

    /// 0x100C, 0x100D or 0x1017 has changed.
    pub(super) fn configure(&mut self, dictionary: &Dictionary) {
        let number = |index| dictionary.get(index, 0).unwrap_or(0).unsigned_abs();
        let life = if number(0x1017) == 0 { number(0x100C) * number(0x100D) } else { 0 };
        self.life = Duration::from_millis(life);
        if life == 0 {
            self.watch = Watch::Unasked;
        }
    }

    /// The master asked: the toggle bit to answer with, and whether it had been lost.
    pub(super) fn asked(&mut self, now: Instant) -> (bool, bool) {
        let back = self.watch == Watch::Lost;
        if !self.life.is_zero() {
            self.watch = Watch::Alive { until: now + self.life };
        }
        self.toggle = !self.toggle;
        (!self.toggle, back)
    }

    /// True once, after the life time without a request of the master.
    pub(super) fn take_lost(&mut self, now: Instant) -> bool {
        let lost = self.next().is_some_and(|until| until <= now);
        if lost {
            self.watch = Watch::Lost;
        }
        lost
    }

    pub(super) fn next(&self) -> Option<Instant> {
        match self.watch {
            Watch::Alive { until } => Some(until),
            Watch::Unasked | Watch::Lost => None,
        }
    }
}
