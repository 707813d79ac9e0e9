//! An episode of `advee gym`: the whole robot in virtual time, but for its planner, whose motion the caller commands.

use super::protocol::{End, Goal, Info, Observation, PROTOCOL, Reset, Reward, Robot, State, Step};
use super::seen::{SECTORS, Seen};
use base::{Duration, Instant};
use diagnostics::orders;
use messages::lowlevel::{CmdMotion, CmdVelocity, DataHold};
use messages::middlelevel::{CmdGoal, Waypoint};
use messages::simulation::DataTruth;
use messages::{Hold, Message};
use navitools::{Point, Pose};
use robot::config::{self, Config, ConfigError, ModuleEntry, SIMULATOR};
use robot::place::RobotLocation;
use robot::topology::virtual_machine_without;
use settings::robot::Geometry;
use sim::host::{self, Virtual};
use simulator::Random;
use simulator::world::World;
use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;

/// Period of a command; it is valid for 250 ms.
const PERIOD: Duration = Duration::from_millis(50);
/// Period in which a robot that starts is looked at, and the longest time of its start.
const LOOK: Duration = Duration::from_millis(100);
const READY_WITHIN: Duration = Duration::from_secs(90);
/// Period of the order to home the steering, while the robot waits for one.
const HOME: Duration = Duration::from_secs(1);
/// Number of good estimates in succession after which the robot knows where it is: one second.
const LOCATED: u32 = 20;
/// Maximum latency of a message beyond the least one.
const JITTER: Duration = Duration::from_micros(200);
/// Distance of a drawn goal from the start beyond the tolerance, m.
const GOAL_OFF_M: f64 = 1.5;
/// Stream of chance for the goal, beside those of the machine.
const GOAL_STREAM: u64 = 0x60A1;
/// Distance up to which an SRF08 measures, m.
const SONAR_REACH_M: f64 = 6.0;
/// Modules that no episode has: the caller takes the place of the first one, and nothing is recorded.
const ABSENT: [&str; 2] = [planner::NAME, logger::NAME];
/// What is for people and for other programs.
const SETS: [&str; 2] = ["web.enabled=false", "ros2.enabled=false"];
/// Modules without which there is nothing to learn.
const NEEDED: [&str; 3] = [SIMULATOR, drivers::canbus::NAME, estimator::NAME];

/// The robot of a configuration, of which each episode makes a new one.
#[derive(Debug)]
pub struct Rig {
    place: RobotLocation,
    /// Modules that are left out, beside [`ABSENT`].
    without: Vec<String>,
    geometry: Geometry,
    robot: Robot,
}

impl Rig {
    /// The simulated robot of `place`; `without` are modules that are left out.
    ///
    /// # Errors
    /// What is wrong with the configuration, or a module cannot be left out.
    pub fn new(mut place: RobotLocation, without: &[String]) -> Result<Self, ConfigError> {
        place.sets.extend(SETS.map(String::from));
        let config = Config::load(&place.config, true, &place.sets)?;
        for name in without {
            let why = match config.modules.iter().find(|module| module.name() == name) {
                None => "the configuration has no such module",
                Some(module) if module.guard.critical => "the robot does not move without it",
                Some(_) if NEEDED.contains(&name.as_str()) => "an episode needs it",
                Some(_) => continue,
            };
            return Err(ConfigError(vec![format!("--without {name}: {why}")]));
        }
        let rig = Self {
            geometry: config.robot.geometry,
            robot: described(&config, without),
            place,
            without: without.to_vec(),
        };
        // Made once here, so that a mistake in the configuration is reported as one.
        drop(rig.machine(&rig.place, 1)?);
        Ok(rig)
    }

    /// What the robot is.
    #[must_use]
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    fn machine(&self, place: &RobotLocation, seed: u64) -> Result<Virtual, ConfigError> {
        let without: Vec<&str> = self.without.iter().map(String::as_str).chain([planner::NAME]).collect();
        virtual_machine_without(place, host::Config { seed, lcm_jitter: JITTER, ..host::Config::default() }, &without)
    }

