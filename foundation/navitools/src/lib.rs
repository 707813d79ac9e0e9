//! Angles, poses, arcs, Ackermann kinematics, odometry and resection: pure maths in SI units and radians.
//!
//! Robot frame: x forward, y left, origin in the middle of the rear axle; angles counter-clockwise. Knows no message,
//! no bus and no clock.
#![no_std]
#![forbid(unsafe_code)]

mod ackermann;
mod angle;
mod arc;
pub mod circular;
pub mod odometry;
mod pose;
pub mod resection;

pub use ackermann::Ackermann;
pub use angle::{Angle, wrap};
pub use arc::Arc;
pub use pose::{Point, Pose};

/// The motion of the rear axle's middle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Along the robot's x axis, m/s (or m, where it stands for a way travelled).
    pub translation: f64,
    /// Counter-clockwise, rad/s (or rad).
    pub rotation: f64,
}
