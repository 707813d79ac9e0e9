//! Nothing resumes by itself (docs/design.md, section 4): after a stop the propulsion turns only for a source that was
//! released since.
//!
//! A manual source begins by a command that moves after zero, or by its very first one: silence is no release. The
//! planner begins by a goal or an operator's RUN, newer than the last stop that was not its own silence, and by an
//! estimate no older than 200 ms. A source of a higher priority that takes the motion over by its zero begins nothing:
//! the wheels may slow down for it as long as it commands zero, also when the source that moved them falls silent.

use super::Verdict;
use super::facts::Facts;
use base::Instant;

/// A set-point has left the wire.
pub(super) fn on_set_point(now: Instant, speed: f64, facts: &Facts) -> Verdict {
    let mut asking = facts.sources.iter().filter(|source| facts.asks(now, source, speed));
    if asking.any(|source| facts.may(now, source)) || facts.ends_motion(now, speed) {
        return Ok(());
    }
    let asking: Vec<&str> = facts
        .sources
        .iter()
        .filter(|source| facts.asks(now, source, speed))
        .map(|source| source.name.as_str())
        .collect();
    let who = if asking.is_empty() { "somebody".into() } else { asking.join(", ") };
    Err(format!("{speed:.3} m/s for {who} who has not begun anew since the stop at {:?}", facts.stopped))
}
