//! The actions `navigate_to_pose` and `navigate_through_poses` of Nav2, on the robot's own planner.
//!
//! ```text
//!   send_goal ──► accepted ──► ML_CMD_GOAL ──► ML_DATA_GOAL ──► feedback, status ──► result
//! ```
//!
//! There is one planner, so one goal of both actions is pursued at a time. A newer one replaces it, and it ends as
//! ABORTED, as in Nav2. What becomes of a goal is what the planner says in `ML_DATA_GOAL` under the goal's number; once
//! the planner speaks of another number somebody else has commanded, and the goal ends as ABORTED, too. Of a goal that
//! is impossible the planner speaks once, and goes on with the one before: a goal of these actions goes on with it, but
//! one that has ended here, since it was replaced, is cancelled.

mod kind;
#[cfg(test)]
mod tests;
pub mod wire;

pub use kind::{Kind, Part};

use crate::action::{
    CancelCode, GoalId, Goals, ResultAnswer, Status, cancel_response, read_cancel, read_get_result, send_goal_response,
};
use crate::service::Caller;
use base::{Duration, Instant};
use diagnostics::orders;
use messages::Hold;
use messages::lowlevel::DataHold;
use messages::middlelevel::{CmdGoal, DataEstimate, DataGoal, Waypoint};
use std::collections::VecDeque;
use wire::{Figures, Progress, Rejection};

/// Shortest time between two feedbacks.
const FEEDBACK_PERIOD: Duration = Duration::from_millis(100);
/// Time within which the planner speaks of a goal that was sent to it, or of its end when it is cancelled: it publishes
/// with each change.
const ANSWER_MAX: Duration = Duration::from_secs(2);
/// Longest silence of the planner, which publishes at 5 Hz.
const SILENCE_MAX: Duration = Duration::from_secs(5);
/// Numbers of commands that are kept: several goals may follow each other before the planner speaks of one.
const SENT_MAX: usize = 8;
/// Module whose holds tell of recoveries.
const PLANNER: &str = "planner";

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Answer a request.
    Answer(Kind, Part, Caller, Vec<u8>),
    /// Publish a feedback.
    Feedback(Kind, Vec<u8>),
    /// Publish the states of the goals.
    Status(Kind, Vec<u8>),
    /// Send a goal, or the end of one, to the planner.
    Command(CmdGoal),
    /// Say it to people.
    Note(String),
}

/// The goal that is pursued.
#[derive(Clone, Debug)]
struct Active {
    kind: Kind,
    id: GoalId,
    /// Its number at the planner.
    number: i32,
    poses: Vec<[f64; 3]>,
    /// When it was accepted, also in µs since the UNIX epoch.
    since: Instant,
    stamp: i64,
    planner: Planner,
    /// Number of the goal that the planner had before, of these actions, too.
    before: Option<i32>,
    /// The planner has refused a goal of somebody else, and has not spoken of this one since.
    is_doubtful: bool,
    /// Index of the pose that is driven to.
    to: usize,
    /// Way that remains, m; NaN: not known.
    remaining: f64,
    recoveries: i16,
    is_backing_out: bool,
    feedback_due: Instant,
}

/// What is expected of the planner, and until when.
#[derive(Clone, Copy, Debug)]
enum Planner {
    /// That it speaks of the goal.
    Begins { until: Instant },
    /// That it goes on.
    Drives { until: Instant },
    /// That it speaks of the end that was commanded under this number.
    Ends { number: i32, until: Instant },
}

impl Planner {
    fn until(self) -> Instant {
        let (Self::Begins { until } | Self::Drives { until } | Self::Ends { until, .. }) = self;
        until
    }
}

/// The servers of both actions.
#[derive(Debug, Default)]
pub struct Navigator {
    goals: [Goals; 2],
    active: Option<Active>,
    /// Number of a goal that has ended here although the planner may have it: if it is pursued later it is cancelled.
    abandoned: Option<i32>,
    /// Numbers of the last commands, the newest at the end: at most [`SENT_MAX`].
    sent: VecDeque<i32>,
    outputs: VecDeque<Output>,
}

impl Navigator {
    /// A request for a service of an action. `refusal`: why ROS may not command now.
    pub fn on_request(
        &mut self,
        now: Instant,
        timestamp: i64,
        (kind, part): (Kind, Part),
        caller: Caller,
        sample: &[u8],
        refusal: Option<&'static str>,
    ) {
        match part {
            Part::SendGoal => {
                let outcome = self.on_goal(now, timestamp, kind, sample, refusal);
                self.answer(kind, part, caller, send_goal_response(outcome.is_ok(), timestamp));
                match outcome {
                    Ok(()) => self.publish_status(kind),
                    Err(why) => self.note(kind, &format!("a goal is rejected: {why}")),
                }
            }
            Part::CancelGoal => match read_cancel(sample) {
                Some((id, stamp)) => {
                    let response = self.on_cancel(now, timestamp, kind, id, stamp);
                    self.answer(kind, part, caller, response);
                }
                None => self.note(kind, "a malformed request to cancel is ignored"),
            },
            Part::GetResult => match read_get_result(sample) {
                Some(id) => match self.goals[kind as usize].result(id, caller) {
                    ResultAnswer::Now(result) => self.answer(kind, part, caller, result),
                    ResultAnswer::Later => {}
                    ResultAnswer::Unknown => {
                        let unknown = wire::result(kind, Status::Unknown, "there is no such goal", None);
                        self.answer(kind, part, caller, unknown);
                    }
                    ResultAnswer::TooMany => self.note(kind, "too many requests for the result of a goal"),
                },
                None => self.note(kind, "a malformed request for a result is ignored"),
            },
        }
    }

