//! Robot in virtual time that patrols a world autonomously, and its observation from outside: path, contacts and who
//! moved, state of the goal. An attendant resumes the planner after a visitor has walked into the robot, as an operator
//! does; the resumptions are counted.
#![allow(dead_code, reason = "bench and test use it, each its part")]

use base::{Duration, Instant};
use messages::lowlevel::Reading;
use messages::middlelevel::{CmdGoal, DataGoal, Waypoint};
use messages::{Hold, Message, lowlevel, simulation};
use module::State;
use navitools::Pose;
use record::Sink;
use robot::config;
use robot::place::RobotLocation;
use robot::topology::virtual_machine_recorded;
use sim::host::{self, News, Virtual};
use simulator::people::{Contact, Mover};
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::rc::Rc;

/// Period at which the attendant checks the robot, and time for which the planner must have waited for an operator.
const LOOK: Duration = Duration::from_millis(500);
const WAITS: Duration = Duration::from_secs(2);
/// Time for which echoes are kept, s, and the accuracy by which one is of what was touched, m; from the middle of a
/// person to the leg that answers, m.
const ECHOES_KEPT_FOR_S: f64 = 2.0;
const ANSWER_M: f64 = 0.3;
const PERSON_M: f64 = 0.15;

/// Values seen by an observer.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// True pose of the robot.
    pub truth: simulation::DataTruth,
    /// Distance driven, m.
    pub way: f64,
    /// Contacts, with their times.
    pub contacts: Vec<(f64, Contact)>,
    /// Sonars that had answered what was touched, for each contact: number, and how long before, s.
    pub answered: Vec<Vec<(i32, f64)>>,
    /// Time for which each cause slowed or held the robot, s: of the motion, and of the goal.
    pub causes: BTreeMap<(&'static str, Option<Hold>), f64>,
    echoes: VecDeque<Echo>,
    /// State of the goal.
    pub goal: DataGoal,
    /// Number of waypoints reached.
    pub waypoints: u32,
    /// Number of changes to FAILED.
    pub failed: u32,
    /// Number of reports of the goal's state, and number of these that were BLOCKED.
    pub told: (u32, u32),
    /// Time since which the planner waits for an operator.
    pub waits: Option<Instant>,
    /// Last command of the planner.
    pub command: lowlevel::CmdMotion,
    /// Drives.
    pub motion: lowlevel::DataMotion,
    /// Causes that hold the motion.
    pub holds: lowlevel::DataHold,
    /// Causes that hold the goal.
    pub goal_holds: lowlevel::DataHold,
    /// Texts of ML_DATA_GOAL with the times of their changes, s; the last hundred.
    pub words: Vec<(f64, String)>,
    estimates: u32,
}

/// Echo of a sonar.
#[derive(Clone, Copy, Debug)]
struct Echo {
    sonar: i32,
    fired: i64,
    /// Time of its reception, s.
    at: f64,
    /// Pose of the sonar in the world, opening of its beam, and distance.
    pose: Pose,
    beam: f64,
    distance: f64,
}

/// Patrolling robot.
pub struct Patrol {
    /// Machine of the robot.
    pub machine: Virtual,
    /// Observed values.
    pub seen: Rc<RefCell<Seen>>,
    route: CmdGoal,
    /// Number of times that the attendant resumed the planner.
    pub let_go: u32,
}

