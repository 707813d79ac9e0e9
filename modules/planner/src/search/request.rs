//! Request to a search, and its result.

use super::footprint::{Body, Footprint};
use crate::map::Field;
use crate::path::{Move, Path};
use base::listed;
use kinematics::{Direction, Shape};
use navitools::{Point, Pose};

/// Geometry of the robot, and preferences.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Footprint of the robot, or the rectangle around it if it has a `shape`.
    pub footprint: Footprint,
    /// Outline of a robot that is no rectangle, within `footprint`; the reference point is in it.
    pub shape: Option<Shape>,
    /// Margin on all sides, m; not below 0.
    pub margin_m: f64,
    /// Smallest margin, m: where no path has the whole margin, paths with half of it, a quarter of it and this one are
    /// tried, as far as these are not smaller.
    pub margin_least_m: f64,
    /// Minimum turning radius of the rear axle's middle, m; above zero.
    pub radius_m: f64,
    /// What the base can do beside arcs.
    pub abilities: Abilities,
    /// Preferences.
    pub costs: Costs,
    /// Maximum number of states in one search; about 64 bytes each.
    pub states_max: u32,
}

impl Limits {
    /// Limits of a robot that steers, with this footprint and turning radius; all others at their defaults.
    #[must_use]
    pub fn new(footprint: Footprint, radius_m: f64) -> Self {
        Self {
            footprint,
            shape: None,
            margin_m: 0.02,
            margin_least_m: 0.0,
            radius_m,
            abilities: Abilities::default(),
            costs: Costs::default(),
            states_max: 400_000,
        }
    }
}

/// Motions of a base beside arcs; a base that steers has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Abilities {
    /// It turns on the spot.
    pub turns: bool,
    /// It goes sideways.
    pub sideways: bool,
}

/// Number of margins that are tried.
const MARGINS: usize = 4;
/// Largest distance by which a corner may leave the poses that are checked, m; also at most three quarters of the
/// margin.
const DEVIATION_MAX_M: f64 = 0.015;
/// Margin of the checked poses where no margin is left, m.
const CONTACT_M: f64 = 1e-3;

/// Margin that is tried.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Margin {
    /// Margin on all sides, m.
    pub(crate) margin: f64,
    /// Margin of the checked poses, m.
    pub(crate) grown: f64,
    /// Distance by which a corner may leave them, m; less than `grown`, so that the footprint itself never touches.
    pub(crate) deviation: f64,
}

impl Limits {
    /// Limits of a robot that steers, with this outline and turning radius; all others at their defaults.
    #[must_use]
    pub fn shaped(shape: &Shape, radius_m: f64) -> Self {
        let length_m = shape.front() - shape.rear();
        let footprint = Footprint { length_m, width_m: 2.0 * shape.half_width(), rear_m: -shape.rear() };
        Self { shape: Some(*shape), ..Self::new(footprint, radius_m) }
    }

    /// True if no occupied cell touches the outline, and all of it is on the map.
    #[must_use]
    pub fn is_free(&self, field: &Field, pose: Pose) -> bool {
        let (sin, cos) = pose.theta.sin_cos();
        match self.shape {
            Some(shape) => Body::shaped(&shape, field).is_free(field, pose.x, pose.y, sin, cos),
            None => self.footprint.is_free(field, pose),
        }
    }

    /// Corners of the outline, m, counter-clockwise.
    #[must_use]
    pub fn corners(&self) -> Vec<Point> {
        self.shape.map_or_else(|| self.footprint.corners().into(), |shape| shape.corners().into())
    }

    /// The outline with a margin, for checks on a field.
    pub(crate) fn body(&self, margin_m: f64, field: &Field) -> Body {
        match self.shape {
            Some(shape) => Body::shaped(&shape.grown(margin_m), field),
            None => Body::new(self.footprint.grown(margin_m), field),
        }
    }

    /// Smallest margin that is tried, m.
    pub(crate) fn margin_least(&self) -> f64 {
        self.margin_least_m.min(self.margin_m)
    }