    fn on_goal(
        &mut self,
        now: Instant,
        timestamp: i64,
        kind: Kind,
        sample: &[u8],
        refusal: Option<&'static str>,
    ) -> Result<(), Rejection> {
        let (id, poses) = wire::read_goal(kind, sample)?;
        if let Some(why) = refusal {
            return Err(Rejection::NotNow(why));
        }
        if !self.goals[kind as usize].begin(id, timestamp) {
            return Err(Rejection::Repeated);
        }
        let before = self.active.as_ref().and_then(Active::left_to_the_planner).or(self.abandoned);
        let status = if self.is_canceling() { Status::Canceled } else { Status::Aborted };
        self.end(now, status, "it was replaced by a newer goal");
        let waypoint = |&[x, y, theta]: &[f64; 3]| Waypoint { x, y, theta, tolerance: 0.0, heading: true };
        let number = self.command(timestamp, poses.iter().map(waypoint).collect());
        self.abandoned = None;
        self.active = Some(Active {
            kind,
            id,
            number,
            poses,
            since: now,
            stamp: timestamp,
            planner: Planner::Begins { until: now + ANSWER_MAX },
            before,
            is_doubtful: false,
            to: 0,
            remaining: f64::NAN,
            recoveries: 0,
            is_backing_out: false,
            feedback_due: now,
        });
        Ok(())
    }

    fn on_cancel(&mut self, now: Instant, timestamp: i64, kind: Kind, id: GoalId, stamp: i64) -> Vec<u8> {
        let meant = match self.goals[kind as usize].meant(id, stamp) {
            Ok(meant) => meant,
            Err(code) => return cancel_response(code, &[]),
        };
        for (id, _) in &meant {
            self.goals[kind as usize].cancel(*id);
            let is_active = self.active.as_ref().is_some_and(|active| active.kind == kind && active.id == *id);
            if is_active {
                let number = self.command(timestamp, Vec::new());
                if let Some(active) = &mut self.active {
                    active.planner = Planner::Ends { number, until: now + ANSWER_MAX };
                }
            }
        }
        if !meant.is_empty() {
            self.publish_status(kind);
        }
        let code = if meant.is_empty() { CancelCode::Rejected } else { CancelCode::None };
        cancel_response(code, &meant)
    }

    /// ROS may not command any more: a goal that is pursued ends as ABORTED, and the planner's with it.
    pub fn withdraw(&mut self, now: Instant, timestamp: i64, why: &str) {
        let Some(active) = &self.active else { return };
        self.abandoned = Some(active.number);
        self.command(timestamp, Vec::new());
        self.end(now, Status::Aborted, why);
    }

    fn is_canceling(&self) -> bool {
        self.active.as_ref().is_some_and(|active| matches!(active.planner, Planner::Ends { .. }))
    }

