//! The robot moves only while all critical modules run and the watchdog is received (docs/design.md, section 4).
//!
//! No set-point once the driver was served a `CM_DATA_PROCESSES` in which one is not RUNNING, nor 250 ms after it
//! received the last one.

use super::Verdict;
use super::facts::Facts;
use base::{Duration, Instant};

/// Timeout of the list, which is sent ten times a second.
const SILENT: Duration = Duration::from_millis(250);

/// A set-point has left the wire.
pub(super) fn on_set_point(now: Instant, speed: f64, facts: &Facts) -> Verdict {
    let slack = facts.slack(now);
    match facts.list {
        Some((_, Some(missing))) if now.since(missing) > slack => {
            Err(format!("{speed:.3} m/s, and a critical module does not run since {missing:?}"))
        }
        Some((heard, None)) if now.since(heard) > SILENT + slack => {
            Err(format!("{speed:.3} m/s, and the watchdog was last heard at {heard:?}"))
        }
        _ => Ok(()),
    }
}
