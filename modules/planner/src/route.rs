//! Looking for a way: the search, asked a piece at a time, and the map it is asked on.

use crate::config::{Body, Limits};
use crate::goal::Waypoint;
use crate::obstacles::Obstacles;
use navitools::{Point, Pose, reeds_shepp};

/// Poses of a way stand this far apart, m.
const STEP: f64 = 0.05;

/// What is known to stand, and what is heard.
#[derive(Debug)]
pub struct Ways {
    radius: f64,
}

/// What came of looking.
pub enum Progress {
    /// Nothing yet.
    Going,
    /// Poses in order, and whether each is driven to forward.
    Found(Vec<(Pose, bool)>),
    /// There is none, and never will be, or not now.
    NoWay {
        /// In words.
        why: String,
        /// The map alone forbids it.
        forever: bool,
    },
}

impl Ways {
    /// An open floor.
    #[must_use]
    pub fn new(body: &Body, limits: &Limits) -> Self {
        Self { radius: body.wheelbase / libm::tan(limits.steering) * 1.05 }
    }

    /// Whether an echo from `point` is no news.
    #[must_use]
    pub fn is_mapped(&self, _point: Point, _within: f64) -> bool {
        false
    }

    /// Ways around are around what is heard now.
    pub fn sense(&mut self, _obstacles: &Obstacles, _robot: Pose, _body: &Body) {}
}

/// A way that is being looked for.
pub struct Route {
    from: Pose,
    to: Pose,
}

impl Route {
    /// Begins to look for a way.
    pub fn begin(_ways: &Ways, from: Pose, to: &Waypoint, heading: Option<f64>, _around: bool) -> Self {
        let toward = libm::atan2(to.at.y - from.y, to.at.x - from.x);
        Self { from, to: Pose::new(to.at.x, to.at.y, heading.unwrap_or(toward)) }
    }

    /// Looks on for about a millisecond.
    pub fn advance(&mut self, ways: &Ways) -> Progress {
        let curve = reeds_shepp(self.from, self.to, ways.radius);
        let mut pose = self.from;
        let mut poses = vec![];
        for arc in curve.arcs() {
            let count = libm::ceil(arc.length.abs() / STEP).max(1.0);
            poses.push((pose, arc.length > 0.0));
            for n in 1..=count as u32 {
                let part = navitools::Arc { length: arc.length * f64::from(n) / count, ..*arc };
                poses.push((pose.along(part.motion()), arc.length > 0.0));
            }
            pose = pose.along(arc.motion());
        }
        Progress::Found(poses)
    }
}
