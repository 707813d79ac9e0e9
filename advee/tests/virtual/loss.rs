//! Every single CAN frame of a start is lost once: boot-up, configuration, homing, enabling, the first motion and its
//! end. One run without a loss counts the frames, then one run for each. Whatever was lost, at every instant
//!
//! 1. no RPDO4 enables a speed without a valid command for it, and without a command the robot stops within its ramp;
//! 2. a robot that gives no reason why it does not move follows its commands, wheels and steering;
//! 3. an axis that is reported as homed is at its reported position;
//!
//! and in the end the robot drives on command, or stands with a reported error and a reason. Every deviation from the
//! run without a loss was reported as an error or given as the reason. The loss of a frame that is repeated anyway, a
//! heartbeat or a PDO, is not even noticed.
//!
//! Frames that are destroyed on the wire, which the controllers send again, cost time and nothing else.
//!
//! `LOSS=NUMBER cargo test -p advee --test virtual loss -- --nocapture` runs one.

use super::{Robot, at};
use base::{Duration, Instant, can};
use messages::{Message, common, lowlevel, simulation};
use sim::host::{Config, News};
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;

const SPEED: f64 = 0.3;
const STEERING: f64 = 0.2;
const TTL: Duration = Duration::from_millis(250);
/// Latency of LCM, the queue of the bus, and a frame on it.
const SLACK: Duration = Duration::from_millis(2);
/// Time for wheels and steering to reach their set-points from standstill: 0.5 m/s², 0.7 rad/s.
const SETTLED: Duration = Duration::from_millis(1000);
/// Longest start after a loss, s: a node may have to boot again, the steering to be homed again.
const PATIENCE: f64 = 40.0;

#[derive(Default)]
struct Checker {
    /// Unbroken sequence of commands: its first and its last.
    commanded: Option<(Instant, Instant)>,
    /// Last instant at which the robot gave a reason.
    excused: Instant,
    reasons: Vec<String>,
    /// Active errors.
    standing: Vec<i32>,
    errors: u32,
    reported: Vec<String>,
    motion: lowlevel::DataMotion,
    holds: lowlevel::DataHold,
    lost: Option<can::Frame>,
    fastest: f64,
    wrong: Option<String>,
}

impl Checker {
    fn take(&mut self, now: Instant, news: &News<'_>) {
        let wrong = match news {
            News::Message { message: Message::LlCmdMotion(_), .. } => self.on_command(now),
            News::Message { message: Message::LlDataHold(list), .. } if list.is_of_motion() => {
                self.holds = list.clone();
                Ok(())
            }
            News::Message { message: Message::LlDataMotion(motion), .. } => self.on_motion(now, motion),
            News::Message { message: Message::SimDataTruth(truth), .. } => {
                self.on_truth(now, truth.speed, truth.steering)
            }
            News::Message { message: Message::CmEventError(error), .. } => self.on_error(error),
            News::Can { frame, .. } if frame.id() == can::Id::Standard(0x501) => self.on_rpdo4(now, frame.data()),
            News::CanLost { frame, .. } => self.on_loss(*frame),
            _ => Ok(()),
        };
        if let (Err(why), None) = (wrong, &self.wrong) {
            self.wrong = Some(format!("at {:.6} s: {why}", now.as_nanos() as f64 / 1e9));
        }
    }

    fn on_command(&mut self, now: Instant) -> Result<(), String> {
        let first = self.commanded.filter(|(_, last)| now.since(*last) < TTL).map_or(now, |(first, _)| first);
        self.commanded = Some((first, now));
        Ok(())
    }

    fn on_loss(&mut self, frame: can::Frame) -> Result<(), String> {
        self.lost = Some(frame);
        Ok(())
    }

    fn on_error(&mut self, error: &common::Error) -> Result<(), String> {
        self.standing.retain(|number| *number != error.number);
        if error.severity > common::Error::NOTICE {
            self.errors += 1;
            self.reported.push(error.message.clone());
            self.standing.push(error.number);
        }
        Ok(())
    }

    fn on_motion(&mut self, now: Instant, motion: &lowlevel::DataMotion) -> Result<(), String> {
        if !motion.reason.is_empty() {
            self.excused = now;
            if self.reasons.last() != Some(&motion.reason) {
                self.reasons.push(motion.reason.clone());
            }
        }
        self.motion = motion.clone();
        Ok(())
    }

