//! Visitors: they walk from place to place, alone or in groups, stop and look, step into the way, and give way.
//!
//! Social forces (Helbing and Molnár 1995) ten times a second, straight lines between; hard limits at walls and at the
//! robot. Whoever looks where he goes walks round the robot and steps aside when it comes; the others notice it at
//! their feet. Everything follows from the seed and from where the robot was. Where somebody was a moment ago is
//! remembered, as the boards are asked for measurements after their moment.

mod contact;
mod floor;

pub use contact::{Contact, Mover, NoContact, TOWARDS, Touched};

use crate::random::Random;
use crate::world::{Crowd, World};
use base::Duration;
use floor::Field;
pub(crate) use floor::Floor;
use kinematics::{Shape, Twist};
use navitools::{Point, Pose};

/// People think this often.
pub const PERIOD: Duration = Duration::from_millis(100);
const DT: f64 = 0.1;
const NS: u64 = PERIOD.as_nanos() as u64;
/// Steps that are remembered: more than the oldest sighting of a beacon.
const MEMORY: usize = 24;
/// A leg at the height of the sonars, m.
pub const LEG: f64 = 0.06;
/// Legs beside the middle, and before and behind it at a stride, m.
const HIP: f64 = 0.09;
const STRIDE: f64 = 0.22;
/// Way of two steps, m.
const GAIT: f64 = 1.3;
/// From wish to speed, s.
const TAU: f64 = 0.4;
/// Greatest speed of a person, m/s.
const FASTEST: f64 = 2.0;
/// A contact lasts until there is this gap, m.
const RELEASE: f64 = 0.05;
/// Nearer than this they touch, m.
const TOUCH: f64 = 0.002;
/// Distance at which an inattentive person notices the robot, m, and the number of steps until then.
const FEET: f64 = 0.6;
const ALERT: u8 = 3;
/// Who looks where he goes gives way to a robot that he would be at within this time, s, and is not farther than this,
/// m: people do so by the time that is left, not by distance (Karamouzas, Skinner, Guy 2014, who find up to 3 s).
const FORESEES: f64 = 1.0;
/// Speed below which a person stands and watches, m/s.
const WALKS: f64 = 0.2;
const FORESEES_WITHIN: f64 = 4.0;
/// He who has noticed the robot does not go nearer, m.
const MANNERS: f64 = 0.15;
/// Probability that a path leads to the robot, and the distances before it, m.
const CURIOUS: f64 = 0.15;
const CURIOUS_WITHIN: f64 = 5.0;
const BEFORE_IT: f64 = 1.0;
/// A walker: radius, m; pace, m/s; distance at which he has arrived, m; steps that he stands there.
const WALKER: f64 = 0.22;
const WALKER_PACE: f64 = 1.1;
const WALKER_NEAR: f64 = 0.4;
const WALKER_STANDS: u64 = 10;
/// Positions in a group: ahead and to the left of the first, m.
const BESIDE: [(f64, f64); 3] = [(0.0, 0.65), (0.0, -0.65), (-0.7, 0.0)];

/// A moment since the start, ns.
pub type Moment = u64;

/// The robot as people meet it.
#[derive(Clone, Copy, Debug)]
pub struct Hull {
    pose: Pose,
    sin_cos: (f64, f64),
    rear: f64,
    front: f64,
    half_width: f64,
    /// Outline within that rectangle; none: the rectangle.
    shape: Option<Shape>,
    motion: Twist,
}

/// Relation of a point to the robot.
#[derive(Clone, Copy, Debug)]
struct Gap {
    /// From the robot's edge, m.
    gap: f64,
    /// From the robot to the point, in the world.
    normal: (f64, f64),
    /// Speed of the edge there along the normal, m/s.
    towards: f64,
}

impl Hull {
    /// A rectangle from `rear` to `front` and `half_width` to each side at `pose`, with its velocity.
    #[must_use]
    pub fn new(pose: Pose, (rear, front, half_width): (f64, f64, f64), motion: Twist) -> Self {
        Self { pose, sin_cos: pose.theta.sin_cos(), rear, front, half_width, shape: None, motion }
    }

