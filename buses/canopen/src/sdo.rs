//! SDO transfers, expedited, segmented and in blocks (CiA 301, 9.2.2.2): the client that a master has for each node,
//! and the server of a node.
//!
//! # What cannot be told apart
//! Of all answers only those that begin a transfer, and aborts, name their object. The others are told by what is
//! awaited: their kind, the toggle bit, the number of a segment. A server answers in order, so whatever of a transfer
//! that was given up comes late comes before the answer that begins the next one, is of another kind, and is ignored.
//! A frame that comes twice (CAN may deliver one twice, UDP too) is ignored by its bytes. What remains:
//! - the late answer to a request for the *same* object, in the same direction, is taken for the one to its
//!   repetition: what it brought was true of that object, but earlier;
//! - an acknowledge that comes twice looks like the next one. Segments that are lost then are missing at the end,
//!   where the size and the CRC tell it; both of our ends always say the size;
//! - segments of a block transfer may look like any other frame. Who breaks off a sub-block in its middle knows which
//!   segments may still come and swallows them.

mod block;
mod client;
mod crc;
mod server;
#[cfg(test)]
mod tests;

pub use block::BLOCK_SIZE;
pub use client::{Client, Done, Error};
pub use server::{Objects, Server};

use base::Duration;

/// Longest transfer that client and server accept, bytes; longer ones are aborted. Memory is allocated as data arrives,
/// independent of the announced size.
pub const MAX_LEN: usize = 1 << 20;

/// Default time limit of an answer.
pub const TIMEOUT: Duration = Duration::from_millis(500);