    fn on_rpdo4(&mut self, now: Instant, data: &[u8]) -> Result<(), String> {
        let rpm = i32::from_le_bytes(data[2..6].try_into().map_err(|_| "a short RPDO4")?);
        if rpm != 0 && self.commanded.is_none_or(|(_, last)| now.since(last) > TTL + SLACK) {
            return Err(format!("{rpm} rpm, and nobody commands"));
        }
        Ok(())
    }

    fn on_truth(&mut self, now: Instant, speed: f64, steering: f64) -> Result<(), String> {
        self.fastest = self.fastest.max(speed.abs());
        let silent = self.commanded.map_or(now.since(Instant::ZERO), |(_, last)| now.since(last));
        // A lost drive is booted again before it can be commanded to stop: within its heartbeat time and its set-up.
        let stopped = TTL + Duration::from_millis(300) + Duration::from_secs_f64(SPEED / 1.5);
        if silent > stopped && speed.abs() > 0.01 {
            return Err(format!("{speed:.3} m/s, and nobody commands since {silent:?}"));
        }
        if self.motion.homed && (self.motion.steering - steering).abs() > 0.05 {
            return Err(format!("homed at {:.3} rad, but it is at {steering:.3} rad", self.motion.steering));
        }
        let settled = self.commanded.is_some_and(|(first, last)| {
            now.since(last) < TTL && now.since(first.max(self.excused)) > SETTLED + Duration::from_millis(100)
        });
        if settled && !((speed - SPEED).abs() < 0.05 && (steering - STEERING).abs() < 0.03) {
            let motion = &self.motion;
            return Err(format!("{speed:.3} m/s at {steering:.3} rad without a reason: {motion:?}"));
        }
        Ok(())
    }
}

/// Outcome of a start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Outcome {
    /// As without a loss.
    Unmoved,
    /// Reported what was wrong, and drove on a new command.
    Recovered,
    /// Stands, with a reason.
    Stands,
}

struct Start {
    robot: Robot,
    checker: Rc<RefCell<Checker>>,
}

impl Start {
    fn new(lost: Option<u64>) -> Self {
        let mut robot = Robot::with(Config { can_loss: lost, ..Config::default() });
        let checker = Rc::new(RefCell::new(Checker::default()));
        let keep = checker.clone();
        robot.machine.observe(move |now, news| keep.borrow_mut().take(now, news));
        Self { robot, checker }
    }

    /// Waits until only a command is missing, or until the timeout.
    fn ready(&mut self) {
        let end = self.robot.machine.now() + Duration::from_secs_f64(PATIENCE);
        while self.robot.machine.now() < end && !self.is_ready() {
            self.robot.pass(0.1);
        }
    }

    fn is_ready(&self) -> bool {
        let checker = self.checker.borrow();
        checker.motion.homed && checker.holds.is_idle()
    }

    /// Drives for 1.5 s, then sends nothing until it must stand. True if it followed the command at once.
    fn drive(&mut self) -> bool {
        self.checker.borrow_mut().fastest = 0.0;
        self.robot.drive_anew(SPEED, STEERING, 1.5);
        self.robot.pass(1.4);
        let went = self.checker.borrow().motion.reason.is_empty() && self.checker.borrow().fastest > SPEED - 0.02;
        self.robot.pass(1.2);
        went
    }

    fn frames(&self) -> u64 {
        self.robot.machine.traffic("can.main").expect("the drives are there").sent
    }

    fn wrong(&self) -> Result<(), String> {
        self.checker.borrow().wrong.clone().map_or(Ok(()), Err)
    }

    /// Runs the whole start.
    fn run(&mut self) -> Result<Outcome, String> {
        self.ready();
        let went = self.drive();
        let said = self.checker.borrow().errors > 0;
        self.wrong()?;
        // A loss at the end of the first motion shows now, or in the second.
        self.robot.pass(0.5);
        self.ready();
        let again = self.drive();
        self.wrong()?;
        let checker = self.checker.borrow();
        match (went, again) {
            (true, true) if !said && checker.errors == 0 => Ok(Outcome::Unmoved),
            (_, true) if checker.errors > 0 => Ok(Outcome::Recovered),
            (_, true) => Err(format!("it did not go at first and reported no error: {:?}", checker.reasons)),
            (_, false) if !checker.standing.is_empty() && !checker.motion.reason.is_empty() => Ok(Outcome::Stands),
            (_, false) => Err(format!("it does not go: {:?}, errors {:?}", checker.motion, checker.standing)),
        }
    }
}

