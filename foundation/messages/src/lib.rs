//! Rust types of messages/*.lcm and the table of channels.
