//! Looking for a way: the search, asked a piece at a time, and the map it is asked on.

use crate::config::{Body, Config};
use crate::goal::Waypoint;
use crate::goal_state::Hindrance;
use crate::map::{Field, Frame, Map, Obstacle, Unknown};
use crate::obstacles::Obstacles;
use crate::path::Path;
use crate::search::{Budget, Footprint, Goal, Limits, NoWay, Search, Status};
use navitools::{Point, Pose};

/// Work of the search in one turn of the control loop: a few milliseconds where the robot's computer is slow.
const WORK: u32 = 250;
/// Work for a way around what is heard: before it is done people have moved.
const WORK_AROUND: u32 = 20_000;
/// Curves are planned wider than the steering allows, so that there is room to correct.
const WIDER: f64 = 1.08;
/// Kept free on all sides, on the map and of what is heard, m: the pose and the following are good to this.
const MARGIN: f64 = 0.08;
/// What is heard is taken as so large, m, beside its cell.
const HEARD: f64 = 0.15;
/// Without a map the floor is taken as free so far beyond start and goal, m.
const BEYOND: f64 = 8.0;
/// In cells of at least this, and about so many along an edge.
const CELL: f64 = 0.05;
const CELLS: f64 = 800.0;

/// What is known to stand, what is heard, and the search among it.
#[derive(Debug)]
pub struct Ways {
    /// The map alone; made up around start and goal where there is none.
    still: Option<Field>,
    has_map: bool,
    /// With what is heard.
    live: Option<Field>,
    search: Search,
}

/// What came of looking.
pub enum Progress {
    /// Nothing yet.
    Going,
    /// Poses in order, and whether each is driven to forward.
    Found(Vec<(Pose, bool)>),
    /// There is none.
    NoWay {
        /// What is in the way.
        why: Hindrance,
        /// As the map is there never will be.
        forever: bool,
    },
}

impl Ways {
    /// The map of a configuration; without one, an open floor.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let Config { body, limits, map, .. } = config;
        let footprint = Footprint { length_m: body.front + body.rear, width_m: body.width, rear_m: body.rear };
        let radius = WIDER * body.wheelbase / libm::tan(limits.steering);
        let limits = Limits { margin_m: MARGIN, ..Limits::new(footprint, radius) };
        let still = map.as_ref().map(|map| Field::new(map, Unknown::Blocked));
        Self { has_map: still.is_some(), still, live: None, search: Search::new(limits) }
    }

    /// Whether the map has something within `within` m of `point`, or `point` is not on it: an echo is no news there.
    #[must_use]
    pub fn is_mapped(&self, point: Point, within: f64) -> bool {
        self.has_map && self.still.as_ref().is_some_and(|still| f64::from(still.distance(point.x, point.y)) <= within)
    }

    /// Whether the map alone lets the robot stand at a pose.
    #[must_use]
    pub fn is_free(&self, pose: Pose) -> bool {
        self.still.as_ref().is_none_or(|still| self.search.limits().footprint.is_free(still, pose))
    }

    /// Ways around are around what is heard now, but for what the robot itself stands in.
    pub fn sense(&mut self, obstacles: &Obstacles, robot: Pose, body: &Body) {
        let Some(still) = &self.still else { return };
        let inverse = robot.inverse();
        let heard = obstacles.hits().filter(|hit| !body.covers(inverse * hit.at, MARGIN));
        let heard: Vec<Obstacle> = heard.map(|hit| Obstacle { x: hit.at.x, y: hit.at.y, radius: HEARD }).collect();
        self.live.get_or_insert_with(|| still.clone()).overlay(&heard);
    }

    /// Without a map, a free floor that holds both.
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

/// A way that is being looked for. There is one search: whoever begins another ends this one.
#[derive(Clone, Copy, Debug)]
pub struct Route {
    from: Pose,
    to: Waypoint,
    /// Tried first; a way with any heading is one as well, where none was asked for.
    heading: Option<f64>,
    around: bool,
    over: bool,
}

impl Route {
    /// Begins to look for a way to `to`, best with `heading`; around what is heard, or on the map alone.
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
        // Half of the tolerance is for the way, half for driving it.
        let goal = Goal { x: at.x, y: at.y, heading: self.heading, tolerance_m: (tolerance / 2.0).min(0.3) };
        if let Some(field) = if self.around { &ways.live } else { &ways.still } {
            let first = if self.around { WORK_AROUND } else { Budget::default().first };
            ways.search.begin(field, self.from, goal, Budget { first, ..Budget::default() });
        }
    }

    /// Looks on for a few milliseconds. An answer is given once more when asked again.
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

/// The poses of a path, each with whether it is driven to forward; at a cusp twice.
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
