//! What the planner must know of the robot, and how it drives.

use crate::map::Map;
use crate::search::Abilities;
use base::Duration;
use guard::law::Law;
use kinematics::Shape;
use navitools::{Point, Pose};
use settings::{Entry, Form, Section, Value, robot, settings};
use std::path::PathBuf;

/// The configuration; SI units. Whoever builds it from a file has checked its numbers.
#[derive(Clone, Debug)]
pub struct Config {
    /// The robot's measures.
    pub body: Body,
    /// How it may move.
    pub limits: Limits,
    /// How it behaves.
    pub behaviour: Behaviour,
    /// The distance that must be free for a speed: the law of the guard.
    pub law: Law,
    /// Full opening angle of a sonar's beam where the message does not have it (`LL_DATA_SRFS`), rad.
    pub sonar_beam: f64,
    /// Greatest age of a sonar's measurement, since it fired, with which the robot drives in its direction.
    pub age_max: Duration,
    /// It has sonars, or its guard expects some. Without, only the map says what is in the way, and `driver_canbus`
    /// bounds the speed.
    pub has_sonars: bool,
    /// What the base does beside curves. Without any of it, it has steered wheels, which take their time; else it
    /// drives the commanded curve from the beginning on.
    pub abilities: Abilities,
    /// Walls and what else is known to stand; none: the floor is taken as free, and the sonars say what is not.
    pub map: Option<Map>,
    /// Pose of the map to which mode HOME drives; `None`: that mode is refused.
    pub home: Option<Pose>,
}

/// What the robot covers on the floor; origin under the middle of the rear axle.
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
    /// Its outline within this rectangle; `None`: the rectangle is the outline.
    pub shape: Option<Shape>,
}

impl Body {
    /// Whether a point of the robot's frame is within it, grown by `margin` m on all sides.
    #[must_use]
    pub fn covers(&self, point: Point, margin: f64) -> bool {
        if let Some(shape) = &self.shape {
            return shape.outside(point) <= margin && shape.distance(point) <= margin;
        }
        (-self.rear - margin..=self.front + margin).contains(&point.x) && point.y.abs() <= self.width / 2.0 + margin
    }

    /// Distance of the farthest corner from the origin, m: its way for each rad on the spot.
    #[must_use]
    pub fn arm(&self) -> f64 {
        let rectangle = || libm::hypot(self.front.max(self.rear), self.width / 2.0);
        self.shape.as_ref().map_or_else(rectangle, Shape::radius)
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
    /// Rotation, rad/s; infinite for a base that steers: its curves bound it.
    pub rotation: f64,
}

impl From<&robot::Geometry> for Body {
    fn from(geometry: &robot::Geometry) -> Self {
        Self {
            wheelbase: geometry.wheelbase_m,
            front: geometry.front_m(),
            rear: geometry.rear_m(),
            width: geometry.width_m(),
            shape: geometry.footprint().copied(),
        }
    }
}

impl Limits {
    /// What the robot may do, with the greatest speed at which the planner drives it.
    #[must_use]
    pub fn new(limits: &robot::Limits, behaviour: &Behaviour, abilities: Abilities) -> Self {
        let speed = limits.speed_autonomous_mps;
        Self {
            speed: behaviour.speed.map_or(speed, |own| own.min(speed)),
            steering: limits.steering_rad,
            steering_rate: limits.steering_rate_radps,
            acceleration: limits.acceleration_mps2,
            deceleration: limits.deceleration_mps2,
            lateral_acceleration: limits.lateral_acceleration_mps2,
            rotation: if abilities.turns { limits.rotation_radps } else { f64::INFINITY },
        }
    }
}

/// Largest absolute coordinate of the home place, m; the same as of a goal.
const COORDINATE_MAX_M: f64 = 1e4;
/// Home place: `[x, y, theta]`.
const HOME: Form<Pose> = Form(home, "a list of 3 numbers within ±10000: x, y, theta", "", |_| {});

fn home(entry: &Entry<'_>) -> Option<Pose> {
    let within = |value: f64| value.abs() <= COORDINATE_MAX_M;
    let read: Option<Vec<f64>> = match &entry.node.value {
        Value::Array(items) => items.iter().map(|item| item.value.number().filter(|value| within(*value))).collect(),
        _ => None,
    };
    match read.as_deref() {
        Some(&[x, y, theta]) => Some(Pose::new(x, y, theta)),
        _ => {
            entry.refuse(HOME.1);
            None
        }
    }
}

settings! {
    /// `[planner]`: what stands where the robot drives, and how it drives among it.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Settings {
        /// Map of walls in YAML and PGM, as nav2 has them, from the configuration folder on. Absent: an open floor, in
        /// simulation the world's walls.
        map: Option<PathBuf> = optional;
        /// Pose to which mode `home` drives: x and y of the middle of the rear axle in the map, m; theta, rad. Absent:
        /// that mode is refused.
        home: Option<Pose> = optional, HOME;
        behaviour: Behaviour = flat;
    }
}

