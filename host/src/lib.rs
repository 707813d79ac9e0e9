//! Live host: runs one module as a process on `epoll`, with real buses and the machine's clocks. Together with what
//! stands on it, this is where files and ports are opened, processes started and clocks read.
//!
//! Read `host` first. Nothing here depends on what a module does.
//!
//! The bus as modules and tools have it, here within the process:
//!
//! ```
//! use base::Duration;
//! use host::bus::{Bus, Received};
//! use host::{clock, log};
//! use messages::{Message, common::DataState};
//!
//! let mut bus = Bus::open("memq://", &["CM_DATA_STATE"])?;
//! let (now, timestamp) = (clock::now(), clock::epoch().timestamp(clock::now()));
//! let state = DataState { timestamp, module: "planner".into(), state: DataState::RUN };
//! bus.publish(&Message::from(state.clone()))?;
//!
//! // An instant of the monotonic clock, not of the wall clock that the message was stamped with.
//! let Received::Message { at, message } = bus.receive(clock::now()) else { panic!("nothing came") };
//! assert_eq!(message, Message::from(state));
//! assert!(at <= clock::now() && at + Duration::from_secs(1) > now);
//! assert!(matches!(bus.receive(clock::now()), Received::Nothing));
//!
//! // A line on stderr begins with the time of the day, in UTC.
//! assert_eq!(log::TimeOfDay(45_296_789_000_000).to_string(), "12:34:56.789");
//! # Ok::<(), String>(())
//! ```
#![deny(unsafe_code)]

mod bad_input;
pub mod beats;
pub mod bus;
mod bus_health;
mod cgroups;
pub mod clock;
pub mod hardware_watchdog;
mod host;
pub mod keeper;
pub mod keepers;
pub mod limits;
pub mod log;
pub mod log_repair;
pub mod notify;
pub mod panics;
pub mod ports;
pub mod processes;
pub mod raw;
pub mod recorder;
pub mod run_folder;
pub mod runs;
pub mod sys;
#[cfg(test)]
mod tests;

pub use host::{Failure, HostConfig, run};
