//! A planned way.

use navitools::{Arc, Pose};

/// A pose on the way, and how it goes on from there to the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Of the rear axle's middle, in the map's frame.
    pub pose: Pose,
    /// 1/m, to the left positive, up to the next point; the last point has that of the one before.
    pub curvature: f64,
    /// Driven in reverse up to the next point; the last point has that of the one before.
    pub reverse: bool,
    /// The way so far, m, forwards and in reverse together.
    pub s: f64,
}

/// A way of arcs and straight lines from the start to the goal; no curvature is above the limit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    pub(crate) points: Vec<PathPoint>,
    pub(crate) arcs: Vec<Arc>,
    pub(crate) cost: f32,
    pub(crate) clearance: f64,
}

impl Path {
    /// Its poses, the start first, at most 5 cm apart. Two at least, or one: the start is the goal.
    #[must_use]
    pub fn points(&self) -> &[PathPoint] {
        &self.points
    }

    /// Its pieces, from the start.
    #[must_use]
    pub fn arcs(&self) -> &[Arc] {
        &self.arcs
    }

    /// m, forwards and in reverse together.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.points.last().map_or(0.0, |last| last.s)
    }

    /// Where the direction changes: indices of the points that are the last of one direction and the first of the next.
    pub fn cusps(&self) -> impl Iterator<Item = usize> {
        self.points.windows(2).enumerate().filter(|(_, pair)| pair[0].reverse != pair[1].reverse).map(|(at, _)| at + 1)
    }

    /// The least distance of the footprint from anything on the way, m, to half a cell; in a collision 0.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        self.clearance
    }

    /// What the search took for its cost: metres, weighted.
    #[must_use]
    pub fn cost(&self) -> f32 {
        self.cost
    }

    /// Fills in points and their kin from `start` and the arcs.
    pub(crate) fn lay(&mut self, start: Pose, spacing: f64) {
        self.points.clear();
        let (mut pose, mut s) = (start, 0.0);
        for arc in &self.arcs {
            let length = libm::fabs(arc.length);
            let pieces = libm::ceil(length / spacing).max(1.0);
            for piece in 0..pieces as u32 {
                let part = f64::from(piece) / pieces;
                let way = Arc { length: arc.length * part, ..*arc };
                let at = pose.along(way.motion());
                self.points.push(PathPoint {
                    pose: at,
                    curvature: arc.curvature,
                    reverse: arc.length < 0.0,
                    s: s + length * part,
                });
            }
            pose = pose.along(arc.motion());
            s += length;
        }
        let (curvature, reverse) = self.points.last().map_or((0.0, false), |last| (last.curvature, last.reverse));
        self.points.push(PathPoint { pose, curvature, reverse, s });
    }
}
