//! Motor controllers without CANopen: [`odrive`] (CAN Simple), [`roboclaw`] (packet serial) and [`vesc`] (CAN and
//! UART), each with its emulated device; [`can`] has one engine for any of them that is on CAN, [`serial`] for any that
//! is on a serial line.
//!
//! Everything here is sans-IO: it reads no clock and owns no port. The [`Engine`] is the same for all devices; a
//! protocol decides what is on the wire. No motion leaves before the device is identified, its command time limit is
//! set or read back, and, where the device can show it, that limit has acted: the engine arms it without torque, falls
//! silent, and waits for the device's own reaction.
//!
//! An ODrive is started and turns. On a robot a host moves the frames; here it is a loop:
//!
//! ```
//! use base::{Duration, Instant};
//! use motorctl::odrive::{self, Odrive, device::Device};
//! use motorctl::{Axis, Config, State};
//!
//! let axis = Axis { gear: 8.0, velocity_max_radps: 10.0, acceleration_radps2: 20.0 };
//! let device = odrive::Device { node: 3, ..odrive::Device::EXAMPLE };
//! let mut engine = Odrive::new(&Config::new([axis]), device).expect("a valid configuration");
//! let mut drive = Device::new(device);
//!
//! for now in (1..2000).map(Instant::from_millis) {
//!     engine.handle_timeout(now);
//!     drive.handle_timeout(now);
//!     if engine.state() == State::Ready {
//!         engine.command(now, [2.0]).expect("it is ready");
//!     }
//!     while let Some(frame) = engine.poll_tx(now) {
//!         drive.handle_rx(now, &frame);
//!     }
//!     while let Some(frame) = drive.poll_tx() {
//!         engine.handle_rx(now, &frame);
//!     }
//! }
//! let velocity = engine.feedback(0).expect("it is measured").velocity_radps;
//! assert!((velocity - 2.0).abs() < 0.01, "{velocity}");
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod can;
mod config;
pub mod crc;
mod engine;
mod event;
pub mod motor;
pub mod odrive;
pub mod roboclaw;
pub mod serial;
mod setpoint;
pub mod vesc;

pub use config::{Axis, Config, ConfigError, FEEDBACK_WITHIN_MAX, TIME_LIMIT_MAX, Timing};
pub use engine::{Engine, STANDSTILL_RADPS};
pub use event::{CommandError, Event, Feedback, LostReason, Reaction, Refusal, ReleaseError, State, Step, Text};
