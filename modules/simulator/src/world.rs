//! The world: walls, columns, drops in the floor; what a ray meets and how near a body is.
//!
//! Plain data. Its fields are the keys of the files `conf/worlds/*.toml`.

mod keys;

use keys::{BEACONS, COLUMNS, DROPS, PEOPLE, POINTS, START, WALLS};
use kinematics::Shape;
use navitools::{Point, Pose};
use settings::{Section, settings};
use std::path::PathBuf;

/// A straight wall, seen and felt from both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end, m.
    pub a: Point,
    /// The other end, m.
    pub b: Point,
}

/// A round column (or a leg).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Middle, m.
    pub centre: Point,
    /// m; above zero.
    pub radius: f64,
}

/// An infrared beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beacon {
    /// Identity.
    pub id: u8,
    /// Position, m.
    pub at: Point,
}

settings! {
    /// Visitors.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Crowd {
        /// Number.
        count: u32 = required, 0..=Crowd::MOST;
        /// Share of them that walks in groups of two to four.
        grouped: f64 = 0.5, 0.0..=1.0;
        /// Share of people who look where they go: others see the robot only at their feet.
        attentive: f64 = 0.9, 0.0..=1.0;
        /// Share of people in black trousers, which a lidar sees as it sees `black` walls.
        dark: f64 = 0.0, 0.0..=1.0;
    }
}

impl Crowd {
    /// Maximum number of people in a world.
    pub const MOST: u32 = 200;
}

impl Default for Crowd {
    /// An empty crowd; people added to it walk in groups half of the time and mostly look where they go.
    fn default() -> Self {
        Self::usual()
    }
}

settings! {
    /// `[[routes]]`: a way through the world, by name.
    #[derive(Clone, Debug, Default, PartialEq)]
    pub struct Route {
        /// Name in `--goal`.
        name: String = required;
        /// Waypoints in order, m; at least one.
        waypoints: Vec<Point> = [], POINTS;
        /// After the last comes the first again.
        loop as looped: bool = false;
    }
}

settings! {
    /// `[[boxes]]`: a box on the floor with four walls, which may be turned.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Crate {
        /// Middle, m.
        x: f64 = required, -1e4..=1e4;
        /// Middle, m.
        y: f64 = required, -1e4..=1e4;
        /// Along its own x, m.
        length: f64 = required, 0.05..=1000.0;
        /// Along its own y, m.
        width: f64 = required, 0.05..=1000.0;
        /// Direction of its own x, rad.
        theta: f64 = 0.0, -7.0..=7.0;
    }
}

impl Crate {
    /// Its four walls.
    #[must_use]
    pub fn walls(&self) -> [Segment; 4] {
        let (sin, cos) = (libm::sin(self.theta), libm::cos(self.theta));
        let corner = |along: f64, across: f64| {
            let (dx, dy) = (along * self.length / 2.0, across * self.width / 2.0);
            Point { x: self.x + cos * dx - sin * dy, y: self.y + sin * dx + cos * dy }
        };
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        [0, 1, 2, 3].map(|i| Segment { a: corners[i], b: corners[(i + 1) % 4] })
    }
}

settings! {
    /// `[[walkers]]`: a person who walks to and fro between two points, or stands.
    #[derive(Clone, Debug, Default, PartialEq)]
    pub struct Walker {
        /// `[[x, y]]`, m: he stands there; or `[[x, y], [x, y]]`: he walks to and fro, and begins at the first.
        points: Vec<Point> = [], POINTS;
    }
}

