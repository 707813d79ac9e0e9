//! Queues keep within their bounds: input is dropped only if a bus is disturbed or a process is held up.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};

/// Time that a process needs to process its pending input after it was held up.
const CATCH_UP_TIME: Duration = Duration::from_secs(1);

/// Processes a report of dropped input.
pub(super) fn on_dropped(now: Instant, whose: &str, count: u64, facts: &Facts) -> Verdict {
    let excused = match facts.life(whose) {
        Some(life) => now.since(life.ill(now)) < CATCH_UP_TIME,
        // A driver that was held up sends its frames late, too.
        None => facts.was_disturbed(now) || now.since(facts.driver.ill(now)) < CATCH_UP_TIME,
    };
    if excused { Ok(()) } else { Err(format!("{count} found no room in the queue of {whose}")) }
}
