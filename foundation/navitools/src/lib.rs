//! Angles, poses, arcs, Dubins and Reeds-Shepp curves, Ackermann kinematics, odometry and resection: pure mathematics
//! in SI units and radians.
//!
//! Robot frame: x forward, y left, origin in the middle of the rear axle; angles counter-clockwise. Independent of
//! messages, buses and clocks.
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