    /// The same with this outline, within that rectangle; none: the rectangle.
    #[must_use]
    pub fn shaped(self, shape: Option<Shape>) -> Self {
        Self { shape, ..self }
    }

    fn is_within(&self, point: Point, reach: f64) -> bool {
        let reach = reach + self.front - self.rear + self.half_width;
        let (dx, dy) = (point.x - self.pose.x, point.y - self.pose.y);
        dx * dx + dy * dy < reach * reach
    }

    fn gap(&self, point: Point) -> Gap {
        let (sin, cos) = self.sin_cos;
        let (dx, dy) = (point.x - self.pose.x, point.y - self.pose.y);
        let (x, y) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let edge = match &self.shape {
            Some(shape) => {
                let Point { x, y } = shape.nearest(Point { x, y });
                (x, y)
            }
            None => (x.clamp(self.rear, self.front), y.clamp(-self.half_width, self.half_width)),
        };
        let (ox, oy) = (x - edge.0, y - edge.1);
        let gap = libm::sqrt(ox * ox + oy * oy);
        let middle = (self.front + self.rear) / 2.0;
        // Inside there is no outside: away from the middle.
        let (nx, ny) = if gap > 1e-9 { (ox / gap, oy / gap) } else { unit((x - middle, y)) };
        let (forward, left) = self.motion.at(edge.0, edge.1);
        let towards = forward * nx + left * ny;
        Gap { gap, normal: (cos * nx - sin * ny, sin * nx + cos * ny), towards }
    }

    /// A point on the robot's axis, so far before its front.
    fn before(&self, ahead: f64) -> Point {
        let (sin, cos) = self.sin_cos;
        let ahead = self.front + ahead;
        Point { x: self.pose.x + cos * ahead, y: self.pose.y + sin * ahead }
    }
}

/// Target of a person.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Goal {
    Place(usize),
    Robot,
    /// With the first of his group, at this place of [`BESIDE`].
    Group(usize, usize),
}

#[derive(Clone, Debug)]
struct Person {
    radius: f64,
    pace: f64,
    at: Point,
    velocity: (f64, f64),
    /// Direction that the person faces; length 1.
    faces: (f64, f64),
    walked: f64,
    /// Both legs, relative to the centre.
    legs: [(f64, f64); 2],
    goal: Goal,
    /// True while standing; and the step at which this ends.
    stands: bool,
    until: u64,
    /// He looks where he goes.
    looks: bool,
    /// For how many steps he has had the robot at his feet.
    alert: u8,
    touches: Option<Mover>,
    /// The two places between which he walks, the next one first, or twice that at which he stands; `None`: a visitor.
    beat: Option<[usize; 2]>,
}

/// One step of a person: begin and end, and both legs relative to the centre at both.
#[derive(Clone, Copy, Debug, Default)]
struct Track {
    from: Point,
    to: Point,
    legs: [[(f64, f64); 2]; 2],
    /// The part of it that was gone; less than 1 when he was stopped.
    gone: f64,
}

impl Track {
    fn at(&self, part: f64) -> Point {
        let part = part.min(self.gone);
        Point { x: self.from.x + part * (self.to.x - self.from.x), y: self.from.y + part * (self.to.y - self.from.y) }
    }
}

/// All people.
#[derive(Clone, Debug)]
pub struct People {
    crowd: Crowd,
    floor: Floor,
    /// Those of the visitors, then those of the walkers.
    places: Vec<Point>,
    /// Number of places that visitors walk to.
    visited: usize,
    fields: Vec<Option<Field>>,
    random: Random,
    persons: Vec<Person>,
    /// The last [`MEMORY`] steps.
    tracks: Vec<Vec<Track>>,
    /// The step that runs.
    step: u64,
    /// Lower bound of the distance to the robot, m.
    room: f64,
}

