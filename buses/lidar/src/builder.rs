//! Sectors from single samples, for devices that send them without a grid.

use crate::engine::Shared;
use crate::scan::{BEAMS_MAX, turn, wrap};
use alloc::boxed::Box;
use base::Instant;
use core::f64::consts::TAU;
use heapless::Vec;

/// Sectors of a revolution.
pub(crate) const EIGHTHS: u8 = 8;
/// The same, of a device that sends the samples of 4 ms to 8 ms at once: a sector is complete with the first sample of
/// the next one, and so up to that time later.
pub(crate) const SIXTEENTHS: u8 = 16;
/// A jump of the angle over more steps than this ends a sector: samples between were lost.
const GAP_STEPS: f64 = 3.5;
/// Samples behind the sector by at most this many steps are put to its begin; others are left out.
const BEHIND_STEPS: f64 = 1.0;

/// A sample. The angle counts in the device's direction of rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// Angle in the device's direction of rotation, rad.
    pub angle_rad: f64,
    /// When it was measured.
    pub at: Instant,
    /// As in a sector, m.
    pub range_m: f32,
    /// In the unit of the device.
    pub intensity: f32,
}

/// From one sample to the next, at the present speed. Both are above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Step {
    /// rad.
    pub angle_rad: f64,
    /// s.
    pub time_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Open {
    /// Number of the sector in its revolution.
    place: u8,
    /// Farthest angle so far, rad.
    front_rad: f64,
}

/// Collects the samples of a sector, and adds the sector when the next begins.
///
/// The samples of a sector lie on a grid from the first to the last of them, with as many beams as samples. Each sample
/// is at most half a step off its beam; of two samples of one beam the nearer is kept, and a beam without one is NaN.
#[derive(Debug)]
pub(crate) struct Builder {
    clockwise: bool,
    /// Sectors of a revolution, and the angle of one, rad.
    sectors: u8,
    sector_rad: f64,
    samples: Box<Vec<(f64, Sample), BEAMS_MAX>>,
    open: Option<Open>,
    revolution: u64,
}

impl Builder {
    /// For a device that turns clockwise, seen from above, or counter-clockwise, with [`EIGHTHS`] or [`SIXTEENTHS`].
    pub fn new(clockwise: bool, sectors: u8) -> Self {
        Self {
            clockwise,
            sectors,
            sector_rad: TAU / f64::from(sectors),
            samples: Box::default(),
            open: None,
            revolution: 0,
        }
    }

    /// Discards the samples of the sector that is not complete.
    pub fn reset(&mut self) {
        self.samples.clear();
        self.open = None;
    }

    /// Adds the sample after the last one.
    pub fn push(&mut self, sample: Sample, step: Step, shared: &mut Shared) {
        let angle = turn(sample.angle_rad);
        let place = ((angle / self.sector_rad) as u8).min(self.sectors - 1);
        let Some(open) = self.open else {
            return self.begin(place, angle, sample);
        };
        let ahead = wrap(angle - open.front_rad);
        let jumped = ahead > GAP_STEPS * step.angle_rad || ahead < -2.0 * GAP_STEPS * step.angle_rad;
        let next = ahead > 0.0 && place != open.place;
        if next && place < open.place {
            self.revolution += 1;
        }
        if self.samples.is_full()
            && wrap(open.front_rad - f64::from(open.place) * self.sector_rad) < step.angle_rad * 4.0
        {
            // The motor stands.
            self.reset();
            return shared.stale();
        }
        if jumped || next || self.samples.is_full() {
            self.close(step, shared);
            return self.begin(place, angle, sample);
        }
        let within = wrap(angle - f64::from(open.place) * self.sector_rad);
        if within >= -BEHIND_STEPS * step.angle_rad {
            // There is room: checked above.
            let _ = self.samples.push((within.max(0.0), sample));
        }
        self.open = Some(Open { front_rad: if ahead > 0.0 { angle } else { open.front_rad }, ..open });
    }

    fn begin(&mut self, place: u8, angle: f64, sample: Sample) {
        self.samples.clear();
        let _ = self.samples.push((angle - f64::from(place) * self.sector_rad, sample));
        self.open = Some(Open { place, front_rad: angle });
    }

    /// Adds the sector.
    fn close(&mut self, nominal: Step, shared: &mut Shared) {
        let Some(open) = self.open.take().filter(|_| !self.samples.is_empty()) else { return };
        let ends = |ends: (f64, f64), angle: f64| (ends.0.min(angle), ends.1.max(angle));
        let (first, last) = self.samples.iter().fold((f64::MAX, f64::MIN), |it, (angle, _)| ends(it, *angle));
        // Not empty, by the check above.
        let began = self.samples.iter().map(|(_, sample)| sample.at).min().unwrap_or_default();
        let steps = self.samples.len() - 1;
        let grid = last > first;
        let step = if grid { (last - first) / steps as f64 } else { nominal.angle_rad };
        let beams = if grid { steps + 1 } else { 1 };
        let angle = f64::from(open.place) * self.sector_rad + first;
        let (samples, clockwise) = (&self.samples, self.clockwise);
        shared.sector(self.revolution, |sector| {
            sector.at = began;
            sector.beam_time_s = nominal.time_s * step / nominal.angle_rad;
            sector.angle_min_rad = if clockwise { -angle } else { angle };
            sector.angle_step_rad = if clockwise { -step } else { step };
            // At most BEAMS_MAX beams.
            let _ = sector.ranges_m.resize(beams, f32::NAN);
            let _ = sector.intensities.resize(beams, 0.0);
            for (angle, sample) in samples.iter() {
                let beam = (libm::round((angle - first) / step) as usize).min(beams - 1);
                let kept = &mut sector.ranges_m[beam];
                if kept.is_nan() || sample.range_m < *kept {
                    *kept = sample.range_m;
                    sector.intensities[beam] = sample.intensity;
                }
            }
        });
        self.samples.clear();
    }
}
