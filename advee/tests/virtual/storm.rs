//! All sources command, all faults occur, in any order; the rules of [`sim::check`] must hold on every frame and at
//! every instant. And afterwards the robot can be driven again.
//!
//! `STORMS=1000 cargo test -p advee --test virtual storm` runs more; `STORM=SEED` runs one.

use super::{Robot, at, command, low_level};
use base::{Duration, Instant};
use messages::{Message, common, lowlevel, middlelevel, simulation};
use robot::place::RobotLocation;
use sim::host::Config;
use simulator::Random;
use std::sync::LazyLock;

/// Robot without estimator and planner, whose messages the storm sends.
static LOW_LEVEL: LazyLock<RobotLocation> = LazyLock::new(low_level);

const SOURCES: [(&str, i8); 5] = [("planner", 0), ("phone", 1), ("shell", 1), ("pad", 2), ("service", 3)];
/// Faults of a drive: one makes it brake, the other makes it coast.
const COMMUNICATION: f64 = 33_040.0;
const OVERCURRENT: f64 = 8976.0;
/// Seeds of earlier failures. 178: commands and TERMINATE waited for a driver that hung, and the set-points of the
/// commands filled its port's queue.
const KEPT: [u64; 1] = [178];
const TICK: Duration = Duration::from_millis(50);

/// Behavior of a source for a while.
#[derive(Clone, Copy)]
enum Mood {
    Silent,
    Holds(f64, f64),
}

struct Storm {
    robot: Robot,
    random: Random,
    moods: [Mood; SOURCES.len()],
    located: bool,
    /// Hung processes, with the end of the hang.
    hung: Vec<(Instant, u32)>,
    log: Vec<String>,
}

impl Storm {
    fn new(seed: u64) -> Self {
        let config = Config { seed, lcm_jitter: Duration::from_micros(200), ..Config::default() };
        let mut robot = Robot::at(&LOW_LEVEL, config);
        robot.machine.run_until(at(12.0));
        let random = Random::new(seed ^ 0x5707_0000);
        Self { robot, random, moods: [Mood::Silent; 5], located: true, hung: Vec::new(), log: Vec::new() }
    }

    fn below(&mut self, n: u64) -> u64 {
        self.random.bits() % n
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.below(1 << 20) as f64 / f64::from(1 << 20))
    }

    fn say(&mut self, message: impl Into<Message>) {
        let delay = Duration::from_micros(self.below(30_000));
        let at = self.robot.machine.now() + delay;
        self.robot.machine.inject(at, message);
    }

    fn note(&mut self, what: String) {
        self.log.push(format!("{:.3} s: {what}", self.robot.machine.now().as_nanos() as f64 / 1e9));
    }

    fn mood(&mut self) -> Mood {
        let steering = self.between(-0.5, 0.5);
        match self.below(8) {
            0..=3 => Mood::Silent,
            4 | 5 => Mood::Holds(0.0, steering),
            _ => Mood::Holds(self.between(-1.0, 1.0), steering),
        }
    }

    fn tick(&mut self) {
        for (index, (source, priority)) in SOURCES.into_iter().enumerate() {
            if self.below(25) == 0 {
                self.moods[index] = self.mood();
            }
            if let Mood::Holds(speed, steering) = self.moods[index] {
                let speed = if self.below(400) == 0 { f64::NAN } else { speed };
                self.say(lowlevel::CmdMotion { timestamp: 0, speed, steering, priority, source: source.into() });
            }
        }
        if !self.located && self.below(20) == 0 {
            self.located = true;
        }
        if self.below(60) == 0 {
            self.say(goal());
        }
        if self.located {
            self.say(estimate());
        }
        if self.below(50) == 0 {
            self.strike();
        }
        self.wake();
        let end = self.robot.machine.now() + TICK;
        self.robot.machine.run_until(end);
    }

    fn strike(&mut self) {
        let axis = if self.below(2) == 0 { "propulsion" } else { "steering" };
        match self.below(13) {
            0 => self.kill("driver_rs485a"),
            1 => self.kill("driver_canbus"),
            2 => self.hang("driver_canbus"),
            3 => self.hang("watchdog"),
            4 => self.hang("driver_rs485a"),
            5 => self.ail(axis, "silent", 0.0),
            6 => self.ail(axis, "fault", COMMUNICATION),
            7 => {
                let fault = if self.below(2) == 0 { "reboot" } else { "fault" };
                self.ail(axis, fault, OVERCURRENT);
            }
            8 => {
                self.note("pause".into());
                self.say(pause(true));
                let released = self.robot.machine.now() + Duration::from_millis(30 + self.below(1500));
                self.robot.machine.inject(released, pause(false));
            }
            9 | 10 => {
                let states = [common::DataState::PAUSE, common::DataState::STOP, common::DataState::TERMINATE];
                let state = states[self.below(3) as usize];
                self.note(format!("state {state}"));
                self.say(order("driver_canbus", state));
                let back = self.robot.machine.now() + Duration::from_millis(30 + self.below(2000));
                self.robot.machine.inject(back, order("driver_canbus", common::DataState::RUN));
            }
            11 => self.located = !self.located,
            _ => self.say(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() }),
        }
    }

    fn kill(&mut self, module: &'static str) {
        if let Some(pid) = self.robot.machine.pid(module) {
            self.note(format!("kill {module}"));
            self.robot.machine.kill(pid);
        }
    }

    fn hang(&mut self, module: &'static str) {
        if let Some(pid) = self.robot.machine.pid(module) {
            let until = self.robot.machine.now() + Duration::from_millis(50 + self.below(1500));
            self.note(format!("hang {module} until {until:?}"));
            self.robot.machine.hang(pid);
            self.hung.push((until, pid));
        }
    }

    fn wake(&mut self) {
        let now = self.robot.machine.now();
        let over: Vec<_> = self.hung.extract_if(.., |(until, _)| *until <= now).collect();
        for (_, pid) in over {
            self.robot.machine.resume(pid);
        }
    }

    fn ail(&mut self, target: &'static str, fault: &'static str, value: f64) {
        let duration = self.between(0.05, 1.0);
        self.note(format!("{target} {fault} {duration:.3}"));
        self.say(simulation::CmdFault { value, ..fault_command(target, fault, duration) });
    }

    /// Removes all faults; the robot drives.
    fn calm(&mut self) {
        self.moods = [Mood::Silent; 5];
        for (until, _) in &mut self.hung {
            *until = Instant::ZERO;
        }
        self.wake();
        self.robot.checkers.borrow_mut().calm(self.robot.machine.now());
        self.robot.pass(3.0);
        for target in ["propulsion", "steering"] {
            self.say(fault_command(target, "none", 0.0));
        }
        self.say(pause(false));
        self.say(order("*", common::DataState::RUN));
        self.robot.pass(20.0);
        self.say(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
        self.robot.pass(20.0);
    }

    /// True if it follows commands for 3 s.
    fn drives(&mut self, speed: f64) -> bool {
        for n in 0..60 {
            let now = self.robot.machine.now() + n * TICK;
            // A deliberate press begins with zero.
            let speed = if n == 0 { 0.0 } else { speed };
            self.robot.machine.inject(now, lowlevel::CmdMotion { source: "phone".into(), ..command(speed, 0.0) });
        }
        self.robot.pass(2.9);
        // Without the speed: it may still roll.
        let motion = self.robot.motion();
        motion.enabled && motion.homed && motion.reason.is_empty() && motion.speed_target == speed
    }
}

