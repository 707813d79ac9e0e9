//! Faults by name, as `SIM_CMD_FAULT` asks for them: `target`, `fault`, `value`, `duration` in seconds.
//!
//! | target | fault | what happens |
//! |---|---|---|
//! | a board | `silent` | it neither hears nor answers |
//! | a board | `bad_crc` | its answers have a wrong CRC |
//! | a board | `refuses` | it says of every instruction that it does not know it |
//! | an odometry board | `stuck` | its encoders stand still |
//! | a drive | `silent` | it neither hears nor speaks, and goes on with what it does until its heartbeat watch stops it |
//! | a drive | `fault` | emergency `value` (0: 0x1000, generic), and the fault state |
//! | a drive | `reboot` | as after a short loss of its supply |
//! | any | `none` | its faults are over |
//!
//! A duration of 0, below, or not a number lasts until `none`. `fault` and `reboot` are of the moment.

use base::{Duration, Instant};

/// What can ail a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ailment {
    /// It neither hears nor speaks.
    Silent,
    /// Its answers are damaged.
    BadCrc,
    /// It knows no instruction.
    Refuses,
    /// Its encoders stand.
    Stuck,
    /// It finds a fault in itself.
    Fault(u16),
    /// It starts anew.
    Reboot,
    /// Nothing.
    None,
}

impl Ailment {
    /// The ailment of a name; none for a name that is none.
    #[must_use]
    pub fn from_name(name: &str, value: f64) -> Option<Self> {
        match name {
            "silent" => Some(Self::Silent),
            "bad_crc" => Some(Self::BadCrc),
            "refuses" => Some(Self::Refuses),
            "stuck" => Some(Self::Stuck),
            // As casts saturate, no value is out of range.
            "fault" => Some(Self::Fault(if value > 0.0 { value as u16 } else { 0x1000 })),
            "reboot" => Some(Self::Reboot),
            "none" => Some(Self::None),
            _ => None,
        }
    }
}

/// Until when a fault of so many seconds lasts.
#[must_use]
pub fn until(now: Instant, seconds: f64) -> Instant {
    if seconds > 0.0 {
        // As casts saturate: ever so long is for ever.
        now + Duration::from_nanos((seconds * 1e9) as u64)
    } else {
        Instant::NEVER
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_without_a_duration_stays() {
        let now = Instant::from_millis(10);
        assert_eq!(until(now, 0.5), Instant::from_millis(510));
        for odd in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(until(now, odd), Instant::NEVER, "{odd}");
        }
    }

    #[test]
    fn names_are_known_or_not() {
        assert_eq!(Ailment::from_name("fault", 8976.0), Some(Ailment::Fault(0x2310)));
        assert_eq!(Ailment::from_name("fault", f64::NAN), Some(Ailment::Fault(0x1000)));
        assert_eq!(Ailment::from_name("on fire", 0.0), None);
    }
}
