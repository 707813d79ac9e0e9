//! Incremental path search for the mission, and the fields that it searches.

use crate::config::{Body, Config};
use crate::goal::Waypoint;
use crate::goal_state::Hindrance;
use crate::map::{Field, Frame, Map, Obstacle, Unknown};
use crate::obstacles::Obstacles;
use crate::path::Path;
use crate::search::{Budget, Footprint, Goal, Limits, NoWay, Search, Status};
use navitools::{Point, Pose};

/// Work units of the search per step of the control loop: a few milliseconds on the robot's computer.
const WORK: u32 = 250;
/// Budget for a path around sensed obstacles: after a longer search people have moved.
const WORK_AROUND: u32 = 20_000;
/// Factor on the minimum turning radius in planning, as a reserve for corrections.
const WIDER: f64 = 1.08;
/// Margin on all sides from mapped and sensed obstacles, m: the accuracy of the pose and of path following.
const MARGIN: f64 = 0.08;
/// Size of a sensed obstacle beyond its cell, m.
const HEARD: f64 = 0.15;
/// Free floor beyond start and goal if there is no map, m.
const BEYOND: f64 = 8.0;
/// Smallest cell of such a floor, m, and the approximate number of cells along a side.
const CELL: f64 = 0.05;
const CELLS: f64 = 800.0;

/// Map, sensed obstacles, and the search among them.
#[derive(Debug)]
pub struct Ways {
    /// Field of the map alone; generated around start and goal without a map.
    still: Option<Field>,
    has_map: bool,
    /// Field with sensed obstacles.
    live: Option<Field>,
    search: Search,
}

/// Progress of the search.
pub enum Progress {
    /// Not finished.
    Going,
    /// Poses in order, each with true if it is driven to forwards.
    Found(Vec<(Pose, bool)>),
    /// No path.
    NoWay {
        /// Reason.
        why: Hindrance,
        /// True if there is no path on this map at all.
        forever: bool,
    },
}

impl Ways {
    /// Field of the configured map; an open floor without one.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let Config { body, limits, map, .. } = config;
        let footprint = Footprint { length_m: body.front + body.rear, width_m: body.width, rear_m: body.rear };
        let radius = WIDER * body.wheelbase / libm::tan(limits.steering);
        let limits = Limits { margin_m: MARGIN, ..Limits::new(footprint, radius) };
        let still = map.as_ref().map(|map| Field::new(map, Unknown::Blocked));
        Self { has_map: still.is_some(), still, live: None, search: Search::new(limits) }
    }

    /// True if the map has an obstacle within `within` m of `point`, or `point` is outside it: the map explains an echo
    /// there.
    #[must_use]
    pub fn is_mapped(&self, point: Point, within: f64) -> bool {
        self.has_map && self.still.as_ref().is_some_and(|still| f64::from(still.distance(point.x, point.y)) <= within)
    }

    /// True if the pose is free on the map alone.
    #[must_use]
    pub fn is_free(&self, pose: Pose) -> bool {
        self.still.as_ref().is_none_or(|still| self.search.limits().footprint.is_free(still, pose))
    }

    /// Sets the obstacles for paths around them: all sensed ones except those within the robot's own body.
    pub fn sense(&mut self, obstacles: &Obstacles, robot: Pose, body: &Body) {
        let Some(still) = &self.still else { return };
        let inverse = robot.inverse();
        let heard = obstacles.hits().filter(|hit| !body.covers(inverse * hit.at, MARGIN));
        let heard: Vec<Obstacle> = heard.map(|hit| Obstacle { x: hit.at.x, y: hit.at.y, radius: HEARD }).collect();
        self.live.get_or_insert_with(|| still.clone()).overlay(&heard);
    }

    /// Without a map: generates a free floor that contains both points.
    fn floor(&mut self, from: Point, to: Point) {
        let holds = |frame: &Frame| {
            let cell = |x, y| frame.cell(x, y).is_some();
            let half = BEYOND / 2.0;
            [from, to].iter().all(|at| cell(at.x - half, at.y - half) && cell(at.x + half, at.y + half))
        };
        if self.has_map || self.still.as_ref().is_some_and(|still| holds(still.frame())) {
            return;
        }
        let low = (from.x.min(to.x) - BEYOND, from.y.min(to.y) - BEYOND);
        let high = (from.x.max(to.x) + BEYOND, from.y.max(to.y) + BEYOND);
        let cell = ((high.0 - low.0).max(high.1 - low.1) / CELLS).max(CELL);
        self.still = Map::around(low, high, cell).ok().map(|map| Field::new(&map, Unknown::Blocked));
        self.live = None;
    }
}

/// Path search in progress. There is one search: a new one replaces it.
#[derive(Clone, Copy, Debug)]
pub struct Route {
    from: Pose,
    to: Waypoint,
    /// Preferred heading at the waypoint; any heading will do if the waypoint requires none.
    heading: Option<f64>,
    around: bool,
    over: bool,
}

impl Route {
    /// Begins to search a path to `to`, preferably with `heading`, around sensed obstacles or on the map alone.
    pub fn begin(ways: &mut Ways, from: Pose, to: &Waypoint, heading: Option<f64>, around: bool) -> Self {
        let route = Self { from, to: *to, heading, around, over: false };
        ways.floor(from.point(), to.at);
        if around && ways.live.is_none() {
            ways.live.clone_from(&ways.still);
        }
        route.search(ways);
        route
    }

    fn search(&self, ways: &mut Ways) {
        let Waypoint { at, tolerance, .. } = self.to;
        // Half of the tolerance is for the path, half for path following.
        let goal = Goal { x: at.x, y: at.y, heading: self.heading, tolerance_m: (tolerance / 2.0).min(0.3) };
        if let Some(field) = if self.around { &ways.live } else { &ways.still } {
            let first = if self.around { WORK_AROUND } else { Budget::default().first };
            ways.search.begin(field, self.from, goal, Budget { first, ..Budget::default() });
        }
    }

    /// Continues for a few milliseconds. A finished search returns its result again.
    pub fn advance(&mut self, ways: &mut Ways) -> Progress {
        let Some(field) = (if self.around { &ways.live } else { &ways.still }) else {
            return Progress::NoWay { why: Hindrance::FloorTooLarge, forever: true };
        };
        if self.over {
            return Progress::Going;
        }
        match ways.search.advance(field, WORK) {
            Status::Searching | Status::Improving(_) => Progress::Going,
            Status::Found(path) => Progress::Found(poses(path)),
            Status::NoWay(NoWay::GoalBlocked | NoWay::Unreachable | NoWay::Budget)
                if self.heading.is_some() && self.to.heading.is_none() =>
            {
                self.heading = None;
                self.search(ways);
                Progress::Going
            }
            Status::NoWay(why) => {
                self.over = true;
                let forever = matches!(why, NoWay::GoalBlocked | NoWay::Unreachable | NoWay::Invalid);
                Progress::NoWay { why: Hindrance::Search(why), forever }
            }
        }
    }
}

/// Poses of a path, each with true if it is driven to forwards; cusps occur twice.
fn poses(path: &Path) -> Vec<(Pose, bool)> {
    let points = path.points();
    let mut poses = Vec::with_capacity(points.len() + 4);
    for (number, point) in points.iter().enumerate() {
        let before = number.checked_sub(1).map_or(point.reverse, |before| points[before].reverse);
        poses.push((point.pose, !before));
        if before != point.reverse {
            poses.push((point.pose, !point.reverse));
        }
    }
    poses
}