fn estimate() -> middlelevel::DataEstimate {
    middlelevel::DataEstimate { quality: middlelevel::DataEstimate::FINE, ..Default::default() }
}

fn goal() -> middlelevel::CmdGoal {
    middlelevel::CmdGoal { waypoints: vec![middlelevel::Waypoint::default()], ..Default::default() }
}

fn pause(engaged: bool) -> lowlevel::EventStop {
    lowlevel::EventStop { timestamp: 0, engaged, source: "button".into() }
}

fn order(module: &str, state: i8) -> common::CmdState {
    common::CmdState { timestamp: 0, module: module.into(), state, manual: true, source: "test".into() }
}

fn fault_command(target: &str, fault: &str, duration: f64) -> simulation::CmdFault {
    simulation::CmdFault { timestamp: 0, target: target.into(), fault: fault.into(), value: 0.0, duration }
}

/// Number of RPDO4 frames that moved the robot.
fn storm(seed: u64) -> u64 {
    let mut storm = Storm::new(seed);
    for _ in 0..2400 {
        storm.tick();
        let violation = storm.robot.checkers.borrow().violation().cloned();
        if let Some(violation) = violation {
            let last = storm.log.len().saturating_sub(12);
            panic!("STORM={seed}, {violation}\n{}", storm.log[last..].join("\n"));
        }
    }
    storm.calm();
    let mut drives = storm.drives(0.3);
    if !drives {
        // It stood at a wall, and a bumper stopped it: it may leave in the other direction.
        storm.robot.pass(3.0);
        drives = storm.drives(-0.3);
    }
    let checkers = storm.robot.checkers.borrow();
    assert_eq!(checkers.violation(), None, "STORM={seed}");
    assert!(drives, "STORM={seed}: {:?}\n{}", storm.robot.motion(), storm.log.join("\n"));
    checkers.setpoints()
}

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok()?.parse().ok()
}

#[test]
fn in_a_storm_nothing_moves_without_permission() {
    if let Some(seed) = number("STORM") {
        storm(seed);
        return;
    }
    let storms = number("STORMS").unwrap_or(16);
    for seed in KEPT {
        storm(seed);
    }
    let moved: u64 = (0..storms).map(storm).sum();
    assert!(moved > 100 * storms, "{moved} frames only: a storm in which nothing moves shows nothing");
}
