//! Words that everybody uses: monotonic time and deadlines, what travels on the buses, error reports, bounded queues.
//!
//! Knows no clock, no port and no protocol. Needs an allocator for the text of a [`Report`] only.
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;

pub mod can;
mod deadlines;
pub mod gamepad;
pub mod i2c;
mod queue;
mod report;
pub mod serial;
pub mod store;
mod time;
pub mod w1;

pub use deadlines::{Deadlines, Key, earliest};
pub use queue::Queue;
pub use report::{Fault, Kind, Level, Location, Report, Severity};
pub use time::{Duration, Epoch, Instant, Ticker};
