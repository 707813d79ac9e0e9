//! LCM (Lightweight Communications and Marshalling), wire compatible, sans-IO core with a live transport.
//!
//! - [`udpm`]: what stands in a datagram; [`url`](mod@url): where they go; [`subscription`]: which are wanted;
//!   [`receiver`]: the three together, with the counters. Pure: no socket, no clock.
//! - [`tcpq`], [`eventlog`]: the hub's protocol, the log format. As pure.
//! - [`codec`]: what stands in a payload; without features the crate is this alone, `no_std` with `alloc`.
//! - `live` (feature `live`, on by default): all of that on this machine's sockets and files; feature `shm`, on by default,
//!   adds memory that programs of one host share.
#![cfg_attr(not(any(feature = "std", test)), no_std)]
#![deny(unsafe_code)]

extern crate alloc;

pub mod codec;
#[cfg(feature = "std")]
pub mod eventlog;
#[cfg(feature = "std")]
pub mod filter;
#[cfg(feature = "live")]
pub mod live;
#[cfg(feature = "std")]
pub mod queue;
#[cfg(feature = "std")]
pub mod reassembly;
#[cfg(feature = "std")]
pub mod receiver;
#[cfg(feature = "shm")]
mod shm;
#[cfg(feature = "std")]
pub mod sources;
#[cfg(feature = "std")]
pub mod subscription;
#[cfg(feature = "std")]
pub mod tcpq;
#[cfg(feature = "std")]
pub mod udpm;
#[cfg(feature = "std")]
pub mod url;

#[cfg(feature = "std")]
pub use url::Url;

/// Compiles the README's example.
#[cfg(all(doctest, feature = "live"))]
#[doc = include_str!("../README.md")]
struct Readme;
