//! What an engine reports.

use base::{Duration, Instant};

/// Whether a sample can be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It can.
    Ok,
    /// The gyroscope is not calibrated: its zero is unknown.
    Uncalibrated,
    /// It has a value that the device or a robot cannot have, or repeats the same values.
    Implausible,
    /// The device reports an error, or its line is disturbed.
    Fault,
}

/// A measurement, in the frame of the device: right-handed, axes as printed on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// When it was measured, as far as that is known: of a device without a clock, when its transfer was requested, or
    /// when it arrived.
    pub at: Instant,
    /// Whether it can be used.
    pub status: Status,
    /// Proper acceleration, m/s²: +9.81 along the axis that points up, at rest.
    pub acceleration_mps2: [f64; 3],
    /// Rate of rotation about each axis, rad/s, counter-clockwise seen from its tip.
    pub rotation_radps: [f64; 3],
    /// Unit quaternion x, y, z, w from the frame of the device to one that is level; its heading counts from power-on,
    /// or from magnetic north, as the device is configured. `None`: the device gave none.
    pub orientation: Option<[f64; 4]>,
    /// Temperature of the device, °C; NaN if it has none.
    pub temperature_c: f64,
}

/// What a device says that it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Firmware, upper and lower byte.
    pub firmware: [u8; 2],
    /// Boot loader.
    pub bootloader: u8,
}

/// Why a device is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LostReason {
    /// Nothing arrives; on I2C nobody answers at the address.
    Silent,
    /// Nothing that arrives is valid; on I2C transfers fail.
    Garbled,
    /// What arrives is valid and has no complete measurement: an output is switched off, or the device restarted.
    Incomplete,
    /// Another device than configured answers.
    Identity {
        /// Its chip identifier.
        chip: u8,
    },
    /// The device reports an error and does not measure.
    Device {
        /// Number of the error, as its data sheet has it.
        code: u8,
    },
    /// The port is closed.
    Closed,
}

/// What is wrong with a device that measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Messages are rejected, or transfers fail.
    Noise = 0,
    /// A value is at the end of the device's range, or gravity is not what it is on Earth.
    Implausible = 1,
    /// All values stay the same, to the last bit.
    Frozen = 2,
    /// The gyroscope is not calibrated.
    Uncalibrated = 3,
    /// The device reports an error.
    Device = 4,
}

impl Fault {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Noise, Self::Implausible, Self::Frozen, Self::Uncalibrated, Self::Device];
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// What the device says that it is; at each start-up.
    Identity(Identity),
    /// A measurement.
    Sample(Sample),
    /// A fault began or ended.
    Fault {
        /// Which.
        fault: Fault,
        /// True if it began.
        active: bool,
    },
    /// The device does not measure; it is started again and again.
    Lost {
        /// Why.
        reason: LostReason,
    },
    /// It measures again, or for the first time.
    Recovered {
        /// Time since the loss; zero at the first start-up.
        after: Duration,
    },
}

/// Progress of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Start-up is under way.
    Starting,
    /// It measures.
    Running,
    /// Pause before the next start-up.
    Resting,
}

/// Counters since the engine was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Valid packets, transfers and frames.
    pub messages: u32,
    /// Invalid packets and frames, failed transfers.
    pub rejected: u32,
    /// Events that had no room, since nobody drained them.
    pub dropped: u32,
}
