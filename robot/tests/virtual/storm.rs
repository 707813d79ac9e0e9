//! Everybody commands, everything breaks, in any order; what must hold holds on every frame and at every moment.
//!
//! 1. No RPDO4 enables a speed that no living command asks for: its sign, at most its size and its source's limit.
//! 2. After a quick stop the propulsion turns for nobody who has not begun anew: a manual source by zero or silence,
//!    the planner by a goal, but after its own silence, and an estimate.
//! 3. When nobody may move the robot any more it stands within 200 ms, 300 ms and its quick stop ramp.
//! 4. When all is over the robot can be driven again.
//!
//! `STORMS=1000 cargo test -p advee --test virtual storm` for more; `STORM=SEED` for one.

use super::{Robot, at, command};
use base::{Duration, Instant, can};
use messages::{Message, common, lowlevel, middlelevel, simulation};
use sim::Random;
use sim::host::News;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

const TTL: Duration = Duration::from_millis(250);
/// What LCM, the queue of the bus and a frame on it may add.
const SLACK: Duration = Duration::from_millis(2);
const RPM_PER_MPS: f64 = 26.0 * 60.0 / (core::f64::consts::TAU * 0.1);
const SOURCES: [(&str, i8); 5] = [("planner", 0), ("phone", 1), ("shell", 1), ("pad", 2), ("service", 3)];
/// Faults of a drive: at the one it brakes, at the other it lets go.
const COMMUNICATION: f64 = 33_040.0;
const OVERCURRENT: f64 = 8976.0;
const TICK: Duration = Duration::from_millis(50);

/// What a source has said lately.
#[derive(Default)]
struct Source {
    said: VecDeque<(Instant, f64)>,
    /// The first command that moves after zero or silence.
    begun: Option<Instant>,
    /// Zero since.
    ended: Option<Instant>,
}

#[derive(Default)]
struct Checker {
    sources: [Source; SOURCES.len()],
    stopped: Instant,
    /// The last stop that was not just the planner's own silence.
    latched: Instant,
    goal: Option<Instant>,
    located: Option<Instant>,
    /// The driver of the drives: its process, and whether that hangs.
    driver: Option<u32>,
    hangs: Option<u32>,
    /// When it went on last: what waited for it is served in order, the newest last.
    woken: Instant,
    /// When it was last held up: it stops for what happened meanwhile when it goes on.
    held: Instant,
    /// The last moment at which somebody might move the robot, and the greatest speed since.
    permitted: Instant,
    speed_max: f64,
    /// The propulsion's power stage is off, and it rolls.
    rolls_until: Instant,
    moved: u32,
    wrong: Option<String>,
}

impl Checker {
    fn take(&mut self, now: Instant, news: &News<'_>) {
        let wrong = match news {
            News::Message { message: Message::LlCmdMotion(command), .. } => self.on_command(now, command),
            News::Message { message: Message::MlCmdGoal(_), .. } => self.on_goal(now),
            News::Message { message: Message::MlDataEstimate(estimate), .. } => self.on_estimate(now, estimate),
            News::Message { message: Message::SimDataTruth(truth), .. } => self.on_truth(now, truth.speed),
            News::Started { module: "driver_canbus", pid } => self.on_driver(Some(*pid)),
            News::Exited { module: "driver_canbus", .. } => self.on_driver(None),
            News::Can { frame, .. } if frame.id() == can::Id::Standard(0x501) => self.on_rpdo4(now, frame.data()),
            _ => Ok(()),
        };
        if let (Err(why), None) = (wrong, &self.wrong) {
            self.wrong = Some(format!("at {:.6} s: {why}", now.as_nanos() as f64 / 1e9));
        }
    }

    fn on_command(&mut self, now: Instant, command: &lowlevel::CmdMotion) -> Result<(), String> {
        let Some(index) = SOURCES.iter().position(|known| *known == (command.source.as_str(), command.priority)) else {
            return Ok(());
        };
        // What is refused does not count as said.
        if !(command.speed.abs() <= 1.2 && command.steering.abs() <= 0.61) {
            return Ok(());
        }
        let source = &mut self.sources[index];
        let silent = source.said.back().is_none_or(|(at, _)| now.since(*at) + SLACK >= TTL);
        if command.speed == 0.0 {
            source.ended = source.ended.or(Some(now));
        } else if silent || source.ended.is_some() || source.begun.is_none() {
            (source.begun, source.ended) = (Some(now), None);
        }
        source.said.push_back((now, command.speed));
        while source.said.front().is_some_and(|(at, _)| now.since(*at) > 2 * TTL) {
            source.said.pop_front();
        }
        Ok(())
    }

