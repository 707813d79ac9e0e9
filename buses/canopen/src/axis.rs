//! CiA 402: decoding of the statusword, the master's way through the power state machine ([`Axis`]) and its modes of
//! operation ([`modes`]), the watches over its motion ([`Follow`], [`Reach`]), units ([`Units`]), and the drive's own
//! side ([`drive`], [`servo`]). Tables: CiA 402-2 (IEC 61800-7-201), 6.1 to 6.4.

pub mod drive;
mod follow;
pub mod modes;
pub mod options;
pub mod servo;
#[cfg(test)]
mod tests;
mod units;
mod walk;

pub use follow::{Follow, FollowConfig, NotFollowing, Reach, ReachConfig};
pub use units::{Factors, Rate, Units};
pub use walk::{Axis, AxisConfig, AxisEvent, Goal, Why};

use base::listed;
use core::fmt;

/// Bits of a statusword.
pub mod status {
    /// Voltage is on the power stage.
    pub const VOLTAGE: u16 = 1 << 4;
    /// 0: quick stop is active.
    pub const QUICK_STOP: u16 = 1 << 5;
    /// Warning active.
    pub const WARNING: u16 = 1 << 7;
    /// The controlword is obeyed; EPOS: NMT Operational.
    pub const REMOTE: u16 = 1 << 9;
    /// Set-point reached, or standing after halt.
    pub const TARGET_REACHED: u16 = 1 << 10;
    /// A limit holds the motion back.
    pub const LIMIT: u16 = 1 << 11;
    /// Mode specific: set-point acknowledge, speed is zero, homing attained.
    pub const MODE_12: u16 = 1 << 12;
    /// Mode specific: following error, slippage, homing error.
    pub const MODE_13: u16 = 1 << 13;
}

/// Bits and commands of a controlword.
pub mod control {
    /// To Ready to Switch On.
    pub const SHUTDOWN: u16 = 0x06;
    /// To Switched On.
    pub const SWITCH_ON: u16 = 0x07;
    /// To Operation Enabled.
    pub const ENABLE: u16 = 0x0F;
    /// To Switch On Disabled.
    pub const DISABLE_VOLTAGE: u16 = 0x00;
    /// To Quick Stop Active.
    pub const QUICK_STOP: u16 = 0x02;
    /// Rising edge resets a fault.
    pub const FAULT_RESET: u16 = 0x80;
    /// Profile position: new set-point.
    pub const NEW_SETPOINT: u16 = 1 << 4;
    /// Homing: start.
    pub const START_HOMING: u16 = 1 << 4;
    /// Interpolated position: enable.
    pub const ENABLE_IP: u16 = 1 << 4;
    /// Profile position: change at once.
    pub const CHANGE_AT_ONCE: u16 = 1 << 5;
    /// Profile position: relative.
    pub const RELATIVE: u16 = 1 << 6;
    /// Halt, by option code 0x605D.
    pub const HALT: u16 = 1 << 8;
    /// Profile position: change when the set-point before is passed.
    pub const CHANGE_ON_SETPOINT: u16 = 1 << 9;
}

/// The bits of a statusword that are the same in all modes, by name, but for those of the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StatusBits(pub u16);

impl fmt::Display for StatusBits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [
            (status::VOLTAGE, "voltage"),
            (status::WARNING, "warning"),
            (status::REMOTE, "remote"),
            (status::TARGET_REACHED, "target reached"),
            (status::LIMIT, "internal limit"),
            (status::MODE_12, "bit 12"),
            (status::MODE_13, "bit 13"),
        ];
        let mut set = names.iter().filter(|(bit, _)| self.0 & bit != 0).map(|(_, name)| *name);
        f.write_str(set.next().unwrap_or("no bit"))?;
        set.try_for_each(|name| write!(f, ", {name}"))
    }
}

listed! {
    /// A state of the power state machine.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    #[allow(missing_docs)] // the names are the standard's
    pub enum PowerState {
        NotReady => "not ready to switch on",
        SwitchOnDisabled => "switch on disabled",
        ReadyToSwitchOn => "ready to switch on",
        SwitchedOn => "switched on",
        OperationEnabled => "operation enabled",
        QuickStopActive => "quick stop active",
        FaultReactionActive => "fault reaction active",
        Fault => "fault",
    }
}

impl PowerState {
    /// The state a statusword names; `None` for patterns that the standard does not have. The Refresh and Measure
    /// Init states of EPOS are Switched On here.
    #[must_use]
    pub const fn decode(statusword: u16) -> Option<Self> {
        Some(match (statusword & 0x4F, statusword & 0x6F) {
            (0x00, _) => Self::NotReady,
            (0x40, _) => Self::SwitchOnDisabled,
            (_, 0x21) => Self::ReadyToSwitchOn,
            (_, 0x23) => Self::SwitchedOn,
            (_, 0x27) => Self::OperationEnabled,
            (_, 0x07) => Self::QuickStopActive,
            (0x0F, _) => Self::FaultReactionActive,
            (0x08, _) => Self::Fault,
            _ => return None,
        })
    }

    /// The bits of a statusword that name the state, and that the power stage has voltage.
    #[must_use]
    pub const fn encode(self) -> u16 {
        match self {
            Self::NotReady => 0x00,
            Self::SwitchOnDisabled => 0x40,
            Self::ReadyToSwitchOn => 0x21,
            Self::SwitchedOn => 0x23,
            Self::OperationEnabled => 0x37,
            Self::QuickStopActive => 0x17,
            Self::FaultReactionActive => 0x1F,
            Self::Fault => 0x08,
        }
    }
}
