//! Planner with a simulated robot among discs, in virtual time.

use super::*;
use crate::config::{Behaviour, Body, Limits};
use kinematics::Direction;
use messages::Hold;
use messages::lowlevel::{self, DataHold, DataMotion, DataRanges, DataSrfs, EventStop, Reading};
use messages::middlelevel::{DataParameters, Waypoint};
use module::bench::Bench;
use module::{Shell, ShellConfig};
use navitools::{Motion as Moved, Point, Pose, wrap};
use settings::Section;
use std::ops::Range;

const BODY: Body = Body { wheelbase: 0.60, front: 0.75, rear: 0.15, width: 0.60, shape: None };
const LIMITS: Limits = Limits {
    speed: 0.8,
    steering: 0.6109,
    steering_rate: 0.698,
    acceleration: 0.5,
    deceleration: 0.8,
    lateral_acceleration: 0.8,
    rotation: f64::INFINITY,
};
/// Mounting of the sonars as on the reference robot.
/// Degrees.
const SRFS: [(f64, f64, f64); 16] = [
    (0.73, 0.28, 60.0),
    (0.75, 0.15, 25.0),
    (0.75, 0.0, 0.0),
    (0.75, -0.15, -25.0),
    (0.73, -0.28, -60.0),
    (0.60, 0.30, 90.0),
    (0.30, 0.30, 90.0),
    (0.60, -0.30, -90.0),
    (0.30, -0.30, -90.0),
    (0.0, -0.30, -90.0),
    (-0.13, -0.28, -120.0),
    (-0.15, -0.15, -155.0),
    (-0.15, 0.0, 180.0),
    (-0.15, 0.15, 155.0),
    (-0.13, 0.28, 120.0),
    (0.0, 0.30, 90.0),
];
const STEP: Duration = Duration::from_millis(10);

struct Robot {
    bench: Bench,
    pose: Pose,
    speed: f64,
    steering: f64,
    command: Motion,
    commanded_at: Instant,
    /// Cause that `driver_canbus` reports against motion.
    stands: Option<Hold>,
    /// Causes for which the planner waits, as it publishes them.
    holds: DataHold,
    discs: Vec<(Point, f64)>,
    /// Size of the hall whose walls return echoes, m.
    walls: Option<(f64, f64)>,
    ticks: u64,
    blind: bool,
    /// Closest distance of the moving body from a disc, m.
    nearest: f64,
    goal: DataGoal,
    /// All messages about goals that failed.
    failed: Vec<DataGoal>,
    commands: u32,
    lost: bool,
    deaf: bool,
    /// The drives keep their speed whatever is commanded.
    pushed: bool,
    /// Ticks between two range messages.
    poll: u64,
    /// Sonars whose state is unknown.
    dead: Range<usize>,
    /// The robot's guard, and what it last permitted, forward and backward; the driver clamps to it.
    guard: Bench,
    bounds: [f64; 2],
    /// What is permitted by pose and steering, instead of by the guard.
    permits: Option<fn(Pose, f64) -> [f64; 2]>,
    /// Sends `LL_DATA_SRFS` instead of `LL_DATA_RANGES`.
    old: bool,
    /// Distance that each sonar measures in its slot and measured in its last finished one, and its firing time.
    firing: [(i64, f64); 16],
    measured_last: [(i64, f64); 16],
    /// Sensed points, of all messages.
    sensed: Vec<Point>,
    /// People, as published since they were last taken out.
    persons: Vec<DataPersons>,
    /// Operation mode and parameters, as last published.
    mode: DataMode,
    parameters: DataParameters,
    /// Numbers of all reports.
    reports: Vec<i32>,
}

/// The guard of the reference robot.
fn guarding() -> Bench {
    let Body { front, rear, width, .. } = BODY;
    let corner = |(x, y)| Point { x, y };
    let sensor = |(id, &(x, y, degrees)): (usize, &(f64, f64, f64))| guard::Sonar {
        id: id as i32,
        at: Point { x, y },
        theta: degrees.to_radians(),
        beam: 0.96,
    };
    let config = guard::Config {
        settings: guard::Settings { ranging: guard::Ranging::Sonar, ..guard::Settings::usual() },
        footprint: [(-rear, -width / 2.0), (front, -width / 2.0), (front, width / 2.0), (-rear, width / 2.0)]
            .map(corner)
            .into(),
        sonars: SRFS.iter().enumerate().map(sensor).collect(),
        lidars: Vec::new(),
        base: guard::Ackermann { wheelbase: BODY.wheelbase, steering: LIMITS.steering, steering_rate: 0.698 }.into(),
        braking: LIMITS.deceleration,
        power_lost: 1.5,
        speed: 1.2,
    };
    let guard = guard::Guard::new(&config).expect("an outline");
    let mut bench = Bench::new(Shell::new(ShellConfig::new(guard::NAME), Box::new(guard)));
    bench.start();
    bench
}

impl Robot {
    fn new() -> Self {
        Self::on(None)
    }

    /// On the floor of this map: the hall, or one with further walls that no sonar comes near.
    fn on(map: Option<crate::map::Map>) -> Self {
        Self::with(map, None)
    }

