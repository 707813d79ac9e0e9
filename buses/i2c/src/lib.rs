//! I2C and SMBus without a port and without a clock: SMBus commands, a bit-banged master, a target bit by bit, and the
//! MAX6615 fan controller from both ends.
//!
//! Read first: `docs/i2c.md`; clause by clause: `docs/conformance/i2c.md`. Does not depend on Linux, GPIO numbers or
//! modules.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bitbang;
pub mod hal;
pub mod max6615;
pub mod smbus;
pub mod target;
#[cfg(test)]
mod testing;
mod timing;
pub mod wire;

pub use base::i2c::{Address, Bytes, Error, MAX, Outcome, Read, Transfer};
pub use timing::{STRETCH_MAX, duration};