impl People {
    /// The people of a world; no visitor within 1.5 m of the robot, no walker who would touch it.
    #[must_use]
    pub fn new(world: &World, seed: u64, robot: &Hull) -> Self {
        let random = Random::stream(seed, u64::from_le_bytes(*b"visitors"));
        let crowd = world.people;
        let mut people = Self {
            crowd,
            floor: Floor::default(),
            places: world.places.clone(),
            visited: 0,
            fields: Vec::new(),
            random,
            persons: Vec::new(),
            tracks: Vec::new(),
            step: 0,
            room: 0.0,
        };
        if crowd.count > 0 || !world.walkers.is_empty() {
            people.come(world, robot);
        }
        people
    }

    fn come(&mut self, world: &World, robot: &Hull) {
        self.floor = Floor::new(world);
        if self.places.len() < 2 && self.crowd.count > 0 {
            let drawn = (0..8).filter_map(|_| self.floor.somewhere(&mut self.random));
            self.places.extend(drawn.collect::<Vec<_>>());
        }
        self.visited = self.places.len();
        let mut left = 0;
        let mut first = 0;
        for number in 0..self.crowd.count as usize {
            let Some(at) = self.free_place(robot) else { break };
            let goal = if left > 0 && number > first {
                left -= 1;
                Goal::Group(first, number - first - 1)
            } else {
                first = number;
                // Of groups of two to four, three on average: whose first is drawn with a third of the share.
                let alone = 1.0 - self.crowd.grouped;
                let begins = self.crowd.grouped / 3.0;
                if self.random.chance(begins / (begins + alone)) {
                    left = 1 + (self.random.uniform() * 3.0) as usize;
                }
                Goal::Place(0)
            };
            let pace = (1.1 + 0.22 * self.random.normal()).clamp(0.6, 1.6);
            let radius = 0.20 + 0.05 * self.random.uniform();
            let mut person = Person {
                radius,
                pace,
                at,
                velocity: (0.0, 0.0),
                faces: (1.0, 0.0),
                walked: self.random.uniform() * GAIT,
                legs: [(0.0, 0.0); 2],
                goal,
                stands: true,
                // Not all at once.
                until: (self.random.uniform() * 100.0) as u64,
                looks: true,
                alert: 0,
                touches: None,
                beat: None,
            };
            person.legs = legs(&person, 0.0);
            self.persons.push(person);
        }
        for walker in &world.walkers {
            self.come_to(&walker.points, robot);
        }
        self.fields = vec![None; self.places.len()];
        let stands = |person: &Person| Track { from: person.at, to: person.at, legs: [person.legs; 2], gone: 1.0 };
        let first: Vec<Track> = self.persons.iter().map(stands).collect();
        self.tracks = vec![first; MEMORY];
    }

    /// A walker comes, unless the robot is there.
    fn come_to(&mut self, points: &[Point], robot: &Hull) {
        let (Some(at), Some(to)) = (points.first().copied(), points.last().copied()) else { return };
        let radius = WALKER;
        if robot.gap(at).gap <= radius + RELEASE {
            return;
        }
        let from = self.places.len();
        self.places.extend([at, to]);
        let mut person = Person {
            radius,
            pace: WALKER_PACE,
            at,
            velocity: (0.0, 0.0),
            faces: unit((to.x - at.x, to.y - at.y)),
            walked: 0.0,
            legs: [(0.0, 0.0); 2],
            goal: Goal::Place(from),
            stands: true,
            until: 0,
            looks: true,
            alert: 0,
            touches: None,
            beat: Some([from + 1, from]),
        };
        if at == to {
            person.faces = (1.0, 0.0);
        }
        person.legs = legs(&person, 0.0);
        self.persons.push(person);
    }

    fn free_place(&mut self, robot: &Hull) -> Option<Point> {
        (0..50).find_map(|_| {
            let place = self.floor.somewhere(&mut self.random)?;
            let alone = self.persons.iter().all(|other| other.at.distance(place) > 0.6);
            (alone && robot.gap(place).gap > 1.5).then_some(place)
        })
    }

