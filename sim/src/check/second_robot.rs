//! Two watchdogs on one bus are two robots, and this one stands (docs/design.md, section 11): no set-point while the
//! list of processes of another watchdog is received.
//!
//! Counted from the first of such lists that nothing delayed: the driver works, and LCM is not disturbed.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};
use messages::Message;

/// Maximum time from the first list to the last set-point.
const REACTION_MAX: Duration = Duration::from_millis(20);
/// The robot stands at least for this time after the last list; the driver takes 3 s.
const STANDS_MIN: Duration = Duration::from_secs(2);

/// Lists of another watchdog.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// First and last of a sequence.
    lists: Option<(Instant, Instant)>,
}

impl Rule {
    /// A message was sent that is not accepted.
    pub fn on_message(&mut self, now: Instant, message: &Message, facts: &Facts) {
        if let Message::CmDataProcesses(_) = message {
            let undisturbed = facts.lcm_disturbed(now).unwrap_or_default().max(facts.driver.ill(now));
            let first = self.lists.filter(|(first, last)| now.since(*last) < STANDS_MIN && *first > undisturbed);
            self.lists = Some((first.map_or(now, |(first, _)| first), now));
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let Some((first, last)) = self.lists else { return Ok(()) };
        let disturbed = facts.lcm_disturbed(now).unwrap_or_default().max(facts.driver.ill(now)) >= first;
        let known = now.since(first) > REACTION_MAX + facts.slack(now);
        if known && now.since(last) < STANDS_MIN && !disturbed {
            return Err(format!("{speed:.3} m/s, and another watchdog is on the bus since {first:?}"));
        }
        Ok(())
    }
}
