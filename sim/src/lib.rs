//! The virtual host, what must hold in it whatever happens, and the soak.
//!
//! In [`host::Virtual`] all processes, buses and the LCM bus share one deterministic process in virtual time; the other
//! ends of the wires are the module [`simulator`]. [`check`] watches every message for what must never be, and
//! [`mod@soak`] draws episodes of work and faults from a seed. No file, no socket, no clock.
#![forbid(unsafe_code)]

pub mod check;
pub mod host;
pub mod soak;
