//! What the keys of several drives have in common.

use motorctl::can::Device;
use settings::Table;
use settings::robot::Limits;
use std::f64::consts::TAU;

/// Margin of the engine's limit above that of commands, and of its ramp above those of the base.
const MARGIN: f64 = 1.1;

/// A motor controller without CANopen, as its keys describe it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerConfig {
    /// Motor turns per wheel turn.
    pub gear: f64,
    /// Which one it must be.
    pub device: Device,
    /// Circumference of the wheel, m.
    pub circumference: f64,
}

/// The axis of a motor controller with this gear, which turns a wheel of this circumference, m.
pub(super) fn axis_of(gear: f64, circumference: f64, limits: &Limits) -> motorctl::Axis {
    let radius = circumference / TAU;
    let ramp = limits.quick_stop_mps2.max(limits.deceleration_mps2).max(limits.acceleration_mps2);
    motorctl::Axis {
        gear,
        velocity_max_radps: limits.speed_mps * MARGIN / radius,
        // Those of the base are followed; the steepest one is that of a command that was not renewed.
        acceleration_radps2: ramp * MARGIN / radius,
    }
}

/// Refuses a gear of 0.
pub(super) fn not_zero(table: &Table<'_>, gear: f64) {
    if gear == 0.0 {
        table.refuse("gear", "a number that is not 0");
    }
}

/// Refuses what only a CANopen node has.
pub(super) fn refuse_canopen(table: &Table<'_>) {
    for key in ["eds", "writable"].into_iter().filter(|key| table.has(key)) {
        table.refuse(key, "nothing: this drive is no CANopen node");
    }
}
