//! Goals as commanded by `ML_CMD_GOAL`.

use messages::middlelevel::{CmdGoal, DataGoal};
use navitools::{Point, Pose};

/// Maximum number of waypoints.
const WAYPOINTS_MAX: usize = 1000;
/// Largest absolute coordinate, m; the same as in a world.
const COORDINATE_MAX_M: f64 = 1e4;
/// Distance that counts as reached without a tolerance, or with one below the accuracy of the estimate, m.
const TOLERANCE_DEFAULT_M: f64 = 0.15;
/// Deviation from a heading that counts as reached, rad.
pub const HEADING_TOLERANCE_RAD: f64 = 0.2;

/// Waypoint of a goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Position in the map, m.
    pub at: Point,
    /// Heading on arrival, rad; `None` for any.
    pub heading: Option<f64>,
    /// Distance that counts as reached, m.
    pub tolerance: f64,
}

impl Waypoint {
    /// Waypoint with the usual tolerance.
    #[must_use]
    pub const fn new(at: Point, heading: Option<f64>) -> Self {
        Self { at, heading, tolerance: TOLERANCE_DEFAULT_M }
    }

    /// True if a robot at this pose has reached the waypoint.
    #[must_use]
    pub fn is_reached(&self, robot: Pose) -> bool {
        let turned = self.heading.map_or(0.0, |heading| navitools::wrap(robot.theta.radians() - heading).abs());
        robot.point().distance(self.at) <= self.tolerance && turned <= HEADING_TOLERANCE_RAD
    }
}

/// Goal: waypoints to be driven once or in a loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// Number chosen by the sender.
    pub id: i32,
    /// Waypoints in order; at least one.
    pub waypoints: Vec<Waypoint>,
    /// True if the goal is repeated without end.
    pub looped: bool,
    /// Waypoint that is driven to.
    pub next: usize,
}

impl Goal {
    /// Goal of a command; `None` if the command cancels the goal.
    ///
    /// # Errors
    /// The command is invalid; the text names the waypoint and the value.
    pub fn of(command: &CmdGoal) -> Result<Option<Self>, String> {
        if command.waypoints.len() > WAYPOINTS_MAX {
            return Err(format!("{} waypoints; at most {WAYPOINTS_MAX}", command.waypoints.len()));
        }
        let mut waypoints = Vec::with_capacity(command.waypoints.len());
        for (number, waypoint) in command.waypoints.iter().enumerate() {
            let within = |value: f64| value.abs() <= COORDINATE_MAX_M;
            if !within(waypoint.x) || !within(waypoint.y) {
                return Err(format!("waypoint {number} at {}, {}: not within ±10 km", waypoint.x, waypoint.y));
            }
            if waypoint.heading && !waypoint.theta.is_finite() {
                return Err(format!("waypoint {number} with heading {}: not an angle", waypoint.theta));
            }
            if !(0.0..=COORDINATE_MAX_M).contains(&waypoint.tolerance) {
                return Err(format!("waypoint {number} with tolerance {}: not a distance", waypoint.tolerance));
            }
            waypoints.push(Waypoint {
                at: Point { x: waypoint.x, y: waypoint.y },
                heading: waypoint.heading.then(|| navitools::wrap(waypoint.theta)),
                tolerance: waypoint.tolerance.max(TOLERANCE_DEFAULT_M),
            });
        }
        let goal = Self { id: command.id, waypoints, looped: command.r#loop, next: 0 };
        Ok((!goal.waypoints.is_empty()).then_some(goal))
    }

    /// Goal of one waypoint.
    #[must_use]
    pub fn to(id: i32, waypoint: Waypoint) -> Self {
        Self { id, waypoints: vec![waypoint], looped: false, next: 0 }
    }

    /// Waypoint after `number`; `None` after the last.
    #[must_use]
    pub fn after(&self, number: usize) -> Option<usize> {
        match number + 1 {
            next if next < self.waypoints.len() => Some(next),
            // A loop of one waypoint is already at its end.
            _ if self.looped && self.waypoints.len() > 1 => Some(0),
            _ => None,
        }
    }

    /// Heading for passing a waypoint on the way to the next; `None` at the last waypoint, or where the robot must
    /// reverse.
    #[must_use]
    pub fn passing(&self, from: Point, number: usize) -> Option<f64> {
        let here = self.waypoints[number].at;
        let there = self.waypoints[self.after(number)?].at;
        let unit = |a: Point, b: Point| {
            let distance = a.distance(b);
            (distance > 0.3).then(|| ((b.x - a.x) / distance, (b.y - a.y) / distance))
        };
        let ((ax, ay), (bx, by)) = (unit(from, here)?, unit(here, there)?);
        let (x, y) = (ax + bx, ay + by);
        (libm::hypot(x, y) > 0.3).then(|| libm::atan2(y, x))
    }
}

/// Status of a goal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(i8)]
pub enum Status {
    /// No goal.
    #[default]
    Idle = DataGoal::IDLE,
    /// Driving, or about to drive.
    Driving = DataGoal::DRIVING,
    /// Reached.
    Reached = DataGoal::REACHED,
    /// Blocked by an obstacle.
    Blocked = DataGoal::BLOCKED,
    /// Failed.
    Failed = DataGoal::FAILED,
    /// Cancelled.
    Cancelled = DataGoal::CANCELLED,
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::middlelevel::Waypoint as Told;

