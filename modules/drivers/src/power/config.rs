//! What `driver_power` must know of the robot; SI units but for ampere-hours.

use base::Duration;
use rs485::crc::Crc8;
use std::fmt;

/// Configuration of `driver_power`.
#[derive(Clone, Debug)]
pub struct Config {
    /// The link's name: `rs485.power`.
    pub bus: String,
    /// bit/s on the wire.
    pub baud: u32,
    /// The check of its frames.
    pub crc: Crc8,
    /// What messages and reports call the controller: `psc1`.
    pub name: String,
    /// 1..=254.
    pub address: u8,
    /// How often channels and currents are asked for, Hz; above 0.
    pub rate_hz: f64,
    /// How long an answer may take.
    pub timeout: Duration,
    /// Of a full battery, Ah; above 0.
    pub capacity_ah: f64,
    /// In series, 1 to 16.
    pub cells: u8,
    /// Below this charge, 0..=1, a warning is reported.
    pub reserve: f64,
    /// The other modules, in the order in which they were started; they are ended the other way round.
    pub modules: Vec<String>,
    /// What halts the computer; none: the operator's affair.
    pub halt: Vec<String>,
    /// What restarts it; none: a restart is refused.
    pub reboot: Vec<String>,
    /// A simulated robot: the computer belongs to somebody else, and neither is run.
    pub simulated: bool,
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// The rate is not above 0.
    Rate,
    /// Capacity, cells or reserve cannot be.
    Battery,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rate => "the controller's rate must be above 0",
            Self::Battery => "battery: a capacity above 0, 1 to 16 cells, a reserve of 0 to 1",
        })
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    /// Looks at what the module relies on.
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        if !(self.rate_hz.is_finite() && self.rate_hz > 0.0) {
            return Err(ConfigError::Rate);
        }
        let capacity = self.capacity_ah.is_finite() && self.capacity_ah > 0.0;
        let sane = capacity && (1..=16).contains(&self.cells) && (0.0..=1.0).contains(&self.reserve);
        if sane { Ok(()) } else { Err(ConfigError::Battery) }
    }
}
