//! What the planner must know of the robot, and how it drives.

use crate::map::Map;
use navitools::Point;

/// The configuration; SI units. Whoever builds it from a file has checked its numbers.
#[derive(Clone, Debug)]
pub struct Config {
    /// The robot's measures.
    pub body: Body,
    /// How it may move.
    pub limits: Limits,
    /// How it behaves.
    pub manners: Manners,
    /// Full opening angle of a sonar's beam where the message does not have it (`LL_DATA_SRFS`), rad.
    pub sonar_beam: f64,
    /// Walls and what else is known to stand; none: the floor is taken as free, and the sonars say what is not.
    pub map: Option<Map>,
}

/// The rectangle on the floor that the robot covers; origin under the middle of the rear axle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Between the axles, m.
    pub wheelbase: f64,
    /// Rear axle to front bumper, m.
    pub front: f64,
    /// Rear axle to rear bumper, m.
    pub rear: f64,
    /// m.
    pub width: f64,
}

impl Body {
    /// Whether a point of the robot's frame is within it, grown by `margin` m on all sides.
    #[must_use]
    pub fn covers(&self, point: Point, margin: f64) -> bool {
        (-self.rear - margin..=self.front + margin).contains(&point.x) && point.y.abs() <= self.width / 2.0 + margin
    }
}

/// How the robot may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Forward, m/s.
    pub speed: f64,
    /// Of the equivalent single front wheel, rad.
    pub steering: f64,
    /// rad/s.
    pub steering_rate: f64,
    /// m/s².
    pub acceleration: f64,
    /// Of a stop that is commanded, m/s².
    pub deceleration: f64,
    /// Sideways at the rear axle, m/s².
    pub lateral_acceleration: f64,
}

/// `[planner]`: how it behaves among people and things.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Manners {
    /// Backwards, m/s.
    pub speed_reverse: f64,
    /// Through space that was not seen within the last second, m/s.
    pub speed_unseen: f64,
    /// Kept to what is sensed, m, beside the robot while it drives.
    pub margin: f64,
    /// Kept to what stands in the way, m.
    pub stop_distance: f64,
    /// From a thing's appearance to the brakes, s: sonar slot, poll, bus, loop, drive (docs/facts/robot.md 5).
    pub reaction: f64,
    /// Of the robot rolling out when PAUSE opens the motors' feed, m/s²; it drives no faster than it could so stop
    /// before what it hears.
    pub coasting: f64,
    /// So long it waits for somebody in the way to leave before it looks for a way around, s.
    pub patience: f64,
    /// So often it tries to get free, one way or another, before a goal that is not a loop has failed.
    pub attempts: u32,
}

impl Default for Manners {
    fn default() -> Self {
        Self {
            speed_reverse: 0.3,
            speed_unseen: 0.4,
            margin: 0.20,
            stop_distance: 0.25,
            reaction: 0.37,
            coasting: 0.25,
            patience: 1.5,
            attempts: 8,
        }
    }
}