    /// True if there are no people.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.persons.is_empty()
    }

    /// Number of them.
    #[must_use]
    pub fn count(&self) -> usize {
        self.persons.len()
    }

    /// The step that is due next, as a moment.
    #[must_use]
    pub fn next_step(&self) -> Moment {
        if self.is_empty() { Moment::MAX } else { (self.step + 1) * NS }
    }

    /// Positions and radii of all people at an instant.
    pub fn at(&self, moment: Moment) -> impl Iterator<Item = (Point, f64)> + '_ {
        let (tracks, part) = self.tracks_at(moment);
        tracks.iter().zip(&self.persons).map(move |(track, person)| (track.at(part), person.radius))
    }

    /// The middles of both legs of everybody within `reach` of a point.
    pub fn legs(&self, moment: Moment, point: Point, reach: f64) -> impl Iterator<Item = [Point; 2]> + '_ {
        self.legs_by_person(moment, point, reach).map(|(_, legs)| legs)
    }

    /// The same with the number of the person.
    pub fn legs_by_person(
        &self,
        moment: Moment,
        point: Point,
        reach: f64,
    ) -> impl Iterator<Item = (usize, [Point; 2])> + '_ {
        let (tracks, part) = self.tracks_at(moment);
        tracks.iter().enumerate().filter_map(move |(person, track)| {
            let at = track.at(part);
            let (dx, dy) = (at.x - point.x, at.y - point.y);
            if dx * dx + dy * dy > reach * reach {
                return None;
            }
            let part = part.min(track.gone);
            let leg = |n: usize| {
                let (begin, end) = (track.legs[0][n], track.legs[1][n]);
                Point { x: at.x + begin.0 + part * (end.0 - begin.0), y: at.y + begin.1 + part * (end.1 - begin.1) }
            };
            Some((person, [leg(0), leg(1)]))
        })
    }

    /// Number of people between two points at an instant.
    #[must_use]
    pub fn between(&self, moment: Moment, a: Point, b: Point) -> usize {
        let wall = crate::world::Segment { a, b };
        self.at(moment).filter(|(at, radius)| crate::world::nearest(&wall, *at).distance(*at) < *radius).count()
    }

    fn tracks_at(&self, moment: Moment) -> (&[Track], f64) {
        let oldest = self.step.saturating_sub(MEMORY as u64 - 1);
        let step = (moment / NS).clamp(oldest, self.step);
        let part = (moment.saturating_sub(step * NS) as f64 / NS as f64).min(1.0);
        let tracks = self.tracks.get((step % MEMORY as u64) as usize);
        (tracks.map_or(&[], Vec::as_slice), part)
    }

    /// Distance from the robot to the nearest person, m; infinite without one.
    #[must_use]
    pub fn clearance(&self, moment: Moment, robot: &Hull) -> f64 {
        let gaps = self.at(moment).map(|(at, radius)| robot.gap(at).gap - radius);
        gaps.fold(f64::INFINITY, f64::min).max(0.0)
    }

    /// True if a person may touch a robot no part of which has moved by more than `way` m since the last call, in `dt`
    /// s: then [`People::meet`] decides.
    pub fn may_meet(&mut self, way: f64, dt: f64) -> bool {
        self.room -= way + FASTEST * dt;
        self.room <= 0.0 && !self.is_empty()
    }

    /// Detects contacts. Returns true if a person is in the robot's way; new contacts are added to `contacts`, and
    /// people in contact stop.
    pub fn meet(&mut self, moment: Moment, robot: &Hull, contacts: &mut Vec<Contact>) -> bool {
        let (ring, part) = ((self.step % MEMORY as u64) as usize, (moment % NS) as f64 / NS as f64);
        let (mut room, mut blocked) = (f64::INFINITY, false);
        for (number, (track, person)) in self.tracks[ring].iter_mut().zip(&mut self.persons).enumerate() {
            let at = track.at(part);
            let found = robot.gap(at);
            let gap = found.gap - person.radius;
            room = room.min(gap);
            if gap > RELEASE {
                person.touches = None;
            }
            if gap > TOUCH {
                continue;
            }
            let velocity = if track.gone > part { person.velocity } else { (0.0, 0.0) };
            let (towards_mps, speed_mps) = (-dot(velocity, found.normal), libm::hypot(velocity.0, velocity.1));
            let mover = if found.towards > TOWARDS { Mover::Robot } else { Mover::Person };
            blocked |= mover == Mover::Robot;
            track.gone = track.gone.min(part);
            person.alert = ALERT;
            // A person who was bumped into, and is then pushed, counts twice.
            if person.touches.is_none() || (person.touches, mover) == (Some(Mover::Person), Mover::Robot) {
                person.touches = Some(mover);
                let person = Some(Touched { number: number as u32, towards_mps, speed_mps });
                contacts.push(Contact { mover, person, robot_mps: found.towards, at });
            }
        }
        self.room = room - TOUCH;
        blocked
    }

    /// The robot is elsewhere, or was not asked about for long.
    pub fn forget(&mut self) {
        self.room = 0.0;
    }

    /// Goes on by one step; the robot and the world are as they are at its beginning.
    pub fn step(&mut self, world: &World, robot: &Hull) {
        let ring = (self.step % MEMORY as u64) as usize;
        for (track, person) in self.tracks[ring].iter().zip(&mut self.persons) {
            person.at = track.at(1.0);
            if track.gone < 1.0 {
                person.velocity = (0.0, 0.0);
            }
        }
        self.step += 1;
        for number in 0..self.persons.len() {
            self.decide(number, world, robot);
        }
        let next = (self.step % MEMORY as u64) as usize;
        let mut tracks = std::mem::take(&mut self.tracks[next]);
        tracks.clear();
        for number in 0..self.persons.len() {
            let velocity = self.velocity(number, robot);
            tracks.push(self.walk(number, velocity, robot));
        }
        for (track, person) in tracks.iter().zip(&mut self.persons) {
            person.velocity = ((track.to.x - track.from.x) / DT, (track.to.y - track.from.y) / DT);
        }
        self.tracks[next] = tracks;
    }

    /// Decides if a person goes on, stops or turns elsewhere.
    fn decide(&mut self, number: usize, world: &World, robot: &Hull) {
        let person = &mut self.persons[number];
        let seen = robot.is_within(person.at, FEET) && robot.gap(person.at).gap - person.radius < FEET;
        person.alert = if seen { (person.alert + 1).min(ALERT) } else { 0 };
        let goal = match person.goal {
            Goal::Group(..) => return,
            Goal::Place(place) => self.places[place],
            Goal::Robot => robot.before(BEFORE_IT),
        };
        let near = if person.beat.is_some() { WALKER_NEAR } else { 0.9 };
        let arrived = !person.stands && person.at.distance(goal) < near;
        if arrived && person.beat.is_some() {
            (person.stands, person.until) = (true, self.step + WALKER_STANDS);
        } else if arrived {
            (person.stands, person.until) = (true, self.step + 30 + (self.random.uniform() * 120.0) as u64);
            person.looks = self.random.chance(self.crowd.attentive);
        } else if self.step >= person.until {
            self.set_out(number, world, robot);
        }
    }

    /// To another place, or to see the robot.
    fn set_out(&mut self, number: usize, world: &World, robot: &Hull) {
        let at = self.persons[number].at;
        if let Some([next, other]) = self.persons[number].beat {
            if at.distance(self.places[next]) < WALKER_NEAR {
                // He who stands is where he is to be; he who walks turns back.
                let person = &mut self.persons[number];
                (person.stands, person.until) = (true, self.step + WALKER_STANDS);
                person.beat = Some([other, next]);
                return;
            }
            self.chart(next);
            let person = &mut self.persons[number];
            // Where something is in his way he turns back in the end.
            (person.goal, person.stands, person.until) = (Goal::Place(next), false, self.step + 900);
            person.beat = Some([other, next]);
            return;
        }
        let before = robot.before(BEFORE_IT);
        let (distance, way) = (at.distance(before), unit((before.x - at.x, before.y - at.y)));
        let near = distance < CURIOUS_WITHIN && world.ray(at, way, distance).is_none();
        let goal = match near && self.random.chance(CURIOUS) {
            true => Goal::Robot,
            false => Goal::Place((self.random.uniform() * self.visited as f64) as usize),
        };
        if let Goal::Place(place) = goal {
            self.chart(place);
        }
        let until = self.step + if goal == Goal::Robot { 100 } else { 900 };
        for person in &mut self.persons[number..] {
            if matches!(person.goal, Goal::Group(first, _) if first == number) {
                person.looks = self.random.chance(self.crowd.attentive);
            }
        }
        let looks = self.random.chance(self.crowd.attentive);
        let person = &mut self.persons[number];
        (person.goal, person.stands, person.until, person.looks) = (goal, false, until, looks);
    }

    /// Finds the ways to a place, once.
    fn chart(&mut self, place: usize) {
        if self.fields[place].is_none() {
            self.fields[place] = Some(self.floor.field(self.places[place]));
        }
    }

    /// Desired velocity of a person, m/s.
    fn wish(&self, number: usize, robot: &Hull) -> (f64, f64) {
        let person = &self.persons[number];
        let (aim, pace) = match person.goal {
            Goal::Group(first, place) => {
                let first = &self.persons[first];
                let (ahead, left) = BESIDE[place % BESIDE.len()];
                let (cos, sin) = first.faces;
                let x = first.at.x + cos * ahead - sin * left;
                let y = first.at.y + sin * ahead + cos * left;
                let behind = person.at.distance(Point { x, y });
                if behind < 0.25 {
                    return (0.0, 0.0);
                }
                let field = self.field(first.goal).filter(|_| behind > 3.0 && !first.stands);
                let aim = field.and_then(|field| self.floor.aim(field, person.at));
                (aim.unwrap_or(Point { x, y }), (1.2 * behind).min(1.3 * first.pace))
            }
            _ if person.stands => return (0.0, 0.0),
            Goal::Robot => (robot.before(BEFORE_IT), person.pace),
            Goal::Place(place) => {
                let aim = self.field(person.goal).and_then(|field| self.floor.aim(field, person.at));
                (aim.unwrap_or(self.places[place]), person.pace)
            }
        };
        let (x, y) = unit((aim.x - person.at.x, aim.y - person.at.y));
        (x * pace, y * pace)
    }

    fn field(&self, goal: Goal) -> Option<&Field> {
        if let Goal::Place(place) = goal { self.fields[place].as_ref() } else { None }
    }

    /// Velocity of a person among walls, others and the robot, m/s.
    fn velocity(&self, number: usize, robot: &Hull) -> (f64, f64) {
        let person = &self.persons[number];
        let wish = self.wish(number, robot);
        let old = person.velocity;
        let mut push = ((wish.0 - old.0) / TAU, (wish.1 - old.1) / TAU);
        for (other, them) in self.persons.iter().enumerate() {
            let (dx, dy) = (person.at.x - them.at.x, person.at.y - them.at.y);
            let near = dx * dx + dy * dy;
            if near > 1.7 || other == number {
                continue;
            }
            let distance = libm::sqrt(near).max(1e-3);
            let normal = (dx / distance, dy / distance);
            let approach = (old.0 - them.velocity.0, old.1 - them.velocity.1);
            let strength = if self.together(number, other) { 1.5 } else { 4.0 };
            add(&mut push, repel(distance - person.radius - them.radius, 0.8, strength, normal, approach));
        }
        for (foot, thickness) in self.floor.near(person.at) {
            let (dx, dy) = (person.at.x - foot.x, person.at.y - foot.y);
            let distance = libm::sqrt(dx * dx + dy * dy).max(1e-3);
            let gap = distance - thickness - person.radius;
            add(&mut push, repel(gap, 0.3, 6.0, (dx / distance, dy / distance), (0.0, 0.0)));
        }
        if (person.looks || person.alert >= ALERT) && robot.is_within(person.at, FORESEES_WITHIN) {
            let found = robot.gap(person.at);
            let gap = found.gap - person.radius;
            let (x, y) = found.normal;
            let moved = found.towards.max(0.0);
            // A standing person steps back only from an approaching robot; a curious one comes near. A walking person
            // sees what is about to be in the way.
            let closing = (found.towards - dot(old, found.normal)).max(0.0);
            let walks = dot(old, old) > WALKS * WALKS && person.goal != Goal::Robot;
            let reach = if walks { 1.2 + FORESEES * closing } else { 0.3 + 1.2 * moved };
            let approach = (old.0 - moved * x, old.1 - moved * y);
            add(&mut push, repel(gap, reach, 5.0, found.normal, approach));
        }
        let mut new = (old.0 + DT * push.0, old.1 + DT * push.1);
        let speed = libm::sqrt(dot(new, new));
        let limit = (1.3 * person.pace).min(FASTEST - 0.1);
        if speed > limit {
            new = (new.0 * limit / speed, new.1 * limit / speed);
        }
        if wish == (0.0, 0.0) && speed < 0.1 { (0.0, 0.0) } else { new }
    }

    fn together(&self, one: usize, other: usize) -> bool {
        let first = |number: usize| if let Goal::Group(first, _) = self.persons[number].goal { first } else { number };
        first(one) == first(other)
    }

    /// One step at this velocity, but neither into a wall nor, if noticed, into the robot.
    fn walk(&mut self, number: usize, (vx, vy): (f64, f64), robot: &Hull) -> Track {
        let person = &mut self.persons[number];
        let from = person.at;
        let mut to = Point { x: from.x + DT * vx, y: from.y + DT * vy };
        if robot.is_within(to, FEET) {
            let (before, after) = (robot.gap(from), robot.gap(to));
            let aware = person.looks || person.alert >= ALERT;
            let keep = person.radius + if aware { MANNERS.min(before.gap - person.radius).max(TOUCH) } else { 0.0 };
            if after.gap < keep && after.gap < before.gap {
                let back = keep.min(before.gap) - after.gap;
                to = Point { x: to.x + back * after.normal.0, y: to.y + back * after.normal.1 };
            }
        }
        for (foot, thickness) in self.floor.near(to) {
            let (dx, dy) = (to.x - foot.x, to.y - foot.y);
            let distance = libm::sqrt(dx * dx + dy * dy).max(1e-3);
            let short = thickness + person.radius - distance;
            if short > 0.0 {
                to = Point { x: to.x + short * dx / distance, y: to.y + short * dy / distance };
            }
        }
        let way = (to.x - from.x, to.y - from.y);
        let length = libm::sqrt(dot(way, way));
        person.walked += length;
        if length > 0.2 * DT {
            person.faces = (way.0 / length, way.1 / length);
        }
        let after = legs(person, length / DT);
        let legs = [std::mem::replace(&mut person.legs, after), after];
        Track { from, to, legs, gone: 1.0 }
    }
}

