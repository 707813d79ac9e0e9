//! What `driver_aux` is told of its devices.

use base::i2c::Address;
use base::w1::{MAX, Rom};
use i2c::max6615::{self, Invalid, fields::Frequency};
use settings::{Choice, Parsed, Table, ZeroOr, settings};
use std::collections::BTreeSet;
use std::fmt;

/// Temperatures of the computer that are published at most.
const SENSORS_MAX: usize = 32;

/// Configuration of `driver_aux`; each part may be missing.
#[derive(Clone, Debug)]
pub struct Config {
    /// The I2C bus and its chips.
    pub bus: Option<BusConfig>,
    /// The 1-Wire bus and its thermometers.
    pub w1: Option<W1Config>,
    /// Temperatures of the computer.
    pub host: Option<HostConfig>,
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

/// Temperatures of the computer.
#[derive(Clone, Debug)]
pub struct HostConfig {
    /// The port's name: `host`.
    pub bus: String,
    /// Those that are published.
    pub sensors: Vec<HostSensor>,
}

settings! {
    /// An item of `sensors` of `[host]`: a temperature of the computer.
    #[derive(Clone, Debug, PartialEq)]
    pub struct HostSensor {
        /// The type of a thermal zone, `"x86_pkg_temp"`, or a hardware monitor and its label, `"coretemp/Core 0"`;
        /// `advee doctor` lists all.
        zone: String = required;
        /// Name in messages and reports.
        name: String = derived zone.clone();
        /// Temperature above which an over-temperature is reported. Absent: none is.
        limit_c: Option<f64> = optional, -50.0..=150.0;
    }
}

settings! {
    /// Keys of `[host]` for the driver.
    #[derive(Clone, Debug, PartialEq)]
    pub struct HostSensors {
        /// Temperatures that are published.
        sensors: Vec<HostSensor> = [];
    }
    check HostSensors::check;
}

settings! {
    /// An item of `sensors` of `[w1]`: a thermometer.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Thermometer {
        /// Code as the kernel names it.
        id as rom: Rom = required, Parsed(
            thermometer, "a thermometer as the kernel names it: \"28-0316a2795bff\"", "28-0316a2795bff"
        );
        /// Name in messages and reports. Absent: its code.
        name: String = derived rom.to_string();
        /// Temperature above which an over-temperature is reported. Absent: none is.
        limit_c: Option<f64> = optional, -50.0..=125.0;
    }
}

settings! {
    /// Keys of `[w1]` for the driver. Thermometers that are not named here are called by their codes.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Thermometers {
        /// Thermometers with names.
        sensors: Vec<Thermometer> = [];
    }
    check Thermometers::check;
}

settings! {
    /// Keys of `[i2c.<name>]` for the driver.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Chips {
        /// Fan controllers.
        chips: Vec<ChipKeys> = [];
    }
    check Chips::check;
}

settings! {
    /// `[[i2c.<name>.chips]]`: a MAX6615. A fan follows temperatures of its chip, the warmer request wins; the chip
    /// does that by itself.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ChipKeys {
        /// Seven bits.
        address: u8 = required, 0x08..=0x77;
        /// Kind of chip.
        driver: &'static str = required, Choice(&[("max6615", "max6615")]);
        /// Temperatures that are measured.
        temperatures: Vec<Temperature> = [];
        /// Fans that are connected.
        fans: Vec<Fan> = [];
        /// Name in messages and reports. Absent: driver and address.
        name: String = derived format!("max6615_{address:02x}");
        /// Channel 2 is the chip itself and no second thermistor.
        internal: bool = true;
        /// An automatic fan runs with its least duty below `start_c`, too.
        always: bool = true;
        /// The fans have an input for 35 kHz; else their supply is switched at 33 Hz.
        pwm_35_khz: bool = false;
    }
    check ChipKeys::check;
}

settings! {
    /// An item of `temperatures` of a chip.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Temperature {
        /// Channel of the chip.
        channel: u8 = required, 1..=2;
        /// Name in messages and reports.
        name: String = required;
        /// Temperature above which an over-temperature is reported.
        limit_c: u8 = required, 1..=150;
        /// Temperature from which on fans that follow it run.
        start_c: u8 = 35, 0..=150;
    }
}

settings! {
    /// An item of `fans` of a chip.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Fan {
        /// Output of the chip.
        output: u8 = required, 1..=2;
        /// Temperatures of the chip that it follows, by name; empty: a fixed duty.
        follows: Vec<String> = Vec::<String>::new();
        /// Speed below which it has failed; 0: not watched.
        rpm_min: f64 = 400.0, ZeroOr(230.0..=57_600.0);
        /// Name in messages and reports.
        name: String = required;
        /// Duty from the start temperature on, or the fixed one.
        duty: f64 = 0.2, 0.0..=1.0;
        /// Highest duty.
        duty_max: f64 = 1.0, 0.0..=1.0;
        /// Rise of the duty for each degree above the start temperature.
        duty_per_c: f64 = 0.04, 0.0..=0.0625;
    }
}

