//! Devices on a serial line that answer a request of fixed bytes by fixed bytes with values in them: frames and values
//! by table, a [`Master`] for one line, and an emulated [`Device`](device::Device), the other end.
//!
//! There is no standard: the table of a device is typed from its manual. Everything here is sans-IO: it reads no clock
//! and owns no port.
//!
//! A thermometer is read. On a robot a host moves the bytes; here it is a loop:
//!
//! ```
//! use base::Instant;
//! use exchange::check::Check;
//! use exchange::{Answer, Config, Master, Octets, Protocol};
//!
//! let octets = |text| Octets::parse(text).expect("bytes");
//! let protocol = Protocol { check: Check::NONE, request_end: octets("0D"), answer_end: octets("0D") };
//! let answer = Answer::Data { length: None, prefix: octets("'A1='"), suffix: Octets::default() };
//!
//! let mut master = Master::new(Config::new(Some(9600)));
//! let now = Instant::from_millis(1000);
//! let frame = protocol.request(b">A1?").expect("it has room");
//! let expected = protocol.expect(&answer, &frame).expect("it has a length or an end");
//! assert!(master.request(now, frame, expected));
//! assert_eq!(&master.poll_tx(now).expect("at once")[..], b">A1?\r");
//! master.handle_rx(Instant::from_millis(1010), b"A1=+023.4\r");
//! assert_eq!(&master.poll_event().expect("its end").result.expect("an answer")[..], b"A1=+023.4");
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod check;
pub mod device;
mod frame;
mod master;
mod octets;
#[cfg(test)]
mod tests;
pub mod value;

pub use frame::{Answer, Expected, Protocol};
pub use master::{Config, Counters, Event, Failure, GAP, Master};
pub use octets::{OCTETS_MAX, Octets};

/// Bytes of a frame at most.
pub const LEN_MAX: usize = 256;

/// Bytes of a frame.
pub type Bytes = heapless::Vec<u8, LEN_MAX>;
