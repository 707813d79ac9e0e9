//! LCM (Lightweight Communications and Marshalling), wire compatible, sans-IO core with a live transport.
//!
//! - [`udpm`]: what stands in a datagram; [`url`](mod@url): where they go; [`subscription`]: which are wanted;
//!   [`receiver`]: the three together, with the counters. Pure: no socket, no clock.
//! - [`codec`]: what stands in a payload.
//! - [`live`] (feature `live`, on by default): the UDP sockets.
#![forbid(unsafe_code)]

pub mod codec;
#[cfg(feature = "live")]
pub mod live;
pub mod receiver;
pub mod subscription;
pub mod udpm;
pub mod url;

pub use url::Url;

/// Compiles the README's example.
#[cfg(all(doctest, feature = "live"))]
#[doc = include_str!("../README.md")]
struct Readme;
