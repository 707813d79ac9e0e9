//! Whole robot in virtual time: the same modules, including the watchdog, on simulated buses. Live tests can only give
//! bounds; this one is exact to the nanosecond.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod auxiliary;
mod bases;
mod blind;
mod by_sheets;
mod campaign;
mod canopen_io;
#[path = "../support/courier_on_two_buses.rs"]
mod courier_on_two_buses;
mod drive_tables;
mod estimator;
mod faults;
mod gamepad;
mod guard;
mod imu;
mod io;
mod lidar;
mod logs;
mod loss;
mod modes;
mod patrol;
mod power;
#[path = "../support/rovers.rs"]
mod rovers;
#[path = "../support/stands.rs"]
mod stands;
mod stops;
mod storm;
mod tricycle;
mod two_buses;
mod velocity;
#[path = "../support/wheel_faults.rs"]
mod wheel_faults;

use base::{Duration, Instant, can};
use messages::{Hold, Message, lowlevel};
use module::State;
use robot::place::RobotLocation;
use robot::topology::virtual_machine;
use sim::check::Checkers;
use sim::host::{Config, News, Virtual};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

#[derive(Default)]
struct Seen {
    frames: Vec<(Instant, can::Frame)>,
    motion: Option<lowlevel::DataMotion>,
    holds: lowlevel::DataHold,
    speed: f64,
    steering: f64,
    messages: u64,
    all_run: Option<Instant>,
    critical: Option<Instant>,
}

/// Robot on which the rules of [`sim::check`] hold in every test.
struct Robot {
    machine: Virtual,
    seen: Rc<RefCell<Seen>>,
    checkers: Rc<RefCell<Checkers>>,
}

fn at(seconds: f64) -> Instant {
    Instant::ZERO + Duration::from_secs_f64(seconds)
}

/// Shipped robot without visitors, as fast as it is commanded: tests of the guard have a place of their own.
fn place() -> RobotLocation {
    let sets = ["guard.ranging=none", "guard.speed_blind_mps=2.0"].map(String::from);
    let place = guarded_place();
    RobotLocation { sets: [place.sets, sets.into()].concat(), ..place }
}

