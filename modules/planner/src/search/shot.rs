//! End of a search: a curve straight to the goal, if it is free.

use super::ruler::Ruler;
use navitools::{Arc, Point, Pose, reeds_shepp_words};

/// Evaluates curves; keeps the buffer of the best one.
#[derive(Debug, Default)]
pub(crate) struct Shot {
    arcs: Vec<Arc>,
}

impl Shot {
    /// Cheapest free curve from a pose to a target pose, or to a point with any heading, that costs less than `most`.
    pub(crate) fn best(
        &mut self,
        ruler: &Ruler<'_>,
        from: Pose,
        before: Option<Arc>,
        target: Result<Pose, (f64, f64)>,
        most: f32,
    ) -> Option<(f32, &[Arc])> {
        let radius = ruler.limits.radius_m;
        match target {
            Ok(to) => curve(ruler, from, before, to, radius, most, &mut self.arcs).map(|cost| (cost, &self.arcs[..])),
            Err((x, y)) => {
                let mut best = most;
                let mut found = false;
                for arcs in to_point(from.inverse() * Point { x, y }, radius).into_iter().flatten() {
                    if let Some(cost) = ruler.cost(from, before, &arcs, best) {
                        self.arcs.clear();
                        self.arcs.extend(arcs.into_iter().filter(|arc| arc.length != 0.0));
                        (best, found) = (cost, true);
                    }
                }
                found.then_some((best, &self.arcs[..]))
            }
        }
    }
}

/// Reeds-Shepp word that would be cheapest without obstacles, if it is free and costs less than `most`.
pub(crate) fn curve(
    ruler: &Ruler<'_>,
    from: Pose,
    before: Option<Arc>,
    to: Pose,
    radius: f64,
    most: f32,
    arcs: &mut Vec<Arc>,
) -> Option<f32> {
    let mut least = most;
    let mut best = None;
    reeds_shepp_words(from, to, radius, |word| {
        let mut cost = 0.0;
        let mut last = before;
        for arc in word.arcs() {
            cost += (libm::fabs(arc.length) * ruler.limits.costs.arc_cost(arc, ruler.limits.radius_m)) as f32;
            cost += last.map_or(0.0, |last| ruler.change(&last, arc));
            last = Some(*arc);
        }
        if cost < least {
            (least, best) = (cost, Some(word));
        }
    });
    let best = best?;
    let cost = ruler.cost(from, before, best.arcs(), most)?;
    arcs.clear();
    arcs.extend_from_slice(best.arcs());
    Some(cost)
}

/// Turn and straight line to a point: forwards and in reverse, to the left and to the right.
fn to_point(to: Point, radius: f64) -> [Option<[Arc; 2]>; 4] {
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(ahead, left)| {
        // Mirrored so that it is forwards and to the left.
        let (x, y) = (to.x * ahead, to.y * left - radius);
        let square = x * x + y * y - radius * radius;
        (square >= 0.0).then(|| {
            let straight = libm::sqrt(square);
            let turn = libm::atan2(y, x) - libm::atan2(straight, radius) + core::f64::consts::FRAC_PI_2;
            let turn = if turn < -1e-9 { turn + 2.0 * core::f64::consts::PI } else { turn.max(0.0) };
            [
                Arc { curvature: left / radius, length: ahead * turn * radius },
                Arc { curvature: 0.0, length: ahead * straight },
            ]
        })
    })
}
