//! Another master stops the robot (docs/design.md, section 4): no set-point of the driver once somebody else has
//! sent an NMT command, SYNC, an RPDO or an SDO request to the drives, or to an ODrive what changes something.
//!
//! Counted from the first of such frames on an undisturbed bus, while the driver works.

use super::Verdict;
use super::facts::{DELAY_MAX, Facts};
use base::can::Frame;
use base::{Duration, Instant};

/// The robot stands at least for this time after the last foreign command; the driver takes 1 s and more.
const STANDS_MIN: Duration = Duration::from_millis(900);

/// Foreign commands.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// First and last of a sequence.
    commands: Option<(Instant, Instant)>,
}

impl Rule {
    /// A node that is not the driver's has sent a frame on a bus of the drives.
    pub fn on_foreign(&mut self, now: Instant, bus: u8, frame: &Frame, facts: &Facts) {
        if facts.is_command(bus, frame) {
            let undisturbed = facts.driver.ill(now);
            let known = |(first, last): &(Instant, Instant)| now.since(*last) < STANDS_MIN && *first > undisturbed;
            let first = self.commands.filter(known).map_or(now, |(first, _)| first);
            // What is sent on a disturbed bus may reach nobody, and a driver whose controller is off does not receive
            // it.
            let reaches = !facts.is_disturbed(now) && !facts.driver_may_be_off(now);
            self.commands = Some((first, now)).filter(|_| reaches);
        }
    }

    /// A set-point has left the wire.
    pub fn on_set_point(&self, now: Instant, speed: f64, facts: &Facts) -> Verdict {
        let Some((first, last)) = self.commands else { return Ok(()) };
        let disturbed = facts.is_disturbed(now) || facts.driver.ill(now) >= first;
        if now.since(first) > DELAY_MAX && now.since(last) < STANDS_MIN && !disturbed {
            return Err(format!("{speed:.3} m/s, and another master commands the drives since {first:?}"));
        }
        Ok(())
    }
}

impl Facts {
    /// True for a frame by which a master commands the drives of its bus.
    pub fn is_command(&self, bus: u8, frame: &Frame) -> bool {
        self.limits.drives().any(|(_, drive)| drive.bus == bus && drive.is_command(frame))
    }
}
