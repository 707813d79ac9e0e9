//! SDO transfers, expedited and segmented: the client that a master has for each node, and the server of a node.

mod client;
mod server;
#[cfg(test)]
mod tests;

pub use client::{Client, Done, Error};
pub use server::{Objects, Server};

use base::Duration;

/// The longest transfer that a client takes in, in bytes; a server that sends more is aborted.
pub const MAX_LEN: usize = 65_536;

/// How long an answer may take by default.
pub const TIMEOUT: Duration = Duration::from_millis(500);
