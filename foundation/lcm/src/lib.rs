//! LCM (Lightweight Communications and Marshalling), wire compatible, sans-IO core with a live transport.
//!
//! - [`udpm`]: what stands in a datagram; [`url`](mod@url): where they go; [`subscription`]: which are wanted;
//!   [`receiver`]: the three together, with the counters. Pure: no socket, no clock.
//! - [`tcpq`], [`eventlog`]: the hub's protocol, the log format. As pure.
//! - [`codec`]: what stands in a payload; without features the crate is this alone, `no_std` with `alloc`.
//! - `live` (feature `live`, on by default): all of that on this machine's sockets and files; feature `shm`, on by
//!   default, adds memory that programs of one host share.
//!
//! With its default features the crate joins a bus by its URL; `memq://` is one within the process, for tests and
//! examples, `udpm://239.255.76.67:7667` the network's:
//!
//! ```
//! # #[cfg(feature = "live")]
//! # {
//! use lcm::{Url, live::Lcm, subscription::Queue};
//!
//! let (url, warnings) = Url::parse("memq://")?;
//! assert!(warnings.is_empty());
//! let mut lcm = Lcm::new(&url)?;
//! lcm.subscribe_with("LL_DATA_.*", Queue::Newest(1))?;
//! lcm.publish("LL_DATA_POSE", b"first")?;
//! lcm.publish("LL_DATA_POSE", b"second")?;
//! lcm.publish("CM_DATA_STATE", b"not subscribed")?;
//!
//! let message = lcm.recv()?.expect("a message waits");
//! assert_eq!((message.channel, message.payload), ("LL_DATA_POSE", &b"second"[..]));
//! assert!(lcm.recv()?.is_none());
//! assert_eq!(lcm.stats().queue_dropped, 1);
//! # }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
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
#[cfg(feature = "shm")]
pub mod memory {
    //! Files that processes share as memory. A process that truncates one does not end the others by SIGBUS.
    pub use crate::shm::memory::{Access, Memory};
}
#[cfg(feature = "std")]
pub mod origin;
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