    fn on_driver(&mut self, pid: Option<u32>) -> Result<(), String> {
        self.driver = pid;
        Ok(())
    }

    fn on_goal(&mut self, now: Instant) -> Result<(), String> {
        self.goal = Some(now);
        Ok(())
    }

    fn on_estimate(&mut self, now: Instant, estimate: &middlelevel::DataEstimate) -> Result<(), String> {
        if estimate.quality >= middlelevel::DataEstimate::COARSE {
            self.located = Some(now);
        }
        Ok(())
    }

    fn on_rpdo4(&mut self, now: Instant, data: &[u8]) -> Result<(), String> {
        let rpm = i32::from_le_bytes(data[2..6].try_into().map_err(|_| "a short RPDO4")?);
        match (data[0], rpm) {
            (0x0B, 0) => self.on_stop(now),
            (0x0F, 0) => {}
            (0x0F, rpm) => {
                self.moved += 1;
                let speed = f64::from(rpm) / RPM_PER_MPS;
                if !(0..SOURCES.len()).any(|index| self.asks(now, index, speed)) {
                    return Err(format!("{speed:.3} m/s, which no living command asks for"));
                }
                if !(0..SOURCES.len()).any(|index| self.asks(now, index, speed) && self.may(now, index)) {
                    return Err(format!("{speed:.3} m/s for somebody who has not begun anew since the stop"));
                }
            }
            (_, 0) => {}
            (word, rpm) if word & 0x0F == 0x0F => return Err(format!("controlword {word:#x} with {rpm} rpm")),
            _ => {}
        }
        Ok(())
    }

    fn on_stop(&mut self, now: Instant) {
        let stopped = if now.since(self.woken) <= SLACK { self.held } else { now };
        self.stopped = self.stopped.max(stopped);
        let silent = |source: &Source| source.said.back().is_none_or(|(at, _)| now.since(*at) > TTL + SLACK);
        if !self.sources.iter().zip(SOURCES).all(|(source, (_, priority))| priority == 0 || silent(source)) {
            self.latched = self.stopped;
        }
    }

    /// Whether this source asks for this speed, or for more that is limited to it.
    fn asks(&self, now: Instant, index: usize, speed: f64) -> bool {
        let limit = if SOURCES[index].1 == 0 { 0.8 } else { 0.6 };
        let said = &self.sources[index].said;
        said.iter().enumerate().any(|(nth, (at, asked))| {
            let superseded = said.get(nth + 1).is_some_and(|(next, _)| now.since((*next).max(self.woken)) > SLACK);
            let lives = now.since(*at) <= TTL + SLACK && !superseded;
            lives && asked * speed > 0.0 && speed.abs() <= asked.abs().min(limit) + 0.001
        })
    }

    fn may(&self, now: Instant, index: usize) -> bool {
        if SOURCES[index].1 > 0 {
            let source = &self.sources[index];
            let ended = source.ended.is_some_and(|at| now.since(at) > SLACK);
            return !ended && source.begun.is_some_and(|at| at + SLACK >= self.stopped)
                || now.since(self.stopped.max(self.woken)) <= SLACK;
        }
        let located = self.located.is_some_and(|at| now.since(at) <= Duration::from_millis(200) + SLACK);
        located && self.goal.is_some_and(|at| at + SLACK >= self.latched)
    }

    fn on_truth(&mut self, now: Instant, speed: f64) -> Result<(), String> {
        let moving =
            |source: &Source| source.said.iter().rev().find(|(_, speed)| *speed != 0.0).map(|(at, _)| *at + TTL);
        let lives =
            self.sources.iter().filter_map(moving).max().filter(|_| self.driver.is_some() && self.driver != self.hangs);
        if let Some(until) = lives
            && until.min(now) > self.permitted
        {
            (self.permitted, self.speed_max) = (until.min(now), 0.0);
        }
        self.speed_max = self.speed_max.max(speed.abs());
        let stands = self.permitted + Duration::from_millis(500) + Duration::from_secs_f64(self.speed_max / 1.5);
        if now > stands && now > self.rolls_until && speed.abs() > 0.02 {
            return Err(format!("{speed:.3} m/s, and nobody moves it since {:?}", self.permitted));
        }
        Ok(())
    }
}

/// How a source behaves for a while.
#[derive(Clone, Copy)]
enum Mood {
    Silent,
    Holds(f64, f64),
}

