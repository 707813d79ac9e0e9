//! Planner with a simulated base that turns on the spot or goes sideways, on a map, in virtual time.

use super::*;
use crate::map::{Field, Map, Unknown};
use crate::path::Move;
use crate::search::{Abilities, Footprint};
use core::f64::consts::{FRAC_PI_2, PI};
use messages::lowlevel::{DataGuard, DataVelocity};
use messages::middlelevel::CmdMode;

const COURIER: Body = Body { wheelbase: 0.30, front: 0.35, rear: 0.35, width: 0.50, shape: None };
const TURNS: Abilities = Abilities { turns: true, sideways: false };
const ALL: Abilities = Abilities { turns: true, sideways: true };
const OF_COURIER: Limits = Limits {
    speed: 0.5,
    steering: 0.9,
    steering_rate: 2.0,
    acceleration: 0.5,
    deceleration: 0.8,
    lateral_acceleration: 0.8,
    rotation: 1.2,
};

struct Wheels {
    bench: Bench,
    abilities: Abilities,
    field: Field,
    pose: Pose,
    /// Velocity, and the commanded one: m/s forward and to the left, rad/s.
    velocity: [f64; 3],
    command: [f64; 3],
    /// Greatest commanded value of each.
    greatest: [f64; 3],
    session: Option<i64>,
    ticks: i64,
    goal: DataGoal,
    /// What a guard permits at a pose, in the order of `LL_DATA_GUARD`; the driver takes of a velocity what it leaves
    /// of all its parts.
    permits: Option<fn(Pose) -> [f64; 6]>,
    /// All texts about goals, each once in succession.
    texts: Vec<String>,
}

