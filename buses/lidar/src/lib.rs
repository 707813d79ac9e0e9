//! 2D lidars.
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;
#[cfg(test)]
extern crate std;

#[cfg(test)]
mod bench;
mod builder;
mod clock;
pub mod emulated;
mod engine;
mod event;
pub mod hokuyo;
pub mod ld;
pub mod rplidar;
mod scan;
pub mod sick;

pub use engine::{Bytes, Lidar, Optics, Progress, Protocol, REST, SILENT_AFTER, Shared};
pub use event::{Counters, Event, Fault, FieldResult, Health, LostReason, State, Text};
pub use scan::{BEAMS_MAX, EIGHTH_RAD, Sector, Status};
