//! Profile velocity (CiA 402-2, 12): the target (0x60FF) is followed by the ramps 0x6083 and 0x6084. It needs no
//! handshake and no bits of the controlword; this is its part of the statusword.

use crate::axis::status;

/// Statusword in this mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityStatus {
    /// Velocity within 0x606D of the target for 0x606E; during a halt: standstill.
    pub reached: bool,
    /// Velocity below the threshold 0x606F.
    pub stands: bool,
    /// The maximum slippage is reached (asynchronous motors).
    pub slips: bool,
    /// A limit holds the velocity back.
    pub limited: bool,
}

impl VelocityStatus {
    /// Reads a statusword.
    #[must_use]
    pub const fn decode(statusword: u16) -> Self {
        Self {
            reached: statusword & status::TARGET_REACHED != 0,
            stands: statusword & status::MODE_12 != 0,
            slips: statusword & status::MODE_13 != 0,
            limited: statusword & status::LIMIT != 0,
        }
    }
}