struct Storm {
    robot: Robot,
    checker: Rc<RefCell<Checker>>,
    random: Random,
    moods: [Mood; SOURCES.len()],
    located: bool,
    /// Processes that hang, and until when.
    hung: Vec<(Instant, u32)>,
    log: Vec<String>,
}

impl Storm {
    fn new(seed: u64) -> Self {
        let mut robot = Robot::new(seed);
        let checker = Rc::new(RefCell::new(Checker::default()));
        let keep = checker.clone();
        robot.machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        robot.machine.run_until(at(12.0));
        let random = Random::new(seed ^ 0x5707_0000);
        Self { robot, checker, random, moods: [Mood::Silent; 5], located: true, hung: Vec::new(), log: Vec::new() }
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
                if axis == "propulsion" {
                    // Without its power stage it rolls, and nobody can brake it.
                    let until = self.robot.machine.now() + Duration::from_secs(8);
                    self.checker.borrow_mut().rolls_until = until;
                }
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
            if module == "driver_canbus" {
                let mut checker = self.checker.borrow_mut();
                (checker.hangs, checker.held) = (Some(pid), self.robot.machine.now());
            }
            self.hung.push((until, pid));
        }
    }

    fn wake(&mut self) {
        let now = self.robot.machine.now();
        let over: Vec<_> = self.hung.extract_if(.., |(until, _)| *until <= now).collect();
        for (_, pid) in over {
            let mut checker = self.checker.borrow_mut();
            if checker.hangs.take_if(|hangs| *hangs == pid).is_some() {
                checker.woken = now;
            }
            drop(checker);
            self.robot.machine.resume(pid);
        }
    }

    fn ail(&mut self, target: &'static str, fault: &'static str, value: f64) {
        let duration = self.between(0.05, 1.0);
        self.note(format!("{target} {fault} {duration:.3}"));
        self.say(simulation::CmdFault { value, ..ailment(target, fault, duration) });
    }

    /// Everything is made well; the robot drives.
    fn calm(&mut self) {
        self.moods = [Mood::Silent; 5];
        for (until, _) in &mut self.hung {
            *until = Instant::ZERO;
        }
        self.wake();
        self.robot.pass(3.0);
        for target in ["propulsion", "steering"] {
            self.say(ailment(target, "none", 0.0));
        }
        self.say(pause(false));
        self.say(order("*", common::DataState::RUN));
        self.robot.pass(20.0);
        self.say(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
        self.robot.pass(20.0);
    }

    /// Whether it does as it is told, for 3 s.
    fn drives(&mut self, speed: f64) -> bool {
        for n in 0..60 {
            let now = self.robot.machine.now() + n * TICK;
            self.robot.machine.inject(now, lowlevel::CmdMotion { source: "phone".into(), ..command(speed, 0.0) });
        }
        self.robot.pass(2.9);
        // Not the speed: it may roll yet.
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

fn ailment(target: &str, fault: &str, duration: f64) -> simulation::CmdFault {
    simulation::CmdFault { timestamp: 0, target: target.into(), fault: fault.into(), value: 0.0, duration }
}

/// How often an RPDO4 moved the robot.
fn storm(seed: u64) -> u32 {
    let mut storm = Storm::new(seed);
    for _ in 0..2400 {
        storm.tick();
        let wrong = storm.checker.borrow().wrong.clone();
        if let Some(wrong) = wrong {
            let last = storm.log.len().saturating_sub(12);
            panic!("STORM={seed}, {wrong}\n{}", storm.log[last..].join("\n"));
        }
    }
    storm.calm();
    let mut drives = storm.drives(0.3);
    if !drives {
        // It stood at a wall, and a bumper stopped it: it may leave the other way.
        storm.robot.pass(3.0);
        drives = storm.drives(-0.3);
    }
    let wrong = storm.checker.borrow().wrong.clone();
    assert_eq!(wrong, None, "STORM={seed}");
    assert!(drives, "STORM={seed}: {:?}\n{}", storm.robot.motion(), storm.log.join("\n"));
    storm.checker.borrow().moved
}

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok()?.parse().ok()
}

#[test]
fn in_a_storm_nothing_moves_that_nobody_lets_move() {
    if let Some(seed) = number("STORM") {
        storm(seed);
        return;
    }
    let storms = number("STORMS").unwrap_or(16);
    let moved: u32 = (0..storms).map(storm).sum();
    assert!(u64::from(moved) > 100 * storms, "{moved} frames only: a storm in which nothing moves shows nothing");
}
