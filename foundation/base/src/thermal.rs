//! Temperatures of the computer itself, and whether it slows itself down; the words between drivers, hosts and the
//! simulator.
//!
//! How they are read is the host's affair: on Linux from thermal zones and hardware monitors under `/sys`.

use alloc::string::String;
use alloc::vec::Vec;

/// Temperatures of a computer at most; further ones are left out.
pub const MAX: usize = 64;
/// Bytes of a name at most.
pub const NAME_MAX: usize = 64;

/// Temperature of a part of the computer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Name of the part as the kernel has it: the type of a thermal zone, `x86_pkg_temp`, or a hardware monitor and
    /// its label, `coretemp/Core 0`.
    pub zone: String,
    /// Thousandths of a degree Celsius.
    pub millidegrees: i32,
}

/// What a computer does about heat, or a low supply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Throttle {
    /// It is slower than it could be, because of its temperature.
    pub slowed: bool,
    /// Its supply voltage is too low.
    pub under_voltage: bool,
}

/// Everything that was read at one time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct State {
    readings: Vec<Reading>,
    /// `None`: not known.
    pub throttle: Option<Throttle>,
}

impl State {
    /// Adds a temperature; false if there are too many, or the name is too long, or there is one of that name.
    pub fn push(&mut self, zone: &str, millidegrees: i32) -> bool {
        let fits = self.readings.len() < MAX && zone.len() <= NAME_MAX && self.get(zone).is_none();
        if fits {
            self.readings.push(Reading { zone: zone.into(), millidegrees });
        }
        fits
    }

    /// Temperature of a part, thousandths of a degree Celsius; `None` if it was not read.
    #[must_use]
    pub fn get(&self, zone: &str) -> Option<i32> {
        self.readings.iter().find(|reading| reading.zone == zone).map(|reading| reading.millidegrees)
    }

    /// All temperatures, in the order in which they were added.
    #[must_use]
    pub fn readings(&self) -> &[Reading] {
        &self.readings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::format;

    #[test]
    fn a_state_is_bounded_and_has_each_name_once() {
        let mut state = State::default();
        assert!(state.push("cpu", 45_000) && !state.push("cpu", 46_000));
        assert_eq!((state.get("cpu"), state.get("gpu")), (Some(45_000), None));
        assert!(!state.push(&"x".repeat(NAME_MAX + 1), 0));
        for n in 0..1000 {
            state.push(&format!("zone{n}"), n);
        }
        assert_eq!(state.readings().len(), MAX);
    }
}
