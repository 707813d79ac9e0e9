//! Faults of a driving robot in virtual time, and when each of its wheels is stopped on the wire: for
//! `benches/wheel_faults.rs`, and for a test of some of them.
//!
//! Each fault has a robot of its own, and everything about it follows from a seed and its number: kind, target, motion,
//! instant.

use base::can::{Frame, Id};
use base::{Duration, Instant};
use kinematics::Twist;
use messages::{Message, lowlevel, middlelevel, simulation};
use module::State;
use robot::config::SIMULATOR;
use robot::place::RobotLocation;
use robot::topology::virtual_machine;
use sim::check::wire::{Drive, Heartbeat};
use sim::check::{Base, Limits, wire};
use sim::host::{Config, News, Virtual};
use simulator::Random;
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::fmt;
use std::path::Path;
use std::rc::Rc;

/// Longest time from a fault to the stop of each other wheel (docs/design.md, section 1.4).
pub const STOP_MAX: Duration = Duration::from_millis(300);
/// Observed after a fault.
const OBSERVED: Duration = Duration::from_millis(1500);
/// Longest time until a robot is ready; one that steers is homed before.
const READY_MAX: Duration = Duration::from_secs(30);
/// Longest time until the planner drives.
const PLANNED_MAX: Duration = Duration::from_secs(15);
/// Period of an operator's commands, and for how long it commands zero first.
const COMMANDS: Duration = Duration::from_millis(50);
const ZERO: Duration = Duration::from_millis(500);
/// Time from the fault of a module on which the motion does not depend until the operator commands zero.
const OBEY: Duration = Duration::from_millis(500);
/// Part of its target to which a wheel must have slowed down to count as obeying.
const OBEYS: f64 = 0.9;
/// Name of the porter on four wheels that do not go sideways, which has no folder of its own.
pub const SKID_STEER: &str = "skid-steer";
/// How much too fast a wheel is that runs away, m/s.
const TOO_FAST: (f64, f64) = (0.3, 0.8);
/// Speed of a commanded motion, shared between translation and rotation, m/s.
const SPEED: (f64, f64) = (0.15, 0.45);
/// Way to the planner's goal, m.
const GOAL: f64 = 3.5;
/// CiA 402-2, statusword: operation enabled, and the bits that show it.
const OPERATION_ENABLED: u16 = 0x27;
const STATUS_MASK: u16 = 0x6F;
/// Middle of `conf/worlds/empty.toml`, where the robot starts.
const START: (f64, f64) = (10.0, 6.0);
/// Name of the steering among the drives.
const STEERING: &str = "steering";

/// Kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A module on which the motion depends ends, as by SIGKILL.
    Dies,
    /// It hangs.
    Hangs,
    /// The watchdog ends.
    WatchdogDies,
    /// The watchdog hangs.
    WatchdogHangs,
    /// Another module ends, and the operator stops the robot half a second later.
    OtherDies,
    /// Another module hangs, likewise.
    OtherHangs,
    /// The master is cut off the drives.
    Cut,
    /// The master's controller goes bus-off.
    BusOff,
    /// A drive goes into its fault state.
    DriveFault,
    /// A drive neither receives nor sends.
    DriveSilent,
    /// A drive restarts.
    DriveReboots,
    /// A drive is lost, or in fault, while all are enabled for a motion that begins.
    NotEnabled,
    /// A wheel is faster than commanded.
    TooFast,
    /// An encoder counts backwards, so that its wheel turns the other way, faster and faster.
    Reversed,
}

impl Kind {
    pub const ALL: [Self; 14] = [
        Self::Dies,
        Self::Hangs,
        Self::WatchdogDies,
        Self::WatchdogHangs,
        Self::OtherDies,
        Self::OtherHangs,
        Self::Cut,
        Self::BusOff,
        Self::DriveFault,
        Self::DriveSilent,
        Self::DriveReboots,
        Self::NotEnabled,
        Self::TooFast,
        Self::Reversed,
    ];

