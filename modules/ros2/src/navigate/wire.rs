//! Goals, feedback and results of the actions of navigation, as Nav2 defines them (`nav2_msgs` 1.4, of ROS 2 Kilted).
//! `NavigateToPose` is the same in Jazzy; `NavigateThroughPoses` has its poses in `nav_msgs/Goals` since Kilted, and
//! the states of waypoints at the end of feedback and result. Goals of Jazzy are read as well, and its clients do not
//! read on to these states.

use super::kind::Kind;
use crate::action::{GoalId, Status, time};
use crate::cdr::Reader;
use crate::incoming::{self, Refusal};
use logger::ros::{Fields, Pose};
use messages::middlelevel::DataEstimate;
use std::fmt;

/// Poses of a goal at most.
pub const POSES_MAX: usize = 100;
/// Longest text of a result, characters.
const TEXT_MAX: usize = 256;

/// Why a goal is rejected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rejection {
    /// A pose is refused, or the request is malformed.
    Pose(Refusal),
    /// It has no pose, or too many.
    Count(usize),
    /// It asks for a behavior tree of Nav2.
    BehaviorTree,
    /// There is a goal of this identifier already.
    Repeated,
    /// ROS may not command now, with the reason.
    NotNow(&'static str),
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pose(refusal) => refusal.fmt(f),
            Self::Count(count) => write!(f, "it has {count} poses: expected 1 to {POSES_MAX}"),
            Self::BehaviorTree => f.write_str("it names a behavior tree: the robot has none"),
            Self::Repeated => f.write_str("its identifier is that of an earlier goal"),
            Self::NotNow(why) => f.write_str(why),
        }
    }
}

impl From<Refusal> for Rejection {
    fn from(refusal: Refusal) -> Self {
        Self::Pose(refusal)
    }
}

/// Reads the request of `send_goal`: identifier, and x, y, heading of each pose in the map.
///
/// # Errors
/// The goal is rejected.
pub fn read_goal(kind: Kind, sample: &[u8]) -> Result<(GoalId, Vec<[f64; 3]>), Rejection> {
    match kind {
        Kind::ToPose => read(sample, Poses::One),
        Kind::ThroughPoses => match (read(sample, Poses::Goals), read(sample, Poses::Sequence)) {
            (Err(MALFORMED), of_jazzy) | (Err(_), of_jazzy @ Ok(_)) => of_jazzy,
            (of_kilted, _) => of_kilted,
        },
    }
}

const MALFORMED: Rejection = Rejection::Pose(Refusal::Malformed);

/// How the poses of a goal are written.
#[derive(Clone, Copy, Debug)]
enum Poses {
    /// `geometry_msgs/PoseStamped`.
    One,
    /// `nav_msgs/Goals`: a header before the sequence.
    Goals,
    /// `geometry_msgs/PoseStamped[]`.
    Sequence,
}

fn read(sample: &[u8], written: Poses) -> Result<(GoalId, Vec<[f64; 3]>), Rejection> {
    let mut reader = Reader::new(sample).ok_or(MALFORMED)?;
    let id = reader.bytes().ok_or(MALFORMED)?;
    if matches!(written, Poses::Goals) {
        incoming::header(&mut reader).ok_or(MALFORMED)?;
    }
    let count = match written {
        Poses::One => 1,
        Poses::Goals | Poses::Sequence => reader.u32().ok_or(MALFORMED)? as usize,
    };
    if !(1..=POSES_MAX).contains(&count) {
        return Err(Rejection::Count(count));
    }
    let poses = (0..count).map(|_| incoming::pose(&mut reader)).collect::<Result<_, _>>()?;
    let tree = reader.string().ok_or(MALFORMED)?;
    reader.end().ok_or(MALFORMED)?;
    if tree.is_empty() { Ok((id, poses)) } else { Err(Rejection::BehaviorTree) }
}

/// How far the robot is on its way through the poses of a goal.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// The poses.
    pub poses: &'a [[f64; 3]],
    /// Time of acceptance, µs since the UNIX epoch.
    pub stamp: i64,
    /// Number of poses that have been reached.
    pub reached: usize,
    /// The next one was given up.
    pub has_failed: bool,
}

/// `nav2_msgs/msg/WaypointStatus`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Waypoint {
    Pending = 0,
    Completed = 1,
    Failed = 3,
}

impl Progress<'_> {
    fn write(&self, fields: &mut Fields<'_>) {
        fields.to.count(self.poses.len());
        for (n, [x, y, theta]) in self.poses.iter().copied().enumerate() {
            let state = match n {
                n if n < self.reached => Waypoint::Completed,
                n if n == self.reached && self.has_failed => Waypoint::Failed,
                _ => Waypoint::Pending,
            };
            fields.to.u8(state as u8);
            fields.to.u32(n as u32);
            fields.header(self.stamp, "map");
            fields.pose(Pose { x, y, theta });
            fields.to.u16(if state == Waypoint::Failed { Kind::ThroughPoses.unknown_error() } else { 0 });
            fields.to.string("");
        }
    }
}