impl Wheels {
    /// In a room of 10 m by 8 m with these walls.
    fn new(abilities: Abilities, start: Pose, walls: &[[f64; 4]]) -> Self {
        let mut map = Map::around((0.0, 0.0), (10.0, 8.0), 0.05).expect("a map");
        walls.iter().for_each(|&[ax, ay, bx, by]| map.wall((ax, ay), (bx, by)));
        let config = Config {
            body: COURIER,
            limits: OF_COURIER,
            behaviour: Behaviour::default(),
            law: guard::law::Law { reaction: 0.37, braking: 0.8, worst: 0.15, approach: 1.6, slow: 0.3 },
            sonar_beam: 0.96,
            age_max: Duration::from_millis(600),
            has_sonars: false,
            abilities,
            map: Some(map.clone()),
            home: None,
        };
        let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(Planner::new(config))));
        bench.start();
        let field = Field::new(&map, Unknown::Blocked);
        let (goal, zero) = (DataGoal::default(), [0.0; 3]);
        let (velocity, command, greatest) = (zero, zero, zero);
        let (session, ticks, permits, texts) = (None, 0, None, Vec::new());
        Self { bench, abilities, field, pose: start, velocity, command, greatest, session, ticks, goal, permits, texts }
    }

    fn step(&mut self) {
        let dt = STEP.as_secs_f64();
        let bounds = self.permits.map_or([f64::INFINITY; 6], |permits| permits(self.pose));
        let left = |part: usize| {
            let bound = bounds[2 * part + usize::from(self.command[part] < 0.0)];
            if self.command[part].abs() <= bound { 1.0 } else { bound / self.command[part].abs() }
        };
        let left = (0..3).map(left).fold(1.0, f64::min);
        for (part, most) in [0.8, 0.8, 2.0].into_iter().enumerate() {
            self.velocity[part] += (left * self.command[part] - self.velocity[part]).clamp(-most * dt, most * dt);
        }
        let [vx, vy, omega] = self.velocity;
        // Wheels that are unequal: motion to the side turns the robot.
        let omega = omega + 0.02 * vy;
        let along = self.pose.along(Moved { translation: vx * dt, rotation: omega * dt });
        self.pose = Move::Aside(vy * dt).from(along);
        let Body { front, rear, width, .. } = COURIER;
        let footprint = Footprint { length_m: front + rear, width_m: width, rear_m: rear };
        assert!(footprint.is_free(&self.field, self.pose), "touches at {:?}", self.pose);
        self.ticks += 1;
        if self.ticks % 5 == 0 {
            let (x, y, theta, timestamp) = (self.pose.x, self.pose.y, self.pose.theta.radians(), self.ticks);
            let quality = DataEstimate::FINE;
            let estimate =
                DataEstimate { timestamp, x, y, theta, speed: vx, rotation: omega, quality, ..Default::default() };
            self.bench.message(estimate);
        }
        if self.ticks % 5 == 3 && self.permits.is_some() {
            let [forward, backward, left, right, turn_left, turn_right] = bounds;
            let guard = DataGuard { forward, backward, left, right, turn_left, turn_right, ..Default::default() };
            self.bench.message(guard);
        }
        if self.ticks % 5 == 1 {
            let (timestamp, module, source) = (1, "driver_canbus".into(), NAME.into());
            self.bench.message(DataHold { timestamp, module, holds: Vec::new() });
            self.bench.message(DataMotion { speed: vx, source, homed: true, ..Default::default() });
            self.bench.message(DataVelocity { vx, vy, omega, ..Default::default() });
        }
        self.bench.pass(STEP);
        for message in self.bench.published() {
            let command = match message {
                Message::LlCmdMotion(command) => {
                    assert!(command.speed != 0.0, "zero is a velocity of such a base");
                    [command.speed, 0.0, command.speed * libm::tan(command.steering) / COURIER.wheelbase]
                }
                Message::LlCmdVelocity(command) => {
                    assert!(self.session.is_none_or(|session| session == command.session));
                    self.session = Some(command.session);
                    let velocity = [command.vx, command.vy, command.omega];
                    assert!(velocity.iter().filter(|part| **part != 0.0).count() <= 1, "one motion: {velocity:?}");
                    assert!(command.vy == 0.0 || self.abilities.sideways);
                    if command.omega != 0.0 || command.vy != 0.0 {
                        assert!(self.velocity[0].abs() < 0.05, "at {} m/s", self.velocity[0]);
                    }
                    self.greatest[1] = self.greatest[1].max(command.vy.abs());
                    self.greatest[2] = self.greatest[2].max(command.omega.abs());
                    velocity
                }
                Message::MlDataGoal(goal) => {
                    if self.texts.last() != Some(&goal.message) {
                        self.texts.push(goal.message.clone());
                    }
                    self.goal = goal;
                    continue;
                }
                _ => continue,
            };
            assert!(command[2].abs() <= OF_COURIER.rotation + 1e-9, "{command:?}");
            self.command = command;
        }
    }

    /// Drives to a goal with a heading; the time that it took, s.
    #[track_caller]
    fn go(&mut self, to: Pose, seconds: f64) -> f64 {
        let waypoint = Waypoint { x: to.x, y: to.y, theta: to.theta.radians(), tolerance: 0.0, heading: true };
        let id = self.goal.id + 1;
        self.bench.message(CmdGoal { id, waypoints: vec![waypoint], ..Default::default() });
        self.greatest = [0.0; 3];
        for n in 0..(seconds * 100.0) as u32 {
            self.step();
            if (self.goal.id, self.goal.status) == (id, DataGoal::REACHED) {
                let (off, turned) = (self.pose.point().distance(to.point()), (self.pose.theta - to.theta).radians());
                assert!(off < 0.12 && turned.abs() < crate::goal::HEADING_TOLERANCE_RAD, "{off} m, {turned} rad off");
                assert!(self.velocity.iter().all(|part| part.abs() < 0.05), "{:?}", self.velocity);
                return f64::from(n) / 100.0;
            }
            assert!(self.goal.status != DataGoal::FAILED, "{:?}", self.goal);
        }
        panic!("after {seconds} s at {:?}: {:?}", self.pose, self.goal);
    }

    fn turns(&self) -> bool {
        self.greatest[2] > 0.3
    }

    fn slides(&self) -> bool {
        self.greatest[1] > 0.1
    }
}

#[test]
fn the_opposite_heading_is_reached_by_a_turn_on_the_spot() {
    for abilities in [TURNS, ALL] {
        let mut robot = Wheels::new(abilities, Pose::new(5.0, 4.0, 0.0), &[]);
        let time = robot.go(Pose::new(5.0, 4.0, PI), 12.0);
        assert!(robot.turns() && !robot.slides(), "{:?}", robot.greatest);
        assert!(robot.greatest[2] <= OF_COURIER.rotation + 1e-9 && time < 8.0, "{:?} {time}", robot.greatest);
        // And with a way before it.
        robot.go(Pose::new(2.0, 4.0, 0.0), 25.0);
    }
}

#[test]
fn out_of_a_dead_end_it_turns_around_and_drives_ahead() {
    let walls = [[0.0, 3.35, 2.5, 3.35], [0.0, 4.65, 2.5, 4.65], [0.6, 3.35, 0.6, 4.65]];
    for abilities in [TURNS, ALL] {
        let mut robot = Wheels::new(abilities, Pose::new(1.3, 4.0, PI), &walls);
        robot.go(Pose::new(7.0, 4.0, 0.0), 30.0);
        assert!(robot.turns(), "{:?}", robot.greatest);
    }
}

#[test]
fn into_a_bay_and_out_of_it_one_that_can_goes_sideways() {
    let walls = [[4.4, 3.4, 4.4, 4.4], [4.4, 3.4, 5.6, 3.4], [5.6, 3.4, 5.6, 4.4]];
    let mut robot = Wheels::new(ALL, Pose::new(5.0, 5.4, 0.0), &walls);
    for y in [4.0, 5.4] {
        robot.go(Pose::new(5.0, y, 0.0), 30.0);
        assert!(robot.slides(), "{:?}", robot.greatest);
    }
}

