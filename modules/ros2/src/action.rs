//! Goals of an action (design.ros2.org, "Actions"; `action_msgs`): their states, their results, and who asks for these.

use crate::cdr::Reader;
use crate::service::Caller;
use base::{Duration, Instant};
use lcm_gen::cdr::Writer;
use std::collections::VecDeque;

/// Goals that are kept at most: the one that is pursued, and the last ones that have ended.
pub const GOALS_MAX: usize = 16;
/// Time for which the result of a goal is kept.
pub const RESULT_KEPT: Duration = Duration::from_secs(15 * 60);
/// Requests at most that wait for the result of a goal.
const CALLERS_MAX: usize = 8;

/// `unique_identifier_msgs/msg/UUID`, drawn by the client.
pub type GoalId = [u8; 16];

/// `action_msgs/msg/GoalStatus`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i8)]
pub enum Status {
    /// No such goal.
    Unknown = 0,
    /// It is pursued.
    Executing = 2,
    /// A client has asked for its end.
    Canceling = 3,
    /// It has been reached.
    Succeeded = 4,
    /// It has ended because a client asked for that.
    Canceled = 5,
    /// It has ended otherwise.
    Aborted = 6,
}

/// Answer to a request for a cancellation, `action_msgs/srv/CancelGoal`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i8)]
pub enum CancelCode {
    /// The goals of the list are cancelled.
    None = 0,
    /// None of them may be.
    Rejected = 1,
    /// There is no such goal.
    UnknownGoal = 2,
    /// It has ended before.
    Terminated = 3,
}

/// Answer to a request for a result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ResultAnswer {
    /// Now: the content.
    Now(Vec<u8>),
    /// At the end of the goal.
    Later,
    /// There is no such goal.
    Unknown,
    /// Too many requests wait for it already.
    TooMany,
}

#[derive(Clone, Debug)]
struct Goal {
    id: GoalId,
    /// Time of its acceptance, µs since the UNIX epoch.
    stamp: i64,
    status: Status,
    /// Content of the answer to `get_result`, and when it is forgotten.
    end: Option<(Vec<u8>, Instant)>,
    callers: Vec<Caller>,
}

/// The goals of an action, oldest first.
#[derive(Clone, Debug, Default)]
pub struct Goals(VecDeque<Goal>);

impl Goals {
    /// Begins a goal; false: there is one of this identifier, or no place.
    pub fn begin(&mut self, id: GoalId, stamp: i64) -> bool {
        if self.0.iter().any(|goal| goal.id == id) {
            return false;
        }
        if self.0.len() >= GOALS_MAX {
            let Some(oldest) = self.0.iter().position(|goal| goal.end.is_some()) else { return false };
            self.0.remove(oldest);
        }
        self.0.push_back(Goal { id, stamp, status: Status::Executing, end: None, callers: Vec::new() });
        true
    }

    /// Marks a goal as one whose end a client has asked for.
    pub fn cancel(&mut self, id: GoalId) {
        if let Some(goal) = self.0.iter_mut().find(|goal| goal.id == id && goal.end.is_none()) {
            goal.status = Status::Canceling;
        }
    }

    /// Ends a goal; who waits for its result `result`, the content of the answer.
    pub fn end(&mut self, now: Instant, id: GoalId, status: Status, result: &[u8]) -> Vec<Caller> {
        let Some(goal) = self.0.iter_mut().find(|goal| goal.id == id && goal.end.is_none()) else { return Vec::new() };
        goal.status = status;
        goal.end = Some((result.to_vec(), now + RESULT_KEPT));
        std::mem::take(&mut goal.callers)
    }

    /// A request for the result of a goal.
    pub fn result(&mut self, id: GoalId, caller: Caller) -> ResultAnswer {
        let Some(goal) = self.0.iter_mut().find(|goal| goal.id == id) else { return ResultAnswer::Unknown };
        match &goal.end {
            Some((result, _)) => ResultAnswer::Now(result.clone()),
            None if goal.callers.len() >= CALLERS_MAX => ResultAnswer::TooMany,
            None => {
                goal.callers.push(caller);
                ResultAnswer::Later
            }
        }
    }

