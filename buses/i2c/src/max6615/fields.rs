//! Register values and what they mean: stateless, and each the other's inverse.

use base::Duration;

/// Full duty: duties count in 240ths.
pub const DUTY_FULL: u8 = 240;

/// Register 02.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// Bit 7: no conversions, both outputs off.
    pub standby: bool,
    /// Bit 6: writes all registers to their power-on values, itself included.
    pub reset: bool,
    /// Bit 5: the chip's SMBus timeout is off.
    pub timeout_off: bool,
    /// Bits 4 and 3: output 1, 2 is high at full duty.
    pub invert: [bool; 2],
    /// Bit 2: below its start temperature an automatic fan runs with its start duty, not at all else.
    pub minimum_duty: bool,
    /// Bit 1: channel 2 is the chip itself, not thermistor 2.
    pub internal: bool,
    /// Bit 0: a fan that starts gets no 2 s of full drive.
    pub spin_up_off: bool,
}

impl Configuration {
    /// From the register's value.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self {
            standby: bit(bits, 7),
            reset: bit(bits, 6),
            timeout_off: bit(bits, 5),
            invert: [bit(bits, 4), bit(bits, 3)],
            minimum_duty: bit(bits, 2),
            internal: bit(bits, 1),
            spin_up_off: bit(bits, 0),
        }
    }

    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u8 {
        at(self.standby, 7)
            | at(self.reset, 6)
            | at(self.timeout_off, 5)
            | at(self.invert[0], 4)
            | at(self.invert[1], 3)
            | at(self.minimum_duty, 2)
            | at(self.internal, 1)
            | at(self.spin_up_off, 0)
    }
}

/// Which temperatures a fan follows, if any; the warmer request wins.
pub type Follows = [bool; 2];

/// Register 11.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanConfiguration {
    /// Bit 7: a falling temperature is followed after 10 C, not 5.
    pub hysteresis_10_c: bool,
    /// Bit 6: a temperature step is 2 C, not 1.
    pub step_2_c: bool,
    /// Bits 5 and 4, 3 and 2: what fan 1, 2 follows. Neither channel: its target duty is what was written (manual).
    pub follows: [Follows; 2],
}

impl FanConfiguration {
    /// From the register's value.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self {
            hysteresis_10_c: bit(bits, 7),
            step_2_c: bit(bits, 6),
            follows: [[bit(bits, 5), bit(bits, 4)], [bit(bits, 3), bit(bits, 2)]],
        }
    }

    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u8 {
        let [[a, b], [c, d]] = self.follows;
        at(self.hysteresis_10_c, 7) | at(self.step_2_c, 6) | at(a, 5) | at(b, 4) | at(c, 3) | at(d, 2)
    }

    /// Hysteresis, C.
    #[must_use]
    pub const fn hysteresis_c(self) -> u8 {
        if self.hysteresis_10_c { 10 } else { 5 }
    }

    /// Temperature step, C.
    #[must_use]
    pub const fn step_c(self) -> u8 {
        if self.step_2_c { 2 } else { 1 }
    }
}

/// Register 12: how long each fan's duty stays before its next step of 2/240, as a code 0..=7.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates(pub [u8; 2]);

impl Rates {
    /// From the register's value.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self([bits >> 5, bits >> 2 & 7])
    }

    /// The register's value; codes beyond 7 count as 7.
    #[must_use]
    pub const fn bits(self) -> u8 {
        lesser(self.0[0], 7) << 5 | lesser(self.0[1], 7) << 2
    }

    /// Time from step to step of a code: 0 changes at once, 1 is 62.5 ms, each next twice that, 7 is 4 s.
    #[must_use]
    pub const fn interval(code: u8) -> Duration {
        if code == 0 { Duration::ZERO } else { Duration::from_micros(62_500 << (lesser(code, 7) - 1)) }
    }
}

/// Register 13: how much duty each fan gets for each temperature step, in 240ths, 0..=15.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Steps(pub [u8; 2]);

impl Steps {
    /// From the register's value.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self([bits >> 4, bits & 0xF])
    }

    /// The register's value; steps beyond 15 count as 15.
    #[must_use]
    pub const fn bits(self) -> u8 {
        lesser(self.0[0], 15) << 4 | lesser(self.0[1], 15)
    }
}

/// Register 14.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frequency {
    /// 33 Hz: the fan's supply is switched.
    Hz33,
    /// 35 kHz: the fan has an input for it. Duties are then multiples of 4/240.
    Khz35,
    /// A code, 0..=7, whose meaning is not known here.
    Code(u8),
}

impl Frequency {
    /// From the register's value.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        match bits >> 5 {
            0b010 => Self::Hz33,
            0b111 => Self::Khz35,
            code => Self::Code(code),
        }
    }

    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u8 {
        match self {
            Self::Hz33 => 0b010 << 5,
            Self::Khz35 => 0b111 << 5,
            Self::Code(code) => lesser(code, 7) << 5,
        }
    }
}

