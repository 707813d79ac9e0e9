//! A command out of limits, or not a number, stops the robot at once (docs/design.md, section 4), for its time to live.

use super::Verdict;
use super::facts::Facts;
use base::Instant;

/// A set-point has left the wire.
pub(super) fn on_set_point(now: Instant, speed: f64, facts: &Facts) -> Verdict {
    let Some(refused) = facts.refused else { return Ok(()) };
    let since = now.since(refused);
    if since > facts.slack(now) && since < facts.limits.ttl {
        return Err(format!("{speed:.3} m/s, and a command out of limits was served at {refused:?}"));
    }
    Ok(())
}
