//! Angles, poses, arcs, Dubins and Reeds-Shepp curves, Ackermann kinematics, odometry and resection: pure mathematics
//! in SI units and radians.
//!
//! Robot frame: x forward, y left, origin in the middle of the rear axle; angles counter-clockwise. Independent of
//! messages, buses and clocks.
//!
//! ```
//! use core::f64::consts::FRAC_PI_2;
//! use navitools::{Motion, Point, Pose, reeds_shepp_length};
//!
//! // The robot stands at (2, 1) and looks along the y axis of the map; a beacon is 3 m ahead of it.
//! let map_from_robot = Pose::new(2.0, 1.0, FRAC_PI_2);
//! let beacon_in_map = map_from_robot * Point { x: 3.0, y: 0.0 };
//! assert!(beacon_in_map.distance(Point { x: 2.0, y: 4.0 }) < 1e-12);
//!
//! // The inverse transforms from the map to the robot.
//! let beacon_in_robot = map_from_robot.inverse() * beacon_in_map;
//! assert!(beacon_in_robot.distance(Point { x: 3.0, y: 0.0 }) < 1e-12);
//!
//! // A quarter of a circle to the left, with a radius of 2 m; no drivable curve of that radius is shorter.
//! let arc = Motion { translation: 2.0 * FRAC_PI_2, rotation: FRAC_PI_2 };
//! let end = map_from_robot.along(arc);
//! assert!(end.point().distance(Point { x: 0.0, y: 3.0 }) < 1e-12);
//! assert!((reeds_shepp_length(map_from_robot, end, 2.0) - arc.translation).abs() < 1e-9);
//! ```
#![no_std]
#![forbid(unsafe_code)]

mod ackermann;
mod angle;
mod arc;
pub mod circular;
mod curve;
mod dubins;
pub mod odometry;
mod pose;
mod reeds_shepp;
pub mod resection;

pub use ackermann::Ackermann;
pub use angle::{Angle, wrap};
pub use arc::Arc;
pub use curve::Curve;
pub use dubins::{dubins, dubins_length};
pub use pose::{Point, Pose};
pub use reeds_shepp::{reeds_shepp, reeds_shepp_length, reeds_shepp_words};

/// Motion of the rear axle's middle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Velocity along the robot's x axis, m/s (or distance, m, of a motion step).
    pub translation: f64,
    /// Angular velocity, counter-clockwise, rad/s (or angle, rad, of a motion step).
    pub rotation: f64,
}
