//! Bosch BNO055: accelerometer, gyroscope and magnetometer with a processor that fuses them, on I2C.
//!
//! Source: Bosch Sensortec, *BNO055 Intelligent 9-axis absolute orientation sensor*, BST-BNO055-DS000 (data sheet):
//! register map in table 4-2 and section 4.3, operation modes in section 3.3, units in section 3.6.
//!
//! It is operated in the mode IMU (section 3.3.3.1): orientation by accelerometer and gyroscope, since motors and steel
//! near a robot's floor disturb a magnetometer. The heading counts from power-on and drifts. The chip has no clock on
//! the bus: the instant of a sample is that of the request, and what is read is up to 10 ms older. I2C has no checksum:
//! a bit that is wrong on the wire is found only if it makes a value that cannot be.

pub(crate) mod emulated;
mod registers;
#[cfg(test)]
mod tests;

use crate::judge::Limits;
use base::Duration;
pub(crate) use registers::Registers;

/// Address with the pin COM3 low; high: the next one (data sheet, table 4-7).
pub const ADDRESS: u8 = 0x28;
/// Value of [`register::CHIP_ID`].
pub const CHIP: u8 = 0xA0;
/// Period of the samples: the data rate of the fusion (data sheet, table 3-14).
pub const PERIOD: Duration = Duration::from_millis(10);
/// Change of the operation mode, to or from the mode CONFIG (data sheet, table 3-6: 19 ms and 7 ms).
pub const MODE_CHANGE: Duration = Duration::from_millis(20);

/// Addresses of the registers of page 0 that are used (data sheet, table 4-2).
pub mod register {
    /// Chip identifier; behind it those of accelerometer, magnetometer and gyroscope, firmware, boot loader.
    pub const CHIP_ID: u8 = 0x00;
    /// Page of the register map.
    pub const PAGE_ID: u8 = 0x07;
    /// Acceleration: x, y, z, lower byte first.
    pub const ACC_DATA: u8 = 0x08;
    /// Rotation: x, y, z.
    pub const GYR_DATA: u8 = 0x14;
    /// Orientation: w, x, y, z.
    pub const QUA_DATA: u8 = 0x20;
    /// Temperature.
    pub const TEMP: u8 = 0x34;
    /// Calibration of system, gyroscope, accelerometer, magnetometer: 2 bits each, 3 is the best.
    pub const CALIB_STAT: u8 = 0x35;
    /// State of the system.
    pub const SYS_STATUS: u8 = 0x39;
    /// Error of the system, while its state is an error.
    pub const SYS_ERR: u8 = 0x3A;
    /// Units.
    pub const UNIT_SEL: u8 = 0x3B;
    /// Operation mode.
    pub const OPR_MODE: u8 = 0x3D;
    /// Power mode.
    pub const PWR_MODE: u8 = 0x3E;
}

/// Operation mode CONFIG: nothing is measured, the other registers can be written.
pub const MODE_CONFIG: u8 = 0x00;
/// Operation mode IMU.
pub const MODE_IMU: u8 = 0x08;
/// m/s², rad/s, rad, °C.
pub const UNITS: u8 = 0x06;
/// Value of [`register::SYS_STATUS`] while the fusion runs.
pub const STATUS_FUSION: u8 = 5;
/// Value of [`register::SYS_STATUS`] with an error.
pub const STATUS_ERROR: u8 = 1;

/// m/s² of a digit (data sheet, table 3-17).
pub const ACCELERATION_MPS2: f64 = 1.0 / 100.0;
/// rad/s of a digit (data sheet, table 3-22).
pub const ROTATION_RADPS: f64 = 1.0 / 900.0;
/// Part of a unit quaternion of a digit (data sheet, table 3-31).
pub const QUATERNION: f64 = 1.0 / 16384.0;

/// What a value of [`register::SYS_ERR`] means (data sheet, 4.3.59).
pub(crate) fn meaning(code: u8) -> Option<&'static str> {
    Some(match code {
        1 => "initialization of a peripheral failed",
        2 => "initialization of the system failed",
        3 => "self-test failed",
        4 => "value of a register out of range",
        5 => "address of a register out of range",
        6 => "writing a register failed",
        7 => "low power mode not available in this operation mode",
        8 => "power mode of the accelerometer not available",
        9 => "configuration of the fusion failed",
        10 => "configuration of a sensor failed",
        _ => return None,
    })
}

/// Ranges in the modes with fusion: 4 g and 2000 °/s (data sheet, tables 3-8 and 3-9), less a digit.
pub(crate) const LIMITS: Limits = Limits { acceleration_mps2: 39.21, rotation_radps: 34.9 };
