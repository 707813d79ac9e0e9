//! What the keys of several drives have in common.

use motorctl::can::Device;
use settings::Table;

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
