//! Greatest speed in each direction: how far the robot's outline may move on each path within reach before it touches
//! something.

use crate::config::Config;
use crate::law::{Law, SPEED_MIN};
use kinematics::reach::{Direction, Kinematics, Motion};
use kinematics::{Polygon, Turn, Twist, integrate};
use navitools::{Point, Pose};
use std::cmp::Ordering;
use std::ops::RangeInclusive;
use surroundings::{Obstacle, Source};

/// Parts of the clearance that remain beside the robot, and the speed that each permits, m/s: narrow gaps are passed
/// slowly. Ahead, the whole clearance applies.
///
/// What is nearer still is passed at the last one's speed: what a sensor detects there, such as a leg, may be narrower
/// than what it belongs to.
const BESIDE: [(f64, f64, Within); 4] = [
    (1.0, f64::INFINITY, Within::Kept),
    (0.5, 0.3, Within::Kept),
    (0.0, 0.15, Within::Kept),
    (0.0, 0.1, Within::Passed),
];
/// Parts of the whole margin; the greatest one that does not yet reach the obstacle applies: an obstacle that is
/// already nearer may be passed and left behind, but not approached further.
const NEARER: [f64; 3] = [0.66, 0.33, 0.0];
/// Distance by which an obstacle beside the robot may still be approached, m.
const APPROACH_M: f64 = 0.03;
/// Distance from a leg that moves within which the rest of a person may be, m: half of a stride to the trunk, and a
/// part of the trunk beyond the other leg.
const PERSON_M: f64 = 0.25;
/// Speed at which a robot may move that is nearer than that to a leg that moves, m/s.
const GIVES_WAY_MPS: f64 = 0.08;
/// Part of the speed with which the robot must leave what moves for that not to count.
const LEAVES: f64 = 0.5;
/// Velocity towards a touching obstacle below which the robot leaves it, per unit of path.
const LEAVING: f64 = 1e-3;
/// Distance beyond the outline at which a direction must be covered by cones, m.
const COVERED_AT_M: f64 = 0.5;
/// Coordinate up to which a point is a place, m. What is beyond it, or is not a number, comes of a broken computation.
const PLACE_MAX_M: f64 = 1e6;
/// Square of a distance, relative, from which on a point is not nearer, whatever the rounding.
const NOT_NEARER: f64 = 1.0 - 1e-6;
/// Tolerance of a comparison of places, m.
const ROUNDING_M: f64 = 1e-6;
/// Lowest speed for which fields are shown, m/s.
const SHOWN_MPS: f64 = 0.1;

/// What bounds the speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Something within the protective field: what senses it.
    Stops(Source),
    /// Something within the warning field: what senses it.
    Slows(Source),
    /// What does not know.
    Unknown(Source),
    /// No sensor covers the direction.
    Blind,
}

/// Bound of a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Greatest speed, m/s, or rad/s on the spot; 0 for a direction in which the base cannot move.
    pub speed: f64,
    /// Free path under all paths within reach, and under the one without a change of steering, m or rad.
    pub free: [f64; 2],
    /// What bounds the speed; `None`: the reach of the sensors, or the robot's own limit.
    pub cause: Option<Cause>,
}

/// Outlines of the robot, and the law.
#[derive(Debug)]
pub struct Fields<K> {
    law: Law,
    base: K,
    /// Outlines of each direction with the clearances of [`BESIDE`].
    outlines: [[Polygon; BESIDE.len()]; 6],
    /// Outlines with the margins of [`NEARER`]; the last one is the robot's own.
    nearer: [Polygon; 3],
    radius: f64,
    reaction: f64,
    /// Distance from the outline up to which the sensors find something, m, by direction.
    reach: [f64; 6],
    speed_max: f64,
    speed_blind: f64,
    /// Directions that no sensor covers.
    blind: [bool; 6],
    buffers: Buffers,
}

/// Reused buffers.
#[derive(Debug, Default)]
struct Buffers {
    /// Paths in the direction at hand.
    paths: Vec<Twist>,
    /// Obstacles that the outline may touch in that direction.
    within: Vec<Obstacle>,
    search: Search,
}

