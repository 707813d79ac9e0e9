//! How the robot is, in a word, and why it does not move, in a sentence.

use crate::{Model, ModuleRow};
use base::{Duration, Instant};
use messages::lowlevel::DataHold;
use messages::middlelevel::DataGoal;
use serde::Serialize;

/// Slower than this it stands, m/s.
const STANDING: f64 = 0.005;
/// Nothing heard for this long: the robot is not there.
const SILENT: Duration = Duration::from_secs(1);

/// How the robot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Word {
    /// Nothing is heard of it.
    Silent,
    /// The PAUSE line is engaged.
    Paused,
    /// Something without which it does not move is broken.
    Fault,
    /// It does not move before somebody does something, or something is done.
    Stopped,
    /// It would move and waits.
    Waiting,
    /// It moves.
    Driving,
    /// It stands, and would move if told to.
    Ready,
}

impl Word {
    /// As people are shown it.
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

/// How the robot is, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Status {
    /// In a word.
    pub word: Word,
    /// In a sentence, and what to do about it where that is known.
    pub reason: String,
}

impl Model {
    /// The robot's state: the most urgent condition wins.
    #[must_use]
    pub fn status(&self, now: Instant) -> Status {
        let status = |word, reason: String| Status { word, reason };
        match self.traffic.last() {
            None => return status(Word::Silent, "nothing is heard of a robot; is it on?".into()),
            Some(at) if now.since(at) > SILENT => {
                let seconds = now.since(at).as_secs();
                return status(Word::Silent, format!("nothing was heard of the robot for {seconds} s"));
            }
            Some(_) => {}
        }
        if let Some(stop) = self.stop.get().filter(|stop| stop.engaged) {
            let reason = format!("the PAUSE line is engaged by {}; release it, then let the robot go on", stop.source);
            return status(Word::Paused, reason);
        }
        let modules = self.modules(now);
        if let Some(row) =
            modules.iter().find(|row| row.critical && row.phase != "running" && row.wanted != "TERMINATE")
        {
            return status(Word::Fault, down(row));
        }
        let Some(motion) = self.motion.fresh(now) else {
            return status(Word::Fault, "driver_canbus says nothing of the drives".into());
        };
        let goal = self.goal.fresh(now);
        let drives = motion.speed.abs() > STANDING;
        let with_source = |text: &str| match motion.source.as_str() {
            "" => text.to_owned(),
            source => format!("{text}; {source} commands"),
        };
        if drives {
            return match motion.reason.is_empty() {
                true => status(Word::Driving, with_source(&format!("{:.2} m/s", motion.speed))),
                false => status(Word::Stopped, format!("it comes to a stop: {}", motion.reason)),
            };
        }
        // Nothing else stands against motion; the drives may hold a quick stop meanwhile.
        let idle = motion.homed && self.motion_holds(now).is_some_and(DataHold::is_idle);
        if !idle && (!motion.enabled || motion.quick_stop || !motion.homed) {
            let reason = if motion.reason.is_empty() { "the drives are not ready" } else { &motion.reason };
            let fault = modules.iter().find(|row| row.critical && row.state == "ERROR");
            return match fault.and_then(|row| self.errors.of(&row.module, now)) {
                Some(error) => status(Word::Fault, format!("{reason} ({}: {})", error.module, error.message)),
                None => status(Word::Stopped, reason.to_owned()),
            };
        }
        match goal {
            Some(goal) if matches!(goal.status, DataGoal::DRIVING | DataGoal::BLOCKED) && !goal.message.is_empty() => {
                status(Word::Waiting, goal.message.clone())
            }
            _ if idle || motion.source.is_empty() => status(Word::Ready, "it stands; nobody commands it".into()),
            _ if !motion.reason.is_empty() => status(Word::Waiting, motion.reason.clone()),
            _ => status(Word::Ready, with_source("it stands")),
        }
    }
}

fn down(row: &ModuleRow) -> String {
    let why = if row.last_exit.is_empty() { String::new() } else { format!(": {}", row.last_exit) };
    format!("{} is {}{why}; the robot does not move without it", row.module, row.phase)
}
