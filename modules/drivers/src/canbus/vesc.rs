//! Keys of a VESC: of its motor, and of its place on CAN.

use super::keys::not_zero;
use motorctl::{can, vesc};
use settings::{Table, settings};

settings! {
    /// A VESC with firmware 6 or later on CAN, for a wheel (docs/motor-controllers.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct VescConfig {
        motor: VescMotor = flat;
        /// Id by which the driver is answered, one for each VESC on the bus; no VESC may have it. Absent: 128 more than
        /// the id of the device.
        host_id: Option<u8> = optional, 0..=254;
    }
}

settings! {
    /// The motor of a VESC, and its gear.
    #[derive(Clone, Debug, PartialEq)]
    pub struct VescMotor {
        /// Motor turns per wheel turn, not 0; negative when the motor is mounted the other way round.
        gear: f64 = required, -1000.0..=1000.0;
        /// Pairs of poles of the motor.
        pole_pairs: u8 = required, 1..=100;
        /// `s_pid_min_erpm` of the device: slower set-points brake, so the wheel stands below
        /// `erpm_min / 60 / pole_pairs / gear` turns a second.
        erpm_min: f64 = 900.0, 0.0..=100_000.0;
        /// Brake current near and at zero speed.
        hold_current_a: f64 = 10.0, 0.1..=1000.0;
        /// Brake current of a quick stop: what `quick_stop_mps2` needs, at least.
        quick_stop_current_a: f64 = 30.0, 0.1..=1000.0;
    }
    check VescMotor::check;
}

/// Absent a host id, it is this much above the id of the device, which is less.
const HOST_ID: u8 = 128;

impl VescMotor {
    fn check(&self, table: &Table<'_>) {
        not_zero(table, self.gear);
    }

    /// The device with this VESC id.
    pub(super) fn device(&self, id: u8) -> vesc::Device {
        let &Self { pole_pairs, erpm_min, hold_current_a, quick_stop_current_a, .. } = self;
        vesc::Device { id, pole_pairs, erpm_min, hold_current_a, quick_stop_current_a }
    }
}

impl VescConfig {
    /// What it must be; `id`: its VESC id.
    #[must_use]
    pub fn device(&self, id: u8) -> can::Device {
        can::Device::Vesc { device: self.motor.device(id), host: self.host(id) }
    }

    /// The id to which a VESC with this id answers.
    pub(super) fn host(&self, id: u8) -> u8 {
        // Of 127, the greatest id, it would be that of all devices.
        self.host_id.unwrap_or(HOST_ID.saturating_add(id).min(254))
    }
}