    /// The same with a home place.
    fn with(map: Option<crate::map::Map>, home: Option<Pose>) -> Self {
        Self::made(map, home, Behaviour::default())
    }

    /// On the floor of the hall, with this behaviour.
    fn behaving(behaviour: Behaviour) -> Self {
        Self::made(None, None, behaviour)
    }

    fn made(map: Option<crate::map::Map>, home: Option<Pose>, behaviour: Behaviour) -> Self {
        let walls = map.as_ref().map(|_| (12.0, 6.0));
        let config = Config {
            body: BODY,
            limits: LIMITS,
            behaviour,
            law: guard::law::Law { reaction: 0.37, braking: 0.8, worst: 0.8, approach: 1.6, slow: 0.3 },
            sonar_beam: 0.96,
            age_max: Duration::from_millis(600),
            has_sonars: true,
            abilities: Abilities::default(),
            map,
            home,
        };
        let shell = Shell::new(ShellConfig::new(NAME), Box::new(Planner::new(config)));
        let mut bench = Bench::new(shell);
        bench.start();
        Self {
            bench,
            pose: Pose::new(2.0, 2.0, 0.0),
            speed: 0.0,
            steering: 0.0,
            command: Motion::default(),
            commanded_at: Instant::ZERO,
            stands: None,
            holds: DataHold::default(),
            discs: Vec::new(),
            walls,
            ticks: 0,
            blind: false,
            nearest: f64::INFINITY,
            goal: DataGoal::default(),
            failed: Vec::new(),
            commands: 0,
            lost: false,
            deaf: false,
            pushed: false,
            poll: 25,
            dead: 0..0,
            guard: guarding(),
            bounds: [0.0; 2],
            permits: None,
            old: false,
            firing: [(0, f64::NAN); 16],
            measured_last: [(0, f64::NAN); 16],
            sensed: Vec::new(),
            persons: Vec::new(),
            mode: DataMode::default(),
            parameters: DataParameters::default(),
            reports: Vec::new(),
        }
    }

    fn goal(&mut self, waypoints: &[(f64, f64)], looped: bool) {
        self.send(5, waypoints, looped);
    }

