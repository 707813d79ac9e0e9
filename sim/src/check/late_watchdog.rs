//! A watchdog that is repeatedly late finds a hang too late, so the robot stands (docs/design.md, section 6): no
//! set-point once it has been served 100 ms late or more for long enough to know it.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};

/// Delay from which on a check of heartbeats counts as late.
const LATE_MIN: Duration = Duration::from_millis(100);
/// Two checks within a second, and the list that is published then; both by a process that is late itself.
const KNOWN_MAX: Duration = Duration::from_millis(1500);

/// The watchdog.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// Time since which it is late.
    since: Option<Instant>,
}

impl Rule {
    /// The watchdog's latency has changed, or its process has.
    pub fn on_late(&mut self, now: Instant, late: Duration) {
        self.since = (late >= LATE_MIN).then(|| self.since.unwrap_or(now));
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let Some(since) = self.since else { return Ok(()) };
        let disturbed = facts.lcm_disturbed(now).unwrap_or_default().max(facts.driver.ill(now));
        if now.since(since.max(disturbed)) > KNOWN_MAX + facts.slack(now) {
            return Err(format!("{speed:.3} m/s, and the watchdog is late since {since:?}"));
        }
        Ok(())
    }
}
