//! No set-point later than its time to live after the command that it follows (DESIGN 4, *Who may move the robot*).
//!
//! Each RPDO4 that moves the propulsion has the sign of a living command that was served to the driver, and at most its
//! size and its source's limit. Bound: 250 ms (`command_ttl_s`) since the command was received, and [`DELAY_MAX`] for the
//! bus.
//!
//! [`DELAY_MAX`]: super::facts::DELAY_MAX

use super::Verdict;
use super::facts::Facts;
use base::Instant;

/// A set-point has left the wire.
pub(super) fn on_set_point(now: Instant, speed: f64, facts: &Facts) -> Verdict {
    let word = facts.set_point.controlword;
    if word != 0x0F {
        return Err(format!("controlword {word:#04x} with {speed:.3} m/s"));
    }
    if !facts.sources.iter().any(|source| facts.asks(now, source, speed)) {
        return Err(format!("{speed:.3} m/s, which no living command asks for"));
    }
    Ok(())
}