    fn send(&mut self, id: i32, waypoints: &[(f64, f64)], looped: bool) {
        let told = |&(x, y): &(f64, f64)| Waypoint { x, y, theta: 0.0, tolerance: 0.0, heading: false };
        let waypoints = waypoints.iter().map(told).collect();
        self.bench.message(CmdGoal { timestamp: 0, id, waypoints, r#loop: looped });
    }

    fn sonar(&self, (x, y, theta): (f64, f64, f64)) -> f64 {
        let mount = self.pose * Pose::new(x, y, theta);
        let distances = self.discs.iter().filter_map(|(at, radius)| {
            let bearing = libm::atan2(at.y - mount.y, at.x - mount.x);
            let distance = mount.point().distance(*at);
            let beam = 0.48 + libm::asin((radius / distance).min(1.0));
            (wrap(bearing - mount.theta.radians()).abs() < beam && distance < 2.5)
                .then_some((distance - radius).max(0.03))
        });
        // A wall returns an echo within the specular limit.
        let facing = |away: f64, normal: f64| {
            let off = wrap(normal - mount.theta.radians()).abs();
            (off < 0.43 && away < 6.0).then_some(away.max(0.03))
        };
        let walls = self.walls.map(|(length, width)| {
            use core::f64::consts::{FRAC_PI_2, PI};
            let walls = [(mount.x, PI), (length - mount.x, 0.0), (mount.y, -FRAC_PI_2), (width - mount.y, FRAC_PI_2)];
            walls.map(|(away, normal)| facing(away, normal))
        });
        let walls = walls.into_iter().flatten().flatten();
        let nearest = distances.chain(walls).fold(f64::INFINITY, f64::min);
        if nearest.is_finite() && !self.blind { nearest } else { f64::NAN }
    }

    fn micros(&self) -> i64 {
        (self.bench.now().as_nanos() / 1000) as i64
    }

    /// Sonars fire in three slots of 70 ms, like those of a board (docs/facts/boards.md).
    fn fire(&mut self) {
        if !self.ticks.is_multiple_of(7) {
            return;
        }
        let turn = (self.ticks / 7 % 3) as usize;
        for (id, &(x, y, degrees)) in SRFS.iter().enumerate() {
            if id % 8 % 3 == (turn + 2) % 3 {
                self.measured_last[id] = self.firing[id];
            } else if id % 8 % 3 == turn {
                self.firing[id] = (self.micros(), self.sonar((x, y, degrees.to_radians())));
            }
        }
    }

    fn reading(&self, id: usize) -> Reading {
        let (x, y, degrees) = SRFS[id];
        let (timestamp, distance) = self.measured_last[id];
        let status = match distance {
            _ if self.dead.contains(&id) || timestamp == 0 => Reading::UNKNOWN,
            distance if distance.is_finite() => Reading::MEASURED,
            _ => Reading::SILENT,
        };
        let distance = if status == Reading::MEASURED { distance } else { f64::NAN };
        let (kind, theta) = (Reading::SONAR, degrees.to_radians());
        Reading { timestamp, id: id as i32, kind, status, distance, x, y, theta, beam: 0.96 }
    }

    fn step(&mut self) {
        let now = self.bench.now();
        let dt = STEP.as_secs_f64();
        let obeyed = now.since(self.commanded_at) < Duration::from_millis(250) && self.stands.is_none();
        let aim = if obeyed { self.command } else { Motion { steering: self.steering, ..Motion::default() } };
        match self.permits {
            Some(permits) => self.bounds = permits(self.pose, self.steering),
            // A robot of that view has no guard.
            None if self.old => self.bounds = [f64::INFINITY; 2],
            None => {}
        }
        let [forward, backward] = self.bounds;
        let aim = Motion { speed: aim.speed.clamp(-backward, forward), ..aim };
        let braking = self.speed.abs() > aim.speed.abs() || self.speed * aim.speed < 0.0;
        let most = dt * if braking { LIMITS.deceleration } else { LIMITS.acceleration };
        self.speed += if self.pushed { 0.0 } else { (aim.speed - self.speed).clamp(-most, most) };
        let most = dt * LIMITS.steering_rate;
        self.steering += (aim.steering - self.steering).clamp(-most, most);
        let curvature = libm::tan(self.steering) / BODY.wheelbase;
        self.pose = self.pose.along(Moved { translation: self.speed * dt, rotation: self.speed * dt * curvature });
        let inverse = self.pose.inverse();
        for (at, radius) in &self.discs {
            let gap = crate::ahead::gap(&BODY, inverse * *at) - radius;
            if self.speed.abs() > 0.01 {
                self.nearest = self.nearest.min(gap);
            }
        }
        self.ticks += 1;
        if self.ticks.is_multiple_of(5) && !self.lost {
            let rotation = self.speed * curvature;
            let timestamp = self.ticks as i64;
            let (x, y, theta) = (self.pose.x, self.pose.y, self.pose.theta.radians());
            let quality = DataEstimate::FINE;
            let estimate =
                DataEstimate { timestamp, x, y, theta, speed: self.speed, rotation, quality, ..Default::default() };
            self.bench.message(estimate);
        }
        if self.ticks % 5 == 3 {
            let [forward, backward] = self.bounds;
            self.bench.message(lowlevel::DataGuard { forward, backward, ..Default::default() });
        }
        if self.ticks % 5 == 1 {
            let source = if obeyed { NAME.into() } else { String::new() };
            // The text changes each time and has no effect.
            let reason = format!("text {}", self.ticks);
            let stands = self.stands.or((!obeyed).then_some(Hold::NobodyCommands));
            let row = |hold: Hold| lowlevel::Hold {
                code: hold.code(),
                subject: NAME.into(),
                latched: hold.is_latched(),
                since: 0,
            };
            let (module, holds) = ("driver_canbus".into(), stands.map(row).into_iter().collect());
            self.bench.message(DataHold { timestamp: 1, module, holds });
            let (speed, steering) = (self.speed, self.steering);
            let motion = DataMotion { speed, steering, source, reason, homed: true, ..Default::default() };
            self.guard.message(motion.clone());
            self.bench.message(motion);
        }
        self.fire();
        if self.ticks % self.poll == 2 && !self.deaf {
            let timestamp = self.micros();
            let readings: Vec<Reading> = (0..SRFS.len()).map(|id| self.reading(id)).collect();
            if self.old {
                let range = |reading: &Reading| {
                    let Reading { id, x, y, theta, distance, .. } = *reading;
                    messages::lowlevel::Range { id, x, y, theta, distance, valid: distance.is_finite() }
                };
                self.bench.message(DataSrfs { timestamp, srfs: readings.iter().map(range).collect() });
            } else {
                self.guard.message(DataRanges { timestamp, readings: readings.clone() });
                self.bench.message(DataRanges { timestamp, readings });
            }
        }
        self.bench.pass(STEP);
        self.guard.pass(STEP);
        for message in self.guard.published() {
            if let Message::LlDataGuard(guard) = message {
                self.bounds = [guard.forward, guard.backward];
            }
        }
        for message in self.bench.published() {
            match message {
                Message::LlCmdMotion(command) => {
                    (self.command, self.commanded_at) = (
                        Motion { speed: command.speed, steering: command.steering, axis: Axis::Along },
                        self.bench.now(),
                    );
                    self.commands += 1;
                }
                Message::MlDataGoal(goal) => {
                    self.failed.extend((goal.status == DataGoal::FAILED).then(|| goal.clone()));
                    self.goal = goal;
                }
                Message::LlDataHold(holds) => self.holds = holds,
                Message::MlDataMode(mode) => self.mode = mode,
                Message::MlDataParameters(parameters) => self.parameters = parameters,
                Message::CmEventError(error) => self.reports.push(error.number),
                Message::MlDataPersons(persons) => self.persons.push(persons),
                Message::MlDataObstacles(seen) => {
                    self.sensed.extend(seen.x.iter().zip(&seen.y).map(|(&x, &y)| Point { x, y }));
                }
                _ => {}
            }
        }
    }

    fn pass(&mut self, seconds: f64) {
        for _ in 0..(seconds * 100.0) as u32 {
            self.step();
        }
    }

    /// Runs until the goal has this status, for at most `seconds`; returns the time taken.
    fn until(&mut self, status: i8, seconds: f64) -> f64 {
        for n in 0..(seconds * 100.0) as u32 {
            self.step();
            if self.goal.status == status {
                return f64::from(n) / 100.0;
            }
        }
        panic!("after {seconds} s at {:?}: {:?}", self.pose, self.goal);
    }
}

impl Robot {
    /// Most important cause that the planner publishes.
    fn hold(&self) -> Option<Hold> {
        assert_eq!(self.holds.module, NAME);
        self.holds.first()
    }
}

#[test]
fn it_drives_to_a_goal_and_stops_there() {
    let mut robot = Robot::new();
    robot.pass(1.0);
    assert_eq!((robot.goal.status, robot.goal.message.as_str()), (DataGoal::IDLE, "there is no goal"));
    assert!(robot.holds.is_idle(), "{:?}", robot.holds);
    assert_eq!(robot.commands, 0, "silent without a goal");
    robot.goal(&[(8.0, 3.0)], false);
    let time = robot.until(DataGoal::REACHED, 30.0);
    assert!(robot.pose.point().distance(Point { x: 8.0, y: 3.0 }) < 0.15, "{:?}", robot.pose);
    assert!(time < 14.0, "6.1 m in {time} s");
    robot.pass(1.0);
    let commands = robot.commands;
    robot.pass(1.0);
    assert_eq!((robot.commands, robot.speed), (commands, 0.0), "silent again");
}

#[test]
fn it_commands_no_more_than_the_guard_permits() {
    let mut robot = Robot::new();
    robot.permits = Some(|pose, _| if pose.x < 4.0 { [0.25, 0.3] } else { [0.8, 0.3] });
    robot.goal(&[(8.0, 2.0)], false);
    while robot.pose.x < 3.9 {
        robot.step();
        assert!(robot.command.speed <= 0.25 && robot.goal.status != DataGoal::BLOCKED, "{:?}", robot.command);
    }
    robot.pass(2.0);
    assert!(robot.speed > 0.5, "{} m/s", robot.speed);
    robot.until(DataGoal::REACHED, 15.0);
}

#[test]
fn where_the_guard_permits_nothing_it_takes_another_way() {
    let mut robot = Robot::on(Some(hall()));
    // Something that the planner's own map does not have, at x = 4.5 below y = 3.
    robot.permits = Some(|pose, _| if pose.x > 3.5 && pose.x < 4.5 && pose.y < 3.0 { [0.0, 0.3] } else { [0.8, 0.3] });
    robot.goal(&[(9.0, 2.0)], false);
    robot.until(DataGoal::BLOCKED, 15.0);
    assert_eq!(robot.speed, 0.0);
    let (x, mut backed) = (robot.pose.x, f64::INFINITY);
    for _ in 0..1500 {
        robot.step();
        backed = backed.min(robot.pose.x);
    }
    assert!(backed < x - 0.3, "it backs out: {backed} from {x}");
}

#[test]
fn it_steers_before_it_waits_for_the_guard() {
    let mut robot = Robot::on(Some(hall()));
    robot.permits = Some(|pose, steering| if steering > 0.2 || pose.y > 2.3 { [0.5, 0.3] } else { [0.0, 0.0] });
    robot.goal(&[(2.0, 4.5)], false);
    robot.pass(10.0);
    assert!(robot.pose.y > 2.5, "{:?} {:?}", robot.pose, robot.goal);
}

#[test]
fn waypoints_are_passed_without_a_stop() {
    let mut robot = Robot::new();
    robot.goal(&[(6.0, 2.0), (8.0, 4.0), (6.0, 6.0), (3.0, 5.0)], true);
    robot.pass(6.0);
    let (mut slowest, mut laps, mut last) = (f64::INFINITY, 0, 0);
    for _ in 0..6000 {
        robot.step();
        slowest = slowest.min(robot.speed.abs());
        laps += u32::from(robot.goal.waypoint == 0 && last != 0);
        last = robot.goal.waypoint;
    }
    assert!(laps >= 2, "{laps} laps in 60 s");
    assert!(slowest > 0.15, "{slowest}");
}

#[test]
fn a_cancelled_goal_leaves_the_robot_at_standstill() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    assert!(robot.speed > 0.5);
    robot.goal(&[], false);
    robot.pass(2.0);
    assert_eq!((robot.goal.status, robot.speed), (DataGoal::CANCELLED, 0.0));
}

/// Leg that stands in the path.
fn disc(x: f64, y: f64) -> (Point, f64) {
    (Point { x, y }, 0.15)
}

#[test]
fn it_waits_for_a_person_on_the_path() {
    let mut robot = Robot::new();
    robot.discs = vec![disc(6.0, 2.0)];
    robot.goal(&[(10.0, 2.0)], false);
    robot.until(DataGoal::BLOCKED, 15.0);
    assert_eq!(robot.hold(), Some(Hold::InTheWay));
    assert!(robot.holds.holds[0].subject.starts_with("5."), "{:?}", robot.holds);
    assert_eq!(robot.speed, 0.0);
    let gap = 6.0 - 0.15 - (robot.pose.x + BODY.front);
    assert!((0.15..0.9).contains(&gap), "{gap}");
    robot.discs.clear();
    robot.until(DataGoal::REACHED, 20.0);
}

#[test]
fn it_brakes_for_a_person_who_steps_onto_the_path() {
    for (x, y) in [(1.3, 0.0), (1.5, 0.2), (1.2, -0.25)] {
        let mut robot = Robot::new();
        robot.goal(&[(12.0, 2.0)], false);
        robot.pass(5.0);
        assert!(robot.speed > 0.6, "{}", robot.speed);
        let at = robot.pose * Point { x: BODY.front + x, y };
        robot.discs = vec![(at, 0.15)];
        robot.until(DataGoal::BLOCKED, 8.0);
        assert!(robot.speed.abs() < 0.05, "{}", robot.speed);
        assert!(robot.nearest > 0.02, "{}", robot.nearest);
    }
}

#[test]
fn it_stands_before_a_person_walking_towards_it_arrives() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    let mut walker = robot.pose.x + BODY.front + 4.0;
    for _ in 0..600 {
        let gap = walker - 0.15 - (robot.pose.x + BODY.front);
        if gap > 0.05 {
            walker -= 0.012;
        }
        robot.discs = vec![disc(walker, 2.0)];
        robot.step();
    }
    // The person approaches to 5 cm by himself, and is known from readings up to 0.5 s old.
    assert!(robot.nearest > 0.01, "{}", robot.nearest);
}