/// Shipped robot without visitors.
fn guarded_place() -> RobotLocation {
    RobotLocation {
        config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: vec!["world.people=0".into()],
        sim: true,
        world: Some(Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/worlds/hall.toml")),
    }
}

/// Shipped robot with these tables, in a folder of this name.
fn with_tables(name: &str, tables: &str) -> RobotLocation {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let shipped = place();
    for file in ["sim.toml", "modules.toml"] {
        std::fs::copy(shipped.config.join(file), folder.join(file)).expect("the shipped configuration");
    }
    let robot = std::fs::read_to_string(shipped.config.join("robot.toml")).expect("the shipped configuration");
    std::fs::write(folder.join("robot.toml"), robot + tables).expect("a file");
    RobotLocation { config: folder, ..shipped }
}

/// Shipped robot without its middle level: the test estimates and plans.
fn low_level() -> RobotLocation {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("low-level-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let shipped = place();
    for file in ["robot.toml", "sim.toml"] {
        std::fs::copy(shipped.config.join(file), folder.join(file)).expect("the shipped configuration");
    }
    let modules = std::fs::read_to_string(shipped.config.join("modules.toml")).expect("the shipped configuration");
    let middle = |entry: &&str| ["estimator", "planner"].iter().any(|name| entry.contains(&format!("name = {name:?}")));
    let entries: Vec<&str> = modules.split("[[modules]]").filter(|entry| !middle(entry)).collect();
    std::fs::write(folder.join("modules.toml"), entries.join("[[modules]]")).expect("a file");
    RobotLocation { config: folder, ..shipped }
}

impl Robot {
    fn new(seed: u64) -> Self {
        Self::with(Config { seed, lcm_jitter: Duration::from_micros(200), ..Config::default() })
    }

    fn with(config: Config) -> Self {
        Self::at(&place(), config)
    }

    fn at(place: &RobotLocation, config: Config) -> Self {
        let mut machine = virtual_machine(place, config).expect("the shipped configuration");
        let seen = Rc::new(RefCell::new(Seen::default()));
        let keep = seen.clone();
        machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        let limits = robot::checks::limits(place, Duration::from_secs(10)).expect("the shipped configuration");
        let checkers = Rc::new(RefCell::new(Checkers::new(limits)));
        let keep = checkers.clone();
        machine.observe(move |now, news| keep.borrow_mut().observe(now, news));
        machine.spawn("watchdog", State::Run).expect("the watchdog starts");
        Self { machine, seen, checkers }
    }

    /// All modules run, the steering is homed.
    fn ready(seed: u64) -> Self {
        let mut robot = Self::new(seed);
        robot.machine.run_until(at(12.0));
        assert!(robot.motion().homed, "{}", robot.motion().reason);
        robot
    }

    /// Commands at 20 Hz from now on, for a while; queued in the machine.
    fn drive(&mut self, speed: f64, steering: f64, seconds: f64) {
        let begin = self.machine.now();
        for n in 0..(seconds * 20.0) as u32 {
            self.machine.inject(begin + n * Duration::from_millis(50), command(speed, steering));
        }
    }

    /// The same by a deliberate press: zero first.
    fn drive_anew(&mut self, speed: f64, steering: f64, seconds: f64) {
        self.machine.inject(self.machine.now(), command(0.0, steering));
        self.drive(speed, steering, seconds);
    }

    fn pass(&mut self, seconds: f64) {
        self.machine.run_until(self.machine.now() + Duration::from_secs_f64(seconds));
    }

    fn motion(&self) -> lowlevel::DataMotion {
        self.seen.borrow().motion.clone().expect("20 Hz")
    }

    /// Most important cause that holds the motion.
    fn hold(&self) -> Option<Hold> {
        self.seen.borrow().holds.first()
    }

    fn speed(&self) -> f64 {
        self.seen.borrow().speed
    }

    /// Instant of the first quick stop for the propulsion after `since`.
    fn quick_stop_after(&self, since: Instant) -> Instant {
        let stops = |frame: &can::Frame| frame.id() == can::Id::Standard(0x501) && frame.data()[0] == 0x0B;
        let seen = self.seen.borrow();
        seen.frames.iter().find(|(at, frame)| *at > since && stops(frame)).expect("a quick stop").0
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert_eq!(self.checkers.borrow().violation(), None);
        }
    }
}

impl Seen {
    fn take(&mut self, now: Instant, news: &News<'_>) {
        match news {
            News::Can { frame, .. } => self.frames.push((now, *frame)),
            News::Message { message, .. } => {
                self.messages += 1;
                match message {
                    Message::LlDataMotion(motion) => self.motion = Some(motion.clone()),
                    Message::LlDataHold(list) if list.is_of_motion() => self.holds = list.clone(),
                    Message::SimDataTruth(truth) => (self.speed, self.steering) = (truth.speed, truth.steering),
                    Message::CmDataProcesses(list) => {
                        let run = list.processes.iter().filter(|process| process.state == State::Run as i8).count();
                        if run == list.processes.len() && self.all_run.is_none() {
                            self.all_run = Some(now);
                        }
                    }
                    Message::CmEventError(error) if error.number == base::Fault::CriticalModule as i32 => {
                        self.critical = self.critical.or(Some(now));
                    }
                    _ => {}
                }
            }
            _ => {}
        }
    }
}

fn command(speed: f64, steering: f64) -> lowlevel::CmdMotion {
    let priority = lowlevel::CmdMotion::REMOTE;
    lowlevel::CmdMotion { timestamp: 0, speed, steering, priority, source: "test".into() }
}

/// Drives, has two processes killed, drives again; the digest shows whether everything happened as before.
fn eventful(seed: u64) -> (u64, u64) {
    let mut robot = Robot::ready(seed);
    robot.drive(0.4, 0.2, 3.0);
    robot.pass(3.5);
    robot.drive(-0.3, -0.3, 4.0);
    robot.pass(1.0);
    let pid = robot.machine.pid("driver_rs485a").expect("it runs");
    robot.machine.kill(pid);
    robot.pass(1.0);
    let pid = robot.machine.pid("driver_canbus").expect("it runs");
    robot.machine.kill(pid);
    robot.pass(15.0);
    robot.drive(0.5, 0.0, 1.0);
    robot.pass(2.0);
    let messages = robot.seen.borrow().messages;
    (robot.machine.digest(), messages)
}

#[test]
fn the_same_seed_gives_the_same_run_bit_for_bit() {
    let (digest, messages) = eventful(7);
    assert_eq!(eventful(7), (digest, messages));
    assert_ne!(eventful(8).0, digest);
    assert!(messages > 3000, "{messages} messages: the robot lived");
}

#[test]
fn all_modules_run_within_a_second_and_the_steering_is_homed_soon_after() {
    let robot = Robot::ready(1);
    let all_run = robot.seen.borrow().all_run.expect("all run");
    assert!(all_run <= at(1.0), "{all_run:?}");
}

#[test]
fn it_drives_as_commanded() {
    let mut robot = Robot::ready(1);
    robot.drive(0.4, 0.0, 3.0);
    robot.pass(2.9);
    assert!((robot.speed() - 0.4).abs() < 0.01, "{}", robot.speed());
    robot.pass(1.5);
    assert!(robot.speed().abs() < 0.001);
}

#[test]
fn silence_begins_a_quick_stop_when_the_command_expires() {
    let mut robot = Robot::ready(1);
    let begin = robot.machine.now();
    robot.drive(0.4, 0.0, 2.0);
    robot.pass(4.0);
    // The last command was published 1.95 s after the beginning and received up to 0.25 ms later; a frame of 6 bytes
    // takes at most 115 us at 1 Mbit/s, twice that at 500 kbit/s, and waits for at most one other.
    let last = begin + Duration::from_millis(1950);
    let stop = robot.quick_stop_after(begin + Duration::from_millis(500));
    let took = stop.since(last);
    assert!((250_000..251_000).contains(&took.as_micros()), "{took:?}");
}

#[test]
fn the_death_of_a_critical_module_begins_the_stop_within_milliseconds() {
    let mut robot = Robot::ready(1);
    robot.drive(0.4, 0.0, 10.0);
    robot.pass(2.0);
    let died = robot.machine.now();
    let pid = robot.machine.pid("driver_rs485a").expect("it runs");
    robot.machine.kill(pid);
    robot.pass(3.0);
    let took = robot.quick_stop_after(died).since(died);
    assert!(took < Duration::from_millis(5), "{took:?}");
    assert!(robot.seen.borrow().critical.is_some());
    assert!(robot.speed().abs() < 0.001, "it resumed by itself");
    assert_eq!(robot.hold(), Some(Hold::NotReleased));
}

#[test]
fn when_the_drives_driver_hangs_the_drives_stop_by_themselves() {
    let mut robot = Robot::ready(1);
    robot.drive(0.4, 0.0, 10.0);
    robot.pass(2.0);
    let pid = robot.machine.pid("driver_canbus").expect("it runs");
    robot.machine.hang(pid);
    // The master's heartbeat may be missing for 200 ms; then 0.4 m/s at 1.5 m/s².
    robot.pass(0.2);
    assert!(robot.speed() > 0.35);
    robot.pass(0.4);
    assert!(robot.speed().abs() < 0.001, "{}", robot.speed());
    // The watchdog receives nothing for 2 s, ends the process and restarts it.
    robot.pass(12.0);
    assert_ne!(robot.machine.pid("driver_canbus"), Some(pid));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
}

#[test]
fn when_the_watchdog_dies_the_robot_stops_within_its_silence() {
    let mut robot = Robot::ready(1);
    robot.drive(0.4, 0.0, 10.0);
    robot.pass(2.0);
    let died = robot.machine.now();
    let pid = robot.machine.pid("watchdog").expect("it runs");
    robot.machine.kill(pid);
    robot.pass(1.0);
    let took = robot.quick_stop_after(died).since(died);
    assert!(took <= Duration::from_millis(252), "{took:?}");
    assert_eq!(robot.hold(), Some(Hold::WatchdogSilent));
}