    /// Name in a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dies => "module dies",
            Self::Hangs => "module hangs",
            Self::WatchdogDies => "watchdog dies",
            Self::WatchdogHangs => "watchdog hangs",
            Self::OtherDies => "other module dies",
            Self::OtherHangs => "other module hangs",
            Self::Cut => "bus cut",
            Self::BusOff => "master bus-off",
            Self::DriveFault => "drive in fault",
            Self::DriveSilent => "drive silent",
            Self::DriveReboots => "drive rebooted",
            Self::NotEnabled => "drive not enabled",
            Self::TooFast => "wheel too fast",
            Self::Reversed => "wheel reversed",
        }
    }

    /// True if it befalls one wheel, or the steering: all others must stop.
    fn is_of_drive(self) -> bool {
        use Kind::{DriveFault, DriveReboots, DriveSilent, NotEnabled, Reversed, TooFast};
        matches!(self, DriveFault | DriveSilent | DriveReboots | NotEnabled | TooFast | Reversed)
    }

    /// True if the robot need not stop by itself, but must obey.
    pub fn obeys(self) -> bool {
        matches!(self, Self::OtherDies | Self::OtherHangs)
    }
}

/// A robot's folder, and what a fault can befall there.
pub struct Subject {
    pub name: String,
    place: RobotLocation,
    limits: Limits,
    /// It can go to the side, or turn on the spot.
    sideways: bool,
    /// Half of the track, or the radius of a base: m/s of a wheel per rad/s.
    arm: f64,
    /// Modules on which the motion depends, and the others; without the watchdog.
    critical: Vec<String>,
    others: Vec<String>,
}

/// What a base does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// An operator commands this velocity: vx and vy in m/s, omega in rad/s.
    Velocity(f64, f64, f64),
    /// The planner drives to this place, m.
    Goal(f64, f64),
}

/// A fault, complete.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    pub number: u64,
    pub kind: Kind,
    /// Module, bus, or drive.
    pub target: String,
    /// Name and value in `SIM_CMD_FAULT`, of faults of a bus or a drive.
    what: (&'static str, f64),
    pub motion: Motion,
    /// From the first command that moves the robot, or the first turn of a wheel, to the fault, s; of a drive that is
    /// not enabled from 0.3 s earlier.
    after: f64,
    /// Of the machine.
    seed: u64,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { number, kind, target, what, motion, after, .. } = self;
        write!(f, "number {number}: {} ({target} {} {:.3}) after {after:.6} s of ", kind.name(), what.0, what.1)?;
        match motion {
            Motion::Velocity(vx, vy, omega) => write!(f, "velocity {vx:.3} {vy:.3} {omega:.3}"),
            Motion::Goal(x, y) => write!(f, "the way to {x:.2}, {y:.2}"),
        }
    }
}

/// What became of a fault.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// All wheels that turned are stopped, the last one after this time.
    Stopped(Duration),
    /// These wheels were not stopped, turn again at the end, or turn although a drive is lost: their names.
    Missed(Vec<String>),
    /// No wheel turned that had to stop.
    Unmoved,
}

/// The wheels on the wire.
#[derive(Default)]
struct Seen {
    drives: Vec<Drive>,
    buses: Vec<String>,
    ready: bool,
    turns: Vec<bool>,
    /// Last target of each, in units of its drive.
    targets: Vec<f64>,
    /// Since when it is measured, and the target of each wheel at that time.
    since: Option<Instant>,
    before: Vec<f64>,
    stopped: Vec<Option<Instant>>,
    slower: Vec<Option<Instant>>,
    /// The drive of which another motion must not begin, and what it reports of that.
    victim: Option<Drive>,
    absence: Absence,
    /// While that is absent: when each ceased to turn for the last time, and whether it still turned when that was
    /// back.
    ended_without: Vec<Option<Instant>>,
    turns_on: Vec<bool>,
}

/// Whether a drive is enabled since the fault.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Absence {
    /// It has reported nothing else yet.
    #[default]
    Unseen,
    /// It is not enabled.
    Seen,
    /// It is enabled again.
    Over,
}

