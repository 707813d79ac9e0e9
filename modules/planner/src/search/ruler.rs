//! Collision check and cost of a curve.

use super::footprint::Body;
use super::lattice::{ProximityCost, Sample};
use super::request::Limits;
use crate::map::Field;
use navitools::{Arc, Pose};

/// Distance between the poses of a curve at which its cost is computed, m.
fn spacing(field: &Field) -> f64 {
    (1.5 * field.frame().resolution).min(0.1)
}

/// Maximum number of poses to be checked between two poses at which the cost is computed.
const LOOKS_MAX: usize = 16;

/// Collision check and cost of curves.
pub(crate) struct Ruler<'a> {
    pub(crate) field: &'a Field,
    pub(crate) body: &'a Body,
    pub(crate) toll: &'a ProximityCost,
    pub(crate) limits: &'a Limits,
    /// Distance by which a corner may leave the checked rectangles between two poses, m.
    pub(crate) deviation: f64,
}

impl Ruler<'_> {
    /// Cost of arcs from a pose, after an arc that leads there; `None` if they touch an obstacle or cost `most` or
    /// more.
    pub(crate) fn cost(&self, start: Pose, before: Option<Arc>, arcs: &[Arc], most: f32) -> Option<f32> {
        let Limits { radius_m, costs, .. } = self.limits;
        let spacing = spacing(self.field);
        let (mut pose, mut before, mut cost) = (start, before, 0.0);
        let (mut sin, mut cos) = pose.theta.sin_cos();
        // Poses to be checked in a part of an arc, relative to its beginning and in the map.
        let (mut local, mut placed) = ([Sample::default(); LOOKS_MAX], [Sample::default(); LOOKS_MAX]);
        for arc in arcs {
            if let Some(before) = before {
                cost += self.change(&before, arc);
            }
            let length = libm::fabs(arc.length);
            let apart = self.body.spacing(arc.curvature, self.deviation);
            let count = libm::ceil(length / spacing.min(apart * LOOKS_MAX as f64)).max(1.0);
            let each = (length / count * costs.arc_cost(arc, *radius_m)) as f32;
            let part = Arc { length: arc.length / count, ..*arc };
            let looks = (libm::ceil(length / count / apart).max(1.0) as usize).min(LOOKS_MAX);
            let way = (length / count * self.body.way(arc.curvature)) as f32;
            let mut known = false;
            // The pose of each part follows from the last one: rounding stays far below the deviation.
            for _ in 0..count as u32 {
                let from = (pose, sin, cos);
                pose = pose.along(part.motion());
                if cost >= most {
                    return None;
                }
                (sin, cos) = pose.theta.sin_cos();
                let room = self.body.room(self.field, Sample { x: pose.x, y: pose.y, sin, cos })?;
                if room < way {
                    if !known {
                        local_samples(&mut local[..looks], part);
                        known = true;
                    }
                    let (pose, sin, cos) = from;
                    turn(&local[..looks], sin, cos, &mut placed);
                    let each = way / looks as f32;
                    if !self.body.is_free_along(self.field, (pose.x, pose.y), &placed[..looks], each) {
                        return None;
                    }
                }
                cost += each * self.toll.at(self.body.middle(self.field, pose.x, pose.y, sin, cos));
            }
            before = Some(*arc);
        }
        (cost < most).then_some(cost)
    }

    /// Cost of the transition from one arc to another.
    pub(crate) fn change(&self, before: &Arc, after: &Arc) -> f32 {
        let Limits { radius_m, costs, .. } = self.limits;
        let turned = libm::fabs(after.curvature - before.curvature) * radius_m / 2.0;
        let cusp = if (before.length < 0.0) != (after.length < 0.0) { costs.cusp } else { 0.0 };
        (costs.steer * turned + cusp) as f32
    }
}

/// Poses that divide an arc into equal parts, its end last, relative to its beginning.
fn local_samples(samples: &mut [Sample], arc: Arc) {
    let count = samples.len() as f64;
    for (number, sample) in samples.iter_mut().enumerate() {
        let Pose { x, y, theta } = Arc { length: arc.length * (number + 1) as f64 / count, ..arc }.end();
        let (sin, cos) = theta.sin_cos();
        *sample = Sample { x, y, sin, cos };
    }
}

/// Turns samples by an angle.
fn turn(samples: &[Sample], sin: f64, cos: f64, turned: &mut [Sample]) {
    for (sample, turned) in samples.iter().zip(turned) {
        *turned = sample.turned(sin, cos);
    }
}
