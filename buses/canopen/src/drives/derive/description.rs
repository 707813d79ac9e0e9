//! What a person knows of a drive beyond its data sheet.

use crate::axis::modes::Mode;
use crate::drives::motor::Own;
use crate::master::Expect;
use alloc::vec::Vec;
use base::{Duration, listed};

listed! {
    /// Unit of the velocity objects; of the acceleration objects, per second.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum VelocityUnit {
        /// A turn of the motor per minute.
        Rpm => "rpm",
        /// A tenth of it.
        TenthRpm => "0.1 rpm",
        /// A thousandth of it.
        MilliRpm => "0.001 rpm",
        /// A position unit per second.
        CountsPerSecond => "counts/s",
    }
}

/// Greatest motion of an axis: SI, of the output (m or rad).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Velocity that is demanded.
    pub velocity: f64,
    /// Acceleration ramp.
    pub acceleration: f64,
    /// Deceleration ramp.
    pub deceleration: f64,
    /// Quick stop ramp.
    pub quick_stop: f64,
}

/// Behaviour of a device beyond the standard, or beyond its data sheet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Quirks {
    /// The controlword that stops, if it is not 0x0002.
    pub quick_stop: Option<u16>,
    /// True if Quick Stop Active is kept although no option code says so.
    pub keeps_quick_stop: bool,
    /// Bit of the statusword that says that the position counts from home; 0: none.
    pub homed: u16,
    /// Objects that the drive lacks, or that cannot be written, and without which it stops nevertheless, by its manual.
    pub vouched: Vec<u16>,
    /// What the drive must be; without vendor and product (0x1018:1 and 2) those of its data sheet, where it has them.
    pub identity: Vec<Expect>,
    /// Greatest speed that motor and gear can bear, 1/min: written to 0x6080 where that can be written. Absent: what
    /// the drive has there must permit the speed of the limits.
    pub motor_rpm_max: Option<u32>,
    /// Object of the motor's current, and its unit; absent: 0x6078, per mille of 0x6075.
    pub current: Option<Own>,
    /// Object of a temperature, and its unit; absent: none, CiA 402 has no such object.
    pub temperature: Option<Own>,
}

/// An axis and its drive.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Mode in which it is driven: profile velocity or position, cyclic synchronous velocity or position, interpolated
    /// position.
    pub mode: Mode,
    /// What a turn of the output is: its circumference in m, or 2π rad.
    pub per_turn: f64,
    /// Motor turns per turn of the output, negative when they turn in opposite directions; absent: 0x6091.
    pub gear: Option<f64>,
    /// Position units per turn of the motor; absent: 0x6092, or 0x608F.
    pub counts_per_turn: Option<u32>,
    /// Unit of the velocity objects; absent: 0x60A9, or position units/s where the drive has factors.
    pub velocity_unit: Option<VelocityUnit>,
    /// Greatest motion.
    pub limits: Limits,
    /// Least and greatest position of an axis in a position mode, SI: the drive's own limits, where it has any.
    pub range: Option<[f64; 2]>,
    /// Homing method that is wanted.
    pub homing: Option<i8>,
    /// Period of SYNC.
    pub sync: Option<Duration>,
    /// Period of the set-points in cyclic synchronous velocity on a bus without SYNC; absent: that mode needs SYNC.
    pub setpoints: Option<Duration>,
    /// Node id of the master.
    pub master: u8,
    /// True if the torque is wanted in a TPDO, where the drive can send it: wheels can work against each other.
    pub torque: bool,
    /// True if the motor can be stopped by another way than the drive.
    pub second_way: bool,
    /// See there.
    pub quirks: Quirks,
}