#[test]
fn several_goals_in_a_room_with_walls_are_reached_by_each_base() {
    let walls = [[3.0, 0.0, 3.0, 5.0], [6.5, 3.0, 6.5, 8.0]];
    for abilities in [TURNS, ALL] {
        let mut robot = Wheels::new(abilities, Pose::new(1.5, 1.5, 0.0), &walls);
        for (x, y, theta) in [(1.0, 4.0, -FRAC_PI_2), (5.0, 1.5, FRAC_PI_2), (8.5, 6.5, PI), (1.5, 1.5, 0.0)] {
            robot.go(Pose::new(x, y, theta), 60.0);
        }
    }
}

/// Readings of eight sonars around the courier, for a leg at this point of the map.
fn around(robot: Pose, leg: Point, timestamp: i64) -> DataRanges {
    let reading = |id: i32| {
        let theta = f64::from(id) * core::f64::consts::FRAC_PI_4;
        let (sin, cos) = libm::sincos(theta);
        let to_edge = (COURIER.front / cos.abs()).min(COURIER.width / 2.0 / sin.abs());
        let (x, y) = (to_edge * cos, to_edge * sin);
        let mount = robot * Pose::new(x, y, theta);
        let (distance, bearing) =
            (mount.point().distance(leg), libm::atan2(leg.y - mount.y, leg.x - mount.x) - mount.theta.radians());
        let hears = wrap(bearing).abs() < 0.48 && distance < 2.5;
        let (status, distance) = if hears { (Reading::MEASURED, distance) } else { (Reading::SILENT, f64::NAN) };
        Reading { timestamp, id, kind: Reading::SONAR, status, distance, x, y, theta, beam: 0.96 }
    };
    DataRanges { timestamp, readings: (0..8).map(reading).collect() }
}

#[test]
fn one_that_waits_turns_to_a_person_who_comes_near_and_stays_at_its_place() {
    let start = Pose::new(5.0, 4.0, 0.0);
    let mut robot = Wheels::new(TURNS, start, &[]);
    robot.bench.message(CmdMode { mode: CmdMode::WAIT, ..Default::default() });
    let person = Point { x: 5.0, y: 5.2 };
    let off = |robot: &Wheels| {
        let bearing = libm::atan2(person.y - robot.pose.y, person.x - robot.pose.x);
        wrap(bearing - robot.pose.theta.radians()).abs()
    };
    for n in 0..2000 {
        robot.step();
        if n % 20 == 0 {
            let timestamp = (robot.bench.now().as_nanos() / 1000) as i64;
            let ranges = around(robot.pose, person, timestamp);
            robot.bench.message(ranges);
        }
        if n > 500 && off(&robot) < 0.3 && robot.velocity.iter().all(|part| part.abs() < 0.01) {
            assert!(robot.greatest[2] > 0.0 && robot.pose.point().distance(start.point()) < 0.15, "{:?}", robot.pose);
            return;
        }
    }
    panic!("{} rad off at {:?}: {:?}", off(&robot), robot.pose, robot.goal);
}

#[test]
fn an_unknown_velocity_begins_no_other_motion() {
    let mut senses = Senses::default();
    assert_eq!(senses.motion_of_wheels(0.4, 4.0).speed, f64::INFINITY);
    let velocity = |vx, vy, omega| DataVelocity { vx, vy, omega, ..Default::default() };
    for (sent, axis, speed) in [
        (velocity(0.2, 0.0, 1.0), Axis::Along, 0.2),
        (velocity(0.0, 0.0, -1.0), Axis::Spot, -0.4),
        (velocity(0.02, 0.0, 0.08), Axis::Along, 0.02),
        (velocity(0.01, -0.2, 0.1), Axis::Aside, -0.2),
        (velocity(0.0, f64::NAN, 0.0), Axis::Spot, f64::INFINITY),
    ] {
        senses.on_velocity(&sent);
        let motion = senses.motion_of_wheels(0.4, 4.0);
        assert!(motion.axis == axis && motion.speed == speed, "{sent:?}: {motion:?}");
    }
}

/// What a guard permits before a wall that is not on the map, 7 cm ahead of a courier at (5, 4) that looks along x.
fn before_a_wall(robot: Pose) -> [f64; 6] {
    let (wall, (sin, cos)) = (5.42, robot.theta.sin_cos());
    let side = COURIER.width / 2.0;
    let ahead = (0.35 * cos.abs()) + side * sin.abs();
    let gap = wall - robot.x - ahead;
    let turn = if wall - robot.x > COURIER.arm() + 0.05 { 1.0 } else { 0.0 };
    let towards = if gap < 0.10 { 0.0 } else { 0.3 };
    let away = if gap < 0.10 { 0.1 } else { 0.3 };
    let [forward, backward] = if cos >= 0.0 { [towards, away] } else { [away, towards] };
    [forward, backward, 0.0, 0.0, turn, turn]
}

