//! The simulated robot: its body, the world around it, and every board at bus level.
//!
//! [`Simulator`] is a module like any other: it sits on the same buses as the drivers and answers them as the boards
//! would. It runs in the live host, in real time, and in the virtual one (`sim`), which shares its source of chance
//! ([`Random`]), its names of faults ([`faults`]) and what they do to a bus ([`disturbance`]). Knows no other module,
//! no file, no socket, no clock.
#![forbid(unsafe_code)]

mod auxiliary;
pub mod boards;
pub mod body;
pub mod disturbance;
pub mod faults;
mod gamepad;
pub mod people;
mod random;
pub mod scene;
mod simulator;
pub mod sonar;
pub mod world;

pub use auxiliary::{I2cConfig, W1Config};
pub use random::Random;
pub use simulator::{BoardConfig, BoardKind, CanConfig, Config, SerialConfig, Simulator};
