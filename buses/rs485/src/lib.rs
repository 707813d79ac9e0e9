//! The 9-bit EIA-485 bus of the robot's boards: a master, the answering side, their frames and transports, and the
//! protocols of the boards. Everything here is sans-IO: it reads no clock and owns no port; the caller feeds words and
//! time, then drains output, events and the next deadline.
//!
//! The wire contract is `docs/facts/boards.md` (sections 1 to 6); clause by clause: `docs/conformance/rs485.md`.
//!
//! A master asks a board for its version. On a robot a host moves the words; here it is a loop:
//!
//! ```
//! use base::{Duration, Instant};
//! use rs485::boards::{GET_VERSION, Version, sd1};
//! use rs485::frame::Status;
//! use rs485::master::{Config, Event, Master};
//! use rs485::slave::{self, Slave};
//!
//! let mut master = Master::new(Config::default());
//! let mut board = Slave::new(slave::Config::new(sd1::FRONT));
//! master.request(GET_VERSION.ask(sd1::FRONT, &[])).expect("the master is idle");
//!
//! let (mut now, mut event) = (Instant::ZERO, None);
//! while event.is_none() {
//!     now += Duration::from_micros(100);
//!     master.handle_timeout(now);
//!     if let Some(transmit) = master.poll_tx(now) {
//!         board.handle_rx(now, transmit.words);
//!         master.handle_tx_done(now);
//!     }
//!     if board.poll_request().is_some_and(|asked| asked.instruction == GET_VERSION.code) {
//!         board.respond(Status::Ok, &Version { major: 1, minor: 4 }.build());
//!     }
//!     if let Some(transmit) = board.poll_tx(now) {
//!         master.handle_rx(now, transmit.words);
//!     }
//!     event = master.poll_event();
//! }
//! let Some(Event::Reply { data, .. }) = event else { panic!("{event:?}") };
//! assert_eq!(Version::parse(&data), Some(Version { major: 1, minor: 4 }));
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod boards;
pub mod crc;
pub mod frame;
mod instruction;
pub mod master;
pub mod node;
pub mod reader;
#[cfg(test)]
mod residual;
pub mod schedule;
pub mod slave;
#[cfg(test)]
mod testing;
pub mod transport;
#[cfg(test)]
mod wire;

/// The page's code is compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/writing-a-board-driver.md")]
pub struct WritingABoardDriver;

use base::Duration;
use base::serial::Word;

/// Bits of one word on the wire: start, eight data bits, the ninth, stop.
pub const BITS_PER_WORD: u64 = 11;

/// The time that one word takes on the wire, rounded up to a nanosecond. A `baud` of 0 counts as 1.
#[must_use]
pub const fn word_time(baud: u32) -> Duration {
    let baud = if baud == 0 { 1 } else { baud as u64 };
    Duration::from_nanos((BITS_PER_WORD * 1_000_000_000).div_ceil(baud))
}

/// Words to be sent at once and without a gap. Borrowed from the engine: copy them out, then go on draining.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transmit<'a> {
    /// The whole frame; word 0 is the address, with the ninth bit set.
    pub words: &'a [Word],
}

/// The data of one frame: 0 to 255 bytes.
pub type Data = heapless::Vec<u8, { frame::MAX_DATA }>;
