//! The robot as a node of ROS 2, without ROS: its messages as topics, and commands from ROS.
//!
//! ```text
//!   LCM bus ──► outgoing (odometry, logger::ros) ──► node ──► rtps ──► transport ──► network
//!   LCM bus ◄── drive, incoming ◄─────────────────── node ◄── rtps ◄── transport ◄── network
//!   LCM bus ◄─► servers: navigate, operator, parameters, lifecycle ┘ requests and answers
//! ```
//!
//! The translation ([`outgoing`], [`incoming`], [`drive`]), the servers of actions, services and parameters, and the
//! node own no port and no clock. The transport has a thread of its own, in the module's own process, which is not
//! critical: whatever the network does, what moves the robot does not notice. Without the feature `rtps` there are
//! neither servers nor node nor transport.
//!
//! A velocity of ROS becomes a command of the source `ros2`, which falls silent in time:
//!
//! ```
//! use base::{Duration, Instant};
//! use ros2::drive::{Config, Drive};
//! use ros2::incoming::{self, Command, Input};
//!
//! // geometry_msgs/msg/Twist: 0.5 m/s forward.
//! let mut sample = vec![0, 1, 0, 0];
//! sample.extend([0.5_f64, 0.0, 0.0, 0.0, 0.0, 0.0].into_iter().flat_map(f64::to_le_bytes));
//! let Ok(Command::Velocity(velocity)) = incoming::read(Input::Twist, 0, &sample) else { panic!() };
//!
//! let [ttl, driver_ttl] = [500, 250].map(Duration::from_millis);
//! let mut drive = Drive::new(Config { priority: 1, ttl, driver_ttl });
//! let start = Instant::from_millis(1);
//! assert!(drive.on_velocity(start, start, 7, velocity));
//! assert_eq!(drive.poll(start, 0).unwrap().vx, 0.5);
//! ```
#![forbid(unsafe_code)]

#[cfg(feature = "rtps")]
pub mod action;
pub mod cdr;
pub mod description;
pub mod drive;
pub mod incoming;
pub mod lifecycle;
#[cfg(feature = "rtps")]
mod module;
#[cfg(feature = "rtps")]
pub mod navigate;
#[cfg(feature = "rtps")]
pub mod node;
pub mod odometry;
pub mod operator;
pub mod outgoing;
pub mod parameters;
#[cfg(feature = "rtps")]
pub mod servers;
#[cfg(feature = "rtps")]
pub mod service;
pub mod settings;
pub mod topics;
#[cfg(feature = "rtps")]
mod transport;
#[cfg(feature = "rtps")]
pub mod type_hashes;
mod ways;

#[cfg(feature = "rtps")]
pub use self::module::{Ros2, Settings};

/// Name on the bus.
pub const NAME: &str = "ros2";

/// Name of the node of a robot that is called so: letters, digits and `_`, beginning with a letter.
#[must_use]
pub fn node_name(robot: &str) -> String {
    let word = |letter: char| if letter.is_ascii_alphanumeric() { letter } else { '_' };
    let name: String = robot.chars().map(word).take(64).collect();
    if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name } else { format!("robot_{name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_has_a_name_that_ros_takes() {
        assert_eq!(["courier", "R2-D2", "4x4", ""].map(node_name), ["courier", "R2_D2", "robot_4x4", "robot_"]);
    }
}