settings! {
    /// A world for the simulated robot (conf/worlds/README.md): all static objects, and the number of people.
    #[derive(Clone, Debug, Default, PartialEq)]
    pub struct World {
        /// Pose of the robot at first: x and y of the middle of the rear axle, m; theta, rad.
        start: Pose = required, START;
        /// Map of further walls in YAML and PGM, as nav2 has them, from the world's file on: what is occupied in it,
        /// and what is unknown beside what is free.
        map: Option<PathBuf> = optional;
        /// Straight walls `[ax, ay, bx, by]`, m; seen and felt from both sides.
        walls: Vec<Segment> = [], WALLS;
        /// Walls of glass: a lidar sees through them, unless it looks at one within 4° of a right angle.
        glass: Vec<Segment> = [], WALLS;
        /// Matt black walls: a lidar sees them up to a third of its range.
        black: Vec<Segment> = [], WALLS;
        /// Polished walls: mirrors for a lidar, unless it looks at one within 4° of a right angle.
        shiny: Vec<Segment> = [], WALLS;
        /// Round columns `[x, y, radius]`, m; sonars hear one of 6 cm to 2.5 m, one of 25 cm to 6 m.
        columns: Vec<Column> = [], COLUMNS;
        /// Areas without floor: polygons of at least three corners, m; stairs, edges of a stage.
        drops: Vec<Vec<Point>> = [], DROPS;
        /// Infrared beacons, each number once. They are the simulated robot's map, too: those of `robot.toml` are the
        /// real robot's, and count where a world has none.
        beacons: Vec<Beacon> = [], BEACONS;
        /// Visitors: their number, or a table.
        people: Crowd = Crowd::default(), PEOPLE;
        /// Places that visitors walk to, m; empty: anywhere.
        places: Vec<Point> = [], POINTS;
        /// Ways for the robot; `advee up --sim --goal NAME` drives one.
        routes: Vec<Route> = [];
        /// Boxes; their walls are among the walls.
        boxes: Vec<Crate> = [];
        /// People with a place or a way of their own, beside the visitors; together at most 200.
        walkers: Vec<Walker> = [];
    }
}

/// What a wall is to a lidar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Surface {
    /// Scatters light: seen from everywhere.
    Matt,
    Glass,
    Black,
    Shiny,
}

/// Least distance of a walker's first point from the start of the robot, m: a robot does not begin in a contact.
pub const WALKER_APART: f64 = 1.5;

/// Defect of a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorldError {
    /// A coordinate of the wall of this index is not a number within ±10 km.
    Wall(usize),
    /// The column of this index has such a coordinate, or a radius that is not above zero.
    Column(usize),
    /// The drop of this index has such a coordinate, or fewer than three corners.
    Drop(usize),
    /// The beacon of this index has such a coordinate, or an earlier one's identity.
    Beacon(usize),
    /// The place of this index has such a coordinate.
    Place(usize),
    /// The route of this index has such a coordinate, no waypoint, or an earlier one's name.
    Route(usize),
    /// More people than [`Crowd::MOST`], or an invalid fraction of them.
    People,
    /// The walker of this index has such a coordinate, not one or two points, or begins within [`WALKER_APART`] of the
    /// start.
    Walker(usize),
    /// The start has such a coordinate.
    Start,
}

impl core::fmt::Display for WorldError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Wall(i) => write!(f, "walls[{i}]: not numbers within ±10000 m"),
            Self::Column(i) => write!(f, "columns[{i}]: not numbers within ±10000 m, or no radius above 0"),
            Self::Drop(i) => write!(f, "drops[{i}]: not numbers within ±10000 m, or fewer than 3 corners"),
            Self::Beacon(i) => write!(f, "beacons[{i}]: not numbers within ±10000 m, or an id twice"),
            Self::Place(i) => write!(f, "places[{i}]: not numbers within ±10000 m"),
            Self::Route(i) => write!(f, "routes[{i}]: not numbers within ±10000 m, no waypoint, or a name twice"),
            Self::People => write!(f, "people: not from 0 to {}, or a share that is not from 0 to 1", Crowd::MOST),
            Self::Walker(i) => write!(
                f,
                "walkers[{i}]: not one or two points within ±10000 m, or nearer than {WALKER_APART} m to the start"
            ),
            Self::Start => write!(f, "start: not numbers within ±10000 m"),
        }
    }
}

