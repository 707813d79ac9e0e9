//! Hokuyo URG, UTM and UST: SCIP 2.0 on USB, a serial line, or TCP (port 10940).
//!
//! Start-up: quit; version; parameters; state; laser on; scans for ever (`MD`, of three characters, or `MS`, of two).
//! Every line has a checksum, every scan a clock of 24 bits, 1 ms.
//!
//! A sensor does not report dirty optics; ranges shorter than its minimum are codes for why it measured nothing.
//!
//! Sources: Hokuyo, *Communication protocol specification for SCIP 2.0 standard*, C-42-03320B (chapters 6: encoding,
//! 7: format, 8: commands); *UXM-30LX-EW communication protocol specification*, C-42-03907; the wiki of the URG Network
//! (answers of real sensors).

pub mod emulated;
mod protocol;
#[cfg(test)]
mod tests;
pub mod wire;

pub use protocol::Scip;

use crate::engine::Lidar;
use base::listed;

listed! {
    /// Characters of a range.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Characters {
        /// Two: ranges up to 4095 mm.
        Two => "2",
        /// Three: ranges up to 262143 mm.
        Three => "3",
    }
}

/// What is configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Begin of the sensor's model (`MODL`), such as `URG-04LX`; another one is refused.
    pub model: &'static str,
    /// Characters of a range.
    pub characters: Characters,
    /// Bytes per second of the line, for the instants of beams; 0: so fast that it does not matter. A rate at which a
    /// scan takes longer than a turn does not count: on USB any may be set, and the line is faster.
    pub bytes_per_s: u32,
}

impl Config {
    /// A model on USB or TCP, ranges of three characters.
    #[must_use]
    pub fn new(model: &'static str) -> Self {
        Self { model, characters: Characters::Three, bytes_per_s: 0 }
    }
}

/// A sensor with SCIP 2.0.
pub type Hokuyo = Lidar<Scip>;

impl Hokuyo {
    /// A lidar with this configuration.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self::with(Scip::new(config))
    }
}
