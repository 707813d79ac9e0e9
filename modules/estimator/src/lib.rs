//! Localization: an extended Kalman filter over odometry and beacon bearings.
//!
//! [`filter::Filter`] is the mathematics, useful to any robot: it takes motion steps and bearings and gives the pose, and
//! knows no bus, message or clock. [`Estimator`] is the module around it. `docs/navigation.md` has the figures.
#![forbid(unsafe_code)]
#![allow(clippy::needless_range_loop, reason = "rows and columns of matrices are read best by their places")]

mod active;
mod estimator;
pub mod filter;
mod motion_source;
mod search;
mod trail;

pub use estimator::{Config, Estimator, NAME};
pub use filter::Filter;
