//! Planned path.

use navitools::{Arc, Pose};

/// Pose on a path, and the motion from there to the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Pose of the rear axle's middle in the map.
    pub pose: Pose,
    /// Curvature up to the next point, 1/m, positive to the left; the last point has that of the previous one.
    pub curvature: f64,
    /// True if driven in reverse up to the next point; the last point has the value of the previous one.
    pub reverse: bool,
    /// Distance driven so far, m, forwards and in reverse together.
    pub s: f64,
}

/// Poses of a path as they are driven, each with true if it is driven to forwards; a cusp occurs twice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Poses {
    /// Poses in order.
    pub poses: Vec<(Pose, bool)>,
    /// True if the path has less than the whole margin beside it.
    pub narrow: bool,
}

/// Path of arcs and straight lines from the start to the goal; the curvature is within the limit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    pub(crate) points: Vec<PathPoint>,
    pub(crate) arcs: Vec<Arc>,
    pub(crate) cost: f32,
    pub(crate) clearance: f64,
    pub(crate) margin: f64,
}

impl Path {
    /// Poses, the start first, at most 5 cm apart. At least two, or one if the start is the goal.
    #[must_use]
    pub fn points(&self) -> &[PathPoint] {
        &self.points
    }

    /// Segments, from the start.
    #[must_use]
    pub fn arcs(&self) -> &[Arc] {
        &self.arcs
    }

    /// Length, m, forwards and in reverse together.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.points.last().map_or(0.0, |last| last.s)
    }

    /// Cusps: indices of the points at which the direction changes.
    pub fn cusps(&self) -> impl Iterator<Item = usize> {
        self.points.windows(2).enumerate().filter(|(_, pair)| pair[0].reverse != pair[1].reverse).map(|(at, _)| at + 1)
    }

    /// Smallest distance of the footprint from an obstacle on the path, m, at most 1 m; 0 if it touches one at the
    /// start. Measured at poses that are at most 10 cm apart, and so close that nothing is touched in between.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        self.clearance
    }

    /// Margin on all sides with which the path was searched, m: less than that of the limits where no path has it.
    #[must_use]
    pub fn margin(&self) -> f64 {
        self.margin
    }

    /// Cost in the search: weighted metres.
    #[must_use]
    pub fn cost(&self) -> f32 {
        self.cost
    }

    /// Fills in points and their derived values from `start` and the arcs.
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
