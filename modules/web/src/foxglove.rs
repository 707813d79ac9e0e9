//! Live endpoint for Foxglove: its WebSocket protocol on the server's own sockets.

pub mod endpoint;
pub mod hub;
pub mod protocol;
