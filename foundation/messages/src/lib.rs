//! Rust types of `/messages/**/*.lcm`, and the table of channels.
//!
//! The types are generated (see `lcm_gen::rust` for the rules): `common::DataState` is `common.data_state_t`. The length
//! members of arrays are no fields: they are the lengths of the `Vec`s. All times are microseconds since the UNIX epoch,
//! all units SI, all angles radians.
//!
//! Knows no transport and no module.
#![forbid(unsafe_code)]

mod channels;

pub use channels::{Channel, Message, Raw};
pub use lcm::codec::{DecodeError, EncodeError};

include!(concat!(env!("OUT_DIR"), "/types.rs"));

/// The definitions: paths below `/messages`, and texts. For logs, which carry them, and for tools.
pub const LCM_FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/files.rs"));

#[cfg(test)]
mod tests;
