//! No set-point follows a command for longer than its time to live (docs/design.md, section 4, *Who may move the
//! robot*).
//!
//! Each RPDO that moves the propulsion has the sign of a valid command that was served to the driver, and at most its
//! magnitude and its source's limit. Bound: 250 ms (`command_ttl_s`) after the reception of the command, plus
//! [`DELAY_MAX`] for the bus.
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
