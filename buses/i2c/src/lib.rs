//! I2C and SMBus without a port and without a clock: SMBus commands, a bit-banged master, a target bit by bit, and the
//! MAX6615 fan controller from both ends.
//!
//! Read first: `docs/i2c.md`; clause by clause: `docs/conformance/i2c.md`. Does not depend on Linux, GPIO numbers or
//! modules.
//!
//! A register of an emulated fan controller is read and written by SMBus commands:
//!
//! ```
//! use i2c::max6615::{ADDRESS, chip::Chip, register};
//! use i2c::smbus::{Answer, Command};
//! use i2c::{Address, Error, target};
//!
//! let address = Address::new(ADDRESS).expect("an address of 7 bits");
//! let mut chip = Chip::new(address, [3000.0, 3000.0]);
//! let mut run = |to: Address, command: Command<'_>| {
//!     let transfer = command.transfer(to, false).expect("only blocks can be too long");
//!     // On a robot a port of the host makes the transfer.
//!     let outcome = target::answer(&mut [&mut chip], &transfer);
//!     command.answer(to, false, &outcome)
//! };
//!
//! let limit = Command::ReadByte { code: register::LIMIT };
//! assert_eq!(run(address, limit), Ok(Answer::Byte(0x6E))); // 110 C, the power-on value
//! run(address, Command::WriteByte { code: register::LIMIT, value: 60 })?;
//! assert_eq!(run(address, limit), Ok(Answer::Byte(60)));
//!
//! let nobody = Address::new(0x29).expect("an address of 7 bits");
//! assert_eq!(run(nobody, limit), Err(i2c::smbus::Error::Bus(Error::NoAddress)));
//! # Ok::<(), i2c::smbus::Error>(())
//! ```
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