/// Buffers of the search for what ends the paths of an outline.
#[derive(Debug, Default)]
struct Search {
    /// Where each obstacle is, seen from the outline at hand.
    seen: Vec<Seen>,
    /// Obstacles that may end the path at hand, by number, and the square of the length at which they do so at the
    /// earliest.
    candidates: Vec<(f64, usize)>,
}

/// What an outline may do with what is within it already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Within {
    /// Leave it, or pass it at the same distance.
    Kept,
    /// Pass it as [`NEARER`] says.
    Passed,
}

/// Free length of paths, and the number of the obstacle that ends it.
type Nearest = (f64, Option<usize>);

/// An obstacle, seen from an outline of the robot as it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    near: Near,
    /// It is within the outline, which may not approach it: normal of the edge beyond which it is least deep.
    edge: Option<Point>,
}

/// How near an obstacle is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Near {
    /// Outside of the outline at hand, by this distance at least, m.
    Clear(f64),
    /// Within that, and outside of the one of this place in [`NEARER`], by this distance at least, m.
    Beside(usize, f64),
    /// Within the robot's own outline, beyond whose edge with this normal it is least deep.
    Touching(Point),
    /// Nowhere: its position is not one.
    Nowhere,
}

impl Seen {
    /// Square of the length of a path before which a point is not touched; 0 where that is not known.
    fn square_before(self, path: Twist, point: Point) -> f64 {
        let Self { near: Near::Clear(out) | Near::Beside(_, out), edge: None } = self else { return 0.0 };
        // Seen from the robot the point moves along the path with this speed: it is not nearer than its distance.
        let (x, y) = path.at(point.x, point.y);
        out * out * NOT_NEARER / (x * x + y * y)
    }
}

/// Ring around the centre of a turn that an outline sweeps: a point that is nearer to the centre, or farther from it,
/// is never touched.
struct Ring {
    center: Point,
    /// Squares of its radii, m².
    within: RangeInclusive<f64>,
}

impl Ring {
    fn new(center: Point, outline: &Polygon) -> Self {
        let (from, to) = (outline.distance(center), outline.radius(center));
        Self { center, within: from * from..=to * to }
    }

    fn contains(&self, point: Point) -> bool {
        let (x, y) = (point.x - self.center.x, point.y - self.center.y);
        self.within.contains(&(x * x + y * y))
    }
}

impl<K: Kinematics> Fields<K> {
    /// Creates the fields of a robot; `None` if its outline has no area.
    #[must_use]
    pub fn new(config: &Config, base: K) -> Option<Self> {
        let body = Polygon::hull(&config.footprint)?;
        let settings = &config.settings;
        let margin = settings.uncertainty + settings.clearance;
        let covered = |direction| is_covered(direction, &body, config);
        Some(Self {
            law: settings.law(config.braking, config.power_lost),
            outlines: Direction::ALL.map(|direction| {
                let (x, y) = direction.ahead();
                let ahead = |out: Point| if direction.turns() { 1.0 } else { (out.x * x + out.y * y).abs() };
                BESIDE.map(|(part, ..)| {
                    body.grown(|out| settings.uncertainty + settings.clearance * f64::max(part, ahead(out)))
                })
            }),
            radius: body.radius(Point::default()) + margin,
            reaction: settings.reaction,
            reach: Direction::ALL.map(|direction| reach_ahead(direction, &body, config)),
            speed_max: config.speed,
            speed_blind: settings.speed_blind,
            blind: Direction::ALL.map(|direction| !covered(direction)),
            nearer: NEARER.map(|part| body.grown(|_| part * margin)),
            base,
            buffers: Buffers::default(),
        })
    }

    /// The kind of base.
    #[must_use]
    pub fn base(&self) -> &K {
        &self.base
    }

    /// Distance of the farthest corner with the whole margin, m: its way for each rad on the spot.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The law.
    #[must_use]
    pub fn law(&self) -> &Law {
        &self.law
    }

