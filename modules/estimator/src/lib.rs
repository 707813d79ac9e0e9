//! Where the robot is: an EKF over odometry and beacon bearings.
//!
//! [`filter::Filter`] is the mathematics, fed with ways and bearings and asked for the pose: of use to any robot. It
//! knows no bus, no message and no clock. [`Estimator`] is the module around it. `docs/navigation.md` has the figures.
#![forbid(unsafe_code)]
#![allow(clippy::needless_range_loop, reason = "rows and columns of matrices are read best by their places")]

mod active;
mod estimator;
pub mod filter;
mod search;
mod trail;
mod ways;

pub use estimator::{Config, Estimator, NAME};
pub use filter::Filter;