/// Object hit by a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// m along the ray.
    pub distance: f64,
    /// Cosine of the angle between the ray and the surface's normal, 0..=1.
    pub cos_incidence: f64,
    /// The radius of what was hit, m; infinite for a wall.
    pub radius: f64,
}

/// Square of a distance, relative, up to which it may be within another one, whatever the rounding.
const ROUNDING: f64 = 1.0 + 1e-9;

fn sane(point: Point) -> bool {
    libm::fabs(point.x) <= 1e4 && libm::fabs(point.y) <= 1e4
}

/// Objects before a sensor.
pub(crate) struct Ahead {
    walls: Vec<Segment>,
    columns: Vec<Column>,
}

impl Ahead {
    /// As [`World::ray`].
    pub fn ray(&self, from: Point, direction: (f64, f64), reach: f64) -> Option<Hit> {
        first_hit(&self.walls, &self.columns, from, direction, reach)
    }
}

pub(crate) fn first_hit(
    walls: &[Segment],
    columns: &[Column],
    from: Point,
    (dx, dy): (f64, f64),
    reach: f64,
) -> Option<Hit> {
    let mut hit: Option<Hit> = None;
    let mut best = reach;
    for wall in walls {
        let (ex, ey) = (wall.b.x - wall.a.x, wall.b.y - wall.a.y);
        let (ox, oy) = (wall.a.x - from.x, wall.a.y - from.y);
        let det = dx * ey - dy * ex;
        // Signs first: most walls are missed, and a division is dear.
        let (t, s) = (ox * ey - oy * ex, ox * dy - oy * dx);
        let (t, s, det) = if det < 0.0 { (-t, -s, -det) } else { (t, s, det) };
        if det == 0.0 || t < 0.0 || s < 0.0 || s > det || t > best * det {
            continue;
        }
        best = t / det;
        hit = Some(Hit { distance: best, cos_incidence: det / libm::sqrt(ex * ex + ey * ey), radius: f64::INFINITY });
    }
    for column in columns {
        let (ox, oy) = (column.centre.x - from.x, column.centre.y - from.y);
        let along = ox * dx + oy * dy;
        let across2 = ox * ox + oy * oy - along * along;
        let r2 = column.radius * column.radius;
        if along <= 0.0 || across2 >= r2 {
            continue;
        }
        let half = libm::sqrt(r2 - across2);
        let distance = along - half;
        if distance < 0.0 || distance > best {
            continue;
        }
        best = distance;
        hit = Some(Hit { distance, cos_incidence: half / column.radius, radius: column.radius });
    }
    hit
}

/// The wall's nearest point to `point`.
pub(crate) fn nearest(wall: &Segment, point: Point) -> Point {
    let (dx, dy) = (wall.b.x - wall.a.x, wall.b.y - wall.a.y);
    let length2 = dx * dx + dy * dy;
    let along = if length2 == 0.0 {
        0.0
    } else {
        (((point.x - wall.a.x) * dx + (point.y - wall.a.y) * dy) / length2).clamp(0.0, 1.0)
    };
    Point { x: wall.a.x + along * dx, y: wall.a.y + along * dy }
}

impl World {
    /// A world of these walls, columns, drops and beacons.
    ///
    /// # Errors
    /// The first thing that is not as its field says.
    pub fn new(
        walls: Vec<Segment>,
        columns: Vec<Column>,
        drops: Vec<Vec<Point>>,
        beacons: Vec<Beacon>,
        start: Pose,
    ) -> Result<Self, WorldError> {
        let world = Self { walls, columns, drops, beacons, start, ..Self::default() };
        world.check()?;
        Ok(world)
    }

    /// A hall of this size, m, with its corner at the origin; the robot in the middle.
    #[must_use]
    pub fn hall(width: f64, depth: f64) -> Self {
        let corner = |x, y| Point { x, y };
        let corners = [corner(0.0, 0.0), corner(width, 0.0), corner(width, depth), corner(0.0, depth)];
        let walls = (0..4).map(|i| Segment { a: corners[i], b: corners[(i + 1) % 4] }).collect();
        Self { walls, start: Pose::new(width / 2.0, depth / 2.0, 0.0), ..Self::default() }
    }