impl Seen {
    fn take(&mut self, now: Instant, news: &News<'_>) {
        match news {
            News::Can { bus, frame, .. } => {
                if let Some(bus) = self.buses.iter().position(|own| own == bus) {
                    self.on_frame(now, bus as u8, frame);
                }
            }
            News::Message { message: Message::LlDataVelocity(velocity), .. } => self.ready = velocity.ready,
            _ => {}
        }
    }

    fn on_frame(&mut self, now: Instant, bus: u8, frame: &Frame) {
        let Id::Standard(id) = frame.id() else { return };
        let id = wire::on_bus(bus, id);
        self.watch_victim(id, frame.data());
        for (wheel, drive) in self.drives.iter().enumerate() {
            let Some(turns) = drive.turns(id, frame.data()) else { continue };
            let turned = std::mem::replace(&mut self.turns[wheel], turns);
            if !turns {
                self.targets[wheel] = 0.0;
            } else if let Some((_, target)) = drive.commanded(frame.data()).filter(|_| id == drive.command.id) {
                self.targets[wheel] = target;
            }
            if self.since.is_none() {
                continue;
            }
            if !turns {
                self.stopped[wheel].get_or_insert(now);
                if turned && self.absence != Absence::Over {
                    self.ended_without[wheel] = Some(now);
                }
            }
            if self.targets[wheel].abs() < OBEYS * self.before[wheel].abs() {
                self.slower[wheel].get_or_insert(now);
            }
        }
    }

    /// A frame of the drive that is not enabled for a motion that begins.
    fn watch_victim(&mut self, id: u16, data: &[u8]) {
        let Some(victim) = self.victim.as_ref().filter(|_| self.since.is_some()) else { return };
        let restarts = victim.heartbeat(id, data) == Some(Heartbeat::Down);
        let enabled = victim.reported(id, data).map(|status| status & STATUS_MASK == OPERATION_ENABLED);
        match (self.absence, enabled) {
            (Absence::Unseen, Some(false)) => self.absence = Absence::Seen,
            (Absence::Unseen, _) if restarts => self.absence = Absence::Seen,
            (Absence::Seen, Some(true)) => {
                self.absence = Absence::Over;
                self.turns_on.clone_from(&self.turns);
            }
            _ => {}
        }
    }

    /// Measures from now on. A wheel that stands is stopped.
    fn mark(&mut self, now: Instant) {
        let wheels = self.drives.len();
        self.since = Some(now);
        self.before.clone_from(&self.targets);
        self.stopped = self.turns.iter().map(|turns| (!turns).then_some(now)).collect();
        self.slower = vec![None; wheels];
        (self.absence, self.ended_without, self.turns_on) =
            (Absence::Unseen, self.stopped.clone(), vec![false; wheels]);
    }
}