    /// Paths that the base can take in a direction.
    pub fn paths(&mut self, direction: Direction, motion: &Motion) -> &[Twist] {
        let paths = &mut self.buffers.paths;
        paths.clear();
        self.base.reachable(direction, motion, self.reaction, paths);
        paths
    }

    /// Bound of a direction, with obstacles in the robot's frame.
    pub fn bound(&mut self, direction: Direction, motion: &Motion, obstacles: &[Obstacle]) -> Bound {
        let mut buffers = std::mem::take(&mut self.buffers);
        let Buffers { paths, within, search } = &mut buffers;
        paths.clear();
        self.base.reachable(direction, motion, self.reaction, paths);
        within.clear();
        let area = self.area(direction, motion, paths);
        within.extend(obstacles.iter().filter(|obstacle| area.may_contain(obstacle.at)));
        let mut bound = self.bound_on(direction, paths, within, search);
        if let Some(path) = paths.first() {
            self.give_way(direction, *path, obstacles, &mut bound);
        }
        self.buffers = buffers;
        bound
    }

    /// Area that the widest outline covers on the paths, as far as either field reaches. What is outside of it bounds
    /// nothing: on the way there the other obstacles, the reach of the sensors and the robot's own limit do.
    fn area(&self, direction: Direction, motion: &Motion, paths: &[Twist]) -> Area {
        let speed = libm::hypot(motion.velocity.vx, motion.velocity.vy).max(self.speed_max);
        let scale = if direction.turns() { self.radius } else { 1.0 };
        let length =
            self.law.warning(speed).max(self.law.protective(speed)).max(self.reach[direction as usize]) / scale;
        let [widest, ..] = &self.outlines[direction as usize];
        let mut area = Area::default();
        paths.iter().for_each(|path| area.sweep(widest, *path, length));
        area
    }

    /// Lowers a bound beside what moves, wherever it is around the robot, unless the robot leaves it on `path`: who
    /// walks may be ahead by the time the robot stands, and is wider than the legs that a lidar sees. The robot is slow
    /// enough to stop before a person around the leg, and gives way to one that is nearer.
    fn give_way(&self, direction: Direction, path: Twist, obstacles: &[Obstacle], bound: &mut Bound) {
        let scale = if direction.turns() { self.radius } else { 1.0 };
        let [.., body] = &self.nearer;
        let mut most = bound.speed * scale;
        for Obstacle { at, source, .. } in obstacles.iter().filter(|obstacle| obstacle.moves && obstacle.sensed) {
            // A lower bound of the distance, which costs less.
            if self.law.brakes_within(body.outside(*at) - PERSON_M).max(GIVES_WAY_MPS) >= most {
                continue;
            }
            let near = body.nearest(*at);
            let gap = at.distance(near);
            let speed = self.law.brakes_within(gap - PERSON_M).max(GIVES_WAY_MPS);
            let (x, y) = path.at(near.x, near.y);
            let towards = x * (at.x - near.x) + y * (at.y - near.y);
            let leaves = towards < -LEAVES * gap * libm::hypot(x, y);
            if speed < most && !leaves {
                most = speed;
                bound.speed = most / scale;
                if !matches!(bound.cause, Some(Cause::Stops(_))) {
                    bound.cause = Some(Cause::Slows(*source));
                }
            }
        }
    }

