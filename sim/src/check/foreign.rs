//! A sender that may not command moves nothing (docs/design.md, section 11): no set-point may follow only from a
//! command of a sender that is not accepted.
//!
//! That such a sender releases nothing either is judged by the other rules, whose facts leave out messages that are not
//! accepted.

use super::facts::Facts;
use super::sources::{Asked, Sources};
use super::{Limits, Verdict};
use base::{Duration, Instant};
use messages::Message;

/// Maximum time from the sending of a command to its set-point: a slow driver, a disturbed bus.
const DELAY_MAX: Duration = Duration::from_millis(500);

/// Commands that are not accepted.
#[derive(Debug)]
pub(super) struct Rule {
    sources: Sources,
}

impl Rule {
    pub fn new(ttl: Duration) -> Self {
        Self { sources: Sources::new(ttl) }
    }

    /// A message was sent that is not accepted.
    pub fn on_message(&mut self, now: Instant, message: &Message, limits: &Limits) {
        if let Some(asked) = Asked::of(message, limits) {
            self.sources.said(now, now, asked);
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        if facts.sources.iter().any(|source| facts.asks(now, source, speed)) {
            return Ok(());
        }
        let asks = |speed| self.sources.iter().find(|source| source.asks(now, DELAY_MAX, speed, facts.limits.speed));
        match asks(speed) {
            Some(source) => Err(format!("{speed:.3} m/s for {}, who may not command", source.name)),
            None => Ok(()),
        }
    }
}