impl Subject {
    /// The robot of this folder of `conf`, in the empty hall.
    pub fn new(name: &str) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        // As fast as it is commanded, whatever it senses; what is injected must be sensed by the drives.
        let sets = ["guard.speed_blind_mps=2.0", "limits.speed_manual_mps=0.8", "world.people=0"];
        let skids = (name == SKID_STEER).then_some("base.kind=\"skid-steer\"");
        let place = RobotLocation {
            config: root.join("conf").join(if skids.is_some() { "porter" } else { name }),
            run_dir: "/run/advee".into(),
            lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
            sets: sets.into_iter().chain(skids).map(String::from).collect(),
            sim: true,
            world: Some(root.join("conf/worlds/empty.toml")),
        };
        let limits = robot::checks::limits(&place, Duration::from_secs(10)).expect("drives that can be judged");
        let config = robot::config::Config::load(&place.config, true, &place.sets).expect("a good configuration");
        let arm = match &config.robot.base {
            Some(_) => 0.5 * (config.robot.geometry.track_m + config.robot.geometry.wheelbase_m),
            None => 0.0,
        };
        // In virtual time there are neither logs nor a page.
        let absent = [SIMULATOR, logger::NAME, web::NAME, "ros2", "bridge", watchdog::NAME];
        let (mut critical, mut others) = (Vec::new(), Vec::new());
        for guard in config.modules.iter().map(|module| &module.guard).filter(|guard| !absent.contains(&&*guard.name)) {
            // The planner's motion depends on the planner and the estimator.
            let moves = guard.critical || [planner::NAME, estimator::NAME].contains(&&*guard.name);
            if moves { &mut critical } else { &mut others }.push(guard.name.clone());
        }
        let aside = |base: &Base| base.chassis.feasible(Twist::new(0.0, 1.0, 0.0)).twist.vy != 0.0;
        let sideways = limits.base.as_ref().is_some_and(aside);
        Self { name: name.into(), sideways, arm, limits, place, critical, others }
    }

    /// The fault of this number.
    pub fn fault(&self, seed: u64, number: u64) -> Fault {
        let mut random = Random::stream(Random::stream(seed, 1).bits(), number);
        // Each kind equally often, whatever the number of faults.
        let kinds: Vec<Kind> = Kind::ALL.into_iter().filter(|kind| !self.targets(*kind).is_empty()).collect();
        let kind = kinds[(number % kinds.len() as u64) as usize];
        let targets = self.targets(kind);
        let target = pick(&targets, &mut random).clone();
        let refusals = [("fault", 0.0), ("silent", 0.0), ("reboot", 0.0)];
        let what = match kind {
            Kind::Cut => ("cut", 0.0),
            Kind::BusOff => ("bus_off", 0.0),
            Kind::DriveFault => ("fault", 0.0),
            Kind::DriveSilent => ("silent", 0.0),
            Kind::DriveReboots => ("reboot", 0.0),
            Kind::NotEnabled => *pick(&refusals, &mut random),
            Kind::TooFast => ("runaway", between(TOO_FAST, &mut random)),
            Kind::Reversed => ("encoder", -1.0),
            Kind::Dies | Kind::WatchdogDies | Kind::OtherDies => ("dies", 0.0),
            Kind::Hangs | Kind::WatchdogHangs | Kind::OtherHangs => ("hangs", 0.0),
        };
        let planned = [planner::NAME, estimator::NAME].contains(&&*target);
        let motion = if planned { goal(&mut random) } else { self.velocity(&mut random) };
        let after = between(if kind == Kind::NotEnabled { (0.0, 0.6) } else { (0.2, 2.2) }, &mut random);
        Fault { number, kind, target, what, motion, after, seed: random.bits() }
    }

    /// What a fault of this kind can befall.
    fn targets(&self, kind: Kind) -> Vec<String> {
        let wheels = || self.limits.wheels.iter().map(|wheel| wheel.name.clone());
        let steering = || self.limits.steering.iter().map(|_| STEERING.to_owned());
        match kind {
            Kind::Dies | Kind::Hangs => self.critical.clone(),
            Kind::OtherDies | Kind::OtherHangs => self.others.clone(),
            Kind::WatchdogDies | Kind::WatchdogHangs => vec![watchdog::NAME.into()],
            Kind::Cut | Kind::BusOff => self.limits.buses.clone(),
            // That of a single wheel is in `advee/tests/virtual/tricycle.rs`: there is no other wheel to be stopped.
            Kind::Reversed if self.limits.wheels.len() < 2 => Vec::new(),
            Kind::TooFast | Kind::Reversed => wheels().collect(),
            _ => wheels().chain(steering()).collect(),
        }
    }

    /// A velocity that the base can have: straight ahead, back, on a curve, on the spot, to a side.
    fn velocity(&self, random: &mut Random) -> Motion {
        let speed = between(SPEED, random) * if random.chance(0.5) { 1.0 } else { -1.0 };
        if self.limits.steering.is_some() {
            // A curve that the steering can follow.
            let curvature = f64::tan(0.7 * self.limits.steering_angle) / self.limits.wheelbase;
            return Motion::Velocity(speed, 0.0, speed * curvature * between((-1.0, 1.0), random));
        }
        // Shares of the translation and of the rotation in the speed of the wheels.
        let share = *pick(&[1.0, 0.7, 0.5, 0.3, 0.0], random);
        let direction =
            if self.sideways { *pick(&[0.0, 0.25, 0.125], random) * TAU + random.uniform() * 0.4 } else { 0.0 };
        let (vx, vy) = (share * speed * direction.cos(), share * speed * direction.sin());
        let turn = if random.chance(0.5) { 1.0 } else { -1.0 };
        Motion::Velocity(vx, vy, turn * (1.0 - share) * speed.abs() / self.arm)
    }

    /// Lets a new robot drive, injects the fault, and observes the wire.
    pub fn run(&self, fault: &Fault) -> Outcome {
        let config = Config { seed: fault.seed, lcm_jitter: Duration::from_micros(200), ..Config::default() };
        let mut machine = virtual_machine(&self.place, config).expect("the shipped configuration");
        let wheels = self.limits.wheels.len();
        let seen = Rc::new(RefCell::new(Seen {
            drives: self.limits.wheels.iter().map(|wheel: &wire::Wheel| wheel.drive.clone()).collect(),
            buses: self.limits.buses.clone(),
            turns: vec![false; wheels],
            targets: vec![0.0; wheels],
            victim: (fault.kind == Kind::NotEnabled).then(|| self.victim(fault)).flatten(),
            ..Seen::default()
        }));
        let keep = seen.clone();
        machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        machine.spawn(watchdog::NAME, State::Run).expect("the watchdog starts");
        let ready = || seen.borrow().ready;
        assert!(pass_until(&mut machine, READY_MAX, ready), "{}: {fault}: it is not ready", self.name);
        let at = self.drive(&mut machine, fault, &seen);
        machine.run_until(at);
        seen.borrow_mut().mark(at);
        befall(&mut machine, fault);
        let mut since = at;
        if fault.kind.obeys() {
            since = at + OBEY;
            machine.run_until(since);
            seen.borrow_mut().mark(since);
        }
        machine.run_until(since + OBSERVED);
        self.judge(fault, since, &seen.borrow())
    }

    /// The drive that is not enabled.
    fn victim(&self, fault: &Fault) -> Option<Drive> {
        let of_wheel = self.limits.wheels.iter().find(|wheel| wheel.name == fault.target).map(|wheel| &wheel.drive);
        of_wheel.or(self.limits.steering.as_ref()).cloned()
    }

    /// Commands the motion; answers when the fault is due.
    fn drive(&self, machine: &mut Virtual, fault: &Fault, seen: &RefCell<Seen>) -> Instant {
        // At any phase of the cycles.
        let phase = Random::stream(fault.seed, 2).uniform() * 0.1;
        let begin = machine.now() + Duration::from_secs_f64(phase);
        let after = Duration::from_secs_f64(fault.after);
        let (vx, vy, omega) = match fault.motion {
            Motion::Velocity(vx, vy, omega) => (vx, vy, omega),
            Motion::Goal(x, y) => {
                let waypoint = middlelevel::Waypoint { x, y, theta: 0.0, tolerance: 0.1, heading: false };
                let waypoints = vec![waypoint];
                machine.inject(begin, middlelevel::CmdGoal { timestamp: 0, id: 1, waypoints, ..Default::default() });
                let turns = || seen.borrow().turns.contains(&true);
                assert!(pass_until(machine, PLANNED_MAX, turns), "{}: {fault}: the planner does not drive", self.name);
                return machine.now() + after;
            }
        };
        let moves = begin + ZERO;
        let at = if fault.kind == Kind::NotEnabled { moves - Duration::from_millis(300) } else { moves } + after;
        let zero = if fault.kind.obeys() { at + OBEY } else { Instant::NEVER };
        let mut due = begin;
        let mut send = |due: Instant, (vx, vy, omega): (f64, f64, f64)| {
            let (priority, source) = (lowlevel::CmdMotion::REMOTE, "test".into());
            machine.inject(due, lowlevel::CmdVelocity { timestamp: 0, vx, vy, omega, priority, source, session: 1 });
        };
        while due < at + OBEY + OBSERVED {
            send(due, if due < moves || due >= zero { (0.0, 0.0, 0.0) } else { (vx, vy, omega) });
            due += COMMANDS;
        }
        if fault.kind.obeys() {
            send(zero, (0.0, 0.0, 0.0));
        }
        at
    }

    fn judge(&self, fault: &Fault, since: Instant, seen: &Seen) -> Outcome {
        let wheels = &self.limits.wheels;
        // A single wheel is stopped itself; otherwise the others are.
        let judged =
            |wheel: usize| !fault.kind.is_of_drive() || wheels.len() == 1 || wheels[wheel].name != fault.target;
        let is_victim = |wheel: &wire::Wheel| wheel.name == fault.target;
        let stands = wheels.iter().position(is_victim).is_some_and(|victim| seen.before[victim] == 0.0);
        if matches!(fault.kind, Kind::TooFast | Kind::Reversed) && stands {
            // There is nothing to notice.
            return Outcome::Unmoved;
        }
        // A drive that is not enabled: one that is silent to the end of the observation, another one until it says that
        // it is enabled, for the motion that begins.
        let is_lost = fault.kind == Kind::NotEnabled;
        // Nothing resumes by itself.
        let is_over = !fault.kind.obeys() && fault.kind != Kind::NotEnabled;
        let stops = if fault.kind.obeys() { &seen.slower } else { &seen.stopped };
        let (mut worst, mut missed) = (None, Vec::new());
        for wheel in (0..wheels.len()).filter(|wheel| judged(*wheel)) {
            let turned = seen.before[wheel] != 0.0;
            match stops[wheel] {
                // No wheel may begin to turn, or turn again.
                _ if is_lost => {
                    let returns = seen.absence == Absence::Over;
                    if if returns { seen.turns_on[wheel] } else { seen.turns[wheel] } {
                        missed.push(wheels[wheel].name.clone());
                    }
                    worst = worst.max(seen.ended_without[wheel].map(|at| at.since(since)));
                }
                Some(_) if is_over && seen.turns[wheel] => missed.push(wheels[wheel].name.clone()),
                Some(at) if turned => worst = worst.max(Some(at.since(since))),
                None if turned => missed.push(wheels[wheel].name.clone()),
                _ => {}
            }
        }
        match worst {
            _ if !missed.is_empty() => Outcome::Missed(missed),
            Some(took) => Outcome::Stopped(took),
            None => Outcome::Unmoved,
        }
    }
}

