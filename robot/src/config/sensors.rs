//! `[sensors]`: what the robot's sensors are like, whichever board serves them.

use settings::Table;

/// `[sensors]`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensors {
    /// The sonars of `srfs`.
    pub srf08: Srf08,
}

/// `[sensors.srf08]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Srf08 {
    /// Full opening angle of the beam at -6 dB, 0.05..=3 rad; default 0.96, 55° (`docs/facts/robot.md` 2.1).
    pub beam_rad: f64,
}

impl Default for Srf08 {
    fn default() -> Self {
        Self { beam_rad: 0.96 }
    }
}

impl Sensors {
    pub(super) fn read(mut table: Table<'_>) -> Self {
        let srf08 = table.table_if_any("srf08").map_or_else(Srf08::default, Srf08::read);
        table.end();
        Self { srf08 }
    }
}

impl Srf08 {
    fn read(mut table: Table<'_>) -> Self {
        let srf08 = Self { beam_rad: table.number("beam_rad", Some(Self::default().beam_rad), 0.05..=3.0) };
        table.end();
        srf08
    }
}
