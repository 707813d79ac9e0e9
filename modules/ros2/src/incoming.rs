//! Messages of ROS as the robot's own.

use crate::cdr::Reader;
use crate::topics::{Quality, Topic};
use diagnostics::orders;
use messages::Message;
use messages::middlelevel::{CmdEstimate, CmdGoal, Waypoint};
use std::f64::consts::PI;
use std::fmt;

/// What ROS may send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// `/cmd_vel` as `geometry_msgs/msg/Twist`.
    Twist,
    /// `/cmd_vel` as `geometry_msgs/msg/TwistStamped`.
    TwistStamped,
    /// `/goal_pose`: a goal, as RViz sends it.
    Goal,
    /// `/initialpose`: where the robot is, as RViz sends it.
    Pose,
}

impl Input {
    /// All.
    pub const ALL: [Self; 4] = [Self::Twist, Self::TwistStamped, Self::Goal, Self::Pose];

    /// Its topic. A velocity is best effort: the newest counts, and an old one must not be repeated.
    #[must_use]
    pub fn topic(self) -> Topic {
        match self {
            Self::Twist => Topic::new("/cmd_vel", "geometry_msgs/msg/Twist", Quality::Sensor),
            Self::TwistStamped => Topic::new("/cmd_vel", "geometry_msgs/msg/TwistStamped", Quality::Sensor),
            Self::Goal => Topic::new("/goal_pose", "geometry_msgs/msg/PoseStamped", Quality::Reliable),
            Self::Pose => Topic::new("/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", Quality::Reliable),
        }
    }
}

/// Velocity of the body. Whatever a robot cannot do of it is left out by its driver, which also judges values that are
/// out of limits or not numbers: they stop the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Velocity {
    /// Forward, m/s.
    pub vx: f64,
    /// To the left, m/s.
    pub vy: f64,
    /// Rotation, counter-clockwise, rad/s.
    pub omega: f64,
}

/// What a message of ROS says.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Move so.
    Velocity(Velocity),
    /// For the robot's bus.
    Message(Box<Message>),
}

/// Why a message is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// It is cut off, or encoded in another way.
    Malformed,
    /// A pose in another frame than the map.
    Frame(String),
    /// A pose with a value that is not a number.
    NotFinite,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed => write!(f, "it is malformed"),
            Self::Frame(frame) => write!(f, "its frame is {frame:?}: expected \"map\""),
            Self::NotFinite => write!(f, "its pose is not finite"),
        }
    }
}

impl std::error::Error for Refusal {}

/// Longest name of a frame in a refusal, characters.
const FRAME_MAX: usize = 40;

/// Reads a message of ROS; `timestamp` is that of the robot's message, µs since the UNIX epoch.
///
/// # Errors
/// It is not obeyed.
pub fn read(input: Input, timestamp: i64, sample: &[u8]) -> Result<Command, Refusal> {
    let mut reader = Reader::new(sample).ok_or(Refusal::Malformed)?;
    match input {
        Input::Twist => twist(&mut reader).ok_or(Refusal::Malformed),
        Input::TwistStamped => header(&mut reader).and_then(|_| twist(&mut reader)).ok_or(Refusal::Malformed),
        Input::Goal => {
            let [x, y, theta] = pose(&mut reader)?;
            let waypoint = Waypoint { x, y, theta, tolerance: 0.0, heading: true };
            let goal = CmdGoal { timestamp, ..orders::goal(timestamp, vec![waypoint], false) };
            Ok(Command::Message(Box::new(goal.into())))
        }
        Input::Pose => {
            let [x, y, theta] = pose(&mut reader)?;
            let all: [f64; 36] = reader.f64s().ok_or(Refusal::Malformed)?;
            const PLACES: [usize; 3] = [0, 1, 5];
            let mut covariance = PLACES.map(|row| PLACES.map(|column| all[6 * row + column]));
            let is_known =
                (0..3).all(|n| covariance[n][n] > 0.0) && covariance.as_flattened().iter().all(|v| v.is_finite());
            if !is_known {
                covariance = orders::covariance(orders::DEVIATIONS);
            }
            Ok(Command::Message(Box::new(CmdEstimate { timestamp, x, y, theta, covariance }.into())))
        }
    }
}

/// Frame of a `std_msgs/msg/Header`.
pub(crate) fn header<'a>(reader: &mut Reader<'a>) -> Option<&'a str> {
    let (_seconds, _nanoseconds) = (reader.i32()?, reader.u32()?);
    reader.string()
}

fn twist(reader: &mut Reader<'_>) -> Option<Command> {
    let [vx, vy, _, _, _, omega] = reader.f64s()?;
    Some(Command::Velocity(Velocity { vx, vy, omega }))
}

