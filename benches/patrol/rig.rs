//! A robot in virtual time that patrols a world by itself, and what is seen of it from outside: its way, whom it touched
//! and who moved, how its goal fares. An attendant lets the planner go again when a stop was for somebody's bumping into
//! the robot, as an operator does; how often is counted.
#![allow(dead_code, reason = "bench and test use it, each its part")]

use base::{Duration, Instant};
use messages::middlelevel::{CmdGoal, DataGoal, Waypoint};
use messages::{Hold, Message, lowlevel, simulation};
use module::State;
use record::Sink;
use robot::config;
use robot::place::Place;
use robot::topology::virtual_machine_recorded;
use sim::host::{self, News, Virtual};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

/// The attendant looks after the robot this often, and acts when it has waited so long for an operator.
const LOOK: Duration = Duration::from_millis(500);
const WAITS: Duration = Duration::from_secs(2);

/// What an observer sees.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// Where the robot really is.
    pub truth: simulation::DataTruth,
    /// Way driven, m.
    pub way: f64,
    /// Contacts, a line each, with the time; and whether the robot moved into the other.
    pub contacts: Vec<(f64, bool, String)>,
    /// How the goal fares.
    pub goal: DataGoal,
    /// Waypoints reached.
    pub waypoints: u32,
    /// How often the status was FAILED.
    pub failed: u32,
    /// How often it was told, and how often of these something was in the way.
    pub told: (u32, u32),
    /// Since when the planner waits for an operator.
    pub waits: Option<Instant>,
    /// What the planner commanded last.
    pub command: lowlevel::CmdMotion,
    /// The drives.
    pub motion: lowlevel::DataMotion,
    /// What stands against motion.
    pub holds: lowlevel::DataHold,
    /// What keeps the goal from being driven to.
    pub goal_holds: lowlevel::DataHold,
    /// Words of ML_DATA_GOAL, each when it changed, s; the last hundred.
    pub words: Vec<(f64, String)>,
    estimates: u32,
}

/// The robot.
pub struct Patrol {
    /// Its machine.
    pub machine: Virtual,
    /// What was seen.
    pub seen: Rc<RefCell<Seen>>,
    route: CmdGoal,
    /// How often the attendant let the planner go again.
    pub let_go: u32,
}

/// The shipped robot in the world of this name.
pub fn place(world: &str, sets: &[String]) -> Place {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    Place {
        config: root.join("conf/advee"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: sets.to_vec(),
        sim: true,
        world: Some(root.join("conf/worlds").join(world).with_extension("toml")),
    }
}

impl Patrol {
    /// A robot in a world of this name, whose route `patrol` it is to drive; `people`: so many, not as the world has
    /// it. `sink` for what the planner is told.
    pub fn new(world: &str, people: Option<u32>, seed: u64, sink: Option<Sink>) -> Self {
        let sets: Vec<String> = people.map(|count| format!("world.people={count}")).into_iter().collect();
        let place = place(world, &sets);
        let read = config::world(&place.config, place.world.as_deref(), &place.sets).expect("a shipped world");
        let route = read.routes.iter().find(|route| route.name == "patrol").expect("a patrol");
        let waypoint = |at: &navitools::Point| Waypoint { x: at.x, y: at.y, ..Waypoint::default() };
        let waypoints = route.waypoints.iter().map(waypoint).collect();
        let route = CmdGoal { timestamp: 0, id: 1, waypoints, r#loop: route.looped };
        let config = host::Config { seed, lcm_jitter: Duration::from_micros(200), ..host::Config::default() };
        let mut sink = sink;
        let record = move |name: &str| if name == planner::NAME { sink.take() } else { None };
        let mut machine = virtual_machine_recorded(&place, config, record).expect("the shipped configuration");
        let seen = Rc::new(RefCell::new(Seen::default()));
        let keep = seen.clone();
        machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        machine.spawn("watchdog", State::Run).expect("the watchdog starts");
        Self { machine, seen, route, let_go: 0 }
    }

    /// Homed, found, and sent on its way.
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

    /// Says the goal again.
    pub fn send(&mut self) {
        let now = self.machine.now();
        self.machine.inject(now, self.route.clone());
    }

    /// Sends it elsewhere, or nowhere.
    pub fn send_to(&mut self, id: i32, places: &[(f64, f64)]) {
        let waypoint = |&(x, y): &(f64, f64)| Waypoint { x, y, ..Waypoint::default() };
        let now = self.machine.now();
        let waypoints = places.iter().map(waypoint).collect();
        self.machine.inject(now, CmdGoal { timestamp: 0, id, waypoints, r#loop: false });
    }

    /// Lets time pass, s, without an attendant.
    pub fn pass(&mut self, seconds: f64) {
        let end = self.machine.now() + Duration::from_secs_f64(seconds);
        self.machine.run_until(end);
    }

    /// Lets time pass, s; the attendant is there.
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

    /// A copy of what was seen.
    pub fn seen(&self) -> Seen {
        self.seen.borrow().clone()
    }

    /// Mean speed since an earlier look, m/s.
    pub fn speed_since(&self, before: &Seen, seconds: f64) -> f64 {
        (self.seen.borrow().way - before.way) / seconds
    }

    /// Subscriptions of the planner, so that a rename is noticed.
    pub fn planner_runs(&self) -> bool {
        let pid = self.machine.pid(planner::NAME);
        pid.and_then(|pid| self.machine.shell(pid)).is_some_and(|shell| !shell.module().subscriptions().is_empty())
    }
}

impl Seen {
    /// Contacts that the robot moved into.
    pub fn own_contacts(&self) -> usize {
        self.contacts.iter().filter(|(_, own, _)| *own).count()
    }

    fn take(&mut self, now: Instant, news: &News<'_>) {
        let seconds = now.as_nanos() as f64 / 1e9;
        match news {
            News::Message { message: Message::SimDataTruth(truth), .. } => {
                let (dx, dy) = (truth.x - self.truth.x, truth.y - self.truth.y);
                if self.truth.timestamp != 0 {
                    self.way += dx.hypot(dy);
                }
                self.truth = truth.clone();
            }
            News::Note { module, line } if *module == config::SIMULATOR && line.starts_with("contact: ") => {
                let own = line.starts_with("contact: by robot");
                self.contacts.push((seconds, own, (*line).into()));
            }
            News::Message { message: Message::MlDataGoal(goal), .. } => self.on_goal(now, goal),
            News::Message { message: Message::LlCmdMotion(command), .. } => self.command = command.clone(),
            News::Message { message: Message::LlDataMotion(motion), .. } => self.motion = motion.clone(),
            News::Message { message: Message::LlDataHold(list), .. } if list.is_of_motion() => {
                self.holds = list.clone();
            }
            News::Message { message: Message::LlDataHold(list), .. } if list.is_of_goal() => {
                self.goal_holds = list.clone();
                let waits = list.first() == Some(Hold::PlannerLatched);
                self.waits = waits.then(|| self.waits.unwrap_or(now));
            }
            News::Message { message: Message::MlDataEstimate(estimate), .. } => {
                self.estimates = if estimate.quality >= 2 { self.estimates + 1 } else { 0 };
            }
            _ => {}
        }
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