/// Time until the robot has moved by 2 cm, and the number of times that it reversed, while it drives to a goal.
#[track_caller]
fn leaves(robot: &mut Wheels, to: Pose, seconds: f64) -> (f64, u32) {
    let (start, mut first, mut sign, mut reversals) = (robot.pose.point(), None, 0.0, 0);
    let waypoint = Waypoint { x: to.x, y: to.y, theta: to.theta.radians(), tolerance: 0.0, heading: true };
    robot.bench.message(CmdGoal { id: 1, waypoints: vec![waypoint], ..Default::default() });
    for n in 0..(seconds * 100.0) as u32 {
        robot.step();
        let vx = robot.velocity[0];
        if vx.abs() > 0.03 && vx.signum() != sign {
            (reversals, sign) = (reversals + u32::from(sign != 0.0), vx.signum());
        }
        if robot.pose.point().distance(start) > 0.02 {
            first.get_or_insert(f64::from(n) / 100.0);
        }
        if robot.goal.status == DataGoal::REACHED {
            return (first.expect("it has moved"), reversals);
        }
        assert!(robot.goal.status != DataGoal::FAILED, "{:?}", robot.texts);
    }
    panic!("after {seconds} s at {:?}: {:?}", robot.pose, robot.texts);
}

#[test]
fn where_it_may_not_turn_it_backs_away_straight_until_it_can() {
    for (abilities, to) in [
        (TURNS, Pose::new(3.5, 6.5, FRAC_PI_2)),
        (TURNS, Pose::new(3.5, 1.5, -FRAC_PI_2)),
        (TURNS, Pose::new(2.0, 4.0, PI)),
        (TURNS, Pose::new(2.0, 5.0, 0.0)),
        (ALL, Pose::new(3.5, 6.5, FRAC_PI_2)),
    ] {
        let mut robot = Wheels::new(abilities, Pose::new(5.0, 4.0, 0.0), &[]);
        robot.permits = Some(before_a_wall);
        let (first, reversals) = leaves(&mut robot, to, 60.0);
        // The planner does not know the wall: its next way may lead towards it once more.
        assert!(first < 6.0 && reversals <= 3, "to {to:?}: after {first} s, {reversals} times: {:?}", robot.texts);
        let backs_out = robot.texts.iter().filter(|text| *text == "backs out").count();
        assert!(backs_out <= 2, "{:?}", robot.texts);
    }
}

#[test]
fn with_something_behind_it_makes_room_ahead() {
    let mut robot = Wheels::new(TURNS, Pose::new(5.0, 4.0, PI), &[]);
    robot.permits = Some(before_a_wall);
    let (first, reversals) = leaves(&mut robot, Pose::new(3.5, 6.5, FRAC_PI_2), 60.0);
    assert!(first < 4.0 && reversals <= 2, "after {first} s, {reversals} times: {:?}", robot.texts);
}

#[test]
fn where_it_may_not_move_at_all_it_stands_and_gives_up() {
    let start = Pose::new(5.0, 4.0, 0.0);
    let mut robot = Wheels::new(TURNS, start, &[]);
    robot.permits = Some(|_| [0.0; 6]);
    let waypoint = Waypoint { x: 5.0, y: 6.5, theta: 0.0, tolerance: 0.0, heading: false };
    robot.bench.message(CmdGoal { id: 1, waypoints: vec![waypoint], ..Default::default() });
    for _ in 0..12_000 {
        robot.step();
        if robot.goal.status == DataGoal::FAILED {
            assert_eq!(robot.pose, start);
            return;
        }
    }
    panic!("{:?}", robot.texts);
}

#[test]
fn where_no_turn_is_ever_permitted_making_room_ends() {
    let mut robot = Wheels::new(TURNS, Pose::new(5.0, 4.0, 0.0), &[]);
    robot.permits = Some(|_| [0.3, 0.3, 0.0, 0.0, 0.0, 0.0]);
    let waypoint = Waypoint { x: 5.0, y: 6.5, theta: 0.0, tolerance: 0.0, heading: false };
    robot.bench.message(CmdGoal { id: 1, waypoints: vec![waypoint], ..Default::default() });
    for _ in 0..30_000 {
        robot.step();
        if robot.goal.status == DataGoal::FAILED {
            assert!(robot.pose.point().distance(Point { x: 5.0, y: 4.0 }) < 4.0, "{:?}", robot.pose);
            return;
        }
    }
    panic!("{:?}", robot.texts);
}
