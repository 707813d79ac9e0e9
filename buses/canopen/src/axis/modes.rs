//! Modes of operation (CiA 402-2, 9 to 15), the master's side: one small part for each, which adds its bits to the
//! controlword of an enabled [`Axis`](super::Axis), gives the set-point, and decodes its part of the statusword. None
//! of them owns a PDO: the drive's table maps controlword and set-point.
//!
//! | mode | piece |
//! |---|---|
//! | pp, profile position | [`pp::Setpoint`] |
//! | pv, profile velocity | [`pv::VelocityStatus`] |
//! | hm, homing | [`hm::Homing`], its methods [`method::Method`] |
//! | ip, interpolated position | [`cyclic::Cyclic`] with [`Mode::Interpolated`] |
//! | csp, csv, cyclic synchronous | [`cyclic::Cyclic`] |
//!
//! The mode itself is switched by [`switch::Switch`], and watched by [`watch::ModeWatch`]; halt, which all of them
//! know, is [`Axis::halt`](super::Axis::halt). Left out: vl, tq, cst.

pub mod cyclic;
pub mod hm;
pub mod method;
pub mod pp;
pub mod pv;
pub mod switch;
#[cfg(test)]
mod tests;
pub mod watch;

use crate::master::Expect;
use base::listed;

listed! {
    /// Mode requested in 0x6060 and displayed in 0x6061.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    #[repr(i8)]
    #[allow(missing_docs)] // the names are the standard's
    pub enum Mode {
        ProfilePosition = 1 => "profile position",
        Velocity = 2 => "velocity",
        ProfileVelocity = 3 => "profile velocity",
        ProfileTorque = 4 => "profile torque",
        Homing = 6 => "homing",
        Interpolated = 7 => "interpolated position",
        CyclicPosition = 8 => "cyclic synchronous position",
        CyclicVelocity = 9 => "cyclic synchronous velocity",
        CyclicTorque = 10 => "cyclic synchronous torque",
    }
}

impl Mode {
    /// The mode of a value of 0x6060; `None` for 0, for reserved ones and for the manufacturers' negative ones.
    #[must_use]
    pub fn from_code(code: i8) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.code() == code)
    }

    /// Value in 0x6060.
    #[must_use]
    pub const fn code(self) -> i8 {
        self as i8
    }

    /// Bit in 0x6502.
    #[must_use]
    pub const fn bit(self) -> u32 {
        1 << (self as u32 - 1)
    }

    /// True if a drive with this 0x6502 has it.
    #[must_use]
    pub const fn is_supported(self, supported: u32) -> bool {
        supported & self.bit() != 0
    }

    /// Value of 0x6502 with all of `modes`, for the identity check of a boot-up.
    #[must_use]
    pub const fn expect(modes: &[Self]) -> Expect {
        let (mut bits, mut at) = (0, 0);
        while at < modes.len() {
            bits |= modes[at].bit();
            at += 1;
        }
        Expect::masked(0x6502, 0, bits, bits)
    }
}
