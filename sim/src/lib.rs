//! Virtual time, the robot's body, the world, and every board at bus level.
//!
//! [`Simulator`] is a module like any other: it sits on the same busses as the drivers and answers them as the boards
//! would. It runs in the live host, in real time, and in [`host::Virtual`], where all processes, busses and the LCM
//! bus share one deterministic process. Knows no module by name, no file, no socket, no clock.
#![forbid(unsafe_code)]

mod auxiliary;
pub mod boards;
pub mod body;
pub mod check;
mod disturbance;
mod faults;
mod gamepad;
pub mod host;
pub mod people;
mod random;
pub mod scene;
mod simulator;
pub mod soak;
pub mod sonar;
pub mod world;

pub use auxiliary::{I2cConfig, W1Config};
pub use random::Random;
pub use simulator::{BoardConfig, BoardKind, CanConfig, Config, SerialConfig, Simulator};
