//! Node guarding: a remote frame each period, an answer whose highest bit alternates (CiA 301, 7.2.8.2.2.1).

use super::{BootError, LostReason, Peer, Shared};
use crate::master::Guarding;
use crate::wire;
use base::{Instant, Ticker};

/// Invalid answers in a row from which two nodes are assumed.
const ODD: u8 = 3;

pub(super) struct Guard {
    ticker: Ticker,
    factor: u8,
    awaiting: bool,
    missed: u8,
    /// Expected toggle bit of the next answer; `None`: any.
    toggle: Option<bool>,
    odd: u8,
}

/// Validity of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    Good,
    /// Unsolicited, or with a toggle bit that did not alternate: counts as not received.
    Odd,
    /// Odd again and again.
    Two,
}

impl Guard {
    /// The first request leaves at `now`. The first answer after a reset has its bit cleared.
    pub(super) fn new(now: Instant, guarding: Guarding, was_reset: bool) -> Self {
        Self {
            ticker: Ticker::new(now, guarding.period),
            factor: guarding.factor,
            awaiting: false,
            missed: 0,
            toggle: was_reset.then_some(false),
            odd: 0,
        }
    }

    pub(super) fn next(&self) -> Instant {
        self.ticker.next()
    }

    pub(super) fn answered(&mut self, toggle: bool) -> Answer {
        // After a missed answer the toggle bit is unknown.
        let expected = self.missed > 0 || self.toggle.is_none_or(|expected| expected == toggle);
        if self.awaiting && expected {
            (self.awaiting, self.missed) = (false, 0);
            self.toggle = Some(!toggle);
            self.odd = self.odd.saturating_sub(1);
            return Answer::Good;
        }
        // Two nodes: one of each pair of answers is good.
        self.odd = self.odd.saturating_add(2);
        if self.odd > 2 * ODD { Answer::Two } else { Answer::Odd }
    }

    /// A request is due; false when too many were not answered.
    fn ask(&mut self) -> bool {
        self.missed = if self.awaiting { self.missed.saturating_add(1) } else { 0 };
        self.awaiting = true;
        self.missed < self.factor
    }
}

impl Peer {
    /// Sends the request that is due.
    pub(super) fn watch(&mut self, now: Instant, shared: &mut Shared) {
        let Some(guard) = self.guard.as_mut().filter(|guard| guard.next() <= now) else {
            return;
        };
        guard.ticker.due(now);
        if guard.ask() {
            shared.outbox.push(wire::guard_request(self.id()));
        } else if self.is_operational() {
            self.lose(now, shared, LostReason::Guarding);
        } else {
            self.fail(now, shared, BootError::NoHeartbeat);
        }
    }
}