/// Hall of 12 m by 6 m.
fn hall() -> crate::map::Map {
    let mut map = crate::map::Map::around((0.0, 0.0), (12.0, 6.0), 0.05).unwrap();
    let corners = [(0.0, 0.0), (12.0, 0.0), (12.0, 6.0), (0.0, 6.0)];
    (0..4).for_each(|n| map.wall(corners[n], corners[(n + 1) % 4]));
    map
}

#[test]
fn a_path_around_is_found_if_the_obstacle_remains() {
    let mut robot = Robot::on(Some(hall()));
    robot.discs = vec![disc(5.5, 2.0), disc(5.5, 2.3), disc(5.5, 1.7)];
    robot.goal(&[(9.0, 2.0)], false);
    robot.until(DataGoal::BLOCKED, 10.0);
    robot.until(DataGoal::REACHED, 60.0);
    assert!(robot.nearest > 0.02, "{}", robot.nearest);
}

#[test]
fn a_goal_in_a_wall_fails_with_a_reason_and_the_robot_stands() {
    let mut map = hall();
    map.wall((8.0, 0.0), (8.0, 6.0));
    for (goal, why) in [
        ((12.0, 3.0), "cannot reach waypoint 1: the robot does not fit in at the goal"),
        ((50.0, 3.0), "cannot reach waypoint 1: it is outside the map, which is 0…12 by 0…6 m"),
        ((10.0, 3.0), "cannot reach waypoint 1: no way leads to the goal"),
    ] {
        let mut robot = Robot::on(Some(map.clone()));
        robot.goal(&[goal], false);
        robot.until(DataGoal::FAILED, 10.0);
        assert_eq!((robot.goal.message.as_str(), robot.speed), (why, 0.0));
    }
}