/// Figures of a feedback.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    /// Time since the goal was accepted, µs.
    pub navigation_us: i64,
    /// Way that remains, m; NaN: not known.
    pub remaining: f64,
    /// Manoeuvres by which the robot got out of where it was stuck.
    pub recoveries: i16,
}

/// Speed, m/s, and way, m, from which the time that remains is estimated, as Nav2 does.
const ESTIMATED_FROM: (f64, f64) = (0.01, 0.1);

/// The feedback of a goal.
#[must_use]
pub fn feedback(kind: Kind, id: GoalId, at: &DataEstimate, figures: Figures, progress: Progress<'_>) -> Vec<u8> {
    let Figures { navigation_us, remaining, recoveries } = figures;
    let speed = at.speed.abs();
    let is_estimated = speed > ESTIMATED_FROM.0 && remaining > ESTIMATED_FROM.1;
    let left_us = if is_estimated { (remaining / speed * 1e6) as i64 } else { 0 };
    let mut cdr = Vec::new();
    let mut fields = Fields::new(&mut cdr);
    id.into_iter().for_each(|byte| fields.to.u8(byte));
    fields.header(at.timestamp, "map");
    fields.pose(Pose { x: at.x, y: at.y, theta: at.theta });
    time(&mut fields.to, navigation_us);
    time(&mut fields.to, left_us);
    fields.to.i16(recoveries);
    fields.to.f32(remaining as f32);
    if kind == Kind::ThroughPoses {
        fields.to.i16((progress.poses.len() - progress.reached.min(progress.poses.len())) as i16);
        progress.write(&mut fields);
    }
    cdr
}

/// The answer to `get_result`; of a goal that was reached without a text.
#[must_use]
pub fn result(kind: Kind, status: Status, text: &str, progress: Option<Progress<'_>>) -> Vec<u8> {
    let mut cdr = Vec::new();
    let mut fields = Fields::new(&mut cdr);
    let has_failed = matches!(status, Status::Aborted | Status::Unknown);
    fields.to.i8(status as i8);
    fields.to.u16(if has_failed { kind.unknown_error() } else { 0 });
    fields.to.string(&text.chars().take(TEXT_MAX).collect::<String>());
    if kind == Kind::ThroughPoses {
        match progress {
            Some(progress) => progress.write(&mut fields),
            None => fields.to.count(0),
        }
    }
    cdr
}

/// A request of `send_goal`, as a client writes it.
#[cfg(test)]
pub fn goal_request(kind: Kind, id: GoalId, frame: &str, poses: &[[f64; 3]], tree: &str) -> Vec<u8> {
    let mut cdr = Vec::new();
    let mut to = lcm_gen::cdr::Writer::new(&mut cdr);
    id.into_iter().for_each(|byte| to.u8(byte));
    let header = |to: &mut lcm_gen::cdr::Writer<'_>| {
        to.i32(0);
        to.u32(0);
        to.string(frame);
    };
    if kind == Kind::ThroughPoses {
        header(&mut to);
        to.count(poses.len());
    }
    for [x, y, theta] in poses {
        header(&mut to);
        let (sin, cos) = libm::sincos(theta / 2.0);
        [*x, *y, 0.0, 0.0, 0.0, sin, cos].into_iter().for_each(|number| to.f64(number));
    }
    to.string(tree);
    cdr
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same goal as a client of Jazzy writes it: without the header before the poses.
    fn of_jazzy(stamp: u32, frame: &str, poses: &[[f64; 3]]) -> Vec<u8> {
        let mut cdr = Vec::new();
        let mut to = lcm_gen::cdr::Writer::new(&mut cdr);
        (0..16).for_each(|byte| to.u8(byte));
        to.count(poses.len());
        for [x, y, _] in poses {
            to.u32(stamp);
            to.u32(stamp % 1_000_000_000);
            to.string(frame);
            [*x, *y, 0.0, 0.0, 0.0, 0.0, 1.0].into_iter().for_each(|number| to.f64(number));
        }
        to.string("");
        cdr
    }

    #[test]
    fn goals_through_poses_are_read_as_jazzy_writes_them() {
        let poses = [[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [5.0, 6.0, 0.0]];
        for stamp in [0, 1, 4, 7, 1_796_000_123] {
            for count in 1..=3 {
                let request = of_jazzy(stamp, "map", &poses[..count]);
                let (id, read) = read_goal(Kind::ThroughPoses, &request).unwrap();
                assert_eq!((id[15], &read[..]), (15, &poses[..count]), "{stamp}");
                for end in 0..request.len() {
                    assert!(read_goal(Kind::ThroughPoses, &request[..end]).is_err());
                }
            }
        }
        let refused = read_goal(Kind::ThroughPoses, &of_jazzy(1_796_000_123, "odom", &poses));
        assert_eq!(refused, Err(Rejection::Pose(Refusal::Frame("odom".into()))));
    }
}
