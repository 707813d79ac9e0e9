//! Keys of a drive on a serial line of its own, and what the driver makes of them.

use super::Axis;
use super::keys::not_zero;
use super::vesc::VescMotor;
use motorctl::roboclaw::{self, Model};
use motorctl::serial::Device;
use settings::{Parsed, Table, settings};

settings! {
    /// Keys of `[serial.<name>]` for the driver: what is on the line, and the wheels that it turns
    /// (docs/motor-controllers.md).
    #[derive(Clone, Debug, PartialEq)]
    pub enum LineKeys by driver {
        /// VESC on a UART: one wheel.
        Vesc(UartVescConfig) = "vesc",
        /// RoboClaw by packet serial: two wheels. Its command time limit cannot be proven, so the robot needs a second
        /// way to stop.
        RoboClaw(RoboClawConfig) = "roboclaw",
    }
}

settings! {
    /// A VESC with firmware 6 or later on a UART.
    #[derive(Clone, Debug, PartialEq)]
    pub struct UartVescConfig {
        /// Wheel, or axle, that it turns.
        axis: Axis = required;
        /// VESC id.
        id: u8 = required, 0..=254;
        motor: VescMotor = flat;
    }
    check UartVescConfig::check;
}

settings! {
    /// A RoboClaw in packet serial mode.
    #[derive(Clone, Debug, PartialEq)]
    pub struct RoboClawConfig {
        /// Address.
        address: u8 = 0x80, 0x80..=0x87;
        /// What the firmware's text must contain: model and version.
        model: Model = required, Parsed(
            Model::new, "model and version, as the device names them", "RoboClaw 2x15a v4.1.34"
        );
        /// Its motor 1.
        m1: RoboClawMotor = required;
        /// Its motor 2.
        m2: RoboClawMotor = required;
    }
    check RoboClawConfig::check;
}

settings! {
    /// A motor of a RoboClaw, with its encoder and gear.
    #[derive(Clone, Debug, PartialEq)]
    pub struct RoboClawMotor {
        /// Wheel, or axle, that it turns.
        axis: Axis = required;
        /// Motor turns per wheel turn, not 0; negative when the motor is mounted the other way round.
        gear: f64 = required, -1000.0..=1000.0;
        /// Quadrature counts of the encoder for a turn of the motor.
        counts_per_turn: f64 = required, 1.0..=1e6;
    }
    check RoboClawMotor::check;
}

impl UartVescConfig {
    fn check(&self, table: &Table<'_>) {
        check_axis(self.axis, table);
    }
}

impl RoboClawConfig {
    fn check(&self, table: &Table<'_>) {
        if self.m1.axis == self.m2.axis
            && let Some(m2) = table.below("m2")
        {
            m2.refuse("axis", "another one than that of m1");
        }
    }
}

impl RoboClawMotor {
    fn check(&self, table: &Table<'_>) {
        check_axis(self.axis, table);
        not_zero(table, self.gear);
    }
}

fn check_axis(axis: Axis, table: &Table<'_>) {
    if axis == Axis::Steering {
        table.refuse("axis", r#""propulsion" or a wheel: this driver cannot steer"#);
    }
}

/// A serial line with one device.
#[derive(Clone, Debug)]
pub struct LineConfig {
    /// The line's name: `serial.left`.
    pub bus: String,
    /// Bd.
    pub baud: u32,
    /// Which device it must be.
    pub device: Device,
    /// What its motors turn, in their order, and motor turns per turn of each wheel.
    pub motors: Vec<(Axis, f64)>,
}

impl LineKeys {
    /// What its motors turn, in their order, and motor turns per turn of each wheel.
    #[must_use]
    pub fn motors(&self) -> Vec<(Axis, f64)> {
        match self {
            Self::Vesc(keys) => vec![(keys.axis, keys.motor.gear)],
            Self::RoboClaw(RoboClawConfig { m1, m2, .. }) => vec![(m1.axis, m1.gear), (m2.axis, m2.gear)],
        }
    }

    /// Where the axis of each motor is written: the table below that of the line, if there is one; in the same order.
    #[must_use]
    pub fn tables(&self) -> &'static [Option<&'static str>] {
        match self {
            Self::Vesc(_) => &[None],
            Self::RoboClaw(_) => &[Some("m1"), Some("m2")],
        }
    }

    /// The line of this name, at this rate.
    #[must_use]
    pub fn line(&self, bus: String, baud: u32) -> LineConfig {
        let device = match self {
            Self::Vesc(keys) => Device::Vesc(keys.motor.device(keys.id)),
            Self::RoboClaw(keys) => Device::RoboClaw(roboclaw::Device {
                address: keys.address,
                baud,
                model: keys.model,
                counts_per_turn: [keys.m1.counts_per_turn, keys.m2.counts_per_turn],
            }),
        };
        LineConfig { bus, baud, device, motors: self.motors() }
    }
}
