//! The live host: runs one module as a process, on `epoll`, with real busses and the machine's clock.
//!
//! Read [`host`] first. Nothing here knows what a module does.

mod bad_input;
pub mod beats;
pub mod bus;
mod cgroups;
pub mod clock;
pub mod hardware_watchdog;
mod host;
pub mod limits;
pub mod log;
pub mod notify;
pub mod ports;
pub mod processes;
pub mod raw;
pub mod recorder;
pub mod sys;
#[cfg(test)]
mod tests;

pub use host::{HostConfig, run};