    fn bound_on(&self, direction: Direction, paths: &[Twist], obstacles: &[Obstacle], search: &mut Search) -> Bound {
        let Some(usual) = paths.first() else { return Bound { speed: 0.0, free: [0.0; 2], cause: None } };
        // On the spot, the speed of the farthest corner counts.
        let scale = if direction.turns() { self.radius } else { 1.0 };
        let reach = self.reach[direction as usize];
        let stops_within = |free: f64| self.law.stops_within((free * scale).min(reach));
        let [widest, narrower @ ..] = &self.outlines[direction as usize];
        let all = self.nearest(widest, Within::Kept, paths, obstacles, f64::INFINITY, search);
        let mut straight = (f64::INFINITY, None);
        self.shorten(widest, *usual, obstacles, |obstacle| obstacle.approaches, search, &mut straight);
        let mut stops = stops_within(all.0);
        for (outline, (_, most, within)) in narrower.iter().zip(&BESIDE[1..]) {
            // The narrower outlines permit no more than that.
            if stops >= *most {
                break;
            }
            // Nor does it count what ends a path beyond the field of a speed that they do not permit.
            let counts = self.law.protective(most + SPEED_MIN) / scale;
            let (free, _) = self.nearest(outline, *within, paths, obstacles, counts, search);
            stops = stops_within(free).min(*most).max(stops);
        }
        let slows = self.law.slows_within(straight.0 * scale);
        let blind = if self.blind[direction as usize] { self.speed_blind } else { f64::INFINITY };
        let speed = stops.min(slows).min(blind).min(self.speed_max);
        let cause = |(_, by): (f64, Option<usize>), sensed: fn(Source) -> Cause| {
            let Obstacle { source, sensed: known, .. } = *obstacles.get(by?)?;
            Some(if known { sensed(source) } else { Cause::Unknown(source) })
        };
        let cause = match () {
            () if speed >= self.speed_max => None,
            () if blind <= stops.min(slows) => Some(Cause::Blind),
            () if stops <= slows => cause(all, Cause::Stops),
            () => cause(straight, Cause::Slows),
        };
        let speed = if speed < SPEED_MIN { 0.0 } else { speed / scale };
        Bound { speed, free: [all.0, straight.0], cause }
    }

    /// Free length of the paths, `length` at most.
    fn nearest(
        &self,
        outline: &Polygon,
        within: Within,
        paths: &[Twist],
        obstacles: &[Obstacle],
        length: f64,
        search: &mut Search,
    ) -> Nearest {
        search.seen.clear();
        search.seen.extend(obstacles.iter().map(|obstacle| self.see(outline, within, obstacle.at)));
        let mut nearest = (length, None);
        paths.iter().for_each(|path| self.shorten(outline, *path, obstacles, |_| true, search, &mut nearest));
        nearest
    }

    /// Shortens `nearest` to the free length of `path` before the obstacles that count; of equals the one before it,
    /// then the first one.
    fn shorten(
        &self,
        outline: &Polygon,
        path: Twist,
        obstacles: &[Obstacle],
        counts: impl Fn(&Obstacle) -> bool,
        Search { seen, candidates }: &mut Search,
        nearest: &mut Nearest,
    ) {
        if nearest.0 <= 0.0 {
            return;
        }
        candidates.clear();
        let counting = obstacles.iter().zip(&*seen).enumerate().filter(|(_, (obstacle, _))| counts(obstacle));
        let ring = path.center().map(|center| Ring::new(center, outline));
        let touched = counting.filter(|(_, (obstacle, seen))| {
            // What is nearer counts for another outline, which is wider in places.
            !matches!(seen.near, Near::Clear(_)) || ring.as_ref().is_none_or(|ring| ring.contains(obstacle.at))
        });
        let squares = touched.map(|(n, (obstacle, seen))| (seen.square_before(path, obstacle.at), n));
        let too_far = nearest.0 * nearest.0;
        candidates.extend(squares.filter(|(square, _)| *square <= too_far));
        // The one that may be first is solved first: most others need not be solved then.
        let sooner = |a: usize, b: usize| if candidates[b].0 < candidates[a].0 { b } else { a };
        let Some(first) = (0..candidates.len()).reduce(sooner) else { return };
        candidates.swap(0, first);
        let before = nearest.0;
        for (square, n) in candidates.iter().copied() {
            if square > nearest.0 * nearest.0 {
                continue;
            }
            let free = self.free(outline, path, obstacles[n].at, seen[n]);
            let is_equal = free == nearest.0 && free < before;
            if free < nearest.0 || is_equal && Some(n) < nearest.1 {
                *nearest = (free, Some(n));
            }
        }
    }

