//! Localization: an extended Kalman filter over odometry and beacon bearings.
//!
//! [`filter::Filter`] is the mathematics, useful to any robot: it takes motion steps and bearings and gives the pose,
//! and knows no bus, message or clock. [`Estimator`] is the module around it. `docs/navigation.md` has the figures.
//!
//! ```
//! use base::Instant;
//! use core::f64::consts::FRAC_PI_4;
//! use estimator::filter::{Beacon, Config, Filter};
//! use navitools::{Motion, Point, Pose};
//!
//! // A beacon, and the robot at the origin: standard deviations 0.2 m, 0.2 m and 0.1 rad.
//! let beacons = vec![Beacon { id: 7, at: Point { x: 5.25, y: 4.0 } }];
//! let mut filter = Filter::new(Config { beacons, ..Config::default() })?;
//! filter.odometry(Instant::ZERO, Motion::default()).unwrap();
//! filter.set(Pose::default(), [[0.04, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, 0.0, 0.01]]).unwrap();
//!
//! // Two seconds at 0.5 m/s straight ahead.
//! for step in 1..=40 {
//!     let at = Instant::from_millis(50 * step);
//!     filter.odometry(at, Motion { translation: 0.5, rotation: 0.0 }).unwrap();
//! }
//! let now = Instant::from_millis(2000);
//! let before = filter.estimate(now);
//! assert!((before.pose.x - 1.0).abs() < 1e-9);
//!
//! // The scanner, 0.25 m ahead of the rear axle, sees the beacon at 45 degrees to the left: the heading becomes more
//! // certain.
//! filter.bearing(now, 7, FRAC_PI_4).unwrap();
//! assert!(filter.estimate(now).covariance[2][2] < 0.5 * before.covariance[2][2]);
//! # Ok::<(), estimator::filter::ConfigError>(())
//! ```
#![forbid(unsafe_code)]
#![allow(clippy::needless_range_loop, reason = "rows and columns of matrices are read best by their places")]

mod active;
mod estimator;
pub mod filter;
mod gyro;
mod motion_source;
pub mod recorded;
mod search;
mod trail;

pub use estimator::{Config, Estimator, NAME, Wheels};
pub use filter::{Filter, PlacingFilter};