    /// The same with the walls of `glass`, `black`, `shiny` and `boxes` among the walls: for everything but a lidar
    /// they are walls as others.
    #[must_use]
    pub fn with_surfaces(mut self) -> Self {
        self.walls.extend(self.glass.iter().chain(&self.black).chain(&self.shiny));
        self.walls.extend(self.boxes.iter().flat_map(Crate::walls));
        self
    }

    /// What a wall is to a lidar.
    pub(crate) fn surface(&self, wall: &Segment) -> Surface {
        let lists = [(&self.glass, Surface::Glass), (&self.black, Surface::Black), (&self.shiny, Surface::Shiny)];
        lists.into_iter().find(|(list, _)| list.contains(wall)).map_or(Surface::Matt, |(_, surface)| surface)
    }

    /// Checks the ranges of all fields.
    ///
    /// # Errors
    /// The first thing that is not.
    pub fn check(&self) -> Result<(), WorldError> {
        let bad = |ok: bool, error| if ok { Ok(()) } else { Err(error) };
        for (i, wall) in self.walls.iter().enumerate() {
            bad(sane(wall.a) && sane(wall.b), WorldError::Wall(i))?;
        }
        for (i, column) in self.columns.iter().enumerate() {
            bad(sane(column.centre) && column.radius > 0.0 && column.radius <= 1e4, WorldError::Column(i))?;
        }
        for (i, drop) in self.drops.iter().enumerate() {
            bad(drop.len() >= 3 && drop.iter().all(|corner| sane(*corner)), WorldError::Drop(i))?;
        }
        for (i, beacon) in self.beacons.iter().enumerate() {
            let twice = self.beacons[..i].iter().any(|other| other.id == beacon.id);
            bad(sane(beacon.at) && !twice, WorldError::Beacon(i))?;
        }
        for (i, place) in self.places.iter().enumerate() {
            bad(sane(*place), WorldError::Place(i))?;
        }
        for (i, route) in self.routes.iter().enumerate() {
            let twice = self.routes[..i].iter().any(|other| other.name == route.name);
            let good = !route.waypoints.is_empty() && route.waypoints.iter().all(|point| sane(*point));
            bad(good && !twice, WorldError::Route(i))?;
        }
        let share = |share: f64| (0.0..=1.0).contains(&share);
        let people = self.people;
        let shares = [people.grouped, people.attentive, people.dark];
        let good = people.count as usize + self.walkers.len() <= Crowd::MOST as usize && shares.into_iter().all(share);
        bad(good, WorldError::People)?;
        for (i, Walker { points }) in self.walkers.iter().enumerate() {
            let apart = points.first().is_some_and(|at| at.distance(self.start.point()) >= WALKER_APART);
            bad(apart && points.len() <= 2 && points.iter().all(|point| sane(*point)), WorldError::Walker(i))?;
        }
        bad(sane(self.start.point()) && !self.start.theta.radians().is_nan(), WorldError::Start)
    }

    /// First object hit by a ray from `from` within `reach` m; `(dx, dy)` has length 1. An object that contains `from`
    /// is not hit.
    #[must_use]
    pub fn ray(&self, from: Point, direction: (f64, f64), reach: f64) -> Option<Hit> {
        first_hit(&self.walls, &self.columns, from, direction, reach)
    }

    /// Objects that rays from `sensor` can hit which deviate from its axis by at most a right angle and end within
    /// `reach` m.
    pub(crate) fn ahead(&self, sensor: Pose, reach: f64) -> Ahead {
        let (from, (sin, cos)) = (sensor.point(), sensor.theta.sin_cos());
        let along = |point: Point| (point.x - from.x) * cos + (point.y - from.y) * sin;
        let is_within = |point: Point, reach: f64| {
            let (dx, dy) = (point.x - from.x, point.y - from.y);
            dx * dx + dy * dy <= reach * reach * ROUNDING
        };
        let wall =
            |wall: &&Segment| (along(wall.a) >= 0.0 || along(wall.b) >= 0.0) && is_within(nearest(wall, from), reach);
        let column = |column: &&Column| {
            along(column.centre) >= -column.radius && is_within(column.centre, reach + column.radius)
        };
        Ahead {
            walls: self.walls.iter().filter(wall).copied().collect(),
            columns: self.columns.iter().filter(column).copied().collect(),
        }
    }