    /// Begins an episode: a new robot, which is homed, knows where it is, and whose planner is released by a goal.
    ///
    /// # Errors
    /// What cannot be had, in one line.
    pub fn reset(&self, reset: &Reset) -> Result<Episode, String> {
        let mut place = self.place.clone();
        place.world = reset.world.as_ref().map(PathBuf::from).or(place.world);
        place.sets.extend(reset.people.map(|count| format!("world.people={count}")));
        place.sets.extend(reset.start.map(|[x, y, theta]| format!("world.start=[{x:?}, {y:?}, {theta:?}]")));
        let world = config::world(&place.config, place.world.as_deref(), &place.sets).map_err(in_a_line)?;
        let [rear, front, half_width] = outline(&self.geometry);
        let clearance = match self.geometry.footprint() {
            Some(shape) => world.clearance_of_shape(world.start, shape),
            None => world.clearance(world.start, rear, front, half_width),
        };
        if clearance <= 0.0 {
            return Err("start: the robot touches something there".into());
        }
        let goal = match reset.goal {
            Some([x, y]) => Point { x, y },
            None => drawn(&world, reset)?,
        };
        if world.start.point().distance(goal) <= reset.tolerance {
            return Err("goal: the robot starts within its tolerance".into());
        }
        let mut machine = self.machine(&place, reset.seed).map_err(in_a_line)?;
        let seen = Rc::new(RefCell::new(Seen::default()));
        let keep = seen.clone();
        machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        machine.keep(watchdog::NAME)?;
        let mut episode = Episode {
            machine,
            seen,
            goal,
            tolerance: reset.tolerance,
            begun: Instant::ZERO,
            end: Instant::NEVER,
            over: None,
            sectors: self.robot.sectors > 0,
        };
        episode.start(Duration::from_secs_f64(reset.seconds))?;
        Ok(episode)
    }
}

fn in_a_line(error: ConfigError) -> String {
    error.0.join("; ")
}

/// Rear end, front end and half of the width in the robot's frame, m.
fn outline(geometry: &Geometry) -> [f64; 3] {
    [-geometry.rear_m(), geometry.front_m(), geometry.width_m() / 2.0]
}

fn described(config: &Config, without: &[String]) -> Robot {
    let robot = &config.robot;
    let (limits, geometry) = (&robot.limits, &robot.geometry);
    let steers = robot.base.is_none();
    let by_steering = limits.speed_mps * limits.steering_rad.tan() / geometry.wheelbase_m;
    let runs = |name: &&str| !ABSENT.contains(name) && !without.iter().any(|other| other == name);
    Robot {
        protocol: PROTOCOL,
        name: robot.general.name.clone(),
        steers,
        sideways: robot.base.is_some_and(|base| base.goes_sideways()),
        speed: limits.speed_autonomous_mps.min(limits.speed_mps),
        speed_max: limits.speed_mps,
        steering: limits.steering_rad,
        rotation: if steers { by_steering } else { limits.rotation_radps },
        wheelbase: geometry.wheelbase_m,
        outline: outline(geometry),
        sonars: robot.srfs.len(),
        sonar_directions: robot.srfs.iter().map(|sonar| sonar.theta).collect(),
        sonar_reach: SONAR_REACH_M,
        sectors: if robot.lidar.is_empty() { 0 } else { SECTORS },
        modules: config.modules.iter().map(ModuleEntry::name).filter(runs).map(Into::into).collect(),
    }
}

/// One of the points of the world's routes, which lead where a robot can drive.
fn drawn(world: &World, reset: &Reset) -> Result<Point, String> {
    let far = |at: &Point| world.start.point().distance(*at) > reset.tolerance + GOAL_OFF_M;
    let points: Vec<Point> = world.routes.iter().flat_map(|route| &route.waypoints).copied().filter(far).collect();
    let place = Random::stream(reset.seed, GOAL_STREAM).uniform() * points.len() as f64;
    points.get(place as usize).copied().ok_or_else(|| "goal: the world has no route with a point to draw".into())
}