/// x, y and heading of a pose in the map, with its header.
pub(crate) fn pose(reader: &mut Reader<'_>) -> Result<[f64; 3], Refusal> {
    let frame = header(reader).ok_or(Refusal::Malformed)?;
    let [x, y, z, qx, qy, qz, qw] = reader.f64s().ok_or(Refusal::Malformed)?;
    if frame.strip_prefix('/').unwrap_or(frame) != "map" {
        return Err(Refusal::Frame(frame.chars().take(FRAME_MAX).collect()));
    }
    let theta = libm::atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz));
    let is_finite = [x, y, z, theta].iter().all(|value| value.is_finite());
    // A heading of -π and one of π are the same.
    is_finite.then_some([x, y, if theta >= PI { -PI } else { theta }]).ok_or(Refusal::NotFinite)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lcm_gen::cdr::Writer;
    use testing::Random;

    fn sample(write: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
        let mut out = Vec::new();
        write(&mut Writer::new(&mut out));
        out
    }

    fn stamped(frame: &str, numbers: &[f64]) -> Vec<u8> {
        sample(|to| {
            to.i32(7);
            to.u32(8);
            to.string(frame);
            numbers.iter().for_each(|number| to.f64(*number));
        })
    }

    #[test]
    fn a_twist_is_a_velocity_with_and_without_a_header_and_bad_values_are_for_the_driver_to_judge() {
        for numbers in [[0.5, 0.1, 9.0, 9.0, 9.0, -0.3], [f64::NAN, f64::INFINITY, 0.0, 0.0, 0.0, 1e300]] {
            let plain = sample(|to| numbers.iter().for_each(|number| to.f64(*number)));
            for (input, bytes) in [
                (Input::Twist, plain),
                (Input::TwistStamped, stamped("base_link", &numbers)),
                (Input::TwistStamped, stamped("", &numbers)),
            ] {
                let Command::Velocity(Velocity { vx, vy, omega }) = read(input, 1, &bytes).unwrap() else { panic!() };
                let expected = [numbers[0], numbers[1], numbers[5]];
                assert_eq!([vx, vy, omega].map(f64::to_bits), expected.map(f64::to_bits));
                for end in 0..bytes.len() {
                    assert_eq!(read(input, 1, &bytes[..end]), Err(Refusal::Malformed));
                }
            }
        }
    }

    #[test]
    fn a_goal_is_one_waypoint_with_a_heading() {
        let (sin, cos) = libm::sincos(0.5);
        let bytes = stamped("map", &[1.0, 2.0, 0.0, 0.0, 0.0, sin, cos]);
        let Ok(Command::Message(message)) = read(Input::Goal, 5_000_000, &bytes) else { panic!() };
        let Message::MlCmdGoal(goal) = *message else { panic!() };
        let [Waypoint { x, y, theta, heading, .. }] = goal.waypoints[..] else { panic!() };
        assert_eq!((x, y, heading, goal.r#loop, goal.timestamp), (1.0, 2.0, true, false, 5_000_000));
        assert!((theta - 1.0).abs() < 1e-12, "{theta}");
    }

    #[test]
    fn a_pose_of_another_frame_or_that_is_none_is_refused() {
        let refused =
            |frame: &str, x: f64, w: f64| read(Input::Goal, 0, &stamped(frame, &[x, 2.0, 0.0, 0.0, 0.0, 0.0, w])).err();
        assert_eq!(refused("map", 1.0, 1.0), None);
        assert_eq!(refused("odom", 1.0, 1.0), Some(Refusal::Frame("odom".into())));
        assert_eq!(refused("", 1.0, 1.0), Some(Refusal::Frame(String::new())));
        assert_eq!(refused("map", f64::NAN, 1.0), Some(Refusal::NotFinite));
        assert_eq!(refused("map", 1.0, f64::INFINITY), Some(Refusal::NotFinite));
    }

    #[test]
    fn a_pose_keeps_its_covariance_and_gets_the_usual_one_without() {
        let told = |diagonal: f64| {
            let mut numbers = vec![1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0];
            let mut covariance = [0.0; 36];
            [0, 7, 35].into_iter().for_each(|place| covariance[place] = diagonal);
            covariance[1] = 0.01;
            numbers.extend(covariance);
            let Ok(Command::Message(message)) = read(Input::Pose, 0, &stamped("map", &numbers)) else { panic!() };
            let Message::MlCmdEstimate(estimate) = *message else { panic!() };
            estimate.covariance
        };
        assert_eq!(told(0.25), [[0.25, 0.01, 0.0], [0.0, 0.25, 0.0], [0.0, 0.0, 0.25]]);
        assert_eq!(told(0.0), orders::covariance(orders::DEVIATIONS));
        assert_eq!(told(f64::NAN), orders::covariance(orders::DEVIATIONS));
    }

    #[test]
    fn random_bytes_are_survived() {
        let mut random = Random::new(3);
        for _ in 0..20_000 {
            let length = random.index(420);
            let mut bytes = random.bytes(length);
            if bytes.len() > 4 {
                bytes[..4].copy_from_slice(&[0, 1, 0, 0]);
            }
            Input::ALL.into_iter().for_each(|input| drop(read(input, 0, &bytes)));
        }
    }
}
