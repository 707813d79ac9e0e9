//! The greatest speeds that can still be stopped before what is sensed or unknown (docs/guard.md).
//!
//! Read [`law`] first (how long the fields are), then [`surroundings`] (what is in the way), [`fields`] (how fast the
//! robot may be), `zones` (fields by configuration, beside those), and [`Guard`], the module around them. It depends
//! neither on the planner nor on the estimator, nor on a map.
//!
//! A robot with one sonar, before which somebody stands at 1.2 m:
//!
//! ```
//! use guard::law::Law;
//!
//! let law = Law { reaction: 0.37, braking: 0.8, worst: 0.25, approach: 1.6, slow: 0.3 };
//! // It could stop from 0.67 m/s, but the person may come nearer meanwhile.
//! assert!((law.stops_within(1.2) - 0.67).abs() < 0.01);
//! assert_eq!(law.slows_within(1.2), 0.3);
//! ```
#![forbid(unsafe_code)]

mod config;
pub mod fields;
mod guard;
pub mod law;
mod zones;

pub use config::{Config, FIELDS_MAX, FieldKeys, FieldKind, Ranging, Settings};
pub use guard::{Guard, NAME, NoOutline};
pub use kinematics::reach::{Ackermann, Base, Direction, Motion};
pub use surroundings::{Lidar, Sonar};
pub use zones::unwatched;