    /// True if messages of the planner concern a goal.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.active.is_some() || self.abandoned.is_some()
    }

    /// The planner's state.
    pub fn on_planner(&mut self, now: Instant, timestamp: i64, goal: &DataGoal) {
        let is_pursued = matches!(goal.status, DataGoal::DRIVING | DataGoal::BLOCKED);
        if self.abandoned == Some(goal.id) {
            if is_pursued {
                self.command(timestamp, Vec::new());
            } else {
                self.abandoned = None;
            }
        }
        let Some(active) = &mut self.active else { return };
        if goal.id == active.number {
            active.to = usize::try_from(goal.waypoint).unwrap_or_default().min(active.poses.len() - 1);
            (active.remaining, active.is_doubtful) = (goal.remaining, false);
            let before = active.before;
            if !matches!(active.planner, Planner::Ends { .. }) {
                active.planner = Planner::Drives { until: now + SILENCE_MAX };
            }
            match goal.status {
                DataGoal::REACHED => self.end(now, Status::Succeeded, ""),
                DataGoal::FAILED => {
                    self.end(now, Status::Aborted, &goal.message);
                    // The planner goes on with it if this one was impossible, and ROS has given it up.
                    self.abandoned = before;
                }
                _ => {}
            }
            return;
        }
        match active.planner {
            // What it says may be older than the command.
            Planner::Begins { .. } => {}
            Planner::Ends { number, .. } if number == goal.id => self.end(now, Status::Canceled, ""),
            // Of a goal from here that the cancelled one replaced, it may have spoken before it received the end.
            Planner::Ends { .. } if !is_pursued || self.sent.contains(&goal.id) => {}
            Planner::Drives { .. } if goal.status == DataGoal::FAILED && !active.is_doubtful => {
                active.is_doubtful = true;
            }
            Planner::Drives { .. } | Planner::Ends { .. } => {
                let number = active.number;
                let why = match goal.status {
                    DataGoal::CANCELLED => "an operator cancelled it",
                    DataGoal::IDLE => "the planner was started again, without a goal",
                    _ => "another goal replaced it, which was not sent by this action",
                };
                self.end(now, Status::Aborted, why);
                // If that one turns out to be impossible, the planner goes on with this.
                self.abandoned = is_pursued.then_some(number);
            }
        }
    }

    /// Where the robot is: becomes the feedback.
    pub fn on_estimate(&mut self, now: Instant, estimate: &DataEstimate) {
        let Some(active) = self.active.as_mut().filter(|active| active.feedback_due <= now) else { return };
        if estimate.quality == DataEstimate::LOST || !(estimate.x + estimate.y + estimate.theta).is_finite() {
            return;
        }
        active.feedback_due = now + FEEDBACK_PERIOD;
        let Active { kind, id, remaining, recoveries, .. } = *active;
        let navigation_us = (now.since(active.since).as_nanos() / 1000) as i64;
        let figures = Figures { navigation_us, remaining, recoveries };
        let cdr = wire::feedback(kind, id, estimate, figures, active.progress(active.to, false));
        self.outputs.push_back(Output::Feedback(kind, cdr));
    }

    /// Why the planner does not drive: backing out of where it is stuck is a recovery.
    pub fn on_holds(&mut self, list: &DataHold) {
        let Some(active) = self.active.as_mut().filter(|_| list.module == PLANNER) else { return };
        let backs_out = list.holds.iter().any(|hold| hold.code == Hold::BackingOut as i32);
        let was = std::mem::replace(&mut active.is_backing_out, backs_out);
        active.recoveries = active.recoveries.saturating_add(i16::from(backs_out && !was));
    }

    /// Ends a goal of which the planner does not speak, and forgets old results.
    pub fn handle_timeout(&mut self, now: Instant) {
        for kind in Kind::ALL {
            if self.goals[kind as usize].expire(now) {
                self.publish_status(kind);
            }
        }
        if let Some(active) = self.active.as_ref().filter(|active| active.planner.until() <= now) {
            self.abandoned = Some(active.number);
            let name = active.kind;
            self.end(now, Status::Aborted, "the planner does not answer");
            self.note(name, "the planner does not answer: the goal is aborted");
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) is to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        let active = self.active.as_ref().map(|active| active.planner.until());
        active.into_iter().chain(self.goals.iter().filter_map(Goals::poll_timeout)).min()
    }

    /// What is to be done next.
    pub fn poll(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    /// Sends waypoints to the planner, or without any the end of its goal; the number of the command.
    fn command(&mut self, timestamp: i64, waypoints: Vec<Waypoint>) -> i32 {
        let mut goal = orders::goal(timestamp, waypoints, false);
        // Several within the same millisecond have the same number otherwise.
        while self.sent.contains(&goal.id) {
            goal.id += 1;
        }
        let number = goal.id;
        if self.sent.len() == SENT_MAX {
            self.sent.pop_front();
        }
        self.sent.push_back(number);
        self.outputs.push_back(Output::Command(goal));
        number
    }

    fn end(&mut self, now: Instant, status: Status, why: &str) {
        let Some(active) = self.active.take() else { return };
        let Active { kind, id, .. } = active;
        let reached = if status == Status::Succeeded { active.poses.len() } else { active.to };
        let progress = active.progress(reached, status == Status::Aborted);
        let result = wire::result(kind, status, why, Some(progress));
        for caller in self.goals[kind as usize].end(now, id, status, &result) {
            self.answer(kind, Part::GetResult, caller, result.clone());
        }
        self.publish_status(kind);
    }

    fn answer(&mut self, kind: Kind, part: Part, caller: Caller, cdr: Vec<u8>) {
        self.outputs.push_back(Output::Answer(kind, part, caller, cdr));
    }

    fn publish_status(&mut self, kind: Kind) {
        self.outputs.push_back(Output::Status(kind, self.goals[kind as usize].status_array()));
    }

    fn note(&mut self, kind: Kind, text: &str) {
        self.outputs.push_back(Output::Note(format!("{}: {text}", kind.name())));
    }
}

impl Active {
    /// Number of the goal that the planner has, as far as it has said so.
    fn left_to_the_planner(&self) -> Option<i32> {
        match self.planner {
            Planner::Begins { .. } => self.before,
            Planner::Drives { .. } => Some(self.number),
            Planner::Ends { .. } => None,
        }
    }

    fn progress(&self, reached: usize, has_failed: bool) -> Progress<'_> {
        Progress { poses: &self.poses, stamp: self.stamp, reached, has_failed }
    }
}
