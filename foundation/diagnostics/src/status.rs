//! Status of the robot, and the reason why it does not move.

use crate::{Model, ModuleRow};
use base::{Duration, Instant};
use messages::lowlevel::{DataHold, Hold};
use messages::middlelevel::DataGoal;
use messages::{StopSource, source_in_words};
use serde::Serialize;

/// Speed below which the robot is at standstill, m/s.
const STANDING: f64 = 0.005;
/// Rotation below which it does not turn, rad/s.
const TURNING: f64 = 0.02;
/// Time without any message after which the robot is considered silent.
const SILENT: Duration = Duration::from_secs(1);

/// Status of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RobotStatus {
    /// Nothing is received.
    Silent,
    /// The PAUSE line is engaged.
    Paused,
    /// A fault prevents motion.
    Fault,
    /// Stopped until a person acts or a task ends.
    Stopped,
    /// Waiting with a command to move, or for the time of a simulation to pass.
    Waiting,
    /// Moving.
    Driving,
    /// At standstill and ready for a command.
    Ready,
}

impl RobotStatus {
    /// Text for people.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Silent => "NO CONTACT",
            Self::Paused => "PAUSE",
            Self::Fault => "FAULT",
            Self::Stopped => "STOPPED",
            Self::Waiting => "WAITING",
            Self::Driving => "DRIVING",
            Self::Ready => "READY",
        }
    }
}

/// Status with its reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Status {
    /// Status.
    pub word: RobotStatus,
    /// Sentence with the reason, and what to do about it if known.
    pub reason: String,
}

impl Model {
    /// Status of the robot; the most important cause takes precedence.
    #[must_use]
    pub fn status(&self, now: Instant) -> Status {
        let status = |word, reason: String| Status { word, reason };
        match self.traffic.last() {
            None => return status(RobotStatus::Silent, "no message from a robot was received; is it on?".into()),
            Some(at) if now.since(at) > SILENT => {
                let seconds = now.since(at).as_secs();
                return status(RobotStatus::Silent, format!("no message from the robot for {seconds} s"));
            }
            Some(_) => {}
        }
        if self.slow_rate(now) == Some(0.0) {
            return status(RobotStatus::Waiting, "simulation paused".into());
        }
        if let Some(stop) = self.stop.get().filter(|stop| stop.engaged) {
            let by = StopSource::in_words(&stop.source);
            let reason = format!("the PAUSE line is engaged by {by}; release it, then resume");
            return status(RobotStatus::Paused, reason);
        }
        let modules = self.modules(now);
        if let Some(row) =
            modules.iter().find(|row| row.critical && row.phase != "running" && row.wanted != "TERMINATE")
        {
            return status(RobotStatus::Fault, down(row));
        }
        let Some(motion) = self.motion.fresh(now) else {
            return status(RobotStatus::Fault, "driver_canbus does not report the drives".into());
        };
        let goal = self.goal.fresh(now);
        // Of a base that goes sideways or turns on the spot the speed forward is not all of its motion.
        let (aside, turn) = self.velocity.fresh(now).map_or((0.0, 0.0), |velocity| (velocity.vy, velocity.omega));
        let speed =
            if aside.abs() > STANDING { (motion.speed * motion.speed + aside * aside).sqrt() } else { motion.speed };
        let drives = speed.abs() > STANDING || turn.abs() > TURNING;
        let with_source = |text: &str| match motion.source.as_str() {
            "" => text.to_owned(),
            source => format!("{text}; commanded by {}", source_in_words(source)),
        };
        if drives {
            return match motion.reason.is_empty() {
                true if speed.abs() > STANDING => status(RobotStatus::Driving, with_source(&format!("{speed:.2} m/s"))),
                true => {
                    let text = format!("turns on the spot at {:.0} deg/s", turn.abs().to_degrees());
                    status(RobotStatus::Driving, with_source(&text))
                }
                false => status(RobotStatus::Stopped, format!("the robot is stopping: {}", motion.reason)),
            };
        }
        // No other cause holds the motion; the drives may keep a quick stop meanwhile, or have no torque before a
        // motion is commanded.
        let stands = |list: &DataHold| list.is_idle() || list.holds.is_empty() && motion.speed_target == 0.0;
        let idle = motion.homed && self.motion_holds(now).is_some_and(stands);
        if !idle && (!motion.enabled || motion.quick_stop || !motion.homed) {
            let reason = if motion.reason.is_empty() { "the drives are not ready" } else { &motion.reason };
            let fault = modules.iter().find(|row| row.critical && row.state == "ERROR");
            return match fault.and_then(|row| self.errors.of(&row.module, now)) {
                // It is what the reason follows from, and mostly repeats it.
                Some(error) => status(RobotStatus::Fault, error.message.clone()),
                None => status(RobotStatus::Stopped, reason.to_owned()),
            };
        }
        match goal {
            Some(goal) if matches!(goal.status, DataGoal::DRIVING | DataGoal::BLOCKED) && !goal.message.is_empty() => {
                status(RobotStatus::Waiting, goal.message.clone())
            }
            _ if idle || motion.source.is_empty() => {
                status(RobotStatus::Ready, "the robot is at standstill without a command".into())
            }
            _ if !motion.reason.is_empty() => status(RobotStatus::Waiting, motion.reason.clone()),
            // A bound of 0 is not a cause against acting.
            _ => match self.bounding(now) {
                Some(bound) => status(RobotStatus::Waiting, bound.words()),
                None => status(RobotStatus::Ready, with_source("the robot is at standstill")),
            },
        }
    }

    /// Source that commands the motion, as people call it; empty: nobody does, or it is not known.
    #[must_use]
    pub fn driver(&self) -> String {
        self.motion.get().map_or_else(String::new, |motion| source_in_words(&motion.source))
    }

    /// Why the robot is slower than commanded.
    fn bounding(&self, now: Instant) -> Option<&Hold> {
        let is_notice = |hold: &&Hold| hold.cause().is_some_and(messages::Hold::is_notice);
        self.motion_holds(now)?.holds.iter().find(is_notice)
    }
}

fn down(row: &ModuleRow) -> String {
    let why = if row.last_exit.is_empty() { String::new() } else { format!(": {}", row.last_exit) };
    format!("{} is {}{why}; the robot does not move without it", row.module, row.phase)
}
