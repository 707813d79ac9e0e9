//! Incremental path search for the mission, and the fields that it searches.

use crate::config::{Body, Config};
use crate::goal::Waypoint;
use crate::goal_state::Hindrance;
use crate::map::{Field, Frame, Map, Obstacle, Unknown};
use crate::obstacles::Obstacles;
use crate::path::{Path, Poses};
use crate::search::{Budget, Footprint, Goal, Limits, Search, SearchError, Status};
use kinematics::Direction;
use navitools::{Point, Pose};

/// Work units of the search per step of the control loop: a few milliseconds on the robot's computer, below half a
/// millisecond on the build machine.
const WORK_PER_STEP: u32 = 200;
/// Budget for a path around sensed obstacles: after a longer search people have moved.
const WORK_AROUND_MAX: u32 = 20_000;
/// Factor on the minimum turning radius in planning, as a reserve for corrections.
const RADIUS_FACTOR: f64 = 1.08;
/// Margin on all sides from mapped and sensed obstacles, m: the accuracy of the pose and of path following.
const MARGIN_M: f64 = 0.12;
/// Margin where no path has the whole one, m: by this the guard widens the outline at any speed (`guard.uncertainty_m`
/// by default), so that it does not let the robot pass between nearer obstacles.
const MARGIN_LEAST_M: f64 = 0.05;
/// Size of a sensed obstacle beyond its cell, m; and by how much farther than `margin_m` a path around it must stay,
/// m: within that margin the obstacle stops the robot.
const SENSED_RADIUS_M: f64 = 0.15;
const BEYOND_MARGIN_M: f64 = 0.03;
/// Greatest distance of the end of a path from its waypoint, m.
const END_MAX_M: f64 = 0.3;
/// Free floor beyond start and goal if there is no map, m.
const FLOOR_MARGIN_M: f64 = 8.0;
/// Smallest cell of such a floor, m, and the approximate number of cells along a side.
const FLOOR_CELL_MIN_M: f64 = 0.05;
const FLOOR_CELLS: f64 = 800.0;

/// Map, sensed obstacles, and the search among them.
#[derive(Debug)]
pub struct PlanningSpace {
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
    Searching,
    /// Path.
    Found(Poses),
    /// No path.
    NoPath {
        /// Reason.
        why: Hindrance,
        /// True if there is no path on this map at all.
        forever: bool,
    },
}

