//! Configuration of a MAX6615, and its register values.

use super::fields::{
    Configuration, FanConfiguration, FanStatus, Follows, Frequency, Offsets, RPM_COUNT, Rates, STOPPED, Steps,
    duty_bits,
};
use super::register;
use base::i2c::Address;
use base::listed;

/// Control of a fan's duty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// Fixed duty.
    Manual {
        /// Fraction of full duty, 0 to 1.
        duty: f64,
    },
    /// Temperatures: from a channel's start temperature on, the start duty, and more for each temperature step, up to
    /// the maximum. Of two channels the one that wants more wins.
    Automatic {
        /// The channels, at least one.
        follows: Follows,
        /// Fraction of full duty at the start temperature, 0 to 1.
        start_duty: f64,
        /// At most this fraction, 0 to 1.
        maximum_duty: f64,
        /// Increase for each temperature step (see [`Config::step_2_c`]), in 240ths, 0..=15.
        step: u8,
    },
}

/// A fan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fan {
    /// Control of its duty.
    pub mode: Mode,
    /// Code of the duty's rate of change, 0..=7; see [`Rates::interval`].
    pub rate: u8,
    /// Below this it has failed, rpm; zero: it is not watched. At least 226 (57 600/255), or zero.
    pub minimum_rpm: f64,
    /// True if its tachometer is measured at full duty only: for a fan whose supply is switched.
    pub full_only: bool,
}

/// Configuration of the chip. The defaults leave both fans at 20 %, as in the thesis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The chip's address.
    pub address: Address,
    /// Over-temperature limits of both channels, C.
    pub limit_c: [u8; 2],
    /// Start temperature of a channel's automatic control, °C.
    pub start_c: [u8; 2],
    /// Channel 2 is the chip itself, not a second thermistor.
    pub internal: bool,
    /// Added to the thermistors' temperatures, 2 C a step, -8..=7.
    pub offset: [i8; 2],
    /// Both fans.
    pub fans: [Fan; 2],
    /// An automatic fan runs with its start duty below the start temperature, too.
    pub minimum_duty: bool,
    /// A falling temperature is followed after 10 C, not 5.
    pub hysteresis_10_c: bool,
    /// A temperature step is 2 C, not 1.
    pub step_2_c: bool,
    /// A fan that starts gets 2 s of full drive.
    pub spin_up: bool,
    /// PWM frequency.
    pub frequency: Frequency,
    /// Output 1, 2 is high at full duty.
    pub invert: [bool; 2],
    /// A failed fan drives the other to full duty.
    pub helps: bool,
}

impl Config {
    /// Both fans manual at 20 %, power-on limits.
    #[must_use]
    pub const fn new(address: Address) -> Self {
        let fan = Fan { mode: Mode::Manual { duty: 0.2 }, rate: 1, minimum_rpm: 0.0, full_only: false };
        Self {
            address,
            limit_c: [110, 80],
            start_c: [0, 0],
            internal: true,
            offset: [0, 0],
            fans: [fan; 2],
            minimum_duty: false,
            hysteresis_10_c: false,
            step_2_c: false,
            spin_up: true,
            frequency: Frequency::Hz33,
            invert: [true, true],
            helps: true,
        }
    }

    /// True if the chip can do it.
    pub fn check(&self) -> Result<(), Invalid> {
        let fraction = |value: f64| (0.0..=1.0).contains(&value);
        for fan in &self.fans {
            let duties = match fan.mode {
                Mode::Manual { duty } => fraction(duty),
                Mode::Automatic { start_duty, maximum_duty, .. } => fraction(start_duty) && fraction(maximum_duty),
            };
            let (follows, step) = match fan.mode {
                Mode::Manual { .. } => (true, 0),
                Mode::Automatic { follows, step, .. } => (follows != [false; 2], step),
            };
            let slowest = RPM_COUNT / f64::from(STOPPED);
            let watched = fan.minimum_rpm == 0.0 || (slowest..=RPM_COUNT).contains(&fan.minimum_rpm);
            match () {
                () if !duties => return Err(Invalid::Duty),
                () if !follows => return Err(Invalid::Follows),
                () if step > 15 => return Err(Invalid::Step),
                () if fan.rate > 7 => return Err(Invalid::Rate),
                () if !watched => return Err(Invalid::MinimumRpm),
                () => {}
            }
        }
        let codes = self.offset.iter().all(|offset| (-8..=7).contains(offset));
        if codes { Ok(()) } else { Err(Invalid::Offset) }
    }