    /// The walls' points nearest to `point` and the columns' middles: where a mirror of sound sends it back.
    pub(crate) fn mirrors(&self, point: Point) -> impl Iterator<Item = Point> + '_ {
        let feet = self.walls.iter().map(move |wall| nearest(wall, point));
        feet.chain(self.columns.iter().map(|column| column.centre))
    }

    /// Edges of the drops.
    pub(crate) fn edges(&self) -> impl Iterator<Item = Segment> + '_ {
        self.drops.iter().flat_map(|drop| {
            let next = drop.iter().cycle().skip(1);
            drop.iter().zip(next).map(|(a, b)| Segment { a: *a, b: *b })
        })
    }

    /// The same world with a wall along each edge: for an operator who sees both.
    #[must_use]
    pub fn fenced(&self) -> Self {
        Self { walls: self.walls.iter().copied().chain(self.edges()).collect(), ..self.clone() }
    }

    /// True if there is floor under a point.
    #[must_use]
    pub fn floor(&self, point: Point) -> bool {
        !self.drops.iter().any(|drop| inside(drop, point))
    }

    /// The distance, m, between the nearest wall or column and a rectangle from (`rear`, -`half_width`) to (`front`,
    /// `half_width`) in the frame of `pose`; 0 when they touch, infinite in an empty world.
    #[must_use]
    pub fn clearance(&self, pose: Pose, rear: f64, front: f64, half_width: f64) -> f64 {
        let robot_from_world = pose.inverse();
        let (sin, cos) = robot_from_world.theta.sin_cos();
        let inner = |p: Point| Point {
            x: robot_from_world.x + cos * p.x - sin * p.y,
            y: robot_from_world.y + sin * p.x + cos * p.y,
        };
        let gap = |p: Point| {
            let x = (rear - p.x).max(p.x - front).max(0.0);
            let y = (libm::fabs(p.y) - half_width).max(0.0);
            libm::sqrt(x * x + y * y)
        };
        let corners = [(rear, -half_width), (rear, half_width), (front, half_width), (front, -half_width)];
        let mut least = f64::INFINITY;
        let nearer = |least: f64, point: Point, corner: Point| {
            let (dx, dy) = (point.x - corner.x, point.y - corner.y);
            let may_be = dx * dx + dy * dy <= least * least * ROUNDING;
            if may_be { least.min(point.distance(corner)) } else { least }
        };
        for wall in &self.walls {
            let wall = Segment { a: inner(wall.a), b: inner(wall.b) };
            if crosses(&wall, rear, front, half_width) {
                return 0.0;
            }
            least = least.min(gap(wall.a)).min(gap(wall.b));
            for (x, y) in corners {
                let corner = Point { x, y };
                least = nearer(least, nearest(&wall, corner), corner);
            }
        }
        for column in &self.columns {
            least = least.min(gap(inner(column.centre)) - column.radius);
        }
        least.max(0.0)
    }

    /// The distance, m, between the nearest wall or column and a shape in the frame of `pose`; 0 when they touch,
    /// infinite in an empty world.
    #[must_use]
    pub fn clearance_of_shape(&self, pose: Pose, shape: &Shape) -> f64 {
        let inner = pose.inverse().to_outer();
        let mut least = f64::INFINITY;
        for wall in &self.walls {
            let wall = Segment { a: inner(wall.a), b: inner(wall.b) };
            if crosses_shape(&wall, shape) {
                return 0.0;
            }
            least = least.min(shape.distance(wall.a)).min(shape.distance(wall.b));
            for corner in shape.corners() {
                least = least.min(nearest(&wall, *corner).distance(*corner));
            }
        }
        for column in &self.columns {
            least = least.min(shape.distance(inner(column.centre)) - column.radius);
        }
        least.max(0.0)
    }
}