/// End of what is said of a goal that is refused while the robot drives to another one.
const GOES_ON: &str = "; the robot goes on to the goal before it";

#[test]
fn a_goal_that_is_known_to_be_impossible_does_not_stop_the_robot() {
    let mut robot = Robot::on(Some(hall()));
    robot.goal(&[(9.0, 2.0)], false);
    robot.pass(4.0);
    assert!(robot.speed > 0.6, "{}", robot.speed);
    let cases: [(&[(f64, f64)], &str); 4] = [
        (&[(f64::NAN, 3.0)], "refused: waypoint 0 at NaN"),
        (&[(50.0, 3.0)], "cannot reach waypoint 1: it is outside the map, which is 0…12 by 0…6 m"),
        (&[(8.0, 3.0), (50.0, 3.0)], "cannot reach waypoint 2: it is outside the map, which is 0…12 by 0…6 m"),
        (&[(12.0, 3.0)], "cannot reach waypoint 1: the robot does not fit in at the goal"),
    ];
    for (id, (places, why)) in (6..).zip(cases) {
        robot.failed.clear();
        robot.send(id, places, false);
        for _ in 0..30 {
            robot.step();
            assert!(robot.speed > 0.6, "{why}: {}", robot.speed);
        }
        let [refused] = &robot.failed[..] else { panic!("told once: {:?}", robot.failed) };
        assert!(refused.id == id && refused.message.starts_with(why), "{refused:?}");
        assert!(refused.message.ends_with(GOES_ON) && refused.remaining.is_nan(), "{refused:?}");
        assert_eq!((robot.goal.id, robot.goal.status, robot.hold()), (5, DataGoal::DRIVING, None));
    }
    robot.until(DataGoal::REACHED, 20.0);
    assert_eq!((robot.goal.id, robot.failed.len()), (5, 1));
}