/// One run; the lost frame, and the outcome.
fn run(lost: u64) -> (Option<can::Frame>, Result<Outcome, String>) {
    let mut start = Start::new(Some(lost));
    let outcome = start.run();
    let frame = start.checker.borrow().lost;
    (frame, outcome)
}

#[test]
fn whatever_single_frame_of_a_start_is_lost_the_robot_drives_or_reports_why_not() {
    if let Some(lost) = std::env::var("LOSS").ok().and_then(|number| number.parse().ok()) {
        let mut start = Start::new(Some(lost));
        let outcome = start.run();
        let checker = start.checker.borrow();
        println!("{outcome:?}, lost {:?}, errors {:?}, {:#?}", checker.lost, checker.standing, checker.reasons);
        outcome.unwrap();
        return;
    }
    let mut without = Start::new(None);
    assert_eq!(without.run(), Ok(Outcome::Unmoved));
    let mut first = Start::new(None);
    first.ready();
    assert!(first.robot.machine.now() < at(10.0) && first.drive());
    let frames = first.frames();

    let next = AtomicU64::new(1);
    let all = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(|| {
                while let Some(lost) = Some(next.fetch_add(1, Relaxed)).filter(|lost| *lost <= frames) {
                    let (frame, outcome) = run(lost);
                    all.lock().unwrap().push((lost, frame, outcome));
                }
            });
        }
    });
    let all = all.into_inner().unwrap();
    let count = |outcome| all.iter().filter(|(.., result)| *result == Ok(outcome)).count();
    println!(
        "{frames} frames lost, one in each run: {} unmoved, {} reported and recovered, {} stand and say why",
        count(Outcome::Unmoved),
        count(Outcome::Recovered),
        count(Outcome::Stands),
    );
    // Heartbeats and PDOs are repeated: the loss of a single one has no effect.
    let repeated =
        |frame: &Option<can::Frame>| frame.is_some_and(|frame| !matches!(frame.id(), can::Id::Standard(0x580..=0x67F)));
    let disturbed = all.iter().filter(|(_, frame, result)| repeated(frame) && *result != Ok(Outcome::Unmoved));
    let disturbed: Vec<u64> = disturbed.map(|(lost, ..)| *lost).collect();
    assert!(disturbed.is_empty(), "a heartbeat or PDO lost was not forgiven: {disturbed:?}");
    let mut failed: Vec<_> = all.iter().filter(|(.., result)| result.is_err()).collect();
    failed.sort_by_key(|(lost, ..)| *lost);
    assert!(all.iter().all(|(_, frame, _)| frame.is_some()), "a frame was not lost");
    assert!(failed.is_empty(), "{} of {frames}: {:#?}", failed.len(), &failed[..failed.len().min(10)]);
}

/// A frame destroyed on the wire is sent again by the controller. At most one in seventeen: error counters then fall as
/// fast as they rise.
#[test]
fn a_frame_that_is_destroyed_on_the_wire_costs_time_and_nothing_else() {
    let mut calm = Start::new(None);
    assert_eq!(calm.run(), Ok(Outcome::Unmoved));
    for every in [17_u32, 19, 23, 29, 31] {
        let mut start = Start::new(None);
        // Repeated, so that it is received before the bus's first frame.
        for millis in 0..200 {
            let value = f64::from(every);
            let (target, fault) = ("can.main".into(), "corrupt".into());
            let disturbed = simulation::CmdFault { timestamp: 0, target, fault, value, duration: 0.0 };
            start.robot.machine.inject(Instant::from_millis(millis), disturbed);
        }
        let outcome = start.run();
        assert!(matches!(outcome, Ok(Outcome::Unmoved | Outcome::Recovered)), "every {every}th: {outcome:?}");
        let checker = start.checker.borrow();
        assert_eq!(checker.reasons, calm.checker.borrow().reasons, "every {every}th");
        // The noise is reported, and nothing else.
        assert!(checker.reported.iter().all(|report| report.contains("frames with errors")), "{:?}", checker.reported);
        let destroyed = start.robot.machine.traffic("can.main").expect("the drives are there").errors;
        assert!(destroyed > start.frames() / u64::from(every) / 2, "{destroyed} frames only");
    }
}
