//! The robot in its world, as the boards' sensors and drives meet it: a body that steps, and where it was a moment ago.

use crate::body::{Body, Demand, Parameters, STEP};
use crate::people::{self, Contact, Floor, Hull, LEG, Moment, Mover, People};
use crate::random::Random;
use crate::sonar::{Cone, Echo, Sonar, floor_distance};
use crate::world::{Column, Hit, Segment, Surface, World, first_hit, nearest};
use base::Instant;
use kinematics::{Chassis, Shape, Twist};
use navitools::{Point, Pose, wrap};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Number of poses kept: steps of the greatest age of the beacon scanner's answer (a sweep of 1 s), and some.
const MEMORY: usize = 256;
/// A step, ns.
const STEP_NS: u64 = STEP.as_nanos() as u64;
/// Free distance around a kidnapped robot, m.
const KIDNAP_ROOM: f64 = 0.3;
/// Greatest distance of an echo from legs, m: the legs' range, and half a stride.
const LEGS_WITHIN: f64 = 2.9;
/// The floor rangers hang this high, m.
pub const RANGER_HEIGHT: f64 = 0.12;

/// Body, world, people and chance.
#[derive(Clone, Debug)]
pub struct Scene {
    world: World,
    body: Body,
    people: People,
    contacts: Vec<Contact>,
    cone: Cone,
    /// Scale of distances by the air's temperature.
    stretch: f64,
    seed: u64,
    /// Demand of the drives from the next step on.
    pub demand: Demand,
    start: Instant,
    steps: u64,
    /// From which step on the body was where.
    past: VecDeque<(u64, Pose)>,
}

/// Part of its reach up to which a lidar sees black, of 10 % remission: that of a SICK TiM571 (8 of 25 m) and of an
/// RPLIDAR S2 (10 of 30 m), by their data sheets.
const BLACK: f64 = 1.0 / 3.0;
/// Least cosine of the incidence at which glass, or a mirror, sends light back to where it came from: 4°.
const STRAIGHT: f64 = 0.9976;
/// Where a ray begins that a mirror throws back, m from it.
const OFF_MIRROR: f64 = 1e-6;

/// Surroundings of a lidar.
pub(crate) struct View<'a> {
    world: &'a World,
    legs: Vec<Column>,
    /// In black trousers.
    dark: Vec<Column>,
    sensor: Pose,
    reach: f64,
}

