//! CANopen: the master of CiA 301 with the boot-up of CiA 302-2, the node side that emulated drives are made of, the
//! axis of CiA 402, and the two drives of the robot.
//!
//! Everything here is sans-IO: it reads no clock and owns no port. After any call drain `poll_tx` and `poll_event`
//! and arm one timer at `poll_timeout`. Read [`wire`] first, then [`Master`] or [`Node`].
//!
//! Clause by clause: `docs/conformance/canopen.md`.
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;
#[cfg(test)]
extern crate std;

mod abort;
pub mod axis;
pub mod dictionary;
pub mod drives;
pub mod eds;
pub mod lss;
pub mod master;
pub mod node;
pub mod pdo;
pub mod sdo;
#[cfg(test)]
mod testing;
mod value;
pub mod wire;
mod write;

pub use abort::Abort;
pub use dictionary::Dictionary;
pub use master::{Event, Master, MasterConfig, NodeConfig};
pub use node::{Node, NodeEvent};
pub use value::{Payload, Value};
pub use wire::{NmtCommand, NmtState};

/// The example of the guide, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/adding-a-drive.md")]
pub struct AddingADrive;
