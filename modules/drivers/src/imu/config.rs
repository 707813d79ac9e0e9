//! Which inertial measurement units there are, and how they are mounted.

use base::i2c::Address;
use module::Line;
use settings::{Choice, settings};

/// Model of an inertial measurement unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Bosch BNO055 on I2C.
    Bno055,
    /// WitMotion with the standard protocol on a serial line.
    WitMotion,
    /// Xsens MTi-600 series on CAN.
    Xsens,
}

const MODELS: Choice<Model> =
    Choice(&[("bno055", Model::Bno055), ("witmotion", Model::WitMotion), ("xsens-mti", Model::Xsens)]);

settings! {
    /// Keys of `[imu.<name>]` for the driver.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct ImuKeys {
        /// Model: `"bno055"` on an I2C bus, `"witmotion"` on a serial line, `"xsens-mti"` on a CAN bus.
        model: Model = required, MODELS;
        /// I2C: seven bits.
        address: u8 = imu::bno055::ADDRESS, 0x08..=0x77;
        /// How it is mounted: rotation about the robot's x axis (forward), which is applied first; 3.1416: it hangs
        /// upside down.
        roll_rad as roll: f64 = 0.0, -7.0..=7.0;
        /// Rotation about the robot's y axis (to the left), applied second.
        pitch_rad as pitch: f64 = 0.0, -7.0..=7.0;
        /// Rotation about the robot's z axis (up), applied last: direction of the device's x axis in the robot, where
        /// the others are 0.
        yaw_rad as yaw: f64 = 0.0, -7.0..=7.0;
    }
}

/// An inertial measurement unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// Its name in the configuration.
    pub name: String,
    /// Its port: a line of its own, `imu.base`, or the bus that it is on, `i2c.main`.
    pub bus: String,
    /// What the port is.
    pub line: Line,
    /// Its keys.
    pub keys: ImuKeys,
}

/// All inertial measurement units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// At most [`DEVICES_MAX`].
    pub devices: Vec<Device>,
}

/// Inertial measurement units of a robot at most.
pub const DEVICES_MAX: usize = 8;

impl ImuKeys {
    /// Its model as its engine has it; absent if its address is none.
    #[must_use]
    pub fn model(&self) -> Option<imu::Model> {
        Some(match self.model {
            Model::Bno055 => imu::Model::Bno055 { address: Address::new(self.address)? },
            Model::WitMotion => imu::Model::WitMotion,
            Model::Xsens => imu::Model::Xsens,
        })
    }
}

impl Device {
    /// Its model as its engine has it; absent if its address is none.
    #[must_use]
    pub fn model(&self) -> Option<imu::Model> {
        self.keys.model()
    }
}
