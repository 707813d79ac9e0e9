//! What a lidar had in sight is not hit (docs/guard.md, docs/soak.md): a person or an object that a lidar could see for
//! as long as the robot needs to react and to stop is not touched by the robot at more than [`CONTACT_MPS`].
//!
//! The evidence is the truth: poses of the robot and of the people, walls and columns, and the simulator's report of a
//! contact. What the lidar measured does not matter: one that is covered, silent, or repeats itself excuses nothing, as
//! what is unknown counts as occupied. Its driver excuses nothing either. The only fault that does is `false`, wild
//! beams, until it has been over for the same time.
//!
//! In sight is what no wall, column or person hides from one lidar, over the whole width of a person, within its view
//! and its reach. Glass and mirrors are not in sight. The speed from which the robot has to stop is that of the fastest
//! point of its outline. All other contacts at such a speed are of what came out of hiding. Both are counted.
//!
//! No violation, but counted: contacts with somebody who walked in that time, for whom the guard slows down and does
//! not stop; of a robot that creeps, or rolls without power; after a disturbance on the way from the guard to the
//! wheels.

use super::Verdict;
use super::facts::Facts;
use super::promise::{CONTACT_MPS, STANDS_MPS, undisturbed_since};
use base::{Duration, Instant};
use kinematics::Shape;
use messages::simulation::{DataPeople, DataTruth};
use navitools::{Point, Pose, wrap};
use simulator::people::{Contact, Mover};
use simulator::world::{Hit, Segment, World};
use std::collections::{BTreeMap, VecDeque};

/// A person who stood was within this distance of where it was touched, m: it sways, and its places are rounded to the
/// steps of the truth.
const STOOD_M: f64 = 0.15;
/// A ray that ends less than this before the touched point, m, has met it.
const SAME_M: f64 = 0.05;
/// Time for which the truth is kept: more than the longest reaction and stop.
const KEPT_FOR: Duration = Duration::from_secs(6);

/// A lidar as the rule needs it.
#[derive(Clone, Debug, PartialEq)]
pub struct SeeingLidar {
    /// Its port, the target of its faults: `lidar.front`.
    pub bus: String,
    /// Where it sits on the robot; its front is along x.
    pub mount: Pose,
    /// Opening angle around its front, rad.
    pub view_rad: f64,
    /// Distance up to which it surely measures what is dark, m.
    pub reach_m: f64,
}

/// What a guard with lidars promises.
#[derive(Clone, Debug, PartialEq)]
pub struct Sight {
    /// The lidars.
    pub lidars: Vec<SeeingLidar>,
    /// From the appearance of an obstacle, or from the loss of a lidar, to the beginning of the deceleration, s.
    pub reaction_s: f64,
    /// Deceleration of a commanded stop, m/s².
    pub braking_mps2: f64,
    /// The robot's outline, m: rear and front edge on its axis, half of its width.
    pub body: (f64, f64, f64),
    /// Its outline within that rectangle; none: the rectangle.
    pub shape: Option<Shape>,
}

/// How many contacts there were at more than `CONTACT_MPS`, and the greatest speed of the robot towards the other,
/// m/s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hits {
    /// Number.
    pub count: u64,
    /// Greatest speed, m/s; 0 without a contact.
    pub fastest_mps: f64,
}

impl Hits {
    fn add(&mut self, mps: f64) {
        *self = Self { count: self.count + 1, fastest_mps: self.fastest_mps.max(mps) };
    }
}

/// Where the robot was.
#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Instant,
    pose: Pose,
    /// Speed of the fastest point of its outline, m/s.
    speed: f64,
}

/// Middles and radii of the people at an instant.
type Crowd = (Instant, Vec<(Point, f64)>);

/// The truth of the last seconds.
#[derive(Debug, Default)]
pub(super) struct Rule {
    world: Option<World>,
    samples: VecDeque<Sample>,
    crowds: VecDeque<Crowd>,
    /// Last instant at which a person crept past the guard.
    crept: Instant,
    /// End of the last fault that makes beams wild, by lidar.
    wild: BTreeMap<String, Instant>,
    /// Contacts with what was in sight.
    pub seen: Hits,
    /// Contacts with what came out of hiding.
    pub hidden: Hits,
}

impl Rule {
    /// Where the walls are; nothing is judged without.
    pub fn set_world(&mut self, world: &World) {
        self.world = Some(world.clone());
    }

    /// Processes a sample of the body's motion.
    pub fn on_truth(&mut self, now: Instant, truth: &DataTruth, facts: &Facts) {
        let Some(sight) = facts.limits.sight.as_ref().filter(|_| self.world.is_some()) else { return };
        let pose = Pose::new(truth.x, truth.y, truth.theta);
        let turns = self.samples.back().map_or(0.0, |last| {
            let passed = now.since(last.at).as_secs_f64();
            if passed > 0.0 { wrap(truth.theta - last.pose.theta.radians()).abs() / passed } else { 0.0 }
        });
        let (rear, front, half_width) = sight.body;
        let rectangle = || libm::hypot(rear.abs().max(front.abs()), half_width);
        let corner = sight.shape.as_ref().map_or_else(rectangle, Shape::radius);
        self.samples.push_back(Sample { at: now, pose, speed: truth.speed.abs() + turns * corner });
        while self.samples.front().is_some_and(|old| now.since(old.at) > KEPT_FOR) {
            self.samples.pop_front();
        }
    }

