//! The virtual host, the rules that must always hold, and the soak.
//!
//! In [`host::Virtual`] all processes, buses and the LCM bus share one deterministic process in virtual time; the other
//! ends of the wires are the module [`simulator`]. [`check`] observes all traffic for violations of the rules, and
//! [`mod@soak`] draws episodes of work and faults from a seed. No files, sockets or clocks.
#![forbid(unsafe_code)]

pub mod check;
pub mod host;
pub mod soak;
