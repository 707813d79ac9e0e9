//! Logs of a run: MCAP files that contain each bus message unchanged and in its ROS 2 form (`docs/logs.md`).
//!
//! [`Logger`] is the module that writes them. Works on any reader and writer; opens no file and reads no clock.
#![forbid(unsafe_code)]

mod config;
mod disk;
mod file;
mod logger;
mod names;
pub mod read;
pub mod recover;
mod ring;
pub mod ros;
mod run_name;
#[cfg(test)]
mod tests;

pub use config::{Attachment, Compression, Config};
pub use file::{TYPES, types};
pub use logger::{Logger, NAME};
pub use run_name::run_name;