/// A robot, and the time that it has had.
pub struct Episode {
    machine: Virtual,
    seen: Rc<RefCell<Seen>>,
    goal: Point,
    tolerance: f64,
    /// The robot was ready.
    begun: Instant,
    /// The time of the episode is over.
    end: Instant,
    over: Option<End>,
    /// There is a lidar.
    sectors: bool,
}

impl Episode {
    /// Runs until the robot is ready, and releases its planner.
    fn start(&mut self, lasts: Duration) -> Result<(), String> {
        let mut home = Instant::ZERO;
        while !self.is_ready() {
            let now = self.machine.now();
            if now.since(Instant::ZERO) >= READY_WITHIN {
                let holds: Vec<String> = self.seen.borrow().holds().iter().map(|hold| hold.code.to_string()).collect();
                let (seconds, codes) = (READY_WITHIN.as_secs(), holds.join(", "));
                return Err(format!("the robot is not ready within {seconds} s of virtual time; holds: {codes}"));
            }
            let waits = self.seen.borrow().holds.as_ref().is_some_and(|list| list.has(Hold::ToBeHomed));
            if waits && now >= home {
                home = now + HOME;
                self.machine.inject(now, orders::home(self.timestamp(), "steering"));
            }
            self.machine.run_until(now + LOOK);
        }
        let Point { x, y } = self.goal;
        let waypoint = Waypoint { x, y, tolerance: self.tolerance, ..Waypoint::default() };
        let goal = CmdGoal { timestamp: self.timestamp(), id: 1, waypoints: vec![waypoint], r#loop: false };
        self.machine.inject(self.machine.now(), goal);
        self.machine.run_until(self.machine.now() + LOOK);
        self.begun = self.machine.now();
        self.end = self.begun + lasts;
        self.judge();
        Ok(())
    }

    fn is_ready(&self) -> bool {
        let seen = self.seen.borrow();
        let free = seen.holds.as_ref().is_some_and(DataHold::is_idle);
        free && seen.motion.homed && seen.located >= LOCATED && seen.truth.is_some()
    }

    fn timestamp(&self) -> i64 {
        host::Config::default().epoch.timestamp(self.machine.now())
    }

    /// The episode is over: no step moves the robot any more.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.over.is_some()
    }

    /// Commands a motion at 20 Hz for the duration of the step, or until the episode is over.
    pub fn step(&mut self, step: &Step) -> State {
        let (from, before, contacts) = (self.machine.now(), self.distance(), self.seen.borrow().contacts);
        let until = from + Duration::from_secs_f64(step.seconds);
        while self.over.is_none() && self.machine.now() < until {
            let now = self.machine.now();
            let command = self.command(step);
            self.machine.inject(now, command);
            self.machine.run_until((now + PERIOD).min(until).min(self.end));
            self.judge();
        }
        self.state(Reward {
            progress: before - self.distance(),
            time: self.machine.now().since(from).as_secs_f64(),
            contact: self.seen.borrow().contacts - contacts,
        })
    }

    /// State at the beginning.
    #[must_use]
    pub fn first(&self) -> State {
        self.state(Reward::default())
    }

    /// The motion of a step as a planner commands it.
    fn command(&self, step: &Step) -> Message {
        let (timestamp, priority, source) = (self.timestamp(), CmdMotion::PLANNER, planner::NAME.into());
        match step.steering {
            Some(steering) => CmdMotion { timestamp, speed: step.v, steering, priority, source }.into(),
            None => {
                let (vy, omega) = (step.vy.unwrap_or(0.0), step.omega.unwrap_or(0.0));
                CmdVelocity { timestamp, vx: step.v, vy, omega, priority, source, session: 1 }.into()
            }
        }
    }

