//! CANopen: the master of CiA 301 with the boot-up of CiA 302-2, the node side that emulated drives are made of, the
//! axis of CiA 402, the two drives of the robot, and any other one by its data sheet.
//!
//! Everything here is sans-IO: it reads no clock and owns no port. After any call drain `poll_tx` and `poll_event`
//! and arm one timer at `poll_timeout`. Read [`wire`] first, then [`Master`] or [`Node`].
//!
//! Clause by clause: `docs/conformance/canopen.md`.
//!
//! A master boots a drive. On a robot a host moves the frames; here it is a loop:
//!
//! ```
//! use base::{Duration, Instant};
//! use canopen::drives::epos;
//! use canopen::master::State;
//! use canopen::{Event, Master, MasterConfig, Node};
//!
//! let config = epos::node_config("propulsion", &epos::parameters(1));
//! let mut master = Master::new(MasterConfig::default(), &[config]).expect("a valid configuration");
//! let mut drive = Node::new(epos::dictionary(1), Duration::from_millis(5));
//! drive.power_on(Instant::ZERO);
//!
//! let mut events = Vec::new();
//! for now in (1..500).map(Instant::from_millis) {
//!     master.handle_timeout(now);
//!     drive.handle_timeout(now);
//!     while let Some(frame) = master.poll_tx() {
//!         drive.handle_rx(now, &frame);
//!     }
//!     while let Some(frame) = drive.poll_tx() {
//!         master.handle_rx(now, &frame);
//!     }
//!     events.extend(std::iter::from_fn(|| master.poll_event()));
//! }
//! assert!(events.contains(&Event::Booted { node: 1 }));
//! assert_eq!(master.state(1), Some(State::Operational));
//! ```
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
