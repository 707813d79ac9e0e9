//! Modbus: a [`Master`] for one line, RTU or TCP; registers as values with scale and limits ([`value`]); and an
//! emulated [`Device`](device::Device), the other end of the line.
//!
//! Sources: Modbus Application Protocol V1.1b3, Modbus over Serial Line V1.02, Messaging on TCP/IP V1.0b. Everything
//! here is sans-IO: it reads no clock and owns no port. What is implemented: `docs/conformance/modbus.md`.
//!
//! A register is read. On a robot a host moves the bytes; here it is a loop:
//!
//! ```
//! use base::Instant;
//! use modbus::device::Device;
//! use modbus::{Config, Event, Line, Master, Request, Table};
//!
//! let line = Line::Rtu { baud: 19_200 };
//! let mut master = Master::new(Config::new(line)).expect("a valid configuration");
//! let mut device = Device::new(line, 17);
//! device.set(Table::InputRegisters, 8, 10);
//!
//! let request = Request::Read { table: Table::InputRegisters, address: 8, count: 1 };
//! master.request(17, request).expect("it is idle, and the request is valid");
//! for now in (1..200).map(Instant::from_millis) {
//!     master.handle_timeout(now);
//!     while let Some(frame) = master.poll_tx(now) {
//!         device.handle_rx(now, &frame);
//!     }
//!     while let Some(frame) = device.poll_tx(now) {
//!         master.handle_rx(now, &frame);
//!     }
//! }
//! let Some(Event { result: Ok(data), .. }) = master.poll_event() else { panic!("no answer") };
//! assert_eq!(data.word(0), Some(10));
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod crc;
pub mod device;
mod frame;
mod master;
pub mod pdu;
#[cfg(test)]
mod tests;
pub mod value;

pub use frame::{Bytes, LATENCY, Line};
pub use master::{Config, ConfigError, Counters, Event, Failure, Master, Refused, TIME_LIMIT_MAX};
pub use pdu::{Exception, Request, Table};
