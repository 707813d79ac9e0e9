//! Smoothing: parts of a path are replaced by curves that cost less, gentle ones first.
//!
//! Each replacement is a Reeds-Shepp curve with the minimum radius or a larger one, checked like any other: the path
//! remains drivable and free. A base that turns on the spot or goes sideways has straight lines with turns, too. Long
//! parts come first, then shorter ones.

use super::ruler::Ruler;
use super::{append, shot};
use crate::path::Move;
use navitools::Pose;

/// Cost of a step, in expansions.
pub(crate) const WORK: u32 = 10;

/// Radii to try, as multiples of the minimum radius.
const RADII: [f64; 4] = [4.0, 2.0, 1.3, 1.0];
/// Lengths of the parts to replace, m, a rad on the spot counting as one: at most the path's length, then halved down
/// to this.
const SHORTEST_M: f64 = 0.6;
const LONGEST_M: f64 = 12.0;

/// Path being smoothed.
#[derive(Debug, Default)]
pub(crate) struct Smoothing {
    start: Pose,
    moves: Vec<Move>,
    /// Current part: its length and its beginning.
    span: f64,
    from: f64,
    /// Buffers.
    part: Vec<Move>,
    curve: Vec<Move>,
    next: Vec<Move>,
}

impl Smoothing {
    /// Begins with a path.
    pub(crate) fn begin(&mut self, start: Pose, moves: &[Move]) {
        self.start = start;
        self.moves.clear();
        self.moves.extend_from_slice(moves);
        self.span = self.length().min(LONGEST_M);
        self.from = 0.0;
    }

    /// Current path.
    pub(crate) fn moves(&self) -> &Vec<Move> {
        &self.moves
    }

    /// Cost of the path; `None` if it begins in an obstacle.
    pub(crate) fn cost(&self, ruler: &Ruler<'_>) -> Option<f32> {
        ruler.cost(self.start, None, self.moves.iter().copied(), f32::INFINITY)
    }

    fn length(&self) -> f64 {
        self.moves.iter().map(|part| part.extent()).sum()
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
        let ends = |cost: f32, last: Option<&Move>| match (last, after) {
            (Some(last), Some(after)) => cost + ruler.change(*last, after),
            _ => cost,
        };
        let Some(now) = ruler.cost(from, before, self.part.iter().copied(), f32::INFINITY) else { return true };
        let mut least = ends(now, self.part.last()) - 1e-3;
        let mut found = false;
        for radius in RADII.map(|radii| Some(radii * ruler.limits.radius_m)).into_iter().chain([None]) {
            let cost = match radius {
                Some(radius) => shot::curve(ruler, from, before, to, radius, least, &mut self.curve),
                None => {
                    let to = (to.point(), Some(to.theta.radians()));
                    shot::straight(ruler, from, before, to, least, &mut self.curve)
                }
            };
            let Some(cost) = cost else { continue };
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
    fn cut(&mut self, a: f64, b: f64) -> (Pose, Option<Move>, Pose, Option<Move>) {
        self.part.clear();
        let (mut at, mut pose) = (0.0, self.start);
        let (mut before, mut after) = (None, None);
        let (mut from, mut to) = (None, None);
        for whole in &self.moves {
            let length = whole.extent();
            let along = |s: f64| whole.with(whole.size() * ((s - at) / length).clamp(0.0, 1.0));
            if at + length <= a {
                before = Some(*whole);
            } else if at < b {
                if at < a {
                    before = Some(*whole);
                }
                from.get_or_insert_with(|| along(a).from(pose));
                let (head, tail) = (along(a).size(), along(b).size());
                self.part.push(whole.with(tail - head));
                to = Some(along(b).from(pose));
            }
            if at + length > b + 1e-9 && after.is_none() {
                after = Some(*whole);
            }
            pose = whole.from(pose);
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
        for whole in &self.moves {
            let length = whole.extent();
            let along = |s: f64| whole.size() * ((s - at) / length).clamp(0.0, 1.0);
            append(&mut self.next, whole.with(along(a)));
            if at + length > a && !placed {
                self.part.iter().for_each(|part| append(&mut self.next, *part));
                placed = true;
            }
            append(&mut self.next, whole.with(whole.size() - along(b)));
            at += length;
        }
        std::mem::swap(&mut self.next, &mut self.moves);
    }
}