settings! {
    /// Behaviour among people and things.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Behaviour {
        /// Greatest speed forwards. Absent: `speed_autonomous_mps`.
        speed_mps as speed: Option<f64> = optional, 0.01..=10.0;
        /// Speed backwards and sideways.
        speed_reverse_mps as speed_reverse: f64 = 0.3, 0.01..=2.0;
        /// Speed through space that was not seen within the last second.
        speed_unseen_mps as speed_unseen: f64 = 0.4, 0.01..=2.0;
        /// Speed towards a person in mode `approach`.
        speed_approach_mps as speed_approach: f64 = 0.4, 0.01..=2.0;
        /// Distance beside the robot to what is sensed.
        margin_m as margin: f64 = 0.15, 0.01..=1.0;
        /// Distance to what stands in the way, beyond the margin.
        stop_distance_m as stop_distance: f64 = 0.1, 0.05..=2.0;
        /// Distance from the robot to the middle of a tracked person that it keeps while it drives.
        people_margin_m as people_margin: f64 = 0.35, 0.35..=1.0;
        /// Distance from the robot to the middle of a person at which it stops in mode `approach`.
        approach_distance_m as approach_distance: f64 = 1.2, 0.5..=2.0;
        /// Time from a thing's appearance to the brakes. Absent: `reaction_s` and `sensing_s` of the guard.
        reaction_s as reaction: Option<f64> = optional, 0.05..=2.0;
        /// Deceleration of the robot when PAUSE opens the motors' feed, if less than `[stop]` says; it drives no faster
        /// than it could so stop before what it hears.
        coasting_mps2 as coasting: Option<f64> = optional, 0.05..=20.0;
        /// Time for which it waits for a person in the way before it looks for a way around.
        patience_s as patience: f64 = 1.5, 0.5..=600.0;
        /// Attempts to get free before a goal that is no loop has failed.
        attempts: u32 = 8, 1..=1000;
    }
}

impl Behaviour {
    /// The law by which it plans: the guard's, except where it is configured differently.
    #[must_use]
    pub fn law(&self, guard: Law) -> Law {
        let reaction = self.reaction.unwrap_or(guard.reaction);
        Law { reaction, worst: self.coasting.unwrap_or(guard.worst).min(guard.worst), ..guard }
    }
}

impl Default for Behaviour {
    fn default() -> Self {
        Self::usual()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_planner_may_drive_slower_than_the_robot_but_not_faster() {
        let limits = robot::Limits {
            speed_mps: 1.2,
            speed_manual_mps: 0.6,
            speed_autonomous_mps: 0.8,
            lateral_acceleration_mps2: 0.8,
            steering_rad: 0.6,
            acceleration_mps2: 0.5,
            deceleration_mps2: 0.8,
            quick_stop_mps2: 1.5,
            steering_rate_radps: 0.7,
            rotation_radps: 1.0,
            command_ttl: base::Duration::from_millis(250),
        };
        for (own, speed) in [(None, 0.8), (Some(0.5), 0.5), (Some(2.0), 0.8)] {
            let behaviour = Behaviour { speed: own, ..Behaviour::usual() };
            assert_eq!(Limits::new(&limits, &behaviour, Abilities::default()).speed, speed);
        }
    }
    #[test]
    fn a_home_place_is_three_numbers() {
        let read = |text: &str| {
            let node = settings::Node::parse(std::path::Path::new("robot.toml"), text).unwrap();
            settings::read_as::<Settings>(&node)
        };
        assert_eq!(read("home = [1, 2.5, -1.5]").unwrap().home, Some(Pose::new(1.0, 2.5, -1.5)));
        assert_eq!(read("").unwrap().home, None);
        for bad in ["home = [1, 2]", "home = [1, 2, 3, 4]", "home = 3", "home = [1, 2, \"x\"]", "home = [1e5, 0, 0]"] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }
}
