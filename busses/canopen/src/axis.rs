//! CiA 402 power state machine: what a statusword says, the master's walk through it, and the drive's own side
//! ([`drive`]). Tables: CiA 402-2 (IEC 61800-7-201), 6.1 to 6.4.

pub mod drive;
#[cfg(test)]
mod tests;
mod walk;

pub use walk::{Axis, AxisConfig, AxisEvent, Goal};

use core::fmt;

/// Bits of a statusword.
pub mod status {
    /// Voltage is on the power stage.
    pub const VOLTAGE: u16 = 1 << 4;
    /// 0: quick stop is active.
    pub const QUICK_STOP: u16 = 1 << 5;
    /// A warning stands.
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
    /// Its rising edge resets a fault.
    pub const FAULT_RESET: u16 = 0x80;
    /// Profile position: new set-point. Homing: start.
    pub const MODE_4: u16 = 1 << 4;
    /// Profile position: change at once.
    pub const CHANGE_AT_ONCE: u16 = 1 << 5;
    /// Profile position: relative.
    pub const RELATIVE: u16 = 1 << 6;
    /// Halt by the ramp.
    pub const HALT: u16 = 1 << 8;
}

/// A state of the power state machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[allow(missing_docs)] // the names are the standard's
pub enum PowerState {
    NotReady,
    SwitchOnDisabled,
    ReadyToSwitchOn,
    SwitchedOn,
    OperationEnabled,
    QuickStopActive,
    FaultReactionActive,
    Fault,
}

impl PowerState {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::NotReady,
        Self::SwitchOnDisabled,
        Self::ReadyToSwitchOn,
        Self::SwitchedOn,
        Self::OperationEnabled,
        Self::QuickStopActive,
        Self::FaultReactionActive,
        Self::Fault,
    ];

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

impl fmt::Display for PowerState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::NotReady => "not ready to switch on",
            Self::SwitchOnDisabled => "switch on disabled",
            Self::ReadyToSwitchOn => "ready to switch on",
            Self::SwitchedOn => "switched on",
            Self::OperationEnabled => "operation enabled",
            Self::QuickStopActive => "quick stop active",
            Self::FaultReactionActive => "fault reaction active",
            Self::Fault => "fault",
        })
    }
}