/// Register 17: what is added to each thermistor's temperature, in steps of 2 C, -8..=7.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Offsets(pub [i8; 2]);

impl Offsets {
    /// From the register's value.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        // Shifting an i8 to the right carries the sign.
        Self([bits.cast_signed() >> 4, (bits << 4).cast_signed() >> 4])
    }

    /// The register's value, of the low four bits of each.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0[0].cast_unsigned() << 4 | self.0[1].cast_unsigned() & 0xF
    }
}

/// Register 1C.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanStatus {
    /// Bits 7 and 6: fan 1, 2 failed.
    pub failed: [bool; 2],
    /// Bits 5 and 4: the tachometer of fan 1, 2 is off.
    pub tach_off: [bool; 2],
    /// Bits 3 and 2: fan 1, 2 is measured at full duty only.
    pub full_only: [bool; 2],
    /// Bit 1: the FAN_FAIL pin stays quiet.
    pub pin_masked: bool,
    /// Bit 0: a failed fan leaves the other alone; else it drives it to full duty.
    pub alone: bool,
}

impl FanStatus {
    /// From the register's value.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        Self {
            failed: [bit(bits, 7), bit(bits, 6)],
            tach_off: [bit(bits, 5), bit(bits, 4)],
            full_only: [bit(bits, 3), bit(bits, 2)],
            pin_masked: bit(bits, 1),
            alone: bit(bits, 0),
        }
    }

    /// The register's value.
    #[must_use]
    pub const fn bits(self) -> u8 {
        at(self.failed[0], 7)
            | at(self.failed[1], 6)
            | at(self.tach_off[0], 5)
            | at(self.tach_off[1], 4)
            | at(self.full_only[0], 3)
            | at(self.full_only[1], 2)
            | at(self.pin_masked, 1)
            | at(self.alone, 0)
    }
}

/// Registers 05 and 06: a bit for each channel, 7 and 6.
#[must_use]
pub const fn channels_from_bits(bits: u8) -> [bool; 2] {
    [bit(bits, 7), bit(bits, 6)]
}

/// See [`channels_from_bits`].
#[must_use]
pub const fn channels_bits(channels: [bool; 2]) -> u8 {
    at(channels[0], 7) | at(channels[1], 6)
}

/// A temperature in C of a whole and a fraction register (eighths in its bits 7 to 5): 0 to 255.875.
#[must_use]
pub fn temperature_c(whole: u8, fraction: u8) -> f64 {
    f64::from(whole) + f64::from(fraction >> 5) / 8.0
}

/// The two registers of a temperature, rounded down; below 0 C, or not a number, they read 0.
#[must_use]
pub fn temperature_bits(c: f64) -> (u8, u8) {
    // A cast saturates, and makes 0 of what is no number.
    let eighths = (c * 8.0) as u16;
    let eighths = if eighths > 0x7FF { 0x7FF } else { eighths };
    ((eighths >> 3) as u8, (eighths as u8 & 7) << 5)
}

/// A fraction of full duty, 0 to 1, of a duty register; 240 and more are full.
#[must_use]
pub fn duty(bits: u8) -> f64 {
    f64::from(bits.min(DUTY_FULL)) / f64::from(DUTY_FULL)
}

/// The nearest duty register value to a fraction; out of 0 to 1 is cut off.
#[must_use]
pub fn duty_bits(fraction: f64) -> u8 {
    let rounded = (fraction * f64::from(DUTY_FULL) + 0.5) as u8;
    rounded.min(DUTY_FULL)
}

/// rpm x count for a fan of two pulses a turn (`docs/facts/robot.md` 2.3).
pub const RPM_COUNT: f64 = 57_600.0;
/// Tachometer count of a stopped fan.
pub const STOPPED: u8 = 0xFF;

/// Speed of a fan of two pulses a turn; a count of 255 is standing still, and so is the impossible 0.
#[must_use]
pub fn rpm(count: u8) -> f64 {
    if count == STOPPED || count == 0 { 0.0 } else { RPM_COUNT / f64::from(count) }
}

/// The count of a speed, rounded down: 255 when too slow, at least 1.
#[must_use]
pub fn count(rpm: f64) -> u8 {
    // A cast saturates: slow is 255.
    if rpm > 0.0 { ((RPM_COUNT / rpm) as u8).max(1) } else { STOPPED }
}

const fn bit(bits: u8, n: u8) -> bool {
    bits >> n & 1 == 1
}

const fn at(bit: bool, n: u8) -> u8 {
    (bit as u8) << n
}

const fn lesser(a: u8, b: u8) -> u8 {
    if a < b { a } else { b }
}
