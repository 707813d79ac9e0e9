//! Queues keep within their bounds: what finds no room is lost only where a bus is disturbed, or a process held up.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};

/// After it was held up a process needs this to work off what has waited.
const CATCH_UP_TIME: Duration = Duration::from_secs(1);

/// Something found no room.
pub(super) fn on_dropped(now: Instant, whose: &str, count: u64, facts: &Facts) -> Verdict {
    let excused = match facts.life(whose) {
        Some(life) => now.since(life.ill(now)) < CATCH_UP_TIME,
        // A driver that was held up has its frames sent late, too.
        None => facts.was_disturbed(now) || now.since(facts.driver.ill(now)) < CATCH_UP_TIME,
    };
    if excused { Ok(()) } else { Err(format!("{count} found no room in the queue of {whose}")) }
}