    /// A point seen from an outline. All comparisons are such that what is not a number touches.
    fn see(&self, outline: &Polygon, within: Within, point: Point) -> Seen {
        if !is_place(point) {
            return Seen { near: Near::Nowhere, edge: None };
        }
        let out = outline.outside(point);
        if out > APPROACH_M {
            return Seen { near: Near::Clear(out), edge: None };
        }
        let is_kept = within == Within::Kept && out.partial_cmp(&0.0) != Some(Ordering::Greater);
        Seen { near: self.near(point), edge: is_kept.then(|| outline.nearest_edge(point).1) }
    }

    /// How near a point is that is within the margin, or almost.
    fn near(&self, point: Point) -> Near {
        let [wider @ .., body] = &self.nearer;
        let mut outs = wider.iter().map(|outline| outline.outside(point)).enumerate();
        if let Some((place, out)) = outs.find(|(_, out)| *out > APPROACH_M) {
            return Near::Beside(place, out);
        }
        let (out, normal) = body.nearest_edge(point);
        if out > 0.0 { Near::Beside(wider.len(), out) } else { Near::Touching(normal) }
    }

    /// Length of the path before the robot is too near to a point; 0 for what is no place: it may be anywhere.
    fn free(&self, outline: &Polygon, path: Twist, point: Point, seen: Seen) -> f64 {
        let (x, y) = path.at(point.x, point.y);
        let leaves = |edge: Point| x * edge.x + y * edge.y <= LEAVING;
        if seen.edge.is_some_and(|edge| !leaves(edge)) {
            return 0.0;
        }
        match seen.near {
            Near::Clear(_) => outline.contact(path, point),
            Near::Beside(place, _) => self.nearer.get(place).map_or(0.0, |outline| outline.contact(path, point)),
            Near::Touching(edge) if leaves(edge) => f64::INFINITY,
            Near::Touching(_) | Near::Nowhere => 0.0,
        }
    }

    /// Outlines of the protective and the warning field at a measured motion, robot frame, and whether something is in
    /// each.
    pub fn shown(&mut self, motion: &Motion, bound: &Bound, direction: Direction) -> [(Vec<Point>, bool); 2] {
        let paths = &mut self.buffers.paths;
        paths.clear();
        self.base.reachable(direction, motion, 0.0, paths);
        let path = paths.first().copied().unwrap_or_default();
        let speed = libm::hypot(motion.velocity.vx, motion.velocity.vy).max(SHOWN_MPS);
        let lengths = [self.law.protective(speed), self.law.warning(speed)];
        let [outline, ..] = &self.outlines[direction as usize];
        [0, 1].map(|kind| (swept(outline, path, lengths[kind]), bound.free[kind] < lengths[kind]))
    }
}

/// Box in the robot's frame, along its axes; empty at first.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Area {
    least: Point,
    most: Point,
}

impl Default for Area {
    fn default() -> Self {
        let (least, most) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { least: Point { x: least, y: least }, most: Point { x: most, y: most } }
    }
}

impl Area {
    /// False if a point is outside of the box; what is not a place may be anywhere.
    fn may_contain(&self, point: Point) -> bool {
        let Self { least, most } = self;
        let outside = point.x < least.x || point.x > most.x || point.y < least.y || point.y > most.y;
        !outside || !is_place(point)
    }

    fn add(&mut self, point: Point) {
        self.least = Point { x: self.least.x.min(point.x - ROUNDING_M), y: self.least.y.min(point.y - ROUNDING_M) };
        self.most = Point { x: self.most.x.max(point.x + ROUNDING_M), y: self.most.y.max(point.y + ROUNDING_M) };
    }

    /// Extends the box to what a polygon covers on a length of a path: the extremes are reached by its corners, at
    /// both ends, or where their circles cross the axes.
    fn sweep(&mut self, outline: &Polygon, path: Twist, length: f64) {
        let to_end = integrate(Pose::default(), path, length).to_outer();
        for corner in outline.corners() {
            self.add(*corner);
            self.add(to_end(*corner));
        }
        let Some(center) = path.center() else { return };
        let end = Turn::by(path.omega.abs() * length);
        for corner in outline.corners() {
            let (x, y) = (corner.x - center.x, corner.y - center.y);
            for (ahead_x, ahead_y) in [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)] {
                // From the corner to the crossing, in the direction of the turn.
                let sin = (x * ahead_y - y * ahead_x) * path.omega.signum();
                let crossing = Turn { cos: x * ahead_x + y * ahead_y, sin };
                if end.is_none_or(|end| crossing.order() <= end.order()) {
                    let radius = libm::hypot(x, y);
                    self.add(Point { x: center.x + radius * ahead_x, y: center.y + radius * ahead_y });
                }
            }
        }
    }
}