impl View<'_> {
    /// Distances of what a lidar sees in `directions`, equal steps all around, counter-clockwise from its front: cosine
    /// and sine; infinite: nothing is within reach. Only those of `count` directions from `first` on, in this order.
    /// Each object is looked for where it can be seen only.
    pub fn distances(&self, directions: &[(f64, f64)], (first, count): (usize, usize)) -> Vec<f64> {
        let mut rays = Rays::new(self, directions, first, count);
        let bearing = |to: Point| {
            let from = self.sensor.point();
            libm::atan2(to.y - from.y, to.x - from.x) - self.sensor.theta.radians()
        };
        let as_black =
            |hit: Hit, _| Some(if hit.distance <= BLACK * self.reach { hit.distance } else { f64::INFINITY });
        for wall in &self.world.walls {
            if rays.are_beside(wall.a, wall.b, 0.0) {
                continue;
            }
            let a = bearing(wall.a);
            let between = wrap(bearing(wall.b) - a);
            let (sector, walls) = ((a + between / 2.0, between.abs() / 2.0), std::slice::from_ref(wall));
            match self.world.surface(wall) {
                Surface::Matt => rays.look(sector, walls, &[], |hit, _| Some(hit.distance)),
                Surface::Black => rays.look(sector, walls, &[], as_black),
                Surface::Glass => rays.look(sector, walls, &[], |hit, _| is_straight(hit).then_some(hit.distance)),
                Surface::Shiny => {
                    let image = self.image(wall);
                    rays.look(sector, walls, &[], |hit, direction| {
                        Some(if is_straight(hit) { hit.distance } else { image(hit, direction) })
                    });
                }
            }
        }
        let matt = self.world.columns.iter().chain(&self.legs).map(|column| (column, false));
        for (column, dark) in matt.chain(self.dark.iter().map(|column| (column, true))) {
            if rays.are_beside(column.centre, column.centre, column.radius) {
                continue;
            }
            let sine = column.radius / self.sensor.point().distance(column.centre);
            let (sector, columns) = ((bearing(column.centre), libm::asin(sine.min(1.0))), std::slice::from_ref(column));
            match dark {
                false => rays.look(sector, &[], columns, |hit, _| Some(hit.distance)),
                true => rays.look(sector, &[], columns, as_black),
            }
        }
        rays.shown
    }

    /// Length of a ray that meets a mirror and is thrown back once, as if what it meets then stood behind the mirror.
    fn image(&self, mirror: &Segment) -> impl Fn(Hit, (f64, f64)) -> f64 + '_ {
        let (ex, ey) = (mirror.b.x - mirror.a.x, mirror.b.y - mirror.a.y);
        let length = libm::hypot(ex, ey);
        let (ex, ey) = (ex / length, ey / length);
        let shown = |wall: &&Segment| *wall != mirror && self.world.surface(wall) != Surface::Glass;
        let walls: Vec<Segment> = self.world.walls.iter().filter(shown).copied().collect();
        let columns: Vec<Column> = self.world.columns.iter().chain(&self.legs).chain(&self.dark).copied().collect();
        move |hit, (dx, dy)| {
            let along = 2.0 * (dx * ex + dy * ey);
            let (back_x, back_y) = (along * ex - dx, along * ey - dy);
            let from = self.sensor.point();
            let at = Point {
                x: from.x + dx * hit.distance + back_x * OFF_MIRROR,
                y: from.y + dy * hit.distance + back_y * OFF_MIRROR,
            };
            let second = first_hit(&walls, &columns, at, (back_x, back_y), self.reach - hit.distance);
            second.map_or(f64::INFINITY, |second| hit.distance + second.distance)
        }
    }
}

/// True if a surface that scatters nothing sends the light back.
fn is_straight(hit: Hit) -> bool {
    hit.cos_incidence >= STRAIGHT
}

/// Rays of a lidar in some directions side by side.
struct Rays {
    from: Point,
    /// Directions all around.
    all: usize,
    /// The first of these rays, and where each leads.
    first: usize,
    directions: Vec<(f64, f64)>,
    /// Where they end, m.
    ends: Vec<f64>,
    /// Which distances are measured, m.
    shown: Vec<f64>,
    reach: f64,
}

/// Distance, m, by which an object must be beside all rays to be left out: more than any rounding.
const BESIDE: f64 = 1e-6;

impl Rays {
    fn new(view: &View<'_>, directions: &[(f64, f64)], first: usize, count: usize) -> Self {
        let (sin, cos) = view.sensor.theta.sin_cos();
        let turned = |&(x, y): &(f64, f64)| (x * cos - y * sin, x * sin + y * cos);
        let (all, reach) = (directions.len(), view.reach);
        let directions: Vec<_> = directions[first..].iter().chain(directions).take(count).map(turned).collect();
        let (ends, shown) = (vec![reach; count], vec![f64::INFINITY; count]);
        Self { from: view.sensor.point(), all, first, directions, ends, shown, reach }
    }

    /// True if no ray can meet what is within `radius` of the line between two points: it is beyond their reach, or, if
    /// they are within half a turn, all of it is to the right of the first one or to the left of the last one.
    fn are_beside(&self, a: Point, b: Point, radius: f64) -> bool {
        let (Some(first), Some(last)) = (self.directions.first(), self.directions.last()) else { return true };
        let beside = radius + BESIDE;
        let far = self.reach + beside;
        let nearest = nearest(&Segment { a, b }, self.from);
        let (dx, dy) = (nearest.x - self.from.x, nearest.y - self.from.y);
        if dx * dx + dy * dy > far * far {
            return true;
        }
        let left_of = |(x, y): (f64, f64), to: Point| x * (to.y - self.from.y) - y * (to.x - self.from.x);
        let is_right = |to| left_of(*first, to) < -beside;
        let is_left = |to| left_of(*last, to) > beside;
        2 * self.directions.len() < self.all && (is_right(a) && is_right(b) || is_left(a) && is_left(b))
    }

