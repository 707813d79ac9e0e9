//! Cost of a curve.

use super::footprint::Body;
use super::lattice::ProximityCost;
use super::request::Limits;
use crate::map::Field;
use navitools::{Arc, Pose};

/// Distance between the checked poses of a step or a curve, m: the deviation in between is far below the margin.
pub(crate) fn spacing(field: &Field) -> f64 {
    (1.5 * field.frame().resolution).min(0.1)
}

/// Collision check and cost of curves.
pub(crate) struct Ruler<'a> {
    pub(crate) field: &'a Field,
    pub(crate) body: &'a Body,
    pub(crate) toll: &'a ProximityCost,
    pub(crate) limits: &'a Limits,
}

impl Ruler<'_> {
    /// Cost of arcs from a pose, after an arc that leads there; `None` if they touch an obstacle or cost `most` or
    /// more.
    pub(crate) fn cost(&self, start: Pose, before: Option<Arc>, arcs: &[Arc], most: f32) -> Option<f32> {
        let Limits { radius_m, costs, .. } = self.limits;
        let spacing = spacing(self.field);
        let (mut pose, mut before, mut cost) = (start, before, 0.0);
        for arc in arcs {
            if let Some(before) = before {
                cost += self.change(&before, arc);
            }
            let length = libm::fabs(arc.length);
            let count = libm::ceil(length / spacing).max(1.0);
            let each = (length / count * costs.arc_cost(arc, *radius_m)) as f32;
            let part = Arc { length: arc.length / count, ..*arc }.motion();
            // The pose of each part follows from the last one: rounding stays far below the margin.
            for _ in 0..count as u32 {
                pose = pose.along(part);
                let (sin, cos) = pose.theta.sin_cos();
                if cost >= most || !self.body.is_free(self.field, pose.x, pose.y, sin, cos) {
                    return None;
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
