//! Live host: runs one module as a process on `epoll`, with real buses and the machine's clocks. Together with what
//! stands on it, this is where files and ports are opened, processes started and clocks read.
//!
//! Read [`host`] first. Nothing here depends on what a module does.
#![deny(unsafe_code)]

mod bad_input;
pub mod beats;
pub mod bus;
mod bus_health;
mod cgroups;
pub mod clock;
pub mod hardware_watchdog;
mod host;
pub mod limits;
pub mod log;
pub mod log_repair;
pub mod notify;
pub mod ports;
pub mod processes;
pub mod raw;
pub mod recorder;
pub mod run_folder;
pub mod runs;
pub mod sys;
#[cfg(test)]
mod tests;

pub use host::{HostConfig, run};