fn thermometer(text: &str) -> Option<Rom> {
    Rom::parse(text).filter(|id| id.is_thermometer())
}

impl HostSensors {
    fn check(&self, table: &Table<'_>) {
        let names: Vec<&String> = self.sensors.iter().map(|sensor| &sensor.name).collect();
        table.unique("sensors", "name", &names, "one that no other of the sensors has");
        for item in (SENSORS_MAX..names.len()).filter_map(|n| table.item("sensors", n)) {
            item.refuse("zone", format_args!("no more than {SENSORS_MAX} sensors"));
        }
    }
}

impl Thermometers {
    fn check(&self, table: &Table<'_>) {
        let codes: Vec<Rom> = self.sensors.iter().map(|sensor| sensor.rom).collect();
        table.unique("sensors", "id", &codes, "one that no other of the sensors has");
        for item in (MAX..codes.len()).filter_map(|n| table.item("sensors", n)) {
            item.refuse("id", format_args!("no more than {MAX} sensors"));
        }
    }
}

impl Chips {
    fn check(&self, table: &Table<'_>) {
        let of = "one that no other chip of the bus has";
        table.unique("chips", "address", &self.chips.iter().map(|chip| chip.address).collect::<Vec<_>>(), of);
        table.unique("chips", "name", &self.chips.iter().map(|chip| &chip.name).collect::<Vec<_>>(), of);
    }
}

impl ChipKeys {
    fn check(&self, table: &Table<'_>) {
        let channels: Vec<u8> = self.temperatures.iter().map(|temperature| temperature.channel).collect();
        table.unique("temperatures", "channel", &channels, "one that no other temperature of the chip has");
        let outputs: Vec<u8> = self.fans.iter().map(|fan| fan.output).collect();
        table.unique("fans", "output", &outputs, "one that no other fan of the chip has");
        let known = |name: &String| self.temperatures.iter().any(|temperature| temperature.name == *name);
        for (n, _) in self.fans.iter().enumerate().filter(|(_, fan)| !fan.follows.iter().all(known)) {
            table.item("fans", n).iter().for_each(|item| item.refuse("follows", "names of temperatures of this chip"));
        }
    }

    /// The chip's address on its bus; absent outside 0x08..=0x77.
    #[must_use]
    pub fn address(&self) -> Option<Address> {
        Address::new(self.address)
    }

    /// What the chip is to do; absent if it has no address.
    #[must_use]
    pub fn chip(&self) -> Option<ChipConfig> {
        let usual = max6615::Config::new(self.address()?);
        let channels = [1, 2].map(|n| self.temperatures.iter().find(|temperature| temperature.channel == n));
        let outputs = [1, 2].map(|n| self.fans.iter().find(|fan| fan.output == n));
        let fan = |fan: Option<&Fan>| {
            // An output without a fan stands still.
            let off = max6615::Fan { mode: max6615::Mode::Manual { duty: 0.0 }, minimum_rpm: 0.0, ..usual.fans[0] };
            let Some(fan) = fan else { return off };
            let follows = channels.map(|channel| channel.is_some_and(|channel| fan.follows.contains(&channel.name)));
            // In 240ths; at most 15, as the configuration was checked.
            let step = (fan.duty_per_c * 240.0).round() as u8;
            let mode = match follows {
                [false, false] => max6615::Mode::Manual { duty: fan.duty },
                follows => max6615::Mode::Automatic { follows, start_duty: fan.duty, maximum_duty: fan.duty_max, step },
            };
            max6615::Fan { mode, minimum_rpm: fan.rpm_min, ..off }
        };
        Some(ChipConfig {
            name: self.name.clone(),
            channels: channels.map(|channel| channel.map(|channel| Channel { name: channel.name.clone() })),
            fans: outputs.map(|fan| fan.map(|fan| FanConfig { name: fan.name.clone() })),
            chip: max6615::Config {
                limit_c: channels.map(|channel| channel.map_or(255, |channel| channel.limit_c)),
                start_c: channels.map(|channel| channel.map_or(255, |channel| channel.start_c)),
                internal: self.internal,
                minimum_duty: self.always,
                frequency: if self.pwm_35_khz { Frequency::Khz35 } else { Frequency::Hz33 },
                fans: outputs.map(fan),
                ..usual
            },
        })
    }
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
            Self::Nothing => f.write_str("neither chips nor a 1-Wire bus nor temperatures of the computer"),
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
        if chips().next().is_none() && self.w1.is_none() && self.host.is_none() {
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
        self.host.iter().flat_map(|host| &host.sensors).try_for_each(|sensor| once(&sensor.name))?;
        let roms: BTreeSet<Rom> = thermometers().map(|thermometer| thermometer.rom).collect();
        let fits = roms.len() == thermometers().count() && roms.len() <= MAX;
        if fits { Ok(()) } else { Err(ConfigError::Thermometers) }
    }
}