    /// Processes the places of the people.
    pub fn on_people(&mut self, now: Instant, people: &DataPeople, facts: &Facts) {
        if facts.limits.sight.is_none() || self.world.is_none() {
            return;
        }
        let is_old = |crowd: &Crowd| now.since(crowd.0) > KEPT_FOR;
        let mut places = match self.crowds.front().is_some_and(is_old) {
            true => self.crowds.pop_front().map_or_else(Vec::new, |(_, places)| places),
            false => Vec::new(),
        };
        places.clear();
        let points = people.x.iter().zip(&people.y).map(|(x, y)| Point { x: *x, y: *y });
        places.extend(points.zip(people.radius.iter().copied()));
        self.crowds.push_back((now, places));
    }

    /// A person creeps past the guard.
    pub fn on_creep(&mut self, now: Instant) {
        self.crept = now;
    }

    /// A fault begins or ends.
    pub fn on_fault(&mut self, now: Instant, target: &str, fault: &str, until: Instant, facts: &Facts) {
        if !facts.limits.is_lidar(target) {
            return;
        }
        if fault == "false" {
            let end = self.wild.entry(target.to_owned()).or_default();
            *end = until.max(*end);
        } else if let Some(end) = self.wild.get_mut(target) {
            // Any other fault of the same lidar ends the wild beams.
            *end = now.min(*end);
        }
    }

    /// The simulator has reported a contact.
    pub fn on_contact(&mut self, now: Instant, contact: &Contact, facts: &Facts) -> Verdict {
        let (Some(sight), Some(world)) = (&facts.limits.sight, &self.world) else { return Ok(()) };
        if contact.mover != Mover::Robot || contact.robot_mps <= CONTACT_MPS {
            return Ok(());
        }
        let touched = match contact.person {
            Some(person) => Some(Touched::Person(person.number as usize)),
            None => self.samples.back().and_then(|last| nearest_thing(world, last.pose, sight)),
        };
        let since = touched.and_then(|touched| self.in_sight_since(now, contact, touched, sight, world));
        let Some((since, stood)) = since else {
            self.hidden.add(contact.robot_mps);
            return Ok(());
        };
        self.seen.add(contact.robot_mps);
        let walks = contact.person.is_some_and(|person| person.speed_mps >= STANDS_MPS);
        let wild = self.wild.values().max().map_or(Instant::ZERO, |end| now.min(*end));
        let excused = undisturbed_since(now, facts).max(self.crept).max(wild) > since;
        if excused || walks || !stood {
            return Ok(());
        }
        let time = now.since(since).as_secs_f64();
        Err(format!("{contact}, and it was in sight of a lidar for the {time:.2} s that it takes to stop"))
    }

    /// Instant since which what was touched was in sight, if that leaves the time to stop, and true if it stood.
    fn in_sight_since(
        &self,
        now: Instant,
        contact: &Contact,
        touched: Touched,
        sight: &Sight,
        world: &World,
    ) -> Option<(Instant, bool)> {
        let mut stood = true;
        for sample in self.samples.iter().rev() {
            let at = match touched {
                Touched::Person(number) => self.person(number, sample.at, (now, contact.at))?,
                Touched::Wall(at) => (at, 0.0),
                Touched::Column(at, radius) => (at, radius),
            };
            let person = match touched {
                Touched::Person(number) => Some(number),
                Touched::Wall(_) | Touched::Column(..) => None,
            };
            stood &= person.is_none() || at.0.distance(contact.at) < STOOD_M;
            let sees = |lidar: &SeeingLidar| self.sees(world, lidar, sample, at, person);
            if !sight.lidars.iter().any(sees) {
                return None;
            }
            let needs = sight.reaction_s + sample.speed / sight.braking_mps2;
            if now.since(sample.at).as_secs_f64() > needs {
                return Some((sample.at, stood));
            }
        }
        None
    }

    /// Where a person was, and its radius: between the samples, and from the last one to where it was touched.
    fn person(&self, number: usize, at: Instant, touched: (Instant, Point)) -> Option<(Point, f64)> {
        let later = self.crowds.partition_point(|(from, _)| *from <= at);
        let (from, before) = self.crowds.get(later.checked_sub(1)?)?;
        let (begin, radius) = *before.get(number)?;
        let (to, end) = match self.crowds.get(later) {
            Some((to, after)) => (*to, after.get(number)?.0),
            None => touched,
        };
        let span = to.since(*from).as_secs_f64();
        let part = if span > 0.0 { (at.since(*from).as_secs_f64() / span).min(1.0) } else { 1.0 };
        Some((Point { x: begin.x + part * (end.x - begin.x), y: begin.y + part * (end.y - begin.y) }, radius))
    }