    /// True distance to the goal, m.
    fn distance(&self) -> f64 {
        let at = |truth: &DataTruth| Point { x: truth.x, y: truth.y };
        self.seen.borrow().truth.as_ref().map_or(f64::NAN, |truth| at(truth).distance(self.goal))
    }

    fn judge(&mut self) {
        let seen = self.seen.borrow();
        let touched = seen.contacts + seen.touched > 0;
        let latched = seen.is_latched();
        drop(seen);
        self.over = match () {
            () if touched => Some(End::Contact),
            () if self.distance() <= self.tolerance => Some(End::Reached),
            () if latched => Some(End::Held),
            () if self.machine.now() >= self.end => Some(End::Time),
            () => None,
        };
    }

    fn state(&self, reward: Reward) -> State {
        let (now, seen) = (self.machine.now(), self.seen.borrow());
        let truth = seen.truth.clone().unwrap_or_default();
        let estimate = seen.estimate(now);
        let (sonars, sonar_status) = seen.sonars();
        let observation = Observation {
            time: now.since(self.begun).as_secs_f64(),
            estimate,
            velocity: seen.velocity(),
            guard: seen.bounds(now),
            sonars,
            sonar_status,
            lidar: if self.sectors { seen.sectors(now) } else { Vec::new() },
            goal: seen_from([estimate.x, estimate.y, estimate.theta], self.goal),
            holds: seen.holds(),
        };
        let info = Info {
            truth: [truth.x, truth.y, truth.theta],
            speed: truth.speed,
            clearance: truth.clearance,
            goal: [self.goal.x, self.goal.y],
            distance: self.distance(),
            contacts: seen.contacts,
            touched: seen.touched,
            end: self.over,
            commanded: seen.motion.source == planner::NAME,
        };
        let terminated = matches!(self.over, Some(End::Reached | End::Contact));
        let truncated = matches!(self.over, Some(End::Held | End::Time));
        State { observation, info, reward, terminated, truncated }
    }
}

/// A place in the frame of a robot at this pose; unknown if the pose is.
fn seen_from(pose: [f64; 3], goal: Point) -> Goal {
    if !pose.iter().all(|number| number.is_finite()) {
        return Goal { x: f64::NAN, y: f64::NAN, distance: f64::NAN, bearing: f64::NAN };
    }
    let [x, y, theta] = pose;
    let Point { x, y } = Pose::new(x, y, theta).inverse() * goal;
    Goal { x, y, distance: x.hypot(y), bearing: y.atan2(x) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn a_goal_is_seen_from_the_robot() {
        let Goal { x, y, distance, bearing } = seen_from([1.0, 1.0, FRAC_PI_2], Point { x: 0.0, y: 1.0 });
        assert!(x.abs() < 1e-12 && (y - 1.0).abs() < 1e-12 && (distance - 1.0).abs() < 1e-12);
        assert!((bearing - FRAC_PI_2).abs() < 1e-12, "to the left");
        assert!(seen_from([f64::NAN, 0.0, 0.0], Point { x: 0.0, y: 0.0 }).distance.is_nan());
    }

    #[test]
    fn a_drawn_goal_is_a_point_of_a_route_and_follows_from_the_seed() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let world = config::world(&root.join("conf/advee"), Some("hall".as_ref()), &[]).unwrap();
        let goal = |seed| drawn(&world, &Reset { seed, ..Reset::default() }).unwrap();
        let goals: Vec<Point> = (0..50).map(goal).collect();
        assert_eq!(goals[7], goal(7));
        assert!(goals.iter().any(|other| *other != goals[0]));
        let on_route = |at: &Point| world.routes.iter().any(|route| route.waypoints.contains(at));
        assert!(goals.iter().all(|goal| on_route(goal) && goal.distance(world.start.point()) > 2.0));
        assert!(drawn(&World::default(), &Reset::default()).is_err());
    }
}
