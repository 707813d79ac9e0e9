//! Bridge between the message buses of a robot's computers: one authenticated TCP connection for each other computer,
//! by which the channels of an allow-list cross. The buses themselves stay on their computers.
//!
//! ```text
//!   LCM bus ──► module (admission by the host) ──► gate ──► connection ──► transport ──► cable
//!   LCM bus ◄── transport ◄── gate ◄── connection ◄── transport ◄────────────────────── cable
//! ```
//!
//! [`auth`], [`wire`], [`clocks`], [`connection`], [`allow`] and [`gate`] own no clock and no port; `transport` has a
//! thread in the module's own process. The contract is in `docs/two-computers.md`.
//!
//! Two ends that have the same key open a session, and a message crosses:
//!
//! ```
//! use base::Instant;
//! use bridge::auth::Key;
//! use bridge::connection::{Connection, Event, Time};
//!
//! let key = Key::new([7; 32]);
//! let at = |ms| Time { now: Instant::from_millis(ms), wall_ns: 1_700_000_000_000_000_000 + ms * 1_000_000 };
//! let mut far = Connection::listen(key.clone(), [1; 32], at(0));
//! let mut near = Connection::connect(key, [2; 32], at(0));
//! let mut received = Vec::new();
//! for ms in 1..20 {
//!     let bytes = near.take_tx();
//!     far.handle_rx(at(ms), &bytes)?;
//!     let bytes = far.take_tx();
//!     near.handle_rx(at(ms), &bytes)?;
//!     near.handle_timeout(at(ms))?;
//!     far.handle_timeout(at(ms))?;
//!     if ms == 10 {
//!         assert!(near.is_open() && near.send(at(ms).now, "HL_DATA_ACTION", b"payload"));
//!     }
//!     received.extend(std::iter::from_fn(|| far.poll_event()));
//! }
//! let crossed = |event: &Event| matches!(event, Event::Message { channel, .. } if channel == "HL_DATA_ACTION");
//! assert_eq!(received.iter().filter(|event| crossed(event)).count(), 1);
//! # Ok::<(), bridge::connection::Refusal>(())
//! ```
#![forbid(unsafe_code)]

pub mod allow;
pub mod auth;
pub mod clocks;
pub mod connection;
pub mod gate;
pub mod key_file;
mod link;
mod module;
pub mod settings;
mod shared;
#[cfg(test)]
mod tests;
mod transport;
pub mod wire;

pub use self::module::{Bridge, Settings};

/// Name on the bus.
pub const NAME: &str = "bridge";