    /// True if nothing hides a round thing, or a point, from a lidar.
    fn sees(
        &self,
        world: &World,
        lidar: &SeeingLidar,
        robot: &Sample,
        (middle, radius): (Point, f64),
        person: Option<usize>,
    ) -> bool {
        let sensor = robot.pose * lidar.mount;
        let from = sensor.point();
        let (dx, dy) = (middle.x - from.x, middle.y - from.y);
        let distance = libm::hypot(dx, dy);
        if distance <= radius || distance > lidar.reach_m {
            return distance <= radius;
        }
        // A ray to a column ends on it; people are not in the world.
        let own = if person.is_some() { 0.0 } else { radius };
        let side = (-dy / distance * radius, dx / distance * radius);
        [-1.0, 0.0, 1.0].into_iter().all(|edge| {
            let to = Point { x: middle.x + edge * side.0, y: middle.y + edge * side.1 };
            self.is_clear(world, sensor, lidar.view_rad, to, robot.at, person, own)
        })
    }

    /// True if a ray from the sensor to a point meets nothing before it, or before the column `own` m around it.
    #[expect(clippy::too_many_arguments, reason = "a ray, and what it may meet")]
    fn is_clear(
        &self,
        world: &World,
        sensor: Pose,
        view: f64,
        to: Point,
        at: Instant,
        person: Option<usize>,
        own: f64,
    ) -> bool {
        let from = sensor.point();
        let distance = from.distance(to);
        let (dx, dy) = ((to.x - from.x) / distance, (to.y - from.y) / distance);
        if wrap(libm::atan2(dy, dx) - sensor.theta.radians()).abs() > view / 2.0 {
            return false;
        }
        let is_before = |hit: Hit| hit.distance < distance - own - SAME_M;
        if world.ray(from, (dx, dy), distance).is_some_and(is_before) {
            return false;
        }
        let later = self.crowds.partition_point(|(from, _)| *from <= at);
        let crowd = self.crowds.get(later.saturating_sub(1)).map_or(&[][..], |(_, places)| places);
        crowd.iter().enumerate().all(|(number, (other, radius))| {
            let along = ((other.x - from.x) * dx + (other.y - from.y) * dy).clamp(0.0, distance);
            let nearest = Point { x: from.x + along * dx, y: from.y + along * dy };
            person == Some(number) || nearest.distance(*other) > *radius
        })
    }
}

/// What the robot has touched.
#[derive(Clone, Copy, Debug)]
enum Touched {
    /// The person of this number.
    Person(usize),
    /// A wall, there.
    Wall(Point),
    /// A column: its middle, and its radius, m.
    Column(Point, f64),
}

/// What stands nearest to the robot's outline; none if that is glass or a mirror, or if there is nothing.
fn nearest_thing(world: &World, robot: Pose, sight: &Sight) -> Option<Touched> {
    let (rear, front, half_width) = sight.body;
    let gap = |at: Point| {
        let (sin, cos) = robot.theta.sin_cos();
        let (dx, dy) = (at.x - robot.x, at.y - robot.y);
        let (x, y) = (cos * dx + sin * dy, cos * dy - sin * dx);
        match &sight.shape {
            Some(shape) => shape.distance(Point { x, y }),
            None => libm::hypot(x - x.clamp(rear, front), y - y.clamp(-half_width, half_width)),
        }
    };
    let rectangle = [(rear, -half_width), (rear, half_width), (front, half_width), (front, -half_width)];
    let rectangle = rectangle.map(|(x, y)| Point { x, y });
    let corners = sight.shape.as_ref().map_or(&rectangle[..], Shape::corners);
    let corners: Vec<Point> = corners.iter().map(|corner| robot * *corner).collect();
    let mut found: Option<(f64, Option<Touched>)> = None;
    let mut take = |gap: f64, thing| {
        if found.is_none_or(|(least, _)| gap < least) {
            found = Some((gap, thing));
        }
    };
    for wall in &world.walls {
        let shown = !world.glass.contains(wall) && !world.shiny.contains(wall);
        for at in corners.iter().map(|corner| nearest_on(wall, *corner)).chain([wall.a, wall.b]) {
            take(gap(at), shown.then_some(Touched::Wall(at)));
        }
    }
    for column in &world.columns {
        take(gap(column.centre) - column.radius, Some(Touched::Column(column.centre, column.radius)));
    }
    found.and_then(|(_, thing)| thing)
}

/// The point of a wall that is nearest to another point.
fn nearest_on(wall: &Segment, point: Point) -> Point {
    let (ex, ey) = (wall.b.x - wall.a.x, wall.b.y - wall.a.y);
    let square = ex * ex + ey * ey;
    let part = if square > 0.0 { ((point.x - wall.a.x) * ex + (point.y - wall.a.y) * ey) / square } else { 0.0 };
    let part = part.clamp(0.0, 1.0);
    Point { x: wall.a.x + part * ex, y: wall.a.y + part * ey }
}