    /// Looks at an object that is within `half` of the direction `middle`, rad. `show` says what is measured of a hit;
    /// none: the ray goes through.
    fn look(
        &mut self,
        (middle, half): (f64, f64),
        walls: &[Segment],
        columns: &[Column],
        show: impl Fn(Hit, (f64, f64)) -> Option<f64>,
    ) {
        let per_rad = self.all as f64 / TAU;
        let first = libm::floor((wrap(middle) + TAU - half) * per_rad) as usize;
        let count = (libm::ceil(2.0 * half * per_rad) as usize + 2).min(self.all);
        // Counted from the first ray.
        let first = (first + self.all - self.first) % self.all;
        let ends = [first..first + count, 0..(first + count).saturating_sub(self.all)];
        for ray in ends.into_iter().flat_map(|part| part.start..part.end.min(self.directions.len())) {
            let direction = self.directions[ray];
            let Some(hit) = first_hit(walls, columns, self.from, direction, self.ends[ray]) else { continue };
            if let Some(shown) = show(hit, direction) {
                (self.ends[ray], self.shown[ray]) = (hit.distance, shown);
            }
        }
    }
}

impl Scene {
    /// The body at the world's start; time counts from `start`.
    #[must_use]
    pub fn new(start: Instant, world: World, parameters: Parameters, sonar: Sonar, seed: u64) -> Self {
        let random = Random::stream(seed, u64::from_le_bytes(*b"the body"));
        let body = Body::drawn(parameters, world.start, random);
        let people = People::new(&world, seed, &body.hull());
        let mut past = VecDeque::with_capacity(MEMORY);
        past.push_back((0, body.pose()));
        let (contacts, cone, demand) = (Vec::new(), Cone::new(sonar), Demand::default());
        let stretch = cone.stretch(&mut Random::stream(seed, u64::from_le_bytes(*b"the air ")));
        Self { world, body, people, contacts, cone, stretch, seed, demand, start, steps: 0, past }
    }

    /// The same with a robot on these wheels, each with a motor.
    #[must_use]
    pub fn on_wheels(mut self, chassis: &Chassis) -> Self {
        self.body = self.body.on_wheels(chassis);
        self
    }

    /// The body.
    #[must_use]
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The world.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Instant of the next step.
    #[must_use]
    pub fn next_step(&self) -> Instant {
        Instant::from_nanos(self.start.as_nanos() + (self.steps + 1) * STEP_NS)
    }

