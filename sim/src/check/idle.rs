//! In states other than RUN the driver of the drives does not act (docs/design.md, section 4): it holds the quick stop.

use super::Verdict;
use super::facts::Facts;
use base::Instant;
use module::State;

/// A set-point has left the wire.
pub(super) fn on_set_point(now: Instant, speed: f64, facts: &Facts) -> Verdict {
    let (state, since) = facts.state;
    if state != State::Run && now.since(since) > facts.slack(now) {
        return Err(format!("{speed:.3} m/s in {state}, since {since:?}"));
    }
    Ok(())
}
