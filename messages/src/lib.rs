//! Rust types of `/messages/**/*.lcm`, the table of channels, the list of causes that hold the robot, the operation
//! modes, and the limits of actions.
//!
//! The types are generated (see `lcm_gen::rust` for the rules): `common::DataState` is `common.data_state_t`. The
//! length members of arrays are not fields: they are the lengths of the `Vec`s. All times are microseconds since the
//! UNIX epoch, all units SI, all angles radians.
//!
//! Independent of transports and modules.
//!
//! ```
//! use messages::common::DataState;
//! use messages::{Channel, Message};
//!
//! let state = DataState { timestamp: 1_767_225_600_000_000, module: "driver_canbus".into(), state: DataState::RUN };
//! let message = Message::from(state);
//! assert_eq!(message.channel(), Channel::CmDataState);
//!
//! // On the bus: the fingerprint of the type, then its members.
//! let mut bytes = Vec::new();
//! message.encode(&mut bytes)?;
//! assert_eq!(bytes[..8], Channel::CmDataState.fingerprint().to_be_bytes());
//!
//! // Whoever receives it looks up the type by the name of the channel.
//! assert_eq!(Message::receive("CM_DATA_STATE", &bytes), Some(Ok(message)));
//! assert!(Message::receive("CM_DATA_STATE", &bytes[..20]).is_some_and(|received| received.is_err()));
//! assert!(Message::receive("SOMETHING_ELSE", &bytes).is_none());
//! # Ok::<(), messages::EncodeError>(())
//! ```
#![forbid(unsafe_code)]

pub mod action;
mod channels;
mod faults;
mod hold;
mod mode;
mod related;
mod source;
mod stop;

pub use channels::{Channel, Message, Raw};
pub use faults::{fault_name, fault_remedy};
pub use hold::{GOAL_MODULE, Hold, MOTION_MODULE};
pub use lcm::codec::{DecodeError, EncodeError};
pub use related::Related;
pub use source::source_in_words;
pub use stop::{StopReports, StopSource};

include!(concat!(env!("OUT_DIR"), "/types.rs"));

/// Definitions: paths below `/messages`, and texts. For logs, which contain them, and for tools.
pub const LCM_FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/files.rs"));

#[cfg(test)]
mod tests;
