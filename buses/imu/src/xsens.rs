//! Xsens MTi-600 series on CAN, which sends on without being asked.
//!
//! Source: Xsens, *MTi 600-series CAN protocol*, MT1604P, section 6 (messages, default identifiers, sizes, scales) and
//! 6.1.1 (errors); status word: *MT Low Level Communication Protocol*, MT0101P.
//!
//! Nothing is sent to the device. It must be set, with the maker's tool, to send rate of turn and acceleration, both at
//! the same rate, with 11-bit identifiers as delivered; they are free on a bus with CANopen. Quaternion, temperature
//! and status word are used if they come. The instant of a sample is that at which the first of its frames arrived.

pub(crate) mod emulated;
mod frames;
#[cfg(test)]
mod tests;

use crate::judge::Limits;
pub(crate) use frames::Frames;

/// Default identifiers (MT1604P, section 6).
pub mod id {
    /// Error: its code, 1 byte.
    pub const ERROR: u16 = 0x001;
    /// Status word, 4 bytes; bit 1: the filter, so the quaternion, is valid.
    pub const STATUS: u16 = 0x011;
    /// Orientation: w, x, y, z.
    pub const QUATERNION: u16 = 0x021;
    /// Rate of turn: x, y, z.
    pub const RATE_OF_TURN: u16 = 0x032;
    /// Acceleration: x, y, z.
    pub const ACCELERATION: u16 = 0x034;
    /// Temperature.
    pub const TEMPERATURE: u16 = 0x051;
}

/// rad/s of a digit (6.4.2).
pub const ROTATION_RADPS: f64 = 1.0 / 512.0;
/// m/s² of a digit (6.4.4).
pub const ACCELERATION_MPS2: f64 = 1.0 / 256.0;
/// Part of a unit quaternion of a digit (6.3.1).
pub const QUATERNION: f64 = 1.0 / 32767.0;
/// °C of a digit (6.6.1).
pub const TEMPERATURE_C: f64 = 1.0 / 256.0;

/// What the code of an error frame means (6.1.1), where it is known.
pub(crate) fn meaning(code: u8) -> Option<&'static str> {
    (code == 1).then_some("overflow of its output buffer")
}

/// Ranges that the protocol states (6.4.2, 6.4.4).
pub(crate) const LIMITS: Limits = Limits { acceleration_mps2: 100.0, rotation_radps: 35.0 };
