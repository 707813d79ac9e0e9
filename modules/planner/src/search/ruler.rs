//! Collision check and cost of a part of a path.

use super::footprint::Body;
use super::lattice::{ProximityCost, Sample};
use super::request::Limits;
use crate::map::Field;
use crate::path::Move;
use navitools::Pose;

/// Distance between the poses at which the cost is computed, m, or rad on the spot.
fn spacing(field: &Field) -> f64 {
    (1.5 * field.frame().resolution).min(0.1)
}

/// Maximum number of poses to be checked between two poses at which the cost is computed.
const LOOKS_MAX: usize = 16;

/// Collision check and cost of parts of a path.
pub(crate) struct Ruler<'a> {
    pub(crate) field: &'a Field,
    pub(crate) body: &'a Body,
    pub(crate) toll: &'a ProximityCost,
    pub(crate) limits: &'a Limits,
    /// Distance by which a corner may leave the checked rectangles between two poses, m.
    pub(crate) deviation: f64,
}

impl Ruler<'_> {
    /// Cost of parts from a pose, after one that leads there, where nothing is near.
    pub(crate) fn cost_in_the_open(&self, before: Option<Move>, parts: impl IntoIterator<Item = Move>) -> f32 {
        let Limits { radius_m, costs, .. } = self.limits;
        let (mut cost, mut last) = (0.0, before);
        for part in parts {
            cost += (part.extent() * costs.of(part, *radius_m)) as f32;
            cost += last.map_or(0.0, |last| self.change(last, part));
            last = Some(part);
        }
        cost
    }

    /// Cost of parts from a pose, after one that leads there; `None` if they touch an obstacle or cost `most` or more.
    pub(crate) fn cost(
        &self,
        start: Pose,
        before: Option<Move>,
        parts: impl IntoIterator<Item = Move>,
        most: f32,
    ) -> Option<f32> {
        let Limits { radius_m, costs, .. } = self.limits;
        let spacing = spacing(self.field);
        let (mut pose, mut before, mut cost) = (start, before, 0.0);
        let (mut sin, mut cos) = pose.theta.sin_cos();
        // Poses to be checked in a piece of a part, relative to its beginning and in the map.
        let (mut local, mut placed) = ([Sample::default(); LOOKS_MAX], [Sample::default(); LOOKS_MAX]);
        for whole in parts {
            if let Some(before) = before {
                cost += self.change(before, whole);
            }
            let length = whole.extent();
            let apart = self.body.spacing(whole, self.deviation);
            let count = libm::ceil(length / spacing.min(apart * LOOKS_MAX as f64)).max(1.0);
            let each = (length / count * costs.of(whole, *radius_m)) as f32;
            let part = whole.with(whole.size() / count);
            let looks = (libm::ceil(length / count / apart).max(1.0) as usize).min(LOOKS_MAX);
            let way = (length / count * self.body.way(whole)) as f32;
            let mut known = false;
            // The pose of each part follows from the last one: rounding stays far below the deviation.
            for _ in 0..count as u32 {
                let from = (pose, sin, cos);
                pose = part.from(pose);
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
            before = Some(whole);
        }
        (cost < most).then_some(cost)
    }

    /// Cost of the transition from one part to another.
    pub(crate) fn change(&self, before: Move, after: Move) -> f32 {
        let Limits { radius_m, costs, .. } = self.limits;
        let turned = libm::fabs(after.curvature() - before.curvature()) * radius_m / 2.0;
        (costs.steer * turned + costs.change(before.direction(), after.direction())) as f32
    }
}

/// Poses that divide a part into equal pieces, its end last, relative to its beginning.
fn local_samples(samples: &mut [Sample], part: Move) {
    let count = samples.len() as f64;
    for (number, sample) in samples.iter_mut().enumerate() {
        let Pose { x, y, theta } = part.with(part.size() * (number + 1) as f64 / count).from(Pose::default());
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
