//! The live host: runs one module as a process, on `epoll`, with real busses and the machine's clock.
//!
//! Read [`host`] first. Nothing here knows what a module does.

mod bad_input;
pub mod beats;
pub mod bus;
pub mod clock;
mod host;
pub mod log;
pub mod ports;
pub mod processes;
pub mod raw;
pub mod sys;
#[cfg(test)]
mod tests;

pub use host::{HostConfig, run};
