//! State of a goal: each with its figures, its status on the wire, its text, and the cause that holds the robot in it.

use crate::goal::Status;
use crate::map::Frame;
use crate::search::SearchError;
use messages::Hold;
use navitools::Point;
use std::fmt;

/// Subjects of [`Hold::SonarsUnknown`].
pub const FRONT: &str = "front";
const REAR: &str = "rear";

/// State of a goal. Waypoints count from 0 here, from 1 in texts.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum GoalState {
    /// No goal received since the start.
    #[default]
    NoGoal,
    /// Cancelled by an operator.
    Cancelled,
    /// Rejected as invalid, with the reason.
    Refused(String),
    /// Rejected in the operation mode MANUAL.
    ModeManual,
    /// The first path is being searched.
    Planning,
    /// Driving.
    Driving {
        /// Waypoint that is driven to.
        to: usize,
        /// Number of waypoints.
        of: usize,
        /// True if the goal begins again after the last waypoint.
        looped: bool,
        /// True if the path has less than the whole margin somewhere: the robot drives slowly.
        narrow: bool,
    },
    /// Stopped by an obstacle on the path, at this point of the map.
    InTheWay(Point),
    /// Stopped by an obstacle near the robot.
    SomebodyNear,
    /// Stopped because the state of all sonars in the direction of travel is unknown.
    Blind {
        /// True at the front, false at the rear.
        forward: bool,
    },
    /// Without a path; planning is repeated.
    NoPath {
        /// Waypoint without a path.
        to: usize,
        /// Reason.
        why: Hindrance,
    },
    /// Backing out, to search another path from there.
    BackingOut,
    /// Last waypoint reached.
    Reached(usize),
    /// At the only waypoint of a loop.
    AtLoop,
    /// Failed: on this map there is no path to the waypoint.
    CannotReach(usize, Hindrance),
    /// Failed: all attempts at this waypoint failed.
    GaveUp(usize, Hindrance),
}

/// Reason why the robot does not reach a waypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hindrance {
    /// The search found no path.
    Search(SearchError),
    /// Outside the map, which has this frame.
    OutsideMap(Frame),
    /// Without a map: start and waypoint are too far apart.
    FloorTooLarge,
    /// No motion although motion was commanded.
    NotMoving,
    /// Stopped at this distance from the waypoint, m.
    Beside(f64),
    /// Blocked by an obstacle that does not leave.
    InTheWay,
}

impl GoalState {
    /// Status in `ML_DATA_GOAL`.
    #[must_use]
    pub const fn status(&self) -> Status {
        match self {
            Self::NoGoal => Status::Idle,
            Self::Cancelled => Status::Cancelled,
            Self::Planning | Self::Driving { .. } => Status::Driving,
            Self::InTheWay(_) | Self::SomebodyNear | Self::Blind { .. } | Self::NoPath { .. } | Self::BackingOut => {
                Status::Blocked
            }
            Self::Reached(_) | Self::AtLoop => Status::Reached,
            Self::Refused(_) | Self::ModeManual | Self::CannotReach(..) | Self::GaveUp(..) => Status::Failed,
        }
    }

    /// Cause, with its subject, for which the robot does not drive to its goal; `None` while it drives.
    #[must_use]
    pub fn hold(&self) -> Option<(Hold, String)> {
        match self {
            Self::Driving { .. } => None,
            Self::Planning => Some((Hold::Planning, String::new())),
            Self::InTheWay(at) => Some((Hold::InTheWay, place(*at))),
            Self::SomebodyNear => Some((Hold::SomebodyNear, String::new())),
            Self::Blind { forward } => Some((Hold::SonarsUnknown, if *forward { FRONT } else { REAR }.into())),
            Self::NoPath { to, why } => Some((why.hold(), (to + 1).to_string())),
            Self::BackingOut => Some((Hold::BackingOut, String::new())),
            Self::AtLoop => Some((Hold::AtLoop, String::new())),
            Self::ModeManual => Some((Hold::ModeManual, String::new())),
            Self::NoGoal
            | Self::Cancelled
            | Self::Refused(_)
            | Self::Reached(_)
            | Self::CannotReach(..)
            | Self::GaveUp(..) => Some((Hold::NoGoal, String::new())),
        }
    }
}

/// Text of `ML_DATA_GOAL`.
impl fmt::Display for GoalState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoGoal => f.write_str("there is no goal"),
            Self::Cancelled => f.write_str("cancelled: there is no goal"),
            Self::Refused(why) => write!(f, "refused: {why}"),
            Self::ModeManual => write!(f, "refused: {}", Hold::ModeManual.words("")),
            Self::Planning => f.write_str("looks for a way"),
            Self::Driving { to, of, looped, narrow } => {
                let loops = if *looped { ", for ever" } else { "" };
                let narrow = if *narrow { ", slowly: the way is narrow" } else { "" };
                write!(f, "drives to waypoint {} of {of}{loops}{narrow}", to + 1)
            }
            Self::InTheWay(at) => write!(f, "waits for whoever stands in the way at {}", place(*at)),
            Self::SomebodyNear => f.write_str("waits for whoever stands near"),
            Self::Blind { forward } => {
                write!(f, "waits: {}", Hold::SonarsUnknown.words(if *forward { FRONT } else { REAR }))
            }
            Self::NoPath { to, why } => write!(f, "waits for a way to waypoint {}: {why}", to + 1),
            Self::BackingOut => f.write_str("backs out"),
            Self::Reached(waypoint) => write!(f, "reached waypoint {}, the last", waypoint + 1),
            Self::AtLoop => f.write_str("stands at the only waypoint of its loop"),
            Self::CannotReach(waypoint, why) => write!(f, "cannot reach waypoint {}: {why}", waypoint + 1),
            Self::GaveUp(waypoint, why) => write!(f, "gave up waypoint {}: {why}", waypoint + 1),
        }
    }
}