/// Both legs relative to the centre: side by side, and when walking one before and one behind.
fn legs(person: &Person, speed: f64) -> [(f64, f64); 2] {
    let (cos, sin) = person.faces;
    let ahead = STRIDE * speed.min(1.0) * libm::sin(core::f64::consts::TAU * person.walked / GAIT);
    [(cos * ahead - sin * HIP, sin * ahead + cos * HIP), (-cos * ahead + sin * HIP, -sin * ahead - cos * HIP)]
}

/// The push of something at a gap along a normal, m/s²; who approaches it passes it on his right.
fn repel(gap: f64, reach: f64, strength: f64, (x, y): (f64, f64), approach: (f64, f64)) -> (f64, f64) {
    if gap >= reach {
        return (0.0, 0.0);
    }
    let part = 1.0 - gap.max(0.0) / reach;
    let push = strength * part * part;
    let aside = if approach.0 * x + approach.1 * y < -0.05 { strength * part * 0.5 } else { 0.0 };
    (push * x - aside * y, push * y + aside * x)
}

fn dot(a: (f64, f64), b: (f64, f64)) -> f64 {
    a.0 * b.0 + a.1 * b.1
}

fn add(sum: &mut (f64, f64), part: (f64, f64)) {
    *sum = (sum.0 + part.0, sum.1 + part.1);
}

fn unit((x, y): (f64, f64)) -> (f64, f64) {
    let length = libm::sqrt(x * x + y * y);
    if length > 1e-9 { (x / length, y / length) } else { (1.0, 0.0) }
}

#[cfg(test)]
mod tests;