#[test]
fn a_goal_to_which_the_search_finds_no_way_leaves_the_robot_the_one_before() {
    let mut map = hall();
    map.wall((9.5, 0.0), (9.5, 6.0));
    let mut robot = Robot::on(Some(map));
    robot.goal(&[(6.5, 2.0)], false);
    robot.pass(3.0);
    assert!(robot.speed > 0.6, "{}", robot.speed);
    // The second one replaces the first, of which nothing is known yet.
    robot.send(6, &[(10.75, 3.0)], false);
    robot.send(7, &[(10.75, 4.0)], false);
    robot.pass(3.0);
    let [refused] = &robot.failed[..] else { panic!("told once: {:?}", robot.failed) };
    assert_eq!((refused.id, refused.status), (7, DataGoal::FAILED));
    assert_eq!(refused.message, format!("cannot reach waypoint 1: no way leads to the goal{GOES_ON}"));
    robot.until(DataGoal::REACHED, 20.0);
    assert_eq!(robot.goal.id, 5);
    // Nothing is driven to any more: the next one ends as it did.
    robot.send(8, &[(10.75, 3.0)], false);
    robot.until(DataGoal::FAILED, 10.0);
    assert_eq!((robot.goal.id, robot.goal.message.as_str()), (8, "cannot reach waypoint 1: no way leads to the goal"));
}

#[test]
fn a_robot_that_is_held_does_not_go_on_to_a_goal_that_nobody_sent_again() {
    let mut map = hall();
    map.wall((9.5, 0.0), (9.5, 6.0));
    for place in [(f64::NAN, 3.0), (50.0, 3.0), (12.0, 3.0), (10.75, 3.0)] {
        let mut robot = Robot::on(Some(map.clone()));
        robot.goal(&[(8.0, 2.0)], false);
        robot.pass(3.0);
        assert!(robot.speed > 0.6, "{}", robot.speed);
        robot.stands = Some(Hold::PlannerLatched);
        robot.pass(2.0);
        assert_eq!((robot.goal.id, robot.speed), (5, 0.0));
        // The driver takes any goal for the act of an operator.
        robot.send(6, &[place], false);
        robot.stands = None;
        robot.pass(3.0);
        assert_eq!((robot.goal.id, robot.goal.status, robot.speed), (6, DataGoal::FAILED, 0.0), "{place:?}");
    }
}

#[test]
fn a_passage_without_the_whole_margin_is_driven_slowly() {
    // 0.75 m wide: the robot has 7.5 cm on each side. First it looks for a way with 8 cm, for up to 50 s.
    let mut map = hall();
    map.wall((6.0, 0.0), (6.0, 2.62));
    map.wall((6.0, 3.42), (6.0, 6.0));
    let mut robot = Robot::on(Some(map.clone()));
    robot.goal(&[(9.0, 3.0)], false);
    let mut fastest = 0f64;
    while robot.goal.status != DataGoal::REACHED {
        robot.pass(0.1);
        fastest = fastest.max(robot.speed);
        assert!(robot.ticks < 15_000 && robot.goal.status != DataGoal::FAILED, "{:?}", robot.goal);
        if robot.goal.status == DataGoal::DRIVING && robot.speed > 0.05 {
            assert_eq!(robot.goal.message, "drives to waypoint 1 of 1, slowly: the way is narrow");
        }
    }
    assert!(fastest < 0.17, "{fastest}");
    // Where there is room, the passage is not taken, and the speed is not reduced.
    map.wall((6.0, 2.6), (6.0, 3.4));
    let gate = [(118, 20), (119, 20), (120, 20), (121, 20)];
    gate.iter().for_each(|&(column, row)| (row..row + 26).for_each(|row| map.set(column, row, crate::map::Cell::Free)));
    let mut robot = Robot::on(Some(map));
    robot.goal(&[(9.0, 3.0)], false);
    robot.pass(5.0);
    assert_eq!(robot.goal.message, "drives to waypoint 1 of 1");
}

#[test]
fn an_invalid_goal_is_refused() {
    let mut robot = Robot::new();
    robot.pass(0.5);
    robot.goal(&[(f64::NAN, 3.0)], false);
    robot.pass(0.1);
    assert_eq!(robot.goal.status, DataGoal::FAILED);
    assert!(robot.goal.message.starts_with("refused: waypoint 0 at NaN"), "{}", robot.goal.message);
    assert_eq!(robot.commands, 0);
}

/// Three legs across the only passage.
fn closed() -> Vec<(Point, f64)> {
    (0..=30).map(|n| disc(6.0, 0.2 * f64::from(n))).collect()
}

#[test]
fn a_goal_behind_a_permanent_obstacle_is_given_up_with_a_reason() {
    let mut robot = Robot::on(Some(hall()));
    robot.discs = closed();
    robot.goal(&[(10.0, 2.0)], false);
    robot.until(DataGoal::FAILED, 400.0);
    assert!(robot.goal.message.starts_with("gave up waypoint 1: "), "{}", robot.goal.message);
    assert!(robot.nearest > 0.0, "{}", robot.nearest);
}

