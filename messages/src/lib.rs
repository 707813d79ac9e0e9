//! Rust types of `/messages/**/*.lcm`, the table of channels, and the list of causes that hold the robot.
//!
//! The types are generated (see `lcm_gen::rust` for the rules): `common::DataState` is `common.data_state_t`. The
//! length members of arrays are not fields: they are the lengths of the `Vec`s. All times are microseconds since the
//! UNIX epoch, all units SI, all angles radians.
//!
//! Independent of transports and modules.
#![forbid(unsafe_code)]

mod channels;
mod faults;
mod hold;
mod stop;

pub use channels::{Channel, Message, Raw};
pub use faults::fault_name;
pub use hold::{GOAL_MODULE, Hold, MOTION_MODULE};
pub use lcm::codec::{DecodeError, EncodeError};
pub use stop::StopSource;

include!(concat!(env!("OUT_DIR"), "/types.rs"));

/// Definitions: paths below `/messages`, and texts. For logs, which contain them, and for tools.
pub const LCM_FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/files.rs"));

#[cfg(test)]
mod tests;
