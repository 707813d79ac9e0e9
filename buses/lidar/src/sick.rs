//! SICK LMS1xx, TiM5xx and TiM7xx: CoLa A (text) or CoLa B (binary) on TCP, port 2111 or 2112.
//!
//! Start-up: identity; state; on an LMS1xx log-in, start of the measurement and log-out; reports of field results and
//! outputs, if wanted; scans. Then every second the contamination is read, and ten times a second the field results and
//! the outputs: a device reports them only when they change, and silence proves nothing. Requests that a device does
//! not know are left out where the device can be used without them.
//!
//! The configuration of the device (resolution, frequency, output) is not changed: scans are taken as they come. A host
//! opens a new connection before each start-up, and reports one that was closed by
//! [`Lidar::handle_closed`](crate::Lidar::handle_closed).
//!
//! Field results and scans are not safe in the sense of any standard: the safety outputs of a safety scanner are wires.
//!
//! Sources: SICK, *Telegram Listing LiDAR sensors LMS1xx, LMS5xx, TiM2xx, TiM5xx, TiM7xx …*, 8014631, chapters 2
//! (formats) and 4 (telegrams); *LMS4400 operating instructions*, annex, reserved distance values; SICK's published
//! driver `sick_scan_xd` (layout of LFErec and LIDoutputstate, byte streams in its comments; that a TiM7xx answers
//! `sRN LFErec` with its present results).

pub mod emulated;
mod protocol;
mod results;
#[cfg(test)]
mod tests;
pub mod wire;

pub use protocol::Cola;
pub use wire::Dialect;

use crate::engine::Lidar;
use crate::ld::NoEcho;
use base::listed;

listed! {
    /// Families.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Family {
        /// LMS1xx.
        Lms1xx => "sick-lms1xx",
        /// TiM5xx.
        Tim5xx => "sick-tim5xx",
        /// TiM7xx.
        Tim7xx => "sick-tim7xx",
    }
}

impl Family {
    /// Begin of the name in the identity.
    #[must_use]
    pub fn name_begins(self) -> &'static str {
        match self {
            Self::Lms1xx => "LMS1",
            Self::Tim5xx => "TiM5",
            Self::Tim7xx => "TiM7",
        }
    }
}

/// What is configured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Family; a device of another one is refused.
    pub family: Family,
    /// As set in the device.
    pub dialect: Dialect,
    /// Meaning of a range of 0: very dark, too near, too far, or filtered.
    pub no_echo: NoEcho,
    /// Shortest range of the model, m (data sheet).
    pub range_min_m: f32,
    /// Longest range of the model, m (data sheet).
    pub range_max_m: f32,
    /// Results of the field evaluation are asked for. An LMS1xx or a TiM7xx has them.
    pub fields: bool,
    /// States of the switching outputs are asked for.
    pub outputs: bool,
}

impl Config {
    /// The usual configuration of a family.
    #[must_use]
    pub fn new(family: Family, dialect: Dialect) -> Self {
        let (range_min_m, range_max_m) = match family {
            Family::Lms1xx => (0.5, 20.0),
            Family::Tim5xx => (0.05, 10.0),
            Family::Tim7xx => (0.05, 25.0),
        };
        Self { family, dialect, no_echo: NoEcho::Unknown, range_min_m, range_max_m, fields: false, outputs: false }
    }
}

/// An LMS1xx, TiM5xx or TiM7xx.
pub type Sick = Lidar<Cola>;

impl Sick {
    /// A lidar with this configuration.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self::with(Cola::new(config))
    }
}
