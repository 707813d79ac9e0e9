//! View model of the whole robot: receives all bus messages and provides what people are shown.
//!
//! The terminal and the web page are functions of a [`Model`]; neither derives anything about the robot by itself. Each
//! value has its age ([`Slot`]) and is stale if it is older than twice its period. Derived values are put into words
//! here, once: the status of the robot and why it does not move ([`Status`]), the bound of its speed ([`Bound`]), how a
//! process ended ([`ModuleRow`]), active faults, and whether they are known ([`ShownGroup`]), texts of modules
//! ([`ShownText`]), and the traffic of each channel ([`ChannelRow`]).
//!
//! All tables are bounded: the bus is hostile input. No bus, clock or screen is used here.
//!
//! ```
//! use base::{Duration, Instant};
//! use diagnostics::{Config, Model, RobotStatus};
//! use messages::{Message, lowlevel::DataMotion};
//!
//! let mut model = Model::new(Config { robot: "advee".into(), ..Config::default() });
//! let now = Instant::from_millis(10_000);
//! assert_eq!(model.status(now).word, RobotStatus::Silent);
//!
//! let motion = DataMotion { speed: 0.5, enabled: true, homed: true, ..DataMotion::default() };
//! let message = Message::from(motion);
//! model.receive(now, &message.channel_name(), 80, Some(message));
//! assert_eq!(model.status(now).word, RobotStatus::Driving);
//! assert_eq!(model.motion.fresh(now).map(|motion| motion.speed), Some(0.5));
//!
//! // LL_DATA_MOTION has a period of 50 ms: after two of them the speed counts as unknown.
//! let later = now + Duration::from_millis(500);
//! assert!(model.motion.fresh(later).is_none());
//! assert_eq!(model.motion.age(later), Some(Duration::from_millis(500)));
//! ```
#![forbid(unsafe_code)]

mod beacons;
mod concerns;
mod errors;
mod guard;
mod holds;
mod model;
mod modules;
pub mod orders;
mod pace;
mod ranges;
mod scans;
mod slot;
mod status;
mod subjects;
#[cfg(test)]
mod tests;
mod texts;
mod traffic;
mod view;

pub use beacons::{BeaconState, normalized_residual};
pub use concerns::{CHARGE_EMPTY, CHARGE_LOW, Concern, Weight};
pub use errors::{ErrorGroup, Errors, Knowledge, LIST_VALID, Reported, ShownGroup};
pub use guard::Bound;
pub use holds::HoldRow;
pub use model::{Config, Model};
pub use modules::{ModuleRow, Modules, exit_in_words};
pub use ranges::Readings;
pub use scans::{Scan, Scans};
pub use slot::{Freshness, Shown, Slot};
pub use status::{RobotStatus, Status};
pub use subjects::Subjects;
pub use texts::{ShownText, Texts};
pub use traffic::{ChannelRow, Traffic};
pub use view::{Ellipse, View};
