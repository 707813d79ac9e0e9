//! The live endpoint for Foxglove: its WebSocket protocol, over the server's own sockets.

pub mod endpoint;
pub mod hub;
pub mod protocol;