impl PlanningSpace {
    /// Field of the configured map; an open floor without one.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let Config { body, limits, map, abilities, .. } = config;
        let footprint = Footprint { length_m: body.front + body.rear, width_m: body.width, rear_m: body.rear };
        let radius = RADIUS_FACTOR * body.wheelbase / libm::tan(limits.steering);
        let limits = Limits {
            margin_m: MARGIN_M,
            margin_least_m: MARGIN_LEAST_M,
            abilities: *abilities,
            shape: body.shape,
            ..Limits::new(footprint, radius)
        };
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
        self.still.as_ref().is_none_or(|still| self.search.limits().is_free(still, pose))
    }

    /// First waypoint that is beyond the edges of the map; `None` without a map.
    #[must_use]
    pub fn outside(&self, waypoints: &[Waypoint]) -> Option<(usize, Hindrance)> {
        let frame = *self.still.as_ref().filter(|_| self.has_map)?.frame();
        let number = waypoints.iter().position(|to| frame.distance(to.at.x, to.at.y) > end_tolerance(to))?;
        Some((number, Hindrance::OutsideMap(frame)))
    }

    /// Why the robot cannot stand at a waypoint on this map, whatever the way there; `None` without a map.
    #[must_use]
    pub fn blocked(&self, to: &Waypoint) -> Option<Hindrance> {
        let still = self.still.as_ref().filter(|_| self.has_map)?;
        (!self.search.fits(still, &end(to, to.heading))).then(|| goal_blocked(still, to))
    }

    /// Sets the obstacles for paths around them: all sensed ones except those that the robot already stands beside,
    /// which it may leave behind. `margin`: the distance to sensed obstacles that the robot keeps, m.
    pub fn set_obstacles(&mut self, obstacles: &Obstacles, robot: Pose, body: &Body, margin: f64) {
        let Some(still) = &self.still else { return };
        let inverse = robot.inverse();
        let radius = SENSED_RADIUS_M.max(margin + BEYOND_MARGIN_M - MARGIN_M);
        let sensed = obstacles.hits().filter(|hit| !body.covers(inverse * hit.at, MARGIN_M + radius));
        let sensed: Vec<Obstacle> = sensed.map(|hit| Obstacle { x: hit.at.x, y: hit.at.y, radius }).collect();
        self.live.get_or_insert_with(|| still.clone()).overlay(&sensed);
    }

    /// Without a map: generates a free floor that contains both points.
    fn make_floor(&mut self, from: Point, to: Point) {
        let holds = |frame: &Frame| {
            let cell = |x, y| frame.cell(x, y).is_some();
            let half = FLOOR_MARGIN_M / 2.0;
            [from, to].iter().all(|at| cell(at.x - half, at.y - half) && cell(at.x + half, at.y + half))
        };
        if self.has_map || self.still.as_ref().is_some_and(|still| holds(still.frame())) {
            return;
        }
        let low = (from.x.min(to.x) - FLOOR_MARGIN_M, from.y.min(to.y) - FLOOR_MARGIN_M);
        let high = (from.x.max(to.x) + FLOOR_MARGIN_M, from.y.max(to.y) + FLOOR_MARGIN_M);
        let cell = ((high.0 - low.0).max(high.1 - low.1) / FLOOR_CELLS).max(FLOOR_CELL_MIN_M);
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
    pub fn begin(space: &mut PlanningSpace, from: Pose, to: &Waypoint, heading: Option<f64>, around: bool) -> Self {
        let route = Self { from, to: *to, heading, around, over: false };
        space.make_floor(from.point(), to.at);
        if around && space.live.is_none() {
            space.live.clone_from(&space.still);
        }
        route.search(space);
        route
    }

    fn search(&self, space: &mut PlanningSpace) {
        // People who are sensed leave, and any heading is better than no margin.
        space.search.keep_margin(self.around || self.has_other_headings());
        let goal = end(&self.to, self.heading);
        if let Some(field) = if self.around { &space.live } else { &space.still } {
            let first = if self.around { WORK_AROUND_MAX } else { Budget::default().first };
            space.search.begin(field, self.from, goal, Budget { first, ..Budget::default() });
        }
    }

    /// True if the heading is only preferred.
    fn has_other_headings(&self) -> bool {
        self.heading.is_some() && self.to.heading.is_none()
    }

    /// Continues for a few milliseconds. A finished search returns its result again.
    pub fn advance(&mut self, space: &mut PlanningSpace) -> Progress {
        let Some(field) = (if self.around { &space.live } else { &space.still }) else {
            return Progress::NoPath { why: Hindrance::FloorTooLarge, forever: true };
        };
        if self.over {
            return Progress::Searching;
        }
        match space.search.advance(field, WORK_PER_STEP) {
            Status::Searching | Status::Improving(_) => Progress::Searching,
            Status::Found(path) => Progress::Found(Poses { poses: poses(path), narrow: path.margin() < MARGIN_M }),
            Status::NoPath(SearchError::GoalBlocked | SearchError::Unreachable | SearchError::Budget)
                if self.has_other_headings() =>
            {
                self.heading = None;
                self.search(space);
                Progress::Searching
            }
            Status::NoPath(why) => {
                self.over = true;
                let forever = matches!(why, SearchError::GoalBlocked | SearchError::Unreachable | SearchError::Invalid);
                let why = match why {
                    SearchError::GoalBlocked => goal_blocked(field, &self.to),
                    why => Hindrance::Search(why),
                };
                Progress::NoPath { why, forever }
            }
        }
    }
}

/// End of a path to a waypoint. Half of the tolerance is for the path, half for path following.
fn end(to: &Waypoint, heading: Option<f64>) -> Goal {
    Goal { x: to.at.x, y: to.at.y, heading, tolerance_m: end_tolerance(to) }
}

fn end_tolerance(to: &Waypoint) -> f64 {
    (to.tolerance / 2.0).min(END_MAX_M)
}

/// Why the robot does not fit in at a waypoint.
fn goal_blocked(field: &Field, to: &Waypoint) -> Hindrance {
    let frame = field.frame();
    match frame.is_outside(to.at.x, to.at.y) {
        true => Hindrance::OutsideMap(*frame),
        false => Hindrance::Search(SearchError::GoalBlocked),
    }
}

/// Poses of a path, each with the direction in which it is driven to; cusps occur twice.
fn poses(path: &Path) -> Vec<(Pose, Direction)> {
    let points = path.points();
    let mut poses = Vec::with_capacity(points.len() + 4);
    for (number, point) in points.iter().enumerate() {
        let before = number.checked_sub(1).map_or(point.direction, |before| points[before].direction);
        poses.push((point.pose, before));
        if before != point.direction {
            poses.push((point.pose, point.direction));
        }
    }
    poses
}
