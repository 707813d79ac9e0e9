//! Beams that meet something alone: nearer than its neighbours, which pass it although a leg would be met by two.
//!
//! The neighbours of the first beams of a sector are in the one before. Those of the last ones are still to be
//! measured: they count as beams beside which something may be, because who walks is not to be found later for that.

use super::{LEG_SPACING_M, SAME_M};
use base::{Duration, Instant};
use messages::lowlevel::DataScan;
use navitools::wrap;

/// Beams on either side of a single one among which one that measured is looked for.
const BESIDE_MAX: usize = 8;
/// Angle from the last beam of a sector to the first one of the next, in steps, if the next one continues it.
const CONTINUES: std::ops::Range<f64> = 0.5..1.5;
/// Time by which two sectors that continue each other may seem to be apart, by the clock of the device.
const APART_MAX: Duration = Duration::from_millis(10);
/// Errors of the robot's measured motion during a revolution: m, and m for each m of distance.
const MOTION_M: f64 = 0.01;
const MOTION_PER_M: f64 = 0.02;

/// How a beam met something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Finding {
    /// The beams beside it met something, too, or it is not known that they did not.
    Beside,
    /// The beams beside it passed it: what it met is narrower than the distance of those.
    Alone {
        /// How far across the beam the same thing may have been met a revolution before, m.
        across: f64,
    },
}

/// The end of a sector.
#[derive(Debug)]
pub(super) struct Tail {
    /// Direction of its last beam, rad.
    angle: f64,
    /// When the next beam was due.
    until: Instant,
    /// What the lidar reported of itself, and the range at which something is sure to be measured, m.
    status: i8,
    range_max: f32,
    /// Ranges of its last beams, from the last one on.
    ranges: Vec<f32>,
}

impl Tail {
    /// The end of a sector whose first beam was measured at `at`.
    pub fn of(scan: &DataScan, at: Instant) -> Self {
        let count = scan.ranges.len();
        Self {
            angle: scan.angle_min + count.saturating_sub(1) as f64 * scan.angle_step,
            until: at + Duration::from_secs_f64(count as f64 * scan.beam_time),
            status: scan.status,
            range_max: scan.range_max,
            ranges: scan.ranges.iter().rev().take(BESIDE_MAX).copied().collect(),
        }
    }

    /// Steps from its last beam to the first one of a sector that continues it; `None`: it does not, or the lidar
    /// reports something else of itself there.
    pub fn gap(&self, scan: &DataScan, at: Instant) -> Option<f64> {
        let gap = wrap(scan.angle_min - self.angle) / scan.angle_step;
        let apart = at.since(self.until).max(self.until.since(at));
        let alike = self.status == scan.status && self.range_max.total_cmp(&scan.range_max).is_eq();
        (alike && CONTINUES.contains(&gap) && apart <= APART_MAX).then_some(gap)
    }
}

/// How a beam met something at `range` m; `same`: distance within which a finding may be that of the revolution before,
/// m; `before`: the sector that this one continues, and the steps from its last beam to the first one.
pub(super) fn finding(scan: &DataScan, beam: usize, range: f64, same: f64, before: Option<(&Tail, f64)>) -> Finding {
    let Some(beside) = Beside::new(scan, range, same) else { return Finding::Beside };
    let ranges = &scan.ranges;
    let own = (0..beam).rev().map(|other| ((beam - other) as f64, ranges[other]));
    let earlier = before.into_iter().flat_map(|(tail, gap)| {
        tail.ranges.iter().enumerate().map(move |(n, other)| ((beam + n) as f64 + gap, *other))
    });
    let behind = ranges.iter().enumerate().skip(beam + 1).map(|(other, range)| ((other - beam) as f64, *range));
    if !beside.pass(own.chain(earlier)) || !beside.pass(behind) {
        return Finding::Beside;
    }
    Finding::Alone { across: SAME_M.min(2.0 * beside.spacing + MOTION_M + MOTION_PER_M * range) }
}

/// What the beams beside one prove.
struct Beside {
    /// Distance of two beams from each other where the thing is, m.
    spacing: f64,
    /// A beam that measured more has passed it, m.
    beyond: f64,
}

impl Beside {
    /// `None`: nothing. Beyond `range_max` a beam that received nothing proves nothing, nor does a lidar that reports a
    /// fault.
    fn new(scan: &DataScan, range: f64, same: f64) -> Option<Self> {
        let (spacing, beyond) = (range * scan.angle_step.abs(), range + same);
        let proves = range >= 0.0 && scan.status == DataScan::OK && f64::from(scan.range_max) > beyond;
        proves.then_some(Self { spacing, beyond })
    }

    /// True if the next one of these beams that measured has passed, and is so near that it would have met a leg; each
    /// with its distance in steps.
    fn pass(&self, beams: impl Iterator<Item = (f64, f32)>) -> bool {
        let near = beams.take(BESIDE_MAX).take_while(|(steps, _)| steps * self.spacing <= LEG_SPACING_M);
        let mut measured = near.filter(|(_, range)| !range.is_nan());
        measured.next().is_some_and(|(_, range)| f64::from(range) > self.beyond)
    }
}
