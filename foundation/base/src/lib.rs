//! Words that everybody uses: monotonic time, what travels on the busses, error reports, bounded queues.
//!
//! Knows no clock, no port and no protocol. Needs an allocator for the text of a [`Report`] only.
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;

pub mod can;
pub mod gamepad;
pub mod i2c;
mod queue;
mod report;
pub mod serial;
pub mod store;
mod time;
pub mod w1;

pub use queue::Queue;
pub use report::{Fault, Kind, Location, Report, Severity};
pub use time::{Duration, Epoch, Instant, Ticker};
