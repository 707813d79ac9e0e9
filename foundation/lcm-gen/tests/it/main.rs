//! Integration tests of this crate in one binary.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod cdr;
mod crates;
#[path = "../dynamic.rs"]
mod dynamic;
mod generated;
mod language;
mod official;
#[path = "../more/generated.rs"]
#[rustfmt::skip]
#[allow(dead_code, reason = "the tests have use for a part")]
mod own;
#[path = "../ros2.rs"]
mod ros2;
mod run_time;
mod sample;
#[path = "../support.rs"]
mod support;
#[path = "../vectors/generated.rs"]
#[rustfmt::skip]
#[allow(dead_code, reason = "the tests have use for a part")]
mod vectors;
