//! Logs of a run: MCAP files in which each message of the bus stands as it was and as ROS 2 has it (`docs/logs.md`).
//!
//! Works on any reader and writer; opens nothing, knows no clock.
#![forbid(unsafe_code)]

pub mod read;
pub mod recover;
pub mod ros;
