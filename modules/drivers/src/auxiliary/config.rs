//! What `driver_aux` is told of its devices.

use base::w1::{MAX, Rom};
use i2c::max6615::{self, Invalid};
use std::collections::BTreeSet;
use std::fmt;

/// Configuration of `driver_aux`; both parts may be missing.
#[derive(Clone, Debug)]
pub struct Config {
    /// The I2C bus and its chips.
    pub bus: Option<BusConfig>,
    /// The 1-Wire bus and its thermometers.
    pub w1: Option<W1Config>,
}

/// An I2C bus.
#[derive(Clone, Debug)]
pub struct BusConfig {
    /// Its name: `i2c.aux`.
    pub bus: String,
    /// Hz, for the share of the wire's time that is in use.
    pub hz: u32,
    /// What is on it.
    pub chips: Vec<ChipConfig>,
}

/// A MAX6615.
#[derive(Clone, Debug)]
pub struct ChipConfig {
    /// What messages and reports call it: `fan1`.
    pub name: String,
    /// Its temperature channels; none: not used.
    pub channels: [Option<Channel>; 2],
    /// Its fans; none: not there.
    pub fans: [Option<FanConfig>; 2],
    /// What the chip is to do. Its limits are those of the channels.
    pub chip: max6615::Config,
}

/// A temperature of a chip.
#[derive(Clone, Debug)]
pub struct Channel {
    /// What messages and reports call it: `box`.
    pub name: String,
}

/// A fan of a chip.
#[derive(Clone, Debug)]
pub struct FanConfig {
    /// What messages and reports call it: `fan_left`.
    pub name: String,
}

/// A 1-Wire bus. Thermometers that are on it and not named here are called by their codes.
#[derive(Clone, Debug)]
pub struct W1Config {
    /// Its name: `w1`.
    pub bus: String,
    /// Those that are named; at most [`MAX`].
    pub thermometers: Vec<Thermometer>,
}

/// A thermometer.
#[derive(Clone, Debug)]
pub struct Thermometer {
    /// Which.
    pub rom: Rom,
    /// What messages and reports call it.
    pub name: String,
    /// Above it there is an over-temperature, °C.
    pub limit_c: Option<f64>,
}

/// Why a configuration is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// There is nothing to drive.
    Nothing,
    /// Two of its devices have this name.
    Name(String),
    /// Two chips have this address.
    Address(u8),
    /// A chip cannot do it.
    Chip(String, Invalid),
    /// More thermometers than can be listed, or one twice.
    Thermometers,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("neither chips nor a 1-Wire bus"),
            Self::Name(name) => write!(f, "two are called {name}"),
            Self::Address(address) => write!(f, "two chips at {address:#04x}"),
            Self::Chip(name, why) => write!(f, "{name}: {why}"),
            Self::Thermometers => write!(f, "thermometers: at most {MAX}, none twice"),
        }
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        let chips = || self.bus.iter().flat_map(|bus| &bus.chips);
        if chips().next().is_none() && self.w1.is_none() {
            return Err(ConfigError::Nothing);
        }
        let (mut names, mut addresses) = (BTreeSet::new(), BTreeSet::new());
        let mut once = |name: &str| {
            if names.insert(name.to_owned()) { Ok(()) } else { Err(ConfigError::Name(name.into())) }
        };
        for chip in chips() {
            chip.channels.iter().flatten().try_for_each(|channel| once(&channel.name))?;
            chip.fans.iter().flatten().try_for_each(|fan| once(&fan.name))?;
            once(&chip.name)?;
            if !addresses.insert(chip.chip.address) {
                return Err(ConfigError::Address(chip.chip.address.get()));
            }
        }
        let thermometers = || self.w1.iter().flat_map(|w1| &w1.thermometers);
        thermometers().try_for_each(|thermometer| once(&thermometer.name))?;
        let roms: BTreeSet<Rom> = thermometers().map(|thermometer| thermometer.rom).collect();
        let fits = roms.len() == thermometers().count() && roms.len() <= MAX;
        if fits { Ok(()) } else { Err(ConfigError::Thermometers) }
    }
}