    /// Which goals a request for a cancellation means: with an identifier that one, with a time (µs since the UNIX
    /// epoch, 0: none) also all that are not newer, with neither all.
    ///
    /// # Errors
    /// The goal of that identifier is not known, or has ended.
    pub fn meant(&self, id: GoalId, stamp: i64) -> Result<Vec<(GoalId, i64)>, CancelCode> {
        let one = self.0.iter().find(|goal| goal.id == id);
        if id != GoalId::default() {
            match one {
                None => return Err(CancelCode::UnknownGoal),
                Some(goal) if goal.end.is_some() && stamp == 0 => return Err(CancelCode::Terminated),
                Some(_) => {}
            }
        }
        let all = id == GoalId::default() && stamp == 0;
        let is_meant = |goal: &&Goal| all || goal.id == id || (stamp != 0 && goal.stamp <= stamp);
        let active = self.0.iter().filter(|goal| goal.status == Status::Executing);
        Ok(active.filter(is_meant).map(|goal| (goal.id, goal.stamp)).collect())
    }

    /// Forgets results that were kept for long enough; true if there were any.
    pub fn expire(&mut self, now: Instant) -> bool {
        let before = self.0.len();
        self.0.retain(|goal| goal.end.as_ref().is_none_or(|(_, until)| *until > now));
        self.0.len() != before
    }

    /// When [`expire`](Self::expire) is to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.0.iter().filter_map(|goal| goal.end.as_ref()).map(|(_, until)| *until).min()
    }

    /// `action_msgs/msg/GoalStatusArray`.
    #[must_use]
    pub fn status_array(&self) -> Vec<u8> {
        let mut cdr = Vec::new();
        let mut to = Writer::new(&mut cdr);
        to.count(self.0.len());
        for goal in &self.0 {
            goal_info(&mut to, goal.id, goal.stamp);
            to.i8(goal.status as i8);
        }
        cdr
    }
}

/// `builtin_interfaces/msg/Time` or `Duration` of µs.
pub fn time(to: &mut Writer<'_>, micros: i64) {
    to.i32(i32::try_from(micros.div_euclid(1_000_000)).unwrap_or(i32::MAX));
    to.u32(micros.rem_euclid(1_000_000) as u32 * 1000);
}

/// `action_msgs/msg/GoalInfo`.
fn goal_info(to: &mut Writer<'_>, id: GoalId, stamp: i64) {
    id.into_iter().for_each(|byte| to.u8(byte));
    time(to, stamp);
}

/// Reads `action_msgs/srv/CancelGoal_Request`: identifier, and time in µs since the UNIX epoch, rounded up.
#[must_use]
pub fn read_cancel(sample: &[u8]) -> Option<(GoalId, i64)> {
    let mut reader = Reader::new(sample)?;
    let id = reader.bytes()?;
    let (seconds, nanoseconds) = (reader.i32()?, reader.u32()?);
    reader.end()?;
    Some((id, i64::from(seconds) * 1_000_000 + i64::from(nanoseconds.div_ceil(1000))))
}

/// Reads the request of `get_result`.
#[must_use]
pub fn read_get_result(sample: &[u8]) -> Option<GoalId> {
    let mut reader = Reader::new(sample)?;
    let id = reader.bytes()?;
    reader.end()?;
    Some(id)
}

/// `action_msgs/srv/CancelGoal_Response`.
#[must_use]
pub fn cancel_response(code: CancelCode, goals: &[(GoalId, i64)]) -> Vec<u8> {
    let mut cdr = Vec::new();
    let mut to = Writer::new(&mut cdr);
    to.i8(code as i8);
    to.count(goals.len());
    goals.iter().for_each(|(id, stamp)| goal_info(&mut to, *id, *stamp));
    cdr
}

/// The answer to `send_goal`: whether the goal is accepted, and when.
#[must_use]
pub fn send_goal_response(is_accepted: bool, stamp: i64) -> Vec<u8> {
    let mut cdr = Vec::new();
    let mut to = Writer::new(&mut cdr);
    to.bool(is_accepted);
    time(&mut to, stamp);
    cdr
}
