//! A signal: its value, how old that is, and of an output what is wanted.

use super::canopen::ObjectPlace;
use super::config::{Config, ConfigError, SIGNALS_MAX};
use super::gpio;
use super::output::OutputKeys;
use base::{Duration, Instant, earliest};
use exchange::value::Place as Field;
use messages::lowlevel;
use modbus::value::Place;

/// Older values of a switch on 1-Wire are not valid: measurements of thermometers come between.
const SWITCH_AGE_MAX: Duration = Duration::from_secs(5);
/// Older values of a power channel are not valid: they are published each second.
const POWER_AGE_MAX: Duration = Duration::from_secs(3);
/// Older values of a CANopen device are not valid: `driver_canbus` publishes them each 0.1 s, NaN once too old.
const NODE_AGE_MAX: Duration = Duration::from_millis(500);

/// An input or an output.
#[derive(Debug)]
pub(super) struct Signal {
    pub name: String,
    pub output: Option<Output>,
    value: f64,
    /// Time of the value; absent before the first one.
    at: Option<Instant>,
    age_max: Duration,
    /// Value and validity changed since that was taken last.
    changed: bool,
    was_valid: bool,
}

/// Numbers that an output has, by where it is.
#[derive(Debug)]
enum Numbers {
    /// 0 and 1.
    Switch,
    Modbus(Place),
    Canopen(ObjectPlace),
    Serial(Box<Field>),
}

/// What an output should be.
#[derive(Debug)]
pub(super) struct Output {
    keys: OutputKeys,
    numbers: Numbers,
    command: Option<(f64, Instant)>,
    /// What it shows of the robot while nobody commands it.
    shown: Option<f64>,
}

/// All signals of a configuration.
pub(super) fn all(config: &Config) -> Result<Vec<Signal>, ConfigError> {
    let modbus = config.modbus.iter().flat_map(|bus| {
        bus.keys.signals.iter().map(|keys| {
            let output = keys.output.then(|| Output::new(keys.limits, Numbers::Modbus(keys.place())));
            Signal::new(&keys.name, output, bus.keys.age_max)
        })
    });
    let serial = config.serial.iter().flat_map(|line| {
        line.keys.signals().map(|keys| {
            let output = keys.output.then(|| Output::new(keys.limits, Numbers::Serial(Box::new(keys.place()))));
            Signal::new(&keys.name, output, line.keys.age_max)
        })
    });
    let gpio = config.gpio.iter().map(|line| {
        let output = line.keys.output.then(|| Output::new(line.keys.limits, Numbers::Switch));
        Signal::new(&line.keys.name, output, gpio::AGE_MAX)
    });
    let w1 = config.switches.iter().map(|keys| {
        let output = keys.output.then(|| Output::new(keys.limits, Numbers::Switch));
        Signal::new(&keys.name, output, SWITCH_AGE_MAX)
    });
    let power = config.power.iter();
    let power =
        power.map(|keys| Signal::new(&keys.name, Some(Output::new(keys.limits, Numbers::Switch)), POWER_AGE_MAX));
    let canopen = config.canopen.iter().flat_map(|device| {
        device.keys.signals.iter().map(|keys| {
            let output = keys.is_output().then(|| Output::new(keys.limits, Numbers::Canopen(keys.place())));
            Signal::new(&keys.name, output, NODE_AGE_MAX)
        })
    });
    let signals: Vec<Signal> = modbus.chain(serial).chain(gpio).chain(w1).chain(power).chain(canopen).collect();
    let mut names: Vec<&str> = signals.iter().map(|signal| signal.name.as_str()).collect();
    names.sort_unstable();
    match signals.len() {
        0 => Err(ConfigError::Empty),
        count if count > SIGNALS_MAX => Err(ConfigError::Count),
        _ if names.windows(2).any(|pair| pair[0] == pair[1]) => Err(ConfigError::Name),
        _ => Ok(signals),
    }
}

/// Index of a signal.
pub(super) fn place(signals: &[Signal], name: &str) -> Option<usize> {
    signals.binary_search_by(|signal| signal.name.as_str().cmp(name)).ok()
}

