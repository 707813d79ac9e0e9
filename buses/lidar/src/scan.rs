//! Sectors: what a lidar measured in at most an eighth of a revolution.

use alloc::boxed::Box;
use alloc::vec;
use base::{Instant, listed};
use core::f64::consts::{FRAC_PI_4, TAU};
use heapless::Vec;

/// Maximum number of beams of a sector: an eighth of a revolution at a step of 0.09°.
pub const BEAMS_MAX: usize = 512;
/// An eighth of a revolution, rad.
pub const EIGHTH_RAD: f64 = FRAC_PI_4;
/// Sectors that wait to be drained; more are dropped and counted.
pub(crate) const SECTORS_MAX: usize = 24;

listed! {
    /// State of the device while it measured a sector. A sector that is not [`Status::Ok`] is shown, and frees nothing.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Status {
        /// The device works.
        #[default]
        Ok => "ok",
        /// The optics are too dirty to measure.
        Blocked => "blocked",
        /// The speed of the motor is out of its range.
        Slow => "slow",
        /// The device reports an error, or its line is disturbed.
        Fault => "fault",
    }
}

/// Beams of a sector, in the order in which they were measured.
///
/// Frame: that of the device, seen from above; angles in rad, counter-clockwise, 0 where the device has its front. Beam
/// `k` was measured at `at + k * beam_time_s`, in direction `angle_min_rad + k * angle_step_rad`.
///
/// Ranges are metres, as in REP 117: `+inf`: nothing was received, `-inf`: an object too near to be measured, NaN: not
/// measured. Not measured is not free.
#[derive(Clone, Debug, PartialEq)]
pub struct Sector {
    /// Instant of the first beam.
    pub at: Instant,
    /// Number of the revolution, from 0 since the engine was made; increases by one at each turn.
    pub revolution: u64,
    /// State of the device.
    pub status: Status,
    /// Direction of the first beam, rad, in [-π, π).
    pub angle_min_rad: f64,
    /// Angle from one beam to the next, rad; negative for a device that turns clockwise.
    pub angle_step_rad: f64,
    /// Time from one beam to the next, s.
    pub beam_time_s: f64,
    /// Shortest range that the device measures, m.
    pub range_min_m: f32,
    /// Longest range that the device measures, m. `+inf` of a beam frees at most as far as dark surfaces are seen.
    pub range_max_m: f32,
    /// Ranges, m.
    pub ranges_m: Vec<f32, BEAMS_MAX>,
    /// Intensities in the unit of the device, one for each range; empty if the device has none.
    pub intensities: Vec<f32, BEAMS_MAX>,
}

impl Sector {
    pub(crate) const EMPTY: Self = Self {
        at: Instant::ZERO,
        revolution: 0,
        status: Status::Ok,
        angle_min_rad: 0.0,
        angle_step_rad: 0.0,
        beam_time_s: 0.0,
        range_min_m: 0.0,
        range_max_m: 0.0,
        ranges_m: Vec::new(),
        intensities: Vec::new(),
    };

    /// Direction of beam `k`, rad, in [-π, π).
    #[must_use]
    pub fn angle_rad(&self, k: usize) -> f64 {
        wrap(self.angle_min_rad + k as f64 * self.angle_step_rad)
    }

    /// Angle between the first and the last beam, rad.
    #[must_use]
    pub fn span_rad(&self) -> f64 {
        self.ranges_m.len().saturating_sub(1) as f64 * self.angle_step_rad.abs()
    }
}

/// The same direction in [-π, π). Angles that are not finite, or far beyond some turns, become 0.
pub(crate) fn wrap(angle_rad: f64) -> f64 {
    if angle_rad.is_nan() || angle_rad.abs() > 1e6 {
        return 0.0;
    }
    let wrapped = angle_rad - TAU * libm::floor((angle_rad + TAU / 2.0) / TAU);
    // Rounding can reach the excluded end.
    if wrapped >= TAU / 2.0 { wrapped - TAU } else { wrapped }
}

/// The same direction in [0, 2π).
pub(crate) fn turn(angle_rad: f64) -> f64 {
    let wrapped = wrap(angle_rad);
    let turned = if wrapped < 0.0 { wrapped + TAU } else { wrapped };
    // Rounding can reach the excluded end.
    if turned >= TAU { 0.0 } else { turned }
}

/// Sectors that wait to be drained, in a ring that is allocated once.
#[derive(Debug)]
pub(crate) struct Sectors {
    slots: Box<[Sector]>,
    head: usize,
    len: usize,
}

impl Sectors {
    pub fn new() -> Self {
        Self { slots: vec![Sector::EMPTY; SECTORS_MAX].into_boxed_slice(), head: 0, len: 0 }
    }

    /// A slot for the next sector; none while all wait to be drained.
    pub fn push(&mut self) -> Option<&mut Sector> {
        if self.len == SECTORS_MAX {
            return None;
        }
        let slot = &mut self.slots[(self.head + self.len) % SECTORS_MAX];
        self.len += 1;
        slot.ranges_m.clear();
        slot.intensities.clear();
        Some(slot)
    }

    /// The oldest sector, which is free for reuse by the next [`Self::push`].
    pub fn pop(&mut self) -> Option<&Sector> {
        if self.len == 0 {
            return None;
        }
        let at = self.head;
        self.head = (self.head + 1) % SECTORS_MAX;
        self.len -= 1;
        Some(&self.slots[at])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_wrap_into_one_turn() {
        for (angle, wrapped) in
            [(0.0, 0.0), (TAU, 0.0), (-TAU / 2.0, -TAU / 2.0), (TAU / 2.0, -TAU / 2.0), (7.0, 7.0 - TAU)]
        {
            assert!((wrap(angle) - wrapped).abs() < 1e-12, "{angle}");
        }
        assert_eq!((wrap(f64::NAN), wrap(f64::INFINITY), wrap(-1e300)), (0.0, 0.0, 0.0));
    }

    #[test]
    fn a_full_ring_refuses_and_keeps_the_order() {
        let mut sectors = Sectors::new();
        for turn in 0..3 {
            for n in 0..SECTORS_MAX as u64 {
                sectors.push().unwrap().revolution = turn * 100 + n;
            }
            assert!(sectors.push().is_none());
            for n in 0..SECTORS_MAX as u64 {
                assert_eq!(sectors.pop().unwrap().revolution, turn * 100 + n);
            }
            assert!(sectors.pop().is_none());
        }
    }
}