/// True for a point that is somewhere.
pub(crate) fn is_place(point: Point) -> bool {
    point.x.abs() <= PLACE_MAX_M && point.y.abs() <= PLACE_MAX_M
}

/// Hull of an outline moved along a path.
fn swept(outline: &Polygon, path: Twist, length: f64) -> Vec<Point> {
    let places = [0.0, 0.5, 1.0].map(|part| integrate(Pose::default(), path, part * length));
    let corners = places.iter().flat_map(|pose| outline.corners().iter().map(|corner| *pose * *corner));
    let corners: Vec<Point> = corners.collect();
    Polygon::hull(&corners).map_or_else(Vec::new, |hull| hull.corners().to_vec())
}

/// True if what senses covers the outline's width before it in a direction.
fn is_covered(direction: Direction, body: &Polygon, config: &Config) -> bool {
    if direction.turns() {
        return Direction::ALL[..4].iter().all(|side| is_covered(*side, body, config));
    }
    ahead_of(direction, body, COVERED_AT_M).into_iter().all(|point| {
        config.sonars().iter().any(|sonar| sonar.covers(point))
            || config.lidars().iter().any(|lidar| lidar.covers(point))
    })
}

/// Distance before the outline, over its width, up to which what senses finds something, m: its reach counts from where
/// it sits. On the spot the least one of the four sides; of a place without a sensor the whole reach, as such a
/// direction is blind.
fn reach_ahead(direction: Direction, body: &Polygon, config: &Config) -> f64 {
    if direction.turns() {
        let sides = Direction::ALL[..4].iter().map(|side| reach_ahead(*side, body, config));
        return sides.fold(f64::INFINITY, f64::min);
    }
    let reach = config.settings.reach;
    let (ahead_x, ahead_y) = direction.ahead();
    let beyond = |begin: Point, sensor: Point| {
        let (x, y) = (begin.x - sensor.x, begin.y - sensor.y);
        let (along, across) = (x * ahead_x + y * ahead_y, y * ahead_x - x * ahead_y);
        libm::sqrt((reach * reach - across * across).max(0.0)) - along
    };
    let lanes = ahead_of(direction, body, 0.0).into_iter().zip(ahead_of(direction, body, COVERED_AT_M));
    let seen = lanes.filter_map(|(begin, covered)| {
        let sonars = config.sonars().iter().filter(|sonar| sonar.covers(covered)).map(|sonar| sonar.at);
        let lidars = config.lidars().iter().filter(|lidar| lidar.covers(covered)).map(|lidar| lidar.mount.point());
        sonars.chain(lidars).map(|sensor| beyond(begin, sensor)).reduce(f64::max)
    });
    seen.fold(reach, f64::min).max(0.0)
}

/// Points over the outline's width, this distance before it in a direction of travel, m.
fn ahead_of(direction: Direction, body: &Polygon, distance: f64) -> [Point; 9] {
    let (ahead_x, ahead_y) = direction.ahead();
    let along = |point: &Point| point.x * ahead_x + point.y * ahead_y;
    let across = |point: &Point| point.y * ahead_x - point.x * ahead_y;
    let corners = body.corners();
    let most = |measure: &dyn Fn(&Point) -> f64| corners.iter().map(measure).fold(f64::NEG_INFINITY, f64::max);
    let (front, left, right) = (most(&along), most(&across), -most(&|point| -across(point)));
    std::array::from_fn(|n| {
        let (x, y) = (front + distance, right + (left - right) * n as f64 / 8.0);
        Point { x: x * ahead_x - y * ahead_y, y: x * ahead_y + y * ahead_x }
    })
}

#[cfg(test)]
mod tests;