    fn command(waypoints: &[(f64, f64)], looped: bool) -> CmdGoal {
        let told = |&(x, y): &(f64, f64)| Told { x, y, theta: 0.0, tolerance: 0.0, heading: false };
        CmdGoal { timestamp: 0, id: 7, waypoints: waypoints.iter().map(told).collect(), r#loop: looped }
    }

    #[test]
    fn a_command_without_waypoints_is_no_goal() {
        assert_eq!(Goal::of(&command(&[], false)), Ok(None));
    }

    #[test]
    fn invalid_waypoints_are_refused_with_a_reason() {
        for bad in [f64::NAN, f64::INFINITY, 1e5] {
            let why = Goal::of(&command(&[(0.0, 0.0), (bad, 0.0)], false)).unwrap_err();
            assert!(why.starts_with("waypoint 1 at "), "{why}");
        }
        let mut turned = command(&[(0.0, 0.0)], false);
        turned.waypoints[0].theta = f64::NAN;
        assert!(Goal::of(&turned).is_ok(), "a heading that does not matter");
        turned.waypoints[0].heading = true;
        assert_eq!(Goal::of(&turned).unwrap_err(), "waypoint 0 with heading NaN: not an angle");
        let mut near = command(&[(0.0, 0.0)], false);
        near.waypoints[0].tolerance = -1.0;
        assert_eq!(Goal::of(&near).unwrap_err(), "waypoint 0 with tolerance -1: not a distance");
        assert!(Goal::of(&command(&[(0.0, 0.0); 1001], false)).is_err());
    }

    #[test]
    fn a_loop_continues_with_its_first_waypoint() {
        let once = Goal::of(&command(&[(0.0, 0.0), (1.0, 0.0)], false)).unwrap().unwrap();
        assert_eq!((once.after(0), once.after(1)), (Some(1), None));
        let looped = Goal { looped: true, ..once };
        assert_eq!((looped.after(0), looped.after(1)), (Some(1), Some(0)));
    }

    #[test]
    fn a_corner_is_passed_with_half_the_turn() {
        let goal = Goal::of(&command(&[(2.0, 0.0), (2.0, 2.0), (0.0, 2.0)], false)).unwrap().unwrap();
        let heading = goal.passing(Point { x: 0.0, y: 0.0 }, 0).unwrap();
        assert!((heading.to_degrees() - 45.0).abs() < 1e-9, "{heading}");
        assert_eq!(goal.passing(Point { x: 2.0, y: 0.0 }, 2), None, "the last one");
        let back = Goal::of(&command(&[(2.0, 0.0), (0.0, 0.0)], false)).unwrap().unwrap();
        assert_eq!(back.passing(Point { x: 0.0, y: 0.0 }, 0), None, "it must turn back");
    }

    #[test]
    fn a_heading_counts_if_it_is_required() {
        let waypoint = Waypoint { at: Point { x: 1.0, y: 0.0 }, heading: Some(3.1), tolerance: 0.15 };
        assert!(waypoint.is_reached(Pose::new(1.1, 0.0, -3.1)), "across the cut");
        assert!(!waypoint.is_reached(Pose::new(1.1, 0.0, 0.0)));
        assert!(Waypoint { heading: None, ..waypoint }.is_reached(Pose::new(1.1, 0.0, 0.0)));
        assert!(!waypoint.is_reached(Pose::new(1.2, 0.0, 3.1)));
    }
}
