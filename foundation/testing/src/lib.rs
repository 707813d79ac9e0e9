//! Support for the tests of all crates: the peers and machine features that a test needs, and seeded random numbers.
//!
//! Used in `[dev-dependencies]` only; `advee/tests/architecture.rs` holds that.
//!
//! A test that lacks something ends by one of two functions, never by a bare `return`:
//!
//! - [`peer_or_skip`] for what a package registry has: a program, a library, a Python package. `make test` sets
//!   `ADVEE_PEERS=required`, and a missing peer then fails the test.
//! - [`machine_or_skip`] for what only the machine can give: a device node, a kernel feature, a privilege.
//!
//! A skipped test is reported on standard error and appended to the file named by `ADVEE_SKIPPED`, whose lines
//! `tools/skipped` counts at the end of `make test`.
#![forbid(unsafe_code)]

mod peers;
mod random;
mod skip;

pub use peers::{GROUP, USERS, lcm_1_3_1, multicast_route, python, root, tool, users};
pub use random::Random;
pub use skip::{Found, machine_or_skip, peer_or_skip};
