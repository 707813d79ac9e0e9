//! The live host, the configuration, the topology of the robot, and the tools of the command line.
//!
//! The one crate that may open, sleep, spawn and ask the time.

pub mod checks;
pub mod cli;
pub mod config;
pub mod live;
pub mod log_repair;
pub mod map_file;
mod orders;
pub mod plot;
pub mod recording;
pub mod run_folder;
pub mod topology;
pub mod web;