/// True if a segment has a point inside the shape (Cyrus and Beck 1978).
fn crosses_shape(wall: &Segment, shape: &Shape) -> bool {
    let (dx, dy) = (wall.b.x - wall.a.x, wall.b.y - wall.a.y);
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for (a, b) in shape.edges() {
        let (ex, ey) = (b.x - a.x, b.y - a.y);
        // Along the normal outwards: the segment's way, and the room of its beginning.
        let (slope, room) = (ey * dx - ex * dy, ex * (wall.a.y - a.y) - ey * (wall.a.x - a.x));
        if slope == 0.0 {
            if room < 0.0 {
                return false;
            }
        } else if slope < 0.0 {
            from = from.max(room / slope);
        } else {
            to = to.min(room / slope);
        }
    }
    from <= to
}

/// True if a segment has a point inside the rectangle (Liang and Barsky 1984).
fn crosses(wall: &Segment, rear: f64, front: f64, half_width: f64) -> bool {
    let (dx, dy) = (wall.b.x - wall.a.x, wall.b.y - wall.a.y);
    let (mut from, mut to) = (0.0f64, 1.0f64);
    let sides =
        [(-dx, wall.a.x - rear), (dx, front - wall.a.x), (-dy, wall.a.y + half_width), (dy, half_width - wall.a.y)];
    for (slope, room) in sides {
        if slope == 0.0 {
            if room < 0.0 {
                return false;
            }
        } else if slope < 0.0 {
            from = from.max(room / slope);
        } else {
            to = to.min(room / slope);
        }
    }
    from <= to
}