impl Hindrance {
    const fn hold(self) -> Hold {
        match self {
            Self::Search(SearchError::GoalBlocked) | Self::OutsideMap(_) => Hold::GoalBlocked,
            Self::Search(SearchError::StartBlocked) => Hold::StartBlocked,
            Self::Search(SearchError::Unreachable) => Hold::Unreachable,
            Self::Search(SearchError::Budget) => Hold::SearchExhausted,
            Self::Search(SearchError::Invalid) => Hold::GoalInvalid,
            Self::FloorTooLarge => Hold::FloorTooLarge,
            Self::NotMoving => Hold::NotMoving,
            Self::Beside(_) => Hold::StoppedBeside,
            Self::InTheWay => Hold::WayBlocked,
        }
    }
}

impl fmt::Display for Hindrance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Search(why) => why.fmt(f),
            Self::OutsideMap(frame) => write!(f, "it is outside the map, which is {}", frame.extent()),
            Self::FloorTooLarge => f.write_str("the floor between is too large"),
            Self::NotMoving => f.write_str("it was commanded to drive and does not move"),
            Self::Beside(off) => write!(f, "the robot came to stand {off:.2} m beside it"),
            Self::InTheWay => f.write_str("something stands in the way"),
        }
    }
}

/// Position as in texts, to 0.1 m.
fn place(at: Point) -> String {
    format!("{:.1}, {:.1}", at.x, at.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The texts of `ML_DATA_GOAL` are a contract: other programs print them.
    #[test]
    fn each_state_has_its_text_its_status_and_its_cause() {
        let point = Point { x: 5.52, y: 5.7 };
        let unreachable = Hindrance::Search(SearchError::Unreachable);
        for (state, text, status, hold) in [
            (GoalState::NoGoal, "there is no goal", Status::Idle, Some((601, ""))),
            (GoalState::Cancelled, "cancelled: there is no goal", Status::Cancelled, Some((601, ""))),
            (GoalState::Refused("x".into()), "refused: x", Status::Failed, Some((601, ""))),
            (
                GoalState::ModeManual,
                "refused: mode manual: only people drive the robot",
                Status::Failed,
                Some((608, "")),
            ),
            (GoalState::Planning, "looks for a way", Status::Driving, Some((603, ""))),
            (
                GoalState::Driving { to: 1, of: 12, looped: true, narrow: false },
                "drives to waypoint 2 of 12, for ever",
                Status::Driving,
                None,
            ),
            (
                GoalState::Driving { to: 0, of: 1, looped: false, narrow: false },
                "drives to waypoint 1 of 1",
                Status::Driving,
                None,
            ),
            (
                GoalState::Driving { to: 0, of: 1, looped: false, narrow: true },
                "drives to waypoint 1 of 1, slowly: the way is narrow",
                Status::Driving,
                None,
            ),
            (
                GoalState::InTheWay(point),
                "waits for whoever stands in the way at 5.5, 5.7",
                Status::Blocked,
                Some((604, "5.5, 5.7")),
            ),
            (GoalState::SomebodyNear, "waits for whoever stands near", Status::Blocked, Some((605, ""))),
            (
                GoalState::Blind { forward: false },
                "waits: nothing is known of the sonars at the rear",
                Status::Blocked,
                Some((506, "rear")),
            ),
            (
                GoalState::NoPath { to: 1, why: Hindrance::Beside(0.314) },
                "waits for a way to waypoint 2: the robot came to stand 0.31 m beside it",
                Status::Blocked,
                Some((618, "2")),
            ),
            (GoalState::BackingOut, "backs out", Status::Blocked, Some((606, ""))),
            (GoalState::Reached(2), "reached waypoint 3, the last", Status::Reached, Some((601, ""))),
            (GoalState::AtLoop, "stands at the only waypoint of its loop", Status::Reached, Some((607, ""))),
            (
                GoalState::CannotReach(0, unreachable),
                "cannot reach waypoint 1: no way leads to the goal",
                Status::Failed,
                Some((601, "")),
            ),
            (
                GoalState::GaveUp(0, Hindrance::InTheWay),
                "gave up waypoint 1: something stands in the way",
                Status::Failed,
                Some((601, "")),
            ),
        ] {
            let told = state.hold().map(|(hold, subject)| (hold.code(), subject));
            let expected = hold.map(|(code, subject)| (code, subject.to_owned()));
            assert_eq!((state.to_string().as_str(), state.status(), told), (text, status, expected));
        }
    }

    #[test]
    fn each_hindrance_is_the_sentence_of_its_cause() {
        let search = [
            SearchError::GoalBlocked,
            SearchError::StartBlocked,
            SearchError::Unreachable,
            SearchError::Budget,
            SearchError::Invalid,
        ];
        let others = [Hindrance::FloorTooLarge, Hindrance::InTheWay];
        for why in search.map(Hindrance::Search).into_iter().chain(others) {
            assert_eq!(why.hold().words("3"), format!("no way to waypoint 3: {why}"));
        }
    }
}
