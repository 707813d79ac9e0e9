//! Why a drive is not driven by its data sheet.

use crate::axis::modes::Mode;
use core::fmt;

/// An object, and what is wrong with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The object's index.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// What is wrong.
    pub reason: Reason,
}

/// What is wrong with an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The device is one of another profile.
    Profile(u16),
    /// The drive has no such object.
    Missing,
    /// It cannot be written.
    NotWritable,
    /// Its data type is not that of CiA 402.
    Type,
    /// The drive does not support this mode, or this master does not.
    Mode {
        /// The mode that is wanted.
        wanted: Mode,
        /// Modes of the drive, in the form of 0x6502.
        offered: u32,
    },
    /// No PDO carries it, and none can be mapped anew.
    NoPdo,
    /// It cannot be mapped.
    NotMappable,
    /// It does not take the value that is needed.
    OutOfLimits {
        /// The value.
        value: i64,
        /// The least one that it takes.
        low: i64,
        /// The greatest one.
        high: i64,
    },
    /// It is fixed at a code with which the motor rolls on.
    RollsOn(i64),
    /// The unit is neither given nor stated by it.
    NoUnit,
    /// The drive does not have this homing method.
    Method(i8),
    /// The mode needs SYNC.
    NoSync,
}

impl Refusal {
    pub(super) const fn new(index: u16, sub: u8, reason: Reason) -> Self {
        Self { index, sub, reason }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{}", self.index, self.sub)?;
        if let Some(name) = name(self.index) {
            write!(f, " ({name})")?;
        }
        write!(f, ": {}", self.reason)
    }
}

impl core::error::Error for Refusal {}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Profile(0) => f.write_str("the device is of no profile, and has no controlword"),
            Self::Profile(profile) => write!(f, "the device is of profile {profile}, not a drive of profile 402"),
            Self::Missing => f.write_str("the drive has no such object"),
            Self::NotWritable => f.write_str("it cannot be written"),
            Self::Type => f.write_str("its data type is not that of CiA 402"),
            Self::Mode { wanted, offered } => {
                write!(f, "the drive cannot be driven in {wanted}; it has")?;
                let mut modes = Mode::ALL.into_iter().filter(|mode| mode.is_supported(offered));
                match modes.next() {
                    Some(mode) => write!(f, " {mode}")?,
                    None => f.write_str(" no mode of the standard")?,
                }
                modes.try_for_each(|mode| write!(f, ", {mode}"))
            }
            Self::NoPdo => f.write_str("no PDO carries what is needed, and none can be mapped anew"),
            Self::NotMappable => f.write_str("it cannot be mapped into a PDO"),
            Self::OutOfLimits { value, low, high } => write!(f, "it takes {low} to {high}, not {value}"),
            Self::RollsOn(code) => write!(f, "it is fixed at {code}, with which the motor rolls on"),
            Self::NoUnit => f.write_str("the unit is neither given nor stated by the data sheet"),
            Self::Method(method) => write!(f, "the drive does not have homing method {method}"),
            Self::NoSync => f.write_str("the mode needs SYNC, and the bus has none"),
        }
    }
}

/// What an object is for.
const fn name(index: u16) -> Option<&'static str> {
    Some(match index {
        0x1000 => "device type",
        0x1006 => "period of SYNC",
        0x100C => "guard time",
        0x100D => "life time factor",
        0x1016 => "limit of the master's heartbeat",
        0x1017 => "period of the heartbeat",
        0x1029 => "error behaviour",
        0x1400..=0x15FF => "RPDO",
        0x1600..=0x17FF => "RPDO mapping",
        0x1800..=0x19FF => "TPDO",
        0x1A00..=0x1BFF => "TPDO mapping",
        0x6007 => "abort connection option",
        0x6040 => "controlword",
        0x6041 => "statusword",
        0x605A => "quick stop option",
        0x605E => "fault reaction option",
        0x6060 => "mode of operation",
        0x6061 => "mode of operation display",
        0x6064 => "actual position",
        0x606C => "actual velocity",
        0x607A => "target position",
        0x607C => "home offset",
        0x607F => "greatest velocity",
        0x6080 => "greatest motor speed",
        0x6081 => "profile velocity",
        0x6083 => "acceleration",
        0x6084 => "deceleration",
        0x6085 => "quick stop deceleration",
        0x608F => "encoder resolution",
        0x6091 => "gear ratio",
        0x6098 | 0x60E3 => "homing method",
        0x6099 => "homing speeds",
        0x60A9 => "unit of velocity",
        0x60C1 => "interpolated position",
        0x60FE => "digital outputs",
        0x60FF => "target velocity",
        0x6502 => "supported modes",
        _ => return None,
    })
}
