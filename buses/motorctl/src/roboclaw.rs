//! RoboClaw, packet serial: two axes.
//!
//! Protocol  address, command, data, CRC-16; "RoboClaw Series User Manual" (Basicmicro), chapters Packet Serial,
//!           Advanced Packet Serial and Encoders; commands 14 and 15 need a manual and a firmware that have them
//! Units     quadrature counts and counts/s of the encoder
//! Silence   serial timeout, command 14, in steps of 100 ms: both motors stop; whether they are braked is not said
//! Feedback  asked for, each period: speeds, positions, and one of status, supply, currents, temperature, timeout
//! Traps     reads feed the timeout too, so the engine watches that its drive commands are acknowledged; the effect of
//!           the timeout at standstill cannot be read, so a second way to stop must be configured
//!
//! Not verified: that any valid packet feeds the timeout (the manual speaks of serial bytes); that a speed below zero
//! is sent as a negative number (so Basicmicro's `roboclaw_3.py` reads it; a positive one with the direction byte of
//! the manual is understood too); the length of the status, four bytes in that library, while the manual lists bits up
//! to 0x0200_0000 and leaves the length open.

use crate::config::{Config, ConfigError};
use crate::engine::Engine;
use core::fmt;

pub mod device;
mod protocol;
#[cfg(test)]
mod tests;
pub mod wire;

pub use protocol::PacketSerial;

/// Engine of one RoboClaw with its two axes.
pub type RoboClaw = Engine<PacketSerial, 2>;

/// What the firmware's text must contain: model and version, as `"RoboClaw 2x15a v4.1.34"`.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Model {
    bytes: [u8; wire::TEXT_LEN_MAX],
    len: usize,
}

impl Model {
    /// The model of this text; `None`: it is empty, or longer than the text of a device, [`wire::TEXT_LEN_MAX`] bytes.
    #[must_use]
    pub const fn new(text: &str) -> Option<Self> {
        let (from, mut bytes, mut place) = (text.as_bytes(), [0; wire::TEXT_LEN_MAX], 0);
        if from.is_empty() || from.len() > bytes.len() {
            return None;
        }
        while place < from.len() {
            bytes[place] = from[place];
            place += 1;
        }
        Some(Self { bytes, len: from.len() })
    }

    /// Its text, at least one byte.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(core::str::from_utf8(self.as_bytes()).unwrap_or("?"))
    }
}

impl fmt::Debug for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{self}\"")
    }
}

/// Which RoboClaw it must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Device {
    /// Address, 0x80 to 0x87.
    pub address: u8,
    /// bit/s; with 115200 a period of 20 ms suffices.
    pub baud: u32,
    /// What the firmware's text must contain.
    pub model: Model,
    /// Quadrature counts for one turn of the motor, for each axis.
    pub counts_per_turn: [f64; 2],
}

impl Device {
    /// A device as the emulation has it.
    pub const EXAMPLE: Self = Self {
        address: 0x80,
        baud: 115_200,
        model: Model::new("RoboClaw 2x15a v4.1.34").expect("a text of a device"),
        counts_per_turn: [4096.0; 2],
    };
}

impl RoboClaw {
    /// An engine for this device. Its first [`Engine::handle_timeout`] starts it. The command time limit must be 100 or
    /// 200 ms.
    ///
    /// # Errors
    /// What is wrong with the configuration.
    pub fn new(config: &Config<2>, device: Device) -> Result<Self, ConfigError> {
        config.check()?;
        if !config.timing.time_limit.as_nanos().is_multiple_of(wire::TIME_UNIT.as_nanos()) {
            return Err(ConfigError::TimeLimit);
        }
        let counts = device.counts_per_turn.iter().all(|counts| counts.is_finite() && *counts > 0.0);
        if !wire::ADDRESSES.contains(&device.address) || device.baud == 0 || !counts {
            return Err(ConfigError::Device);
        }
        Ok(Self::with(PacketSerial::new(device, config.timing), config))
    }
}