/// True if a point is inside a polygon (even-odd rule).
fn inside(polygon: &[Point], point: Point) -> bool {
    let mut inside = false;
    let mut previous = polygon[polygon.len() - 1];
    for &corner in polygon {
        if (corner.y > point.y) != (previous.y > point.y) {
            let x = corner.x + (point.y - corner.y) / (previous.y - corner.y) * (previous.x - corner.x);
            inside ^= point.x < x;
        }
        previous = corner;
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    fn p(x: f64, y: f64) -> Point {
        Point { x, y }
    }

    #[test]
    fn rays_meet_what_geometry_says() {
        let mut world = World::hall(20.0, 12.0);
        let (sin, cos) = libm::sincos(0.3);
        let hit = world.ray(p(10.0, 6.0), (cos, sin), 100.0).unwrap();
        assert!((hit.distance - 10.0 / cos).abs() < 1e-12 && (hit.cos_incidence - cos).abs() < 1e-12, "{hit:?}");
        assert_eq!(world.ray(p(10.0, 6.0), (1.0, 0.0), 9.9), None);
        world.columns.push(Column { centre: p(14.0, 6.1), radius: 0.5 });
        let hit = world.ray(p(10.0, 6.0), (1.0, 0.0), 100.0).unwrap();
        let half = libm::sqrt(0.25 - 0.01);
        assert!((hit.distance - (4.0 - half)).abs() < 1e-12 && (hit.cos_incidence - half / 0.5).abs() < 1e-12);
        assert_eq!(world.ray(p(10.0, 6.0), (-1.0, 0.0), 100.0).unwrap().distance, 10.0);
    }

    #[test]
    fn a_box_has_four_walls_and_is_turned_about_its_middle() {
        let one = Crate { x: 10.0, y: 6.0, length: 2.0, width: 1.0, theta: core::f64::consts::FRAC_PI_2 };
        let world = World { boxes: vec![one], ..World::default() }.with_surfaces();
        assert_eq!(world.walls.len(), 4);
        let ahead = |x: f64, y: f64| world.ray(p(x, y), (1.0, 0.0), 100.0).map(|hit| hit.distance);
        assert!((ahead(0.0, 6.9).unwrap() - 9.5).abs() < 1e-9, "its length lies along y");
        assert_eq!(ahead(0.0, 7.1), None);
    }

    #[test]
    fn clearance_is_the_gap_between_rectangle_and_world() {
        let mut world = World::hall(20.0, 12.0);
        let robot = |pose| (pose, -0.15, 0.75, 0.30);
        let clearance = |world: &World, (pose, rear, front, half)| world.clearance(pose, rear, front, half);
        assert!((clearance(&world, robot(Pose::new(10.0, 6.0, 0.0))) - 5.7).abs() < 1e-12);
        assert!((clearance(&world, robot(Pose::new(19.0, 6.0, 0.0))) - 0.25).abs() < 1e-12);
        // Turned by 45 degrees the front left corner is the nearest to the right wall... and the right one to the same.
        let turned = clearance(&world, robot(Pose::new(18.0, 6.0, core::f64::consts::FRAC_PI_4)));
        let reach = (0.75 + 0.30) * core::f64::consts::FRAC_1_SQRT_2;
        assert!((turned - (2.0 - reach)).abs() < 1e-12, "{turned}");
        world.columns.push(Column { centre: p(11.75, 6.3), radius: 0.4 });
        assert!((clearance(&world, robot(Pose::new(10.0, 6.0, 0.0))) - 0.6).abs() < 1e-12);
        assert_eq!(clearance(&world, robot(Pose::new(19.5, 6.0, 0.0))), 0.0);
        // A wall that runs through the body without an end in it.
        assert_eq!(clearance(&world, robot(Pose::new(10.0, 0.1, 0.0))), 0.0);
        assert_eq!(World::default().clearance(Pose::default(), -0.1, 0.1, 0.1), f64::INFINITY);
    }

    #[test]
    fn clearance_is_the_least_distance_of_all_corners_and_ends() {
        let mut random = crate::random::Random::new(5);
        let (rear, front, half) = (-0.15, 0.75, 0.30);
        for _ in 0..2000 {
            let end =
                |random: &mut crate::random::Random| p(8.0 * random.uniform() - 4.0, 8.0 * random.uniform() - 4.0);
            let wall = |random: &mut crate::random::Random| Segment { a: end(random), b: end(random) };
            let world = World { walls: (0..3).map(|_| wall(&mut random)).collect(), ..World::default() };
            let pose = Pose::new(random.uniform(), random.uniform(), 6.3 * random.uniform());
            let clearance = world.clearance(pose, rear, front, half);
            let to_robot = pose.inverse().to_outer();
            let of_wall = |wall: &Segment| {
                let wall = Segment { a: to_robot(wall.a), b: to_robot(wall.b) };
                let corners = [p(rear, -half), p(rear, half), p(front, half), p(front, -half)];
                let of_corners = corners.map(|corner| nearest(&wall, corner).distance(corner));
                let of_ends = [wall.a, wall.b].map(|end| {
                    let x = (rear - end.x).max(end.x - front).max(0.0);
                    libm::sqrt(x * x + (end.y.abs() - half).max(0.0) * (end.y.abs() - half).max(0.0))
                });
                of_corners.into_iter().chain(of_ends).fold(f64::INFINITY, f64::min)
            };
            let least = world.walls.iter().map(of_wall).fold(f64::INFINITY, f64::min);
            assert!(clearance == least || clearance == 0.0, "{clearance} {least} {world:?}");
        }
    }

    #[test]
    fn clearance_of_a_rectangle_as_a_shape_is_the_same() {
        let mut random = crate::random::Random::new(6);
        let (rear, front, half) = (-0.15, 0.75, 0.30);
        let shape = Shape::hull(&[p(rear, -half), p(rear, half), p(front, half), p(front, -half)]).unwrap();
        let mut touched = 0;
        for _ in 0..2000 {
            let end =
                |random: &mut crate::random::Random| p(4.0 * random.uniform() - 2.0, 4.0 * random.uniform() - 2.0);
            let wall = |random: &mut crate::random::Random| Segment { a: end(random), b: end(random) };
            let walls = vec![wall(&mut random)];
            let columns = vec![Column { centre: end(&mut random), radius: 0.1 }];
            let world = World { walls, columns, ..World::default() };
            let pose = Pose::new(random.uniform(), random.uniform(), 6.3 * random.uniform());
            let (one, other) = (world.clearance(pose, rear, front, half), world.clearance_of_shape(pose, &shape));
            assert!((one - other).abs() < 1e-9, "{one} {other} {world:?}");
            touched += u32::from(one == 0.0);
        }
        assert!(touched > 200 && touched < 1800, "{touched}");
    }

    #[test]
    fn what_is_not_ahead_is_met_by_no_ray_ahead() {
        let mut world = World::hall(20.0, 12.0);
        let mut random = crate::random::Random::new(7);
        for n in 0..20 {
            let (x, y) = (20.0 * random.uniform(), 12.0 * random.uniform());
            world.walls.push(Segment { a: p(x, y), b: p(x + 2.0 * random.normal(), y + 2.0 * random.normal()) });
            world.columns.push(Column { centre: p(y, x), radius: 0.1 + 0.05 * f64::from(n) });
        }
        let (mut left_out, mut met) = (0, 0);
        for _ in 0..20_000 {
            let sensor = Pose::new(20.0 * random.uniform(), 12.0 * random.uniform(), 6.3 * random.uniform());
            let reach = 6.0 * random.uniform();
            let ahead = world.ahead(sensor, reach);
            left_out += world.walls.len() - ahead.walls.len() + world.columns.len() - ahead.columns.len();
            let (sin, cos) = (sensor.theta + (random.uniform() - 0.5) * 3.1).sin_cos();
            let hit = world.ray(sensor.point(), (cos, sin), reach);
            met += usize::from(hit.is_some());
            assert_eq!(ahead.ray(sensor.point(), (cos, sin), reach), hit);
        }
        assert!(left_out > 20_000 * 22 && met > 2_000, "{left_out} of 880000, {met}");
    }

    #[test]
    fn there_is_no_floor_inside_a_drop() {
        let mut world = World::hall(20.0, 12.0);
        world.drops.push(vec![p(1.0, 1.0), p(3.0, 1.0), p(3.0, 2.0), p(1.0, 2.0)]);
        assert!(!world.floor(p(2.0, 1.5)) && world.floor(p(2.0, 2.5)) && world.floor(p(0.5, 1.5)));
    }

    #[test]
    fn a_world_that_is_none_says_where() {
        let good = World::hall(20.0, 12.0);
        let mut bad = good.clone();
        bad.walls[2].a.x = f64::NAN;
        assert_eq!(bad.check(), Err(WorldError::Wall(2)));
        let mut bad = good.clone();
        bad.columns.push(Column { centre: p(0.0, 0.0), radius: 0.0 });
        assert_eq!(bad.check(), Err(WorldError::Column(0)));
        let mut bad = good.clone();
        bad.beacons = vec![Beacon { id: 1, at: p(0.0, 0.0) }; 2];
        assert_eq!(bad.check(), Err(WorldError::Beacon(1)));
        let mut bad = good.clone();
        bad.places = vec![p(1.0, 1.0), p(1.0, f64::INFINITY)];
        assert_eq!(bad.check(), Err(WorldError::Place(1)));
        let mut bad = good.clone();
        bad.routes = vec![Route { name: "patrol".into(), ..Route::default() }];
        assert_eq!(bad.check(), Err(WorldError::Route(0)));
        bad.routes[0].waypoints.push(p(1.0, 1.0));
        assert_eq!(bad.check(), Ok(()));
        bad.routes.push(bad.routes[0].clone());
        assert_eq!(bad.check(), Err(WorldError::Route(1)));
        let mut bad = good.clone();
        bad.people.attentive = f64::NAN;
        assert_eq!(bad.check(), Err(WorldError::People));
        assert_eq!(good.check(), Ok(()));
    }
}
