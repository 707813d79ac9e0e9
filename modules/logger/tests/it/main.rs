//! Integration tests of this crate in one binary.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../../../../foundation/lcm-gen/tests/dynamic.rs"]
mod dynamic;
mod files;
mod read;
#[path = "../../../../foundation/lcm-gen/tests/ros2.rs"]
mod reader;
mod recover;
mod ros;
mod ros_peers;
mod translated;
