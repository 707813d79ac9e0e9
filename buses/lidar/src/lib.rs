//! 2D lidars: [`ld`] (LDROBOT LD06, LD19, STL-19P), [`rplidar`] (A1, A2, A3, C1, S2), [`ydlidar`] (X4, G4), [`sick`]
//! (LMS1xx, TiM5xx, TiM7xx, CoLa A and B) and [`hokuyo`] (SCIP 2.0), each with its emulated device.
//!
//! Everything here is sans-IO: it reads no clock and owns no port. The engine, [`Lidar`], is the same for all devices;
//! a protocol decides what is on the wire. Measurements come as [`Sector`]s of at most an eighth of a revolution, with
//! the instant of their first beam. Memory is allocated once, when an engine is made; what arrives is bounded and
//! counted.
//!
//! **None of these is a safety device.** `driver_lidar` is the module on them.
//!
//! A lidar is started and measures. On a robot a host moves the bytes; here it is a loop:
//!
//! ```
//! use base::Instant;
//! use lidar::emulated::Device;
//! use lidar::rplidar::{self, Config, Model, Rplidar};
//! use lidar::{Event, Status};
//!
//! let mut engine = Rplidar::new(Config::new(Model::A2));
//! let mut device = rplidar::emulated::Device::new(Model::A2);
//! let mut sectors = 0;
//!
//! for now in (1000..2500).map(Instant::from_millis) {
//!     device.handle_timeout(now);
//!     let mut bytes = [0; 1024];
//!     let count = device.poll_tx(now, &mut bytes);
//!     engine.handle_rx(now, &bytes[..count]);
//!     engine.handle_timeout(now);
//!     while let Some(request) = engine.poll_tx() {
//!         device.handle_rx(now, &request);
//!     }
//!     while let Some(event) = engine.poll_event() {
//!         if let Event::Sector(sector) = event
//!             && sector.status == Status::Ok
//!         {
//!             // The wall of the emulated surroundings; NaN: not measured.
//!             assert!(sector.ranges_m.iter().all(|range| range.is_nan() || (range - 3.0).abs() < 0.01));
//!             sectors += 1;
//!         }
//!     }
//! }
//! assert!(sectors > 50, "{sectors}");
//! ```
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;
#[cfg(test)]
extern crate std;

#[cfg(test)]
mod bench;
mod builder;
mod clock;
mod dialog;
pub mod emulated;
mod engine;
mod event;
mod framing;
pub mod hokuyo;
pub mod ld;
pub mod probe;
pub mod rplidar;
mod scan;
pub mod sick;
pub mod ydlidar;

pub use engine::{Bytes, Lidar, Optics, Progress, Protocol, REST, SILENT_AFTER, Shared};
pub use event::{Counters, Event, Fault, FieldResult, Health, LostReason, State, Text, Zone};
pub use scan::{BEAMS_MAX, EIGHTH_RAD, Sector, Status};