impl Signal {
    fn new(name: &str, output: Option<Output>, age_max: Duration) -> Self {
        Self { name: name.into(), output, value: f64::NAN, at: None, age_max, changed: false, was_valid: false }
    }

    /// Takes a value that was read, or confirmed by the device, and is not older than `at`.
    pub fn take(&mut self, at: Instant, value: f64) {
        self.changed |= value.to_bits() != self.value.to_bits();
        (self.value, self.at) = (value, Some(at));
    }

    /// Its value is not known any more; the last one is still shown, as not valid.
    pub fn lose(&mut self) {
        self.at = None;
    }

    fn expiry(&self) -> Option<Instant> {
        self.too_old(self.age_max)
    }

    /// The value, if it is known and not too old.
    pub fn valid(&self, now: Instant) -> Option<f64> {
        self.expiry().filter(|expiry| now < *expiry).map(|_| self.value)
    }

    /// The value, if it is known and not older than `age_max`.
    pub fn recent(&self, now: Instant, age_max: Duration) -> Option<f64> {
        self.too_old(age_max).filter(|old| now < *old).map(|_| self.value)
    }

    /// From when on the present value is older than that.
    pub fn too_old(&self, age_max: Duration) -> Option<Instant> {
        // An age equal to the limit is valid.
        self.at.filter(|_| !self.value.is_nan()).map(|at| at + age_max + Duration::from_nanos(1))
    }

    /// True if value or validity changed since the last call.
    pub fn take_change(&mut self, now: Instant) -> bool {
        let valid = self.valid(now).is_some();
        let changed = self.changed || valid != self.was_valid;
        (self.changed, self.was_valid) = (false, valid);
        changed
    }

    /// For `LL_DATA_IO`.
    pub fn shown(&self, now: Instant) -> lowlevel::Signal {
        let (output, valid) = (self.output.is_some(), self.valid(now).is_some());
        lowlevel::Signal { name: self.name.clone(), value: self.value, output, valid }
    }

    /// What is to be written; of an input nothing.
    pub fn target(&self) -> Option<f64> {
        self.output.as_ref().map(Output::target)
    }

    /// Sets what an output shows while nobody commands it; `None`: its safe value.
    pub fn show(&mut self, value: Option<f64>) {
        if let Some(output) = &mut self.output {
            output.shown = value;
        }
    }

    /// Forgets a command.
    pub fn release(&mut self) {
        if let Some(output) = &mut self.output {
            output.command = None;
        }
    }

    /// Forgets a command that has expired; true if there was one.
    pub fn expire(&mut self, now: Instant) -> bool {
        let expired = self.output.as_ref().and_then(Output::expiry).is_some_and(|expiry| expiry <= now);
        if expired {
            self.release();
        }
        expired
    }

    /// When something expires.
    pub fn poll_timeout(&self) -> Option<Instant> {
        let age = self.expiry().filter(|_| self.was_valid);
        earliest([age, self.output.as_ref().and_then(Output::expiry)])
    }
}

impl Output {
    fn new(keys: OutputKeys, numbers: Numbers) -> Self {
        Self { keys, numbers, command: None, shown: None }
    }

    /// True for values that it has, within its limits.
    pub fn accepts(&self, value: f64) -> bool {
        let exists = match &self.numbers {
            Numbers::Modbus(place) => place.number(value).is_some(),
            Numbers::Canopen(place) => place.bits(value).is_some(),
            Numbers::Serial(place) => place.has(value),
            Numbers::Switch => value == 0.0 || value == 1.0,
        };
        exists && self.keys.accepts(value)
    }

    pub fn command(&mut self, value: f64, at: Instant) {
        self.command = Some((value, at));
    }

    fn target(&self) -> f64 {
        let safe = self.keys.safe.unwrap_or_default();
        self.command.map(|(value, _)| value).or(self.shown).unwrap_or(safe)
    }

    fn expiry(&self) -> Option<Instant> {
        Some(self.command?.1 + self.keys.hold?)
    }
}
