//! Kinematics of wheeled bases: body velocity to wheels, wheels to body velocity, and what a base cannot do.
//!
//! A [`Chassis`] is a list of [`Wheel`]s: contact point, rolling direction, and one of four kinds (fixed, skidding,
//! steered, with rollers). Differential, skid-steer, bicycle, tricycle, Ackermann, mecanum and omni bases are
//! constructors that make that list from a few lengths; all of them share the same functions:
//!
//! | function | from | to |
//! |---|---|---|
//! | [`Chassis::feasible`] | commanded velocity | the velocity that the base can do, and what it cannot |
//! | [`Chassis::step`] | that velocity, the wheels as they are | next speeds and steering angles within all limits |
//! | [`Chassis::wheel_states`] | velocity | speeds and steering angles, without limits of time |
//! | [`Chassis::estimate`] | measured wheels | velocity by least squares, with the residual of each wheel |
//! | [`Chassis::agreement`] | measured wheels | the wheel that disagrees, where the geometry can tell |
//! | [`Chassis::strain`] | forces of the wheels | the parts of them that cancel each other |
//! | [`integrate`] | pose, velocity, time | pose at the end of the exact arc |
//! | [`Polygon::contact`] | outline, path, point | length of the path up to the contact |
//! | [`reach::Kinematics::reachable`] | direction, measured motion, time | the paths that the base can take by then |
//!
//! SI units and radians. Robot frame: x forward, y left, angles counter-clockwise. The speed of a wheel is that of its
//! tread on the floor, m/s; radius, gear and counts belong to its drive. Independent of messages, buses and clocks;
//! allocates nothing but the corners of an outline and lists of paths.
//!
//! The model is the one of the textbooks: rolling and sliding constraints of standard and Swedish wheels (Siegwart,
//! Nourbakhsh, Scaramuzza: *Introduction to Autonomous Mobile Robots*, 2nd ed., 3.2 and 3.3) and omnidirectional and
//! nonholonomic bases with their odometry (Lynch, Park: *Modern Robotics*, 13.2 to 13.4).
//!
//! ```
//! use kinematics::{Agreement, Chassis, Limits, Refusal, Twist, integrate};
//! use navitools::Pose;
//!
//! // Two wheels 0.42 m apart.
//! let limits = Limits { speed_mps: 1.0, acceleration_mps2: 0.6, deceleration_mps2: 1.0 };
//! let courier = Chassis::differential(0.42, limits).unwrap();
//!
//! // It cannot move sideways; the rest of the command is kept.
//! let feasible = courier.feasible(Twist::new(0.5, 0.1, 1.0));
//! assert_eq!(feasible.twist, Twist::new(0.5, 0.0, 1.0));
//! assert_eq!(feasible.refused, [Refusal::Sideways]);
//!
//! // From standstill both wheels accelerate together, so the curve is the commanded one from the first step on.
//! let standing = courier.standing();
//! let wheels = courier.step(feasible.twist, &standing, 0.05);
//! assert!((wheels[1].speed_mps - 0.03).abs() < 1e-12);
//! let twist = courier.estimate(&wheels).unwrap().twist;
//! assert!((twist.omega / twist.vx - 2.0).abs() < 1e-12);
//!
//! // Two wheels are exactly enough to measure the velocity: one that lies is not noticed.
//! assert_eq!(courier.redundancy(), 0);
//! assert_eq!(courier.agreement(&wheels, 0.01), Some(Agreement::Agree));
//!
//! let pose = integrate(Pose::default(), twist, 0.05);
//! assert!(pose.x > 0.0 && pose.y > 0.0);
//! ```
#![no_std]
#![forbid(unsafe_code)]

mod chassis;
mod command;
mod error;
mod kinds;
mod least_squares;
mod odometry;
mod outline;
pub mod reach;
mod shape;
mod twist;
mod wheel;

pub use chassis::Chassis;
pub use command::{Feasible, Refusal};
pub use error::Error;
pub use kinds::{Driven, End, SteeredBase};
pub use navitools::Point;
pub use odometry::{Agreement, Estimate};
pub use outline::{Polygon, Turn};
pub use reach::Direction;
pub use shape::{SHAPE_CORNERS_MAX, Shape};
pub use twist::{Twist, integrate};
pub use wheel::{Kind, Limits, PerWheel, Steering, WHEELS_MAX, Wheel, WheelState};

extern crate alloc;
#[cfg(test)]
extern crate std;

#[cfg(test)]
mod tests;