    /// Registers and the values that they are to have, in the order in which they are written: a fan begins to follow
    /// temperatures when all that it needs is there.
    pub(super) fn registers(&self) -> heapless::Vec<(u8, u8), 20> {
        let mut values = heapless::Vec::new();
        // 18 at most.
        let mut put = |register: u8, value: u8| values.extend([(register, value)]);
        let configuration = Configuration {
            standby: false,
            reset: false,
            timeout_off: false,
            invert: self.invert,
            minimum_duty: self.minimum_duty,
            internal: self.internal,
            spin_up_off: !self.spin_up,
        };
        put(register::CONFIGURATION, configuration.bits());
        put(register::FREQUENCY, self.frequency.bits());
        put(register::OFFSET, Offsets(self.offset).bits());
        put(register::RATE, Rates(self.fans.map(|fan| fan.rate)).bits());
        let mut follows = [[false; 2]; 2];
        let mut steps = [5; 2];
        for (n, fan) in (0u8..).zip(&self.fans) {
            put(register::LIMIT + n, self.limit_c[usize::from(n)]);
            put(register::START_TEMPERATURE + n, self.start_c[usize::from(n)]);
            put(register::TACH_LIMIT + n, fan.tach_limit());
            if let Mode::Automatic { follows: channels, start_duty, maximum_duty, step } = fan.mode {
                (follows[usize::from(n)], steps[usize::from(n)]) = (channels, step);
                put(register::START_DUTY + n, duty_bits(start_duty));
                put(register::MAXIMUM_DUTY + n, duty_bits(maximum_duty));
            }
        }
        put(register::STEP, Steps(steps).bits());
        put(register::FAN_STATUS, self.fan_status().bits());
        let (hysteresis_10_c, step_2_c) = (self.hysteresis_10_c, self.step_2_c);
        put(register::FAN_CONFIGURATION, FanConfiguration { hysteresis_10_c, step_2_c, follows }.bits());
        for (n, fan) in (0u8..).zip(&self.fans) {
            if let Mode::Manual { duty } = fan.mode {
                // Odd duties round down in the chip.
                put(register::TARGET_DUTY + n, duty_bits(duty) & !1);
            }
        }
        values
    }

    fn fan_status(&self) -> FanStatus {
        FanStatus {
            failed: [false; 2],
            tach_off: [false; 2],
            full_only: self.fans.map(|fan| fan.full_only),
            pin_masked: false,
            alone: !self.helps,
        }
    }
}

impl Fan {
    /// A count above it is a failed fan.
    fn tach_limit(&self) -> u8 {
        if self.minimum_rpm == 0.0 { STOPPED } else { super::fields::count(self.minimum_rpm) }
    }
}

listed! {
    /// Part of a configuration that the chip does not support.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Invalid {
        /// A duty is not 0 to 1.
        Duty => "a duty is a fraction from 0 to 1",
        /// An automatic fan follows no channel.
        Follows => "an automatic fan follows at least one channel",
        /// A duty step is beyond 15.
        Step => "a duty step is 0 to 15 (240ths)",
        /// A rate code is beyond 7.
        Rate => "a rate of change is a code from 0 to 7",
        /// A minimum speed is neither 0 nor 226 to 57 600 rpm.
        MinimumRpm => "a minimum speed is 226 to 57600 rpm, or 0 for a fan that is not watched",
        /// An offset is not -8 to 7.
        Offset => "a thermistor offset is -8 to 7 steps of 2 C",
    }
}

impl core::error::Error for Invalid {}
