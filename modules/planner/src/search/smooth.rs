//! Smoothing: parts of a path are replaced by curves that cost less, gentle ones first.
//!
//! Each replacement is a Reeds-Shepp curve with the minimum radius or a larger one, checked like any other: the path
//! remains drivable and free. Long parts come first, then shorter ones.

use super::ruler::Ruler;
use super::{append, shot};
use navitools::{Arc, Pose};

/// Cost of a step, in expansions.
pub(crate) const WORK: u32 = 10;

/// Radii to try, as multiples of the minimum radius.
const RADII: [f64; 4] = [4.0, 2.0, 1.3, 1.0];
/// Lengths of the parts to replace, m: at most the path's length, then halved down to this.
const SHORTEST_M: f64 = 0.6;
const LONGEST_M: f64 = 12.0;

/// Path being smoothed.
#[derive(Debug, Default)]
pub(crate) struct Smoothing {
    start: Pose,
    arcs: Vec<Arc>,
    /// Current part: its length and its beginning.
    span: f64,
    from: f64,
    /// Buffers.
    part: Vec<Arc>,
    curve: Vec<Arc>,
    next: Vec<Arc>,
}

impl Smoothing {
    /// Begins with a path.
    pub(crate) fn begin(&mut self, start: Pose, arcs: &[Arc]) {
        self.start = start;
        self.arcs.clear();
        self.arcs.extend_from_slice(arcs);
        self.span = self.length().min(LONGEST_M);
        self.from = 0.0;
    }

    /// Current path.
    pub(crate) fn arcs(&self) -> &Vec<Arc> {
        &self.arcs
    }

    /// Cost of the path; `None` if it begins in an obstacle.
    pub(crate) fn cost(&self, ruler: &Ruler<'_>) -> Option<f32> {
        ruler.cost(self.start, None, &self.arcs, f32::INFINITY)
    }

    fn length(&self) -> f64 {
        self.arcs.iter().map(|arc| libm::fabs(arc.length)).sum()
    }

    /// Attempts to replace one part; false when all have been tried.
    pub(crate) fn step(&mut self, ruler: &Ruler<'_>) -> bool {
        let length = self.length();
        if self.from + 0.5 * self.span > length - 1e-6 && self.from > 0.0 {
            self.span /= 2.0;
            self.from = 0.0;
        }
        if self.span < SHORTEST_M {
            return false;
        }
        let (a, b) = (self.from, (self.from + self.span).min(length));
        self.from += self.span / 2.0;
        let (from, before, to, after) = self.cut(a, b);
        let ends = |cost: f32, last: Option<&Arc>| match (last, after) {
            (Some(last), Some(after)) => cost + ruler.change(last, &after),
            _ => cost,
        };
        let Some(now) = ruler.cost(from, before, &self.part, f32::INFINITY) else { return true };
        let mut least = ends(now, self.part.last()) - 1e-3;
        let mut found = false;
        for radius in RADII.map(|radii| radii * ruler.limits.radius_m) {
            let Some(cost) = shot::curve(ruler, from, before, to, radius, least, &mut self.curve) else { continue };
            let cost = ends(cost, self.curve.last());
            if cost < least {
                (least, found) = (cost, true);
                std::mem::swap(&mut self.curve, &mut self.part);
            }
        }
        if found {
            self.splice(a, b);
        }
        true
    }

    /// Part between two lengths: its beginning and end, and the arcs before and after it.
    fn cut(&mut self, a: f64, b: f64) -> (Pose, Option<Arc>, Pose, Option<Arc>) {
        self.part.clear();
        let (mut at, mut pose) = (0.0, self.start);
        let (mut before, mut after) = (None, None);
        let (mut from, mut to) = (None, None);
        for arc in &self.arcs {
            let length = libm::fabs(arc.length);
            let along = |s: f64| Arc { length: arc.length * ((s - at) / length).clamp(0.0, 1.0), ..*arc };
            if at + length <= a {
                before = Some(*arc);
            } else if at < b {
                if at < a {
                    before = Some(*arc);
                }
                from.get_or_insert_with(|| pose.along(along(a).motion()));
                let (head, tail) = (along(a).length, along(b).length);
                self.part.push(Arc { length: tail - head, ..*arc });
                to = Some(pose.along(along(b).motion()));
            }
            if at + length > b + 1e-9 && after.is_none() {
                after = Some(*arc);
            }
            pose = pose.along(arc.motion());
            at += length;
        }
        let from = from.unwrap_or(pose);
        (from, before, to.unwrap_or(from), after)
    }

    /// Replaces the section between two lengths by `part`.
    fn splice(&mut self, a: f64, b: f64) {
        self.next.clear();
        let mut at = 0.0;
        let mut placed = false;
        for arc in &self.arcs {
            let length = libm::fabs(arc.length);
            let along = |s: f64| arc.length * ((s - at) / length).clamp(0.0, 1.0);
            append(&mut self.next, Arc { length: along(a), ..*arc });
            if at + length > a && !placed {
                self.part.iter().for_each(|arc| append(&mut self.next, *arc));
                placed = true;
            }
            append(&mut self.next, Arc { length: arc.length - along(b), ..*arc });
            at += length;
        }
        std::mem::swap(&mut self.next, &mut self.arcs);
    }
}