#[test]
fn where_no_path_leads_around_it_waits_on_its_way() {
    let (length, width) = (12.0, 1.6);
    let mut map = crate::map::Map::around((0.0, 0.0), (length, width), 0.05).unwrap();
    let corners = [(0.0, 0.0), (length, 0.0), (length, width), (0.0, width)];
    (0..4).for_each(|n| map.wall(corners[n], corners[(n + 1) % 4]));
    for waited in [2.0, 3.0, 4.0, 5.0] {
        let mut robot = Robot::on(Some(map.clone()));
        (robot.walls, robot.pose) = (Some((length, width)), Pose::new(2.0, 0.8, 0.0));
        robot.discs = vec![disc(6.0, 0.8)];
        robot.goal(&[(10.0, 0.8)], false);
        robot.until(DataGoal::BLOCKED, 15.0);
        robot.pass(waited);
        assert_eq!((robot.hold(), robot.speed), (Some(Hold::InTheWay), 0.0), "{waited} s: {:?}", robot.goal);
        robot.discs.clear();
        robot.until(DataGoal::REACHED, 25.0);
    }
}

#[test]
fn a_loop_is_never_given_up() {
    let mut robot = Robot::on(Some(hall()));
    robot.goal(&[(10.0, 2.0), (2.0, 3.0)], true);
    robot.pass(3.0);
    robot.discs = closed();
    for _ in 0..20_000 {
        robot.step();
        assert!([DataGoal::DRIVING, DataGoal::BLOCKED].contains(&robot.goal.status), "{:?}", robot.goal);
    }
    robot.discs.clear();
    let mut far = false;
    for _ in 0..8000 {
        robot.step();
        far |= robot.pose.x > 9.5;
    }
    assert!(far, "{:?} {:?}", robot.pose, robot.goal);
}

#[test]
fn without_an_estimate_it_stands_and_reports_the_cause() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    robot.lost = true;
    robot.pass(2.0);
    assert_eq!(robot.speed, 0.0);
    assert_eq!(robot.hold(), Some(Hold::EstimateBad));
    assert_eq!(robot.goal.message, "waits: the estimate is old or no number");
    assert_eq!(robot.goal.status, DataGoal::DRIVING);
    robot.lost = false;
    robot.until(DataGoal::REACHED, 30.0);
}

#[test]
fn causes_of_driver_canbus_are_passed_on() {
    let mut robot = Robot::new();
    robot.stands = Some(Hold::PlannerLatched);
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(2.0);
    assert_eq!(robot.goal.message, "waits for an operator: a goal or mode given anew, or planner RUN by hand");
    assert!(robot.hold() == Some(Hold::PlannerLatched) && robot.holds.holds[0].latched, "{:?}", robot.holds);
    assert!(robot.commands > 30 && robot.command.speed == 0.0);
    robot.stands = None;
    robot.pass(4.0);
    assert!(robot.speed > 0.5);
}

#[test]
fn in_pause_it_keeps_its_goal_and_is_silent() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    let command = |state: State| messages::common::CmdState {
        timestamp: 0,
        module: NAME.into(),
        state: state as i8,
        manual: true,
        source: "test".into(),
    };
    robot.bench.message(command(State::Pause));
    robot.pass(2.0);
    assert_eq!((robot.speed, robot.goal.message.as_str()), (0.0, "planner is in PAUSE"));
    assert_eq!(robot.hold(), Some(Hold::ModulePaused));
    let commands = robot.commands;
    robot.pass(1.0);
    assert_eq!(robot.commands, commands);
    robot.bench.message(command(State::Run));
    robot.until(DataGoal::REACHED, 30.0);
}

#[test]
fn missing_sonar_readings_stop_it() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    robot.deaf = true;
    robot.pass(3.0);
    assert_eq!((robot.speed, robot.goal.message.as_str()), (0.0, "waits: the sonars do not report"));
    assert_eq!(robot.hold(), Some(Hold::SonarsSilent));
}

#[test]
fn sensed_obstacles_are_at_their_true_position_at_any_rate() {
    for poll in [50, 25, 10, 5] {
        let mut robot = Robot::new();
        robot.discs = vec![disc(8.0, 2.0)];
        (robot.speed, robot.pushed, robot.poll) = (0.8, true, poll);
        while robot.pose.x + BODY.front < 7.2 {
            robot.step();
        }
        // Cells before the disc, as its nearest point is seen from ahead.
        let off = robot.sensed.iter().filter(|at| (at.y - 2.0).abs() < 0.1).map(|at| at.x - 7.85);
        let off: Vec<f64> = off.collect();
        let worst = off.iter().fold(0.0f64, |worst, off| worst.max(off.abs()));
        assert!(off.len() > 4 && worst < 0.05, "each {poll} ticks: {worst:.3} m, {off:.3?}");
    }
}

#[test]
fn unknown_front_sonars_stop_it_until_they_are_known_again() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    assert!(robot.speed > 0.6, "{}", robot.speed);
    let x = robot.pose.x;
    robot.dead = 0..8;
    robot.pass(10.0);
    assert_eq!((robot.speed, robot.goal.message.as_str()), (0.0, "waits: nothing is known of the sonars at the front"));
    assert_eq!(robot.hold(), Some(Hold::SonarsUnknown));
    assert!(robot.pose.x - x < 0.8 * 1.3 + 0.5, "believed for a second, then braked: {} m", robot.pose.x - x);
    robot.dead = 0..0;
    robot.until(DataGoal::REACHED, 30.0);
}