    /// Margin of an attempt, from 0; `None` after the last.
    pub(crate) fn margin(&self, attempt: usize) -> Option<Margin> {
        let margin_m = self.margin_m;
        let least = self.margin_least();
        let margins = [margin_m, margin_m / 2.0, margin_m / 4.0, least];
        let mut known = f64::INFINITY;
        let margin = margins.into_iter().filter(|&margin| {
            let is_next = margin >= least && margin < known;
            known = if is_next { margin } else { known };
            is_next
        });
        let margin = margin.take(MARGINS).nth(attempt)?;
        let grown = margin.max(CONTACT_M);
        Some(Margin { margin, grown, deviation: (0.75 * grown).min(DEVIATION_MAX_M) })
    }
}

/// Preferences, in metres of free straight road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// Extra cost of a metre in reverse.
    pub reverse: f64,
    /// Extra cost of a metre at the minimum radius.
    pub turn: f64,
    /// Cost of a change between forwards and reverse, or between both sides; half of it is the cost of a change
    /// between driving along, driving sideways and turning on the spot.
    pub cusp: f64,
    /// Cost of a rad on the spot.
    pub spot: f64,
    /// Extra cost of a metre sideways.
    pub aside: f64,
    /// Cost of steering from the minimum radius on one side to that on the other.
    pub steer: f64,
    /// Extra cost of a metre without clearance.
    pub near: f64,
    /// Clearance beyond which there is no extra cost, m.
    pub keep_m: f64,
}

impl Default for Costs {
    fn default() -> Self {
        Self { reverse: 0.7, turn: 0.1, cusp: 0.7, spot: 0.3, aside: 0.7, steer: 0.1, near: 1.5, keep_m: 0.35 }
    }
}

impl Costs {
    /// Cost of a metre of a motion, or of a rad on the spot.
    pub(crate) fn of(&self, part: Move, radius: f64) -> f64 {
        match part {
            Move::Arc(arc) => {
                let reverse = if arc.length < 0.0 { self.reverse } else { 0.0 };
                1.0 + reverse + self.turn * libm::fabs(arc.curvature) * radius
            }
            Move::Turn(_) => self.spot,
            Move::Aside(_) => 1.0 + self.aside,
        }
    }

    /// Cost of a change of direction.
    pub(crate) fn change(&self, before: Direction, after: Direction) -> f64 {
        match () {
            () if before == after => 0.0,
            () if before.opposite() == after => self.cusp,
            () => self.cusp / 2.0,
        }
    }

    /// Lowest cost of a rad of a turn that is driven by arcs or on the spot.
    pub(crate) fn turning(&self, radius: f64) -> f64 {
        self.spot.min((1.0 + self.turn) * radius)
    }
}

/// Goal of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Position in the map, x, m.
    pub x: f64,
    /// Position in the map, y, m.
    pub y: f64,
    /// Heading, rad; `None` for any.
    pub heading: Option<f64>,
    /// Distance that satisfies the goal, m; the heading is then within 5°. With 0 the path ends exactly at the goal.
    pub tolerance_m: f64,
}

/// Work allowed for a search; a unit is an expanded state, or an operation of equal duration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Until a first path is found; half of it for each smaller margin.
    pub first: u32,
    /// After that, for a better one; at most the work for the first one, or a tenth of this.
    pub better: u32,
}

impl Default for Budget {
    fn default() -> Self {
        Self { first: 200_000, better: 20_000 }
    }
}

listed! {
    /// Reason why there is no path.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum SearchError {
        /// The robot does not fit in at the goal.
        GoalBlocked => "the robot does not fit in at the goal",
        /// The robot is in an obstacle or outside the map, and cannot get out.
        StartBlocked => "the robot stands in an obstacle or outside of the map",
        /// Everything within reach was tried.
        Unreachable => "no way leads to the goal",
        /// The work allowed was exhausted.
        Budget => "no way was found with the work allowed",
        /// A coordinate is not a number, or a limit is invalid.
        Invalid => "a coordinate is no number",
    }
}

impl std::error::Error for SearchError {}

/// Progress of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Status<'a> {
    /// No path yet.
    Searching,
    /// A drivable path was found; the search continues for a better one.
    Improving(&'a Path),
    /// Best path found. Further calls have no effect.
    Found(&'a Path),
    /// No path. Further calls have no effect.
    NoPath(SearchError),
}