fn pick<'a, T>(from: &'a [T], random: &mut Random) -> &'a T {
    &from[(random.bits() % from.len() as u64) as usize]
}

fn between((least, most): (f64, f64), random: &mut Random) -> f64 {
    least + (most - least) * random.uniform()
}

fn goal(random: &mut Random) -> Motion {
    let direction = random.uniform() * TAU;
    Motion::Goal(START.0 + GOAL * direction.cos(), START.1 + GOAL * direction.sin())
}

/// Passes until it is so; false if it is not so in this time.
fn pass_until(machine: &mut Virtual, within: Duration, is_so: impl Fn() -> bool) -> bool {
    let end = machine.now() + within;
    while !is_so() && machine.now() < end {
        machine.run_until(machine.now() + Duration::from_millis(50));
    }
    is_so()
}

fn befall(machine: &mut Virtual, fault: &Fault) {
    let (name, value) = fault.what;
    match name {
        "dies" | "hangs" => {
            let pid = machine.pid(&fault.target).unwrap_or_else(|| panic!("{fault}: no such process"));
            if name == "dies" { machine.kill(pid) } else { machine.hang(pid) }
        }
        _ => {
            // Longer than it is observed.
            let duration = 5.0;
            if machine.fault(&fault.target, name, value, duration) {
                return;
            }
            let (target, fault) = (fault.target.clone(), name.to_owned());
            machine.inject(machine.now(), simulation::CmdFault { timestamp: 0, target, fault, value, duration });
        }
    }
}
