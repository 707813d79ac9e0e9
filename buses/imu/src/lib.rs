//! Inertial measurement units: Bosch BNO055 on I2C ([`bno055`]), WitMotion on a serial line ([`witmotion`]) and Xsens
//! MTi on CAN ([`xsens`]), and the emulated device of each ([`emulated`]).
//!
//! Everything here is sans-IO: it reads no clock and owns no port. The engine, [`Imu`], is the same for all devices; a
//! protocol decides what is on the wire. Measurements come as [`Sample`]s in the frame of the device. No memory is
//! allocated; what arrives is bounded and counted.
//!
//! **None of these is a safety device.** `driver_imu` is the module on them.
//!
//! A BNO055 is configured and read. On a robot a host makes the transfers; here it is a loop:
//!
//! ```
//! use base::Instant;
//! use imu::emulated::{Emulated, Truth};
//! use imu::{Event, Imu, Model, Status};
//!
//! let address = base::i2c::Address::new(imu::bno055::ADDRESS).expect("an address of 7 bits");
//! let model = Model::Bno055 { address };
//! let (mut engine, mut device) = (Imu::new(model), Emulated::new(model));
//! let mut samples = 0;
//!
//! for now in (1000..3000).map(Instant::from_millis) {
//!     // A turn to the left on a level floor; the acceleration changes, as that of a real sensor does by its noise.
//!     let ripple = if now.as_nanos() / 1_000_000 % 20 < 10 { 0.0 } else { 0.02 };
//!     let (rotation_radps, acceleration_mps2) = ([0.0, 0.0, 0.5], [ripple, 0.0, 9.81]);
//!     device.set(Truth { rotation_radps, acceleration_mps2, ..Truth::default() });
//!     device.handle_timeout(now);
//!     engine.handle_timeout(now);
//!     while let Some(transfer) = engine.poll_transfer() {
//!         let outcome = device.handle_transfer(now, &transfer);
//!         engine.handle_outcome(now, &outcome);
//!     }
//!     while let Some(event) = engine.poll_event() {
//!         if let Event::Sample(sample) = event
//!             && sample.status == Status::Ok
//!         {
//!             assert!((sample.rotation_radps[2] - 0.5).abs() < 0.001);
//!             samples += 1;
//!         }
//!     }
//! }
//! assert!(samples > 100, "{samples}");
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

#[cfg(test)]
mod bench;
pub mod bno055;
pub mod emulated;
mod engine;
mod event;
pub mod frame;
mod judge;
mod shared;
pub mod witmotion;
pub mod xsens;

pub use engine::{Imu, Model, REST, SILENT_AFTER};
pub use event::{Counters, Event, Fault, Identity, LostReason, Sample, State, Status};

/// Standard acceleration of gravity, m/s².
pub const GRAVITY_MPS2: f64 = 9.80665;