#[test]
fn one_unknown_sonar_ahead_stops_it_too() {
    for dead in 1..4 {
        let mut robot = Robot::new();
        robot.goal(&[(12.0, 2.0)], false);
        robot.pass(4.0);
        assert!(robot.speed > 0.6, "{}", robot.speed);
        let x = robot.pose.x;
        robot.dead = dead..dead + 1;
        robot.pass(3.0);
        assert_eq!((robot.speed, robot.hold()), (0.0, Some(Hold::SonarsUnknown)), "sonar {dead}");
        // The measurement counts for 0.6 s since it fired; then the robot brakes.
        assert!(robot.pose.x - x < 0.8 * 0.6 + 0.5, "sonar {dead}: {} m", robot.pose.x - x);
    }
}

#[test]
fn unknown_rear_sonars_only_prevent_backing_out() {
    let mut robot = Robot::on(Some(hall()));
    robot.dead = 11..14;
    robot.goal(&[(9.0, 2.0)], false);
    robot.pass(2.5);
    assert!(robot.speed > 0.6, "{}", robot.speed);
    robot.discs = closed();
    let mut back = 0.0f64;
    for _ in 0..3000 {
        robot.step();
        back = back.min(robot.speed);
    }
    assert!(back > -0.01 && robot.nearest > 0.0, "{back} m/s");
}

#[test]
fn with_the_view_of_2011_alone_it_drives_at_the_speed_for_unobserved_space() {
    let mut robot = Robot::new();
    robot.old = true;
    robot.goal(&[(8.0, 3.0)], false);
    let mut fastest = 0.0f64;
    while robot.goal.status != DataGoal::REACHED {
        robot.step();
        fastest = fastest.max(robot.speed);
        assert!(robot.ticks < 4000, "{:?}", robot.goal);
    }
    assert!((0.35..0.45).contains(&fastest), "{fastest}");
    // And it waits for a person on its path.
    let mut robot = Robot::new();
    (robot.old, robot.discs) = (true, vec![disc(6.0, 2.0)]);
    robot.goal(&[(10.0, 2.0)], false);
    robot.until(DataGoal::BLOCKED, 25.0);
    assert!(robot.nearest > 0.1, "{}", robot.nearest);
}

#[test]
fn an_edge_without_floor_is_remembered_and_driven_around() {
    let mut robot = Robot::new();
    robot.goal(&[(9.0, 2.0)], false);
    while robot.pose.x < 4.0 {
        robot.step();
    }
    // Its front left corner is over an edge: the line is engaged, and the ranger sees nothing.
    robot.stands = Some(Hold::PauseFloor);
    let stop = |engaged| EventStop { timestamp: 0, engaged, source: "sd1_front".into() };
    robot.bench.message(stop(true));
    robot.pass(1.0);
    let infrared = |y, status| Reading { kind: Reading::INFRARED, status, x: 0.75, y, ..Default::default() };
    let readings = vec![infrared(0.3, Reading::SILENT), infrared(-0.3, Reading::UNKNOWN)];
    robot.bench.message(DataRanges { timestamp: robot.micros(), readings });
    let edge = (robot.pose * Pose::new(0.8, 0.3, 0.0)).point();
    // Somebody pushes it back, and the line opens.
    robot.pose = robot.pose * Pose::new(-0.4, 0.0, 0.0);
    robot.pass(1.0);
    assert!(robot.sensed.iter().any(|at| at.distance(edge) < 0.1), "{:?}", robot.sensed);
    robot.bench.message(stop(false));
    robot.stands = None;
    robot.goal(&[(9.0, 2.0)], false);
    while robot.goal.status != DataGoal::REACHED {
        robot.step();
        let gap = crate::ahead::gap(&BODY, robot.pose.inverse() * edge);
        assert!(gap > 0.0 && robot.ticks < 9000, "{gap} {:?} {:?}", robot.pose, robot.goal);
    }
}

#[test]
fn it_returns_to_its_position_with_another_heading() {
    let mut robot = Robot::on(Some(hall()));
    let turned = Waypoint { x: 2.0, y: 2.0, theta: 3.1, tolerance: 0.2, heading: true };
    robot.bench.message(CmdGoal { timestamp: 0, id: 5, waypoints: vec![turned], r#loop: false });
    robot.until(DataGoal::REACHED, 60.0);
    assert!(wrap(robot.pose.theta.radians() - 3.1).abs() < 0.2, "{:?}", robot.pose);
}

#[test]
fn backing_out_leads_to_no_waypoint() {
    let poses = [0.0, -0.25, -0.5].map(|x| (Pose::new(x, 0.0, 0.0), Direction::Backward)).into();
    let path = crate::path::Poses { poses, narrow: false };
    let mut track = crate::track::Track::new(&path, None, &BODY, &LIMITS, &Behaviour::default());
    assert_eq!((track.leads_to(), track.passed(), track.remaining()), (None, None, 0.5));
}

#[path = "tests/bases.rs"]
mod bases;
#[path = "tests/modes.rs"]
mod modes;
#[path = "tests/persons.rs"]
mod persons;
