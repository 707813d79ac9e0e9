//! Words that everybody uses: monotonic time and deadlines, what travels on the buses, error reports, bounded queues.
//!
//! Knows no clock, no port and no protocol. Needs an allocator for the text of a [`Report`] only.
//!
//! ```
//! use base::can::Frame;
//! use base::{Duration, Epoch, Fault, Instant, Queue, Report, Severity};
//!
//! // Monotonic time, and the same instant as messages carry it: microseconds since the UNIX epoch.
//! let now = Instant::from_millis(1500) + Duration::from_millis(500);
//! let epoch = Epoch { offset_us: 1_767_225_600_000_000 }; // 2026-01-01T00:00:00Z
//! assert_eq!(epoch.timestamp(now), 1_767_225_602_000_000);
//!
//! // A queue with room for two frames refuses the third and counts it.
//! let mut queue: Queue<Frame, 2> = Queue::new();
//! for id in 0x181..=0x183 {
//!     queue.push(Frame::standard(id, &[1, 2, 3]));
//! }
//! assert_eq!((queue.len(), queue.dropped()), (2, 1));
//!
//! // A report has a number that is never reused, and the subject that it is about.
//! let report = Report::new(Severity::Warning, Fault::ChipLost, "fan1", "no acknowledge from address 18");
//! assert_eq!((report.fault as u16, report.fault.name()), (0x0701, "ChipLost"));
//! ```
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;

pub mod can;
mod deadlines;
mod disturbance;
pub mod gamepad;
pub mod gpio;
pub mod i2c;
mod listed;
mod queue;
mod remedy;
mod report;
pub mod serial;
pub mod store;
pub mod thermal;
mod time;
pub mod w1;

pub use deadlines::{Deadlines, Key, earliest};
pub use disturbance::Disturbance;
pub use queue::Queue;
pub use report::{Fault, Kind, Level, Location, Report, Severity};
pub use time::{Duration, Epoch, Instant, Ticker};
