//! The view model of the whole robot: fed with what is said on the bus, asked for what people are shown.
//!
//! The terminal and the web page are functions of a [`Model`]; neither decides anything about the robot by itself. Each
//! value knows how old it is ([`Slot`]) and whether it is stale: heard longer ago than twice its period. What is derived
//! is said in words here, once: the status of the robot and why it does not move ([`Status`]), how a process ended
//! ([`ModuleRow`]), which faults are active, and whether that is known ([`ShownGroup`]), what modules say ([`ShownText`]), what
//! is said on which channel how often ([`ChannelRow`]).
//!
//! All tables are bounded: the bus is hostile input. Knows no bus, no clock and no screen.
//!
//! ```
//! use base::{Duration, Instant};
//! use diagnostics::{Config, Model, Word};
//! use messages::{Message, lowlevel::DataMotion};
//!
//! let mut model = Model::new(Config { robot: "advee".into(), ..Config::default() });
//! let now = Instant::from_millis(10_000);
//! assert_eq!(model.status(now).word, Word::Silent);
//!
//! let motion = DataMotion { speed: 0.5, enabled: true, homed: true, ..DataMotion::default() };
//! let message = Message::from(motion);
//! model.hear(now, &message.channel_name(), 80, Some(message));
//! assert_eq!(model.status(now).word, Word::Driving);
//! assert_eq!(model.motion.fresh(now).map(|motion| motion.speed), Some(0.5));
//!
//! // LL_DATA_MOTION has a period of 50 ms: after two of them the speed counts as unknown.
//! let later = now + Duration::from_millis(500);
//! assert!(model.motion.fresh(later).is_none());
//! assert_eq!(model.motion.age(later), Some(Duration::from_millis(500)));
//! ```
#![forbid(unsafe_code)]

mod errors;
mod holds;
mod model;
mod modules;
pub mod orders;
mod ranges;
mod slot;
mod status;
mod subjects;
#[cfg(test)]
mod tests;
mod texts;
mod traffic;
mod view;

pub use errors::{ErrorGroup, Errors, Knowledge, LIST_VALID, Reported, ShownGroup};
pub use holds::HoldRow;
pub use model::{Config, Model};
pub use modules::{ModuleRow, Modules, exit_in_words};
pub use ranges::Readings;
pub use slot::{Freshness, Shown, Slot};
pub use status::{Status, Word};
pub use subjects::Subjects;
pub use texts::{ShownText, Texts};
pub use traffic::{ChannelRow, Traffic};
pub use view::{Ellipse, View};