/// Shipped robot in the world of this name.
pub fn place(world: &str, sets: &[String]) -> RobotLocation {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    RobotLocation {
        config: root.join("conf/advee"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: sets.to_vec(),
        sim: true,
        world: Some(root.join("conf/worlds").join(world).with_extension("toml")),
    }
}

impl Patrol {
    /// Robot in the world of this name, with its route `patrol` as the goal; `people` replaces the number of visitors.
    /// `sink` records the planner's inputs.
    pub fn new(world: &str, people: Option<u32>, seed: u64, sink: Option<Sink>) -> Self {
        Self::with(world, people, seed, sink, &[])
    }

    /// The same, with overrides of the configuration.
    pub fn with(world: &str, people: Option<u32>, seed: u64, sink: Option<Sink>, more: &[&str]) -> Self {
        let mut sets: Vec<String> = people.map(|count| format!("world.people={count}")).into_iter().collect();
        sets.extend(more.iter().copied().map(String::from));
        Self::at(&place(world, &sets), seed, sink)
    }

    /// Robot of this place, with the route `patrol` of its world as the goal.
    pub fn at(place: &RobotLocation, seed: u64, sink: Option<Sink>) -> Self {
        let read = config::world(&place.config, place.world.as_deref(), &place.sets).expect("a shipped world");
        let route = read.routes.iter().find(|route| route.name == "patrol").expect("a patrol");
        let waypoint = |at: &navitools::Point| Waypoint { x: at.x, y: at.y, ..Waypoint::default() };
        let waypoints = route.waypoints.iter().map(waypoint).collect();
        let route = CmdGoal { timestamp: 0, id: 1, waypoints, r#loop: route.looped };
        let config = host::Config { seed, lcm_jitter: Duration::from_micros(200), ..host::Config::default() };
        let mut sink = sink;
        let record = move |name: &str| if name == planner::NAME { sink.take() } else { None };
        let mut machine = virtual_machine_recorded(place, config, record).expect("the shipped configuration");
        let seen = Rc::new(RefCell::new(Seen::default()));
        let keep = seen.clone();
        machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        machine.spawn("watchdog", State::Run).expect("the watchdog starts");
        Self { machine, seen, route, let_go: 0 }
    }

    /// Waits until the steering is homed and the pose known, then sends the goal.
    pub fn go(&mut self) {
        for _ in 0..60 {
            self.pass(0.5);
            let seen = self.seen.borrow();
            if seen.motion.homed && seen.holds.is_idle() && seen.estimates > 20 {
                break;
            }
        }
        self.send();
    }

    /// Sends the goal again.
    pub fn send(&mut self) {
        let now = self.machine.now();
        self.machine.inject(now, self.route.clone());
    }

    /// Sends another goal, or cancels it.
    pub fn send_to(&mut self, id: i32, places: &[(f64, f64)]) {
        let waypoint = |&(x, y): &(f64, f64)| Waypoint { x, y, ..Waypoint::default() };
        let now = self.machine.now();
        let waypoints = places.iter().map(waypoint).collect();
        self.machine.inject(now, CmdGoal { timestamp: 0, id, waypoints, r#loop: false });
    }

    /// Advances the time without an attendant, s.
    pub fn pass(&mut self, seconds: f64) {
        let end = self.machine.now() + Duration::from_secs_f64(seconds);
        self.machine.run_until(end);
    }

    /// Advances the time with an attendant, s.
    pub fn patrol(&mut self, seconds: f64) {
        let end = self.machine.now() + Duration::from_secs_f64(seconds);
        while self.machine.now() < end {
            let now = self.machine.now();
            self.machine.run_until((now + LOOK).min(end));
            let waits = self.seen.borrow().waits;
            if waits.is_some_and(|since| now.since(since) >= WAITS) {
                self.let_go += 1;
                self.seen.borrow_mut().waits = None;
                self.send();
            }
        }
    }

    /// Copy of the observed values.
    pub fn seen(&self) -> Seen {
        self.seen.borrow().clone()
    }

    /// Mean speed since earlier values, m/s.
    pub fn speed_since(&self, before: &Seen, seconds: f64) -> f64 {
        (self.seen.borrow().way - before.way) / seconds
    }

    /// True if the planner is configured, so that a rename is noticed.
    pub fn planner_runs(&self) -> bool {
        let pid = self.machine.pid(planner::NAME);
        pid.and_then(|pid| self.machine.shell(pid)).is_some_and(|shell| !shell.module().subscriptions().is_empty())
    }
}

impl Seen {
    /// Number of contacts caused by the robot.
    pub fn own_contacts(&self) -> usize {
        self.contacts.iter().filter(|(_, contact)| contact.mover == Mover::Robot).count()
    }

    fn take(&mut self, now: Instant, news: &News<'_>) {
        let seconds = now.as_nanos() as f64 / 1e9;
        match news {
            News::Message { message: Message::SimDataTruth(truth), .. } => {
                let (dx, dy) = (truth.x - self.truth.x, truth.y - self.truth.y);
                if self.truth.timestamp != 0 {
                    self.way += dx.hypot(dy);
                    let dt = (truth.timestamp - self.truth.timestamp) as f64 / 1e6;
                    for (whose, list) in [("motion", &self.holds), ("goal", &self.goal_holds)] {
                        *self.causes.entry((whose, list.first())).or_default() += dt;
                    }
                }
                self.truth = truth.clone();
            }
            News::Note { module, line } if *module == config::SIMULATOR && line.starts_with("contact: ") => {
                let contact: Contact = line.parse().expect("a contact");
                self.answered.push(self.answers(seconds, &contact));
                self.contacts.push((seconds, contact));
            }
            News::Message { message: Message::LlDataRanges(ranges), .. } => self.on_ranges(seconds, ranges),
            News::Message { message: Message::MlDataGoal(goal), .. } => self.on_goal(now, goal),
            News::Message { message: Message::LlCmdMotion(command), .. } => self.command = command.clone(),
            News::Message { message: Message::LlDataMotion(motion), .. } => self.motion = motion.clone(),
            News::Message { message: Message::LlDataHold(list), .. } if list.is_of_motion() => {
                self.holds = list.clone();
            }
            News::Message { message: Message::LlDataHold(list), .. } if list.is_of_goal() => {
                self.goal_holds = list.clone();
                let waits = matches!(list.first(), Some(Hold::PlannerLatched | Hold::PauseLatched));
                self.waits = waits.then(|| self.waits.unwrap_or(now));
            }
            News::Message { message: Message::MlDataEstimate(estimate), .. } => {
                self.estimates = if estimate.quality >= 2 { self.estimates + 1 } else { 0 };
            }
            _ => {}
        }
    }

    fn on_ranges(&mut self, seconds: f64, ranges: &lowlevel::DataRanges) {
        let robot = Pose::new(self.truth.x, self.truth.y, self.truth.theta);
        let sonars = ranges.readings.iter().filter(|one| one.kind == Reading::SONAR && one.status == Reading::MEASURED);
        for one in sonars {
            let known = self.echoes.iter().any(|echo| (echo.sonar, echo.fired) == (one.id, one.timestamp));
            if !known {
                let pose = robot * Pose::new(one.x, one.y, one.theta);
                let (sonar, fired, at) = (one.id, one.timestamp, seconds);
                self.echoes.push_back(Echo { sonar, fired, at, pose, beam: one.beam, distance: one.distance });
            }
        }
        while self.echoes.front().is_some_and(|old| seconds - old.at > ECHOES_KEPT_FOR_S) {
            self.echoes.pop_front();
        }
    }

    /// Sonars that had answered what a contact touched, and how long before.
    fn answers(&self, seconds: f64, contact: &Contact) -> Vec<(i32, f64)> {
        let of_it = |echo: &&Echo| {
            let from = echo.pose.point();
            let bearing = (contact.at.y - from.y).atan2(contact.at.x - from.x);
            let within = (echo.pose.theta + -bearing).radians().abs() < echo.beam / 2.0 + 0.1;
            let off = from.distance(contact.at) - PERSON_M - echo.distance;
            // Who walks was elsewhere.
            let walked = contact.person.map_or(0.0, |person| person.towards_mps.abs()) * (seconds - echo.at);
            within && off.abs() < ANSWER_M + walked
        };
        let mut answers: Vec<(i32, f64)> =
            self.echoes.iter().filter(of_it).map(|echo| (echo.sonar, seconds - echo.at)).collect();
        answers.sort_by(|a, b| b.1.total_cmp(&a.1));
        answers
    }

    fn on_goal(&mut self, now: Instant, goal: &DataGoal) {
        self.waypoints += u32::from(goal.waypoint != self.goal.waypoint);
        self.failed += u32::from(goal.status == DataGoal::FAILED && self.goal.status != DataGoal::FAILED);
        self.told.0 += 1;
        self.told.1 += u32::from(goal.status == DataGoal::BLOCKED);
        if goal.message != self.goal.message {
            if self.words.len() >= 100 {
                self.words.remove(0);
            }
            self.words.push((now.as_nanos() as f64 / 1e9, goal.message.clone()));
        }
        self.goal = goal.clone();
    }
}
