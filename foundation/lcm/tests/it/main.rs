//! The tests of this crate in one program. `interop` is one of its own, and so are the two that take in the sources of
//! the ring.

#[cfg(feature = "live")]
#[path = "../common.rs"]
mod common;
mod eventlog;
#[cfg(feature = "live")]
#[path = "../common/hosts.rs"]
mod hosts;
mod interfaces;
mod live;
mod providers;
mod shm;
mod tcpq;
mod wire;