    /// True if a step would change nothing.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.body.rests(&self.demand)
    }

    /// The people.
    #[must_use]
    pub fn people(&self) -> &People {
        &self.people
    }

    /// The contacts since it was asked last.
    pub fn take_contacts(&mut self) -> Vec<Contact> {
        std::mem::take(&mut self.contacts)
    }

    /// Goes on by one step.
    pub fn step(&mut self) {
        self.steps += 1;
        let before = self.body.clone();
        self.body.step(&self.world, &self.demand);
        if self.body.collisions() > before.collisions() {
            let robot_mps = before.fastest();
            self.contacts.push(Contact { mover: Mover::Robot, person: None, robot_mps, at: self.body.pose().point() });
        }
        self.meet(&before);
        if self.body.pose() != before.pose() {
            self.remember();
        }
    }

    fn remember(&mut self) {
        if self.past.len() == MEMORY {
            self.past.pop_front();
        }
        self.past.push_back((self.steps, self.body.pose()));
    }

    /// The people go on as far as the body is, and are met on the way from `before`.
    fn meet(&mut self, before: &Body) {
        let moment = self.steps * STEP_NS;
        if self.people.next_step() <= moment {
            self.people.step(&self.world, &self.body.hull());
        }
        if !self.people.may_meet(self.body.moved_since(before), STEP_NS as f64 / 1e9) {
            return;
        }
        let known = self.contacts.len();
        if self.people.meet(moment, &self.body.hull(), &mut self.contacts) {
            let anew = self.contacts[known..].iter().any(|contact| contact.mover == Mover::Robot);
            self.body.stop_at(before, anew);
        }
    }

    /// Leaves out the steps up to `now`, in which the body did nothing.
    pub fn skip(&mut self, now: Instant) {
        let passed = self.moment(now) / STEP_NS;
        while self.people.next_step() <= passed * STEP_NS {
            let moment = self.people.next_step();
            let hull = self.body.hull();
            self.people.step(&self.world, &hull);
            if self.people.may_meet(0.0, people::PERIOD.as_secs_f64()) {
                self.people.meet(moment, &hull, &mut self.contacts);
            }
        }
        self.steps = self.steps.max(passed);
    }

    /// Puts the robot there by hand; false, and nothing happens, where there is no room for it.
    pub fn put(&mut self, pose: Pose) -> bool {
        let mut body = self.body.clone();
        body.put(pose);
        let free = body.clearance(&self.world) > 0.0 && self.people.clearance(self.steps * STEP_NS, &body.hull()) > 0.0;
        if free {
            self.body = body;
            self.people.forget();
            self.remember();
        }
        free
    }

    /// Puts the robot somewhere, by the number of a draw; false where there is no such place.
    pub fn kidnap(&mut self, number: u64) -> bool {
        let floor = Floor::new(&self.world);
        let mut random = Random::stream(self.seed ^ number, u64::from_le_bytes(*b"kidnap  "));
        (0..1000).any(|_| {
            let place = floor.somewhere(&mut random);
            let heading = core::f64::consts::TAU * random.uniform();
            place.is_some_and(|place| {
                let pose = Pose::new(place.x, place.y, heading);
                let room = self.body.clearance_at(&self.world, pose);
                room > KIDNAP_ROOM && self.put(pose)
            })
        })
    }

    fn moment(&self, at: Instant) -> Moment {
        at.since(self.start).as_nanos() as u64
    }

    /// Distance of the body to the nearest wall, column or person, m; infinite without one.
    #[must_use]
    pub fn clearance(&self) -> f64 {
        let people = self.people.clearance(self.steps * STEP_NS, &self.body.hull());
        self.body.clearance(&self.world).min(people)
    }

    /// Distance of a rectangle from `rear` to `front` and `half_width` to each side at `pose`.
    #[must_use]
    pub fn clearance_of(&self, pose: Pose, rear: f64, front: f64, half_width: f64) -> f64 {
        let hull = Hull::new(pose, (rear, front, half_width), Twist::ZERO);
        let people = self.people.clearance(self.steps * STEP_NS, &hull);
        self.world.clearance(pose, rear, front, half_width).min(people)
    }

    /// Distance of a shape in the frame of `pose`.
    #[must_use]
    pub fn clearance_of_shape(&self, pose: Pose, shape: &Shape) -> f64 {
        let extent = (shape.rear(), shape.front(), shape.half_width());
        let hull = Hull::new(pose, extent, Twist::ZERO).shaped(Some(*shape));
        let people = self.people.clearance(self.steps * STEP_NS, &hull);
        self.world.clearance_of_shape(pose, shape).min(people)
    }

    /// Pose of the body at a recent instant.
    #[must_use]
    pub fn pose_at(&self, at: Instant) -> Pose {
        let step = self.moment(at) / STEP_NS;
        let known = self.past.iter().rev().find(|(from, _)| *from <= step);
        known.or(self.past.front()).map_or(self.body.pose(), |(_, pose)| *pose)
    }

    /// Reflector of the sound of a sonar at `mount` on the robot, fired at `at`. The same call has the same result,
    /// here and below: randomness comes from a stream of its own.
    #[must_use]
    pub fn echo(&self, mount: Pose, at: Instant, stream: u64) -> Option<Echo> {
        let sensor = self.pose_at(at) * mount;
        let people = self.people.legs(self.moment(at), sensor.point(), LEGS_WITHIN);
        self.cone.echo(&self.world, people, sensor, &mut Random::stream(self.seed, stream))
    }

    /// What surrounds a lidar at `mount` on the robot at an instant, up to `reach` m: walls, columns, legs.
    #[must_use]
    pub(crate) fn view(&self, mount: Pose, at: Instant, reach: f64) -> View<'_> {
        let sensor = self.pose_at(at) * mount;
        let (mut legs, mut dark) = (Vec::new(), Vec::new());
        for (person, pair) in self.people.legs_by_person(self.moment(at), sensor.point(), reach + LEG) {
            let seen = if self.is_dark(person) { &mut dark } else { &mut legs };
            seen.extend(pair.map(|centre| Column { centre, radius: LEG }));
        }
        View { world: &self.world, legs, dark, sensor, reach }
    }

    /// True if a person wears black trousers.
    fn is_dark(&self, person: usize) -> bool {
        let share = self.world.people.dark;
        share > 0.0 && self.random(person as u64 ^ u64::from_le_bytes(*b"trousers")).uniform() < share
    }

    /// Distance at which a sonar at `mount` received the sound of another one sent at `at`, m.
    #[must_use]
    pub fn overheard(&self, mount: Pose, at: Instant, other: &Echo, stream: u64) -> Option<f64> {
        self.cone.overheard(&self.world, self.pose_at(at) * mount, other, &mut Random::stream(self.seed, stream))
    }

    /// Reading of a sonar whose first echo was at this distance, m.
    #[must_use]
    pub fn reading(&self, heard: Option<f64>, stream: u64) -> Option<f64> {
        self.cone.measure(heard, self.stretch, &mut Random::stream(self.seed, stream))
    }

    /// Middles and radii of all people at a recent instant.
    pub fn people_at(&self, at: Instant) -> impl Iterator<Item = (Point, f64)> + '_ {
        self.people.at(self.moment(at))
    }

    /// Number of people between two points at a recent instant.
    #[must_use]
    pub fn people_between(&self, at: Instant, a: Point, b: Point) -> usize {
        self.people.between(self.moment(at), a, b)
    }

    /// A sequence of its own for each `stream`: the same question has the same answer.
    #[must_use]
    pub fn random(&self, stream: u64) -> Random {
        Random::stream(self.seed, stream)
    }

    /// Reading of a floor ranger at `mount` on the robot, m.
    #[must_use]
    pub fn ranger(&self, mount: Point, stream: u64) -> Option<f64> {
        let at = self.body.pose() * mount;
        floor_distance(&self.world, at, RANGER_HEIGHT, &mut Random::stream(self.seed, stream))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put_at(scene: &mut Scene, x: f64, y: f64) -> bool {
        scene.put(Pose::new(x, y, 1.0))
    }

    #[test]
    fn what_is_looked_for_where_it_can_be_is_what_a_ray_in_each_direction_meets() {
        let point = |x, y| Point { x, y };
        let mut hall = World::hall(20.0, 12.0);
        let wall = |a, b| Segment { a, b };
        hall.walls.extend([wall(point(6.0, 0.0), point(6.0, 8.0)), wall(point(9.0, 3.0), point(15.0, 7.0))]);
        hall.columns.extend([(3.0, 9.0), (14.0, 10.0)].map(|(x, y)| Column { centre: point(x, y), radius: 0.3 }));
        hall.places = vec![point(2.0, 2.0), point(18.0, 10.0), point(10.0, 1.0)];
        hall.people.count = 12;
        let directions: Vec<(f64, f64)> =
            (0..720).map(|n| libm::sincos(f64::from(n) * TAU / 720.0)).map(|(sin, cos)| (cos, sin)).collect();
        let mut random = Random::stream(3, 1);
        for n in 0..40 {
            let (x, y) = (0.5 + 19.0 * random.uniform(), 0.5 + 11.0 * random.uniform());
            let world = World { start: Pose::new(x, y, TAU * random.uniform()), ..hall.clone() };
            let scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), n);
            let view = scene.view(Pose::new(0.3, -0.1, 0.4), Instant::ZERO, 12.0);
            let from = view.sensor.point();
            for (place, distance) in view.distances(&directions, (0, 720)).into_iter().enumerate() {
                let (sin, cos) = (view.sensor.theta + place as f64 * TAU / 720.0).sin_cos();
                let still = view.world.ray(from, (cos, sin), 12.0).map_or(12.0, |hit| hit.distance);
                let leg = first_hit(&[], &view.legs, from, (cos, sin), still).map_or(still, |hit| hit.distance);
                let off = distance.min(12.0) - leg;
                assert!(off.abs() < 1e-6, "{n}: {place}: {distance}, by a ray {leg}");
            }
            // The same to the last bit, if only some are looked at.
            let all = view.distances(&directions, (0, 720));
            for count in [1, 40, 212, 359, 360, 500, 720] {
                let first = (720.0 * random.uniform()) as usize;
                let some: Vec<f64> = (first..first + count).map(|place| all[place % 720]).collect();
                assert_eq!(view.distances(&directions, (first, count)), some, "{n}: {count} from {first} on");
            }
        }
    }

    /// What a lidar at (5, 6) of a hall of 20 m by 12 m, looking along x, sees in whole degrees up to 12 m.
    fn seen(change: impl Fn(&mut World)) -> Vec<f64> {
        let mut world = World::hall(20.0, 12.0);
        world.start = Pose::new(5.0, 6.0, 0.0);
        change(&mut world);
        let scene = Scene::new(Instant::ZERO, world.with_surfaces(), Parameters::default(), Sonar::default(), 1);
        let directions: Vec<(f64, f64)> =
            (0..360).map(|n| libm::sincos(f64::from(n).to_radians())).map(|(sin, cos)| (cos, sin)).collect();
        scene.view(Pose::default(), Instant::ZERO, 12.0).distances(&directions, (0, 360))
    }

    fn wall(a: (f64, f64), b: (f64, f64)) -> Segment {
        Segment { a: Point { x: a.0, y: a.1 }, b: Point { x: b.0, y: b.1 } }
    }

    #[test]
    fn a_lidar_looks_through_glass_but_not_straight() {
        let glass = seen(|world| world.glass.push(wall((5.0, 8.0), (1.0, 8.0))));
        let matt = seen(|world| world.walls.push(wall((5.0, 8.0), (1.0, 8.0))));
        let none = seen(|_| ());
        assert!((glass[93] - matt[93]).abs() < 1e-9 && (matt[93] - 2.0).abs() < 0.01, "{}", glass[93]);
        for degrees in [95, 110, 130] {
            assert!(glass[degrees] == none[degrees] && glass[degrees] > matt[degrees] + 1.0, "{degrees}");
        }
    }

    #[test]
    fn a_lidar_sees_black_from_near_only_and_it_hides_what_is_behind() {
        // 3.5 m away, of a reach of 12 m.
        let black = seen(|world| world.black.push(wall((8.5, 0.0), (8.5, 12.0))));
        assert!((black[0] - 3.5).abs() < 1e-9, "{}", black[0]);
        assert!(black[30] == f64::INFINITY, "4.04 m by the ray, the wall behind it is at 6.9 m: {}", black[30]);
        let trousers = |dark| {
            seen(|world| {
                world.places = vec![Point { x: 8.0, y: 6.0 }, Point { x: 14.0, y: 6.0 }];
                world.people = crate::world::Crowd { count: 40, dark, ..crate::world::Crowd::default() };
            })
        };
        let (bright, dark) = (trousers(0.0), trousers(1.0));
        let differ = bright.iter().zip(&dark).filter(|(bright, dark)| bright != dark).collect::<Vec<_>>();
        assert!(!differ.is_empty() && differ.iter().all(|(bright, dark)| **bright > 4.0 && **dark == f64::INFINITY));
        assert!(bright.iter().zip(&dark).any(|(bright, dark)| bright == dark && *bright < 3.9), "seen from near");
    }

    #[test]
    fn a_mirror_shows_what_is_before_it_behind_it() {
        // 2 m to the left, and long: the wall 6 m to the right is seen in it.
        let shiny = seen(|world| world.shiny.push(wall((0.0, 8.0), (20.0, 8.0))));
        assert!((shiny[90] - 2.0).abs() < 1e-9, "straight: itself");
        let (sin, _) = libm::sincos(60f64.to_radians());
        assert!((shiny[60] - (2.0 + 8.0) / sin).abs() < 1e-3, "{}", shiny[60]);
        assert_eq!(shiny[45], f64::INFINITY, "2.8 m to it, and 11.3 m on");
    }

    #[test]
    fn a_robot_that_is_carried_off_is_elsewhere_and_its_wheels_have_not_turned() {
        let world = World::hall(20.0, 12.0);
        let mut scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 1);
        scene.demand = Demand::speed(0.5);
        for _ in 0..100 {
            scene.step();
        }
        let (ticks, before) = (scene.body().ticks(), scene.body().pose());
        assert!(!put_at(&mut scene, 19.8, 6.0) && scene.body().pose() == before, "there is a wall");
        assert!(put_at(&mut scene, 3.0, 4.0));
        assert_eq!(
            (scene.body().pose(), scene.body().ticks(), scene.body().speed()),
            (Pose::new(3.0, 4.0, 1.0), ticks, 0.0)
        );
        let mut poses: Vec<_> = (0..20)
            .map(|number| {
                assert!(scene.kidnap(number) && scene.clearance() > 0.3);
                let Pose { x, y, .. } = scene.body().pose();
                (x * 1000.0) as i64 * 100_000 + (y * 1000.0) as i64
            })
            .collect();
        let last = scene.body().pose();
        assert!(scene.kidnap(3) && scene.kidnap(19) && scene.body().pose() == last, "by its number");
        poses.sort_unstable();
        poses.dedup();
        assert!(poses.len() > 15, "{poses:?}");
    }

    #[test]
    fn a_robot_that_runs_into_somebody_stops_and_its_bumper_is_pressed() {
        let mut world = World::hall(20.0, 12.0);
        world.places = vec![Point { x: 10.0, y: 6.0 }, Point { x: 10.0, y: 6.5 }];
        // Nobody looks: all that they do is stop at their feet.
        world.people = crate::world::Crowd { count: 60, attentive: 0.0, ..crate::world::Crowd::default() };
        let mut scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 2);
        let (mut blocked, mut contacts) = (0, Vec::new());
        for step in 0..40_000 {
            let forward = (step / 800) % 2 == 0;
            scene.demand = Demand::speed(if forward { 0.8 } else { -0.8 });
            let before = scene.body().pose();
            scene.step();
            assert!(scene.people().is_empty() || scene.clearance() >= 0.0);
            let new = scene.take_contacts();
            if scene.body().is_blocked() {
                blocked += 1;
                assert!(scene.body().speed() == 0.0 && scene.body().pose() == before);
            }
            let walls = new.iter().filter(|contact| contact.person.is_none()).count();
            assert!(walls == 0 || scene.body().is_blocked(), "{new:?}");
            contacts.extend(new);
        }
        let robots = contacts.iter().filter(|contact| contact.mover == Mover::Robot);
        assert_eq!(u32::try_from(robots.count()).unwrap(), scene.body().collisions(), "{contacts:?}");
        assert!(blocked > 0 && scene.body().collisions() > 3, "{contacts:?}");
        for contact in &contacts {
            assert!((contact.mover == Mover::Robot) == (contact.robot_mps > people::TOWARDS), "{contact}");
        }
    }

    #[test]
    fn it_remembers_where_it_was() {
        let start = Instant::from_millis(3);
        let mut scene = Scene::new(start, World::hall(20.0, 12.0), Parameters::default(), Sonar::default(), 1);
        scene.demand = Demand::speed(0.5);
        let mut true_pose = vec![(start, scene.body().pose())];
        for _ in 0..400 {
            let at = scene.next_step();
            scene.step();
            true_pose.push((at, scene.body().pose()));
        }
        for (at, pose) in &true_pose[true_pose.len() - 60..] {
            assert_eq!(scene.pose_at(*at), *pose);
        }
        // Standing still leaves no trace and needs none.
        scene.demand = Demand::default();
        while !scene.rests() {
            scene.step();
        }
        let rest = scene.body().pose();
        let later = scene.next_step() + base::Duration::from_secs(10);
        scene.skip(later);
        assert!(scene.next_step() > later);
        assert_eq!(scene.pose_at(later), rest);
    }
}
