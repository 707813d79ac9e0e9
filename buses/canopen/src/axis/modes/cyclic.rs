//! Set-points that leave with each SYNC: interpolated position (CiA 402-2, 14), cyclic synchronous position and
//! velocity (15). The drive has no ramp of its own here, so what it is sent is watched: a set-point that did not come,
//! or is too far from the one before, stops the axis where it is, and it stays so until [`Cyclic::restart`].

use super::Mode;
use crate::axis::{control, status};

/// Bounds on what is sent, in the drive's units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CyclicConfig {
    /// [`Mode::Interpolated`], [`Mode::CyclicPosition`] or [`Mode::CyclicVelocity`].
    pub mode: Mode,
    /// Maximum number of SYNCs in a row without a new set-point.
    pub patience: u32,
    /// From one set-point to the next at most; of a position: greatest speed times period.
    pub max_step: u32,
}

/// Why the axis was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
    /// More SYNCs than the patience found no new set-point.
    Starved,
    /// A set-point was too far from the one before.
    Step {
        /// From where.
        from: i32,
        /// Target.
        to: i32,
    },
}

/// Statusword in these modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CyclicStatus {
    /// The drive follows: ip is active, or the command value is obeyed.
    pub follows: bool,
    /// Following error; csp only.
    pub following_error: bool,
    /// A limit holds the motion back.
    pub limited: bool,
}

/// Set-points of one axis. Used while the axis is enabled in its mode; [`Self::restart`] when that begins.
#[derive(Clone, Copy, Debug)]
pub struct Cyclic {
    config: CyclicConfig,
    next: Option<i32>,
    sent: i32,
    missed: u32,
    stopped: Option<Stopped>,
    running: bool,
}

impl Cyclic {
    /// Makes a sender of zero set-points; [`Self::restart`] begins.
    #[must_use]
    pub fn new(config: CyclicConfig) -> Self {
        Self { config, next: None, sent: 0, missed: 0, stopped: None, running: false }
    }

    fn is_velocity(&self) -> bool {
        self.config.mode == Mode::CyclicVelocity
    }

    /// Begins from where the axis is: its actual position, or its actual velocity.
    pub fn restart(&mut self, actual: i32) {
        *self = Self { sent: actual, running: true, ..Self::new(self.config) };
    }

    /// Resets: the axis is disabled, or in another mode. Sends the `actual` position, or velocity zero.
    pub fn reset(&mut self, actual: i32) {
        let sent = if self.is_velocity() { 0 } else { actual };
        *self = Self { sent, ..Self::new(self.config) };
    }

    /// The set-point for the next SYNC; false: it was refused, as the axis is stopped, or is by this one.
    pub fn set(&mut self, setpoint: i32) -> bool {
        if !self.running || self.stopped.is_some() {
            return false;
        }
        if setpoint.abs_diff(self.sent) > self.config.max_step {
            self.stop(Stopped::Step { from: self.sent, to: setpoint });
            return false;
        }
        self.next = Some(setpoint);
        true
    }

    fn stop(&mut self, why: Stopped) {
        self.stopped = Some(why);
        self.next = None;
        if self.is_velocity() {
            self.sent = 0;
        }
    }

    /// Once for each SYNC, before its PDO leaves: bits to add to the controlword, and the set-point to send with it.
    pub fn sync(&mut self) -> (u16, i32) {
        match self.next.take() {
            Some(next) => (self.sent, self.missed) = (next, 0),
            None if self.running && self.stopped.is_none() => {
                self.missed += 1;
                if self.missed > self.config.patience {
                    self.stop(Stopped::Starved);
                }
            }
            None => {}
        }
        (self.bits(), self.sent)
    }

    /// Bits to add to the controlword.
    #[must_use]
    pub fn bits(&self) -> u16 {
        if self.config.mode == Mode::Interpolated && self.running { control::ENABLE_IP } else { 0 }
    }

    /// Why it was stopped; until [`Self::restart`].
    #[must_use]
    pub fn stopped(&self) -> Option<Stopped> {
        self.stopped
    }
}

impl CyclicStatus {
    /// Reads a statusword.
    #[must_use]
    pub const fn decode(statusword: u16) -> Self {
        Self {
            follows: statusword & status::MODE_12 != 0,
            following_error: statusword & status::MODE_13 != 0,
            limited: statusword & status::LIMIT != 0,
        }
    }
}

/// The SYNC period as 0x60C2:1 and 0x60C2:2 have it: mantissa and power of ten, in s. `None`: it has no exact form of
/// at most 255 units.
#[must_use]
pub const fn interpolation_period(period: base::Duration) -> Option<(u8, i8)> {
    let (mut mantissa, mut exponent) = (period.as_nanos(), -9);
    if mantissa == 0 {
        return None;
    }
    while mantissa.is_multiple_of(10) {
        mantissa /= 10;
        exponent += 1;
    }
    if mantissa <= 255 { Some((mantissa as u8, exponent)) } else { None }
}
