//! What a search is asked, and what it answers.

use super::footprint::Footprint;
use crate::path::Path;
use navitools::Arc;
use std::fmt;

/// What the robot is, and what it prefers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Its rectangle.
    pub footprint: Footprint,
    /// Kept free around it on all sides, m; not below 0.
    pub margin_m: f64,
    /// The least turning radius of the rear axle's middle, m; above zero.
    pub radius_m: f64,
    /// Preferences.
    pub costs: Costs,
    /// States that one search may hold; about 64 bytes each.
    pub states_max: u32,
}

impl Limits {
    /// Limits of a robot with this footprint and turning radius; all else as usual.
    #[must_use]
    pub fn new(footprint: Footprint, radius_m: f64) -> Self {
        Self { footprint, margin_m: 0.02, radius_m, costs: Costs::default(), states_max: 400_000 }
    }
}

/// Preferences, in metres of free straight road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// What a metre in reverse costs more.
    pub reverse: f64,
    /// What a metre at the least radius costs more.
    pub turn: f64,
    /// A change between forwards and reverse.
    pub cusp: f64,
    /// From the least radius on one side to that on the other.
    pub steer: f64,
    /// What a metre with no clearance costs more.
    pub near: f64,
    /// More clearance than this is worth nothing, m.
    pub keep_m: f64,
}

impl Default for Costs {
    fn default() -> Self {
        Self { reverse: 0.7, turn: 0.1, cusp: 0.7, steer: 0.1, near: 1.5, keep_m: 0.35 }
    }
}

impl Costs {
    /// What a metre along an arc costs.
    pub(crate) fn way(&self, arc: &Arc, radius: f64) -> f64 {
        let reverse = if arc.length < 0.0 { self.reverse } else { 0.0 };
        1.0 + reverse + self.turn * libm::fabs(arc.curvature) * radius
    }
}

/// Where to go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// rad; `None`: any.
    pub heading: Option<f64>,
    /// Nearer than this is there, m; the heading is then good to 5°. With 0 the way ends exactly at the goal.
    pub tolerance_m: f64,
}

/// How much work a search may do; a unit is a state expanded, or what takes as long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Until a first way is found.
    pub first: u32,
    /// After that, for a better one; not more than it took to find the first one, or a tenth of this.
    pub better: u32,
}

impl Default for Budget {
    fn default() -> Self {
        Self { first: 200_000, better: 20_000 }
    }
}

/// Why there is no way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoWay {
    /// The robot does not fit in at the goal.
    GoalBlocked,
    /// The robot stands in something, or outside of the map, and does not get out.
    StartBlocked,
    /// Everything within reach was tried.
    Unreachable,
    /// The work allowed was done first.
    Budget,
    /// A coordinate is no number, or a limit makes no sense.
    Invalid,
}

impl fmt::Display for NoWay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::GoalBlocked => "the robot does not fit in at the goal",
            Self::StartBlocked => "the robot stands in an obstacle or outside of the map",
            Self::Unreachable => "no way leads to the goal",
            Self::Budget => "no way was found with the work allowed",
            Self::Invalid => "a coordinate is no number",
        })
    }
}

impl std::error::Error for NoWay {}

/// How far a search has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Status<'a> {
    /// No way yet.
    Searching,
    /// A way that can be driven; a better one is looked for.
    Improving(&'a Path),
    /// The best way found. Further calls do nothing.
    Found(&'a Path),
    /// None. Further calls do nothing.
    NoWay(NoWay),
}
