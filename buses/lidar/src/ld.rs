//! LDROBOT LD06, LD19 and STL-19P: a stream of packets, without commands.
//!
//! The device turns by itself and sends from power-on, 12 samples in a packet of 47 bytes, at 230400 bit/s, 8N1, to the
//! host only. It has no identity and no health; its packets have the speed of the motor and a clock of 1 ms.
//!
//! Sources: LDROBOT, *LD06 Development Manual* V1.0 and *LD19 Development Manual* V2.3, section 3 (protocol, example
//! packet, CRC table); LDROBOT's published driver `ldlidar_stl_ros2` (samples per second of each model).

pub mod emulated;
mod protocol;
#[cfg(test)]
mod tests;
pub mod wire;

pub use protocol::Packets;

use crate::engine::Lidar;
use base::listed;

listed! {
    /// Models.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Model {
        /// LD06.
        Ld06 => "ld06",
        /// LD19.
        Ld19 => "ld19",
        /// STL-19P.
        Stl19p => "stl-19p",
    }
}

impl Model {
    /// Samples per second.
    #[must_use]
    pub fn samples_per_s(self) -> u32 {
        match self {
            Self::Ld06 | Self::Ld19 => 4500,
            Self::Stl19p => 5000,
        }
    }
}

/// How a range of 0 is understood, which the devices send when they received no echo, for whatever reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NoEcho {
    /// Not measured (NaN): the safe choice.
    #[default]
    Unknown,
    /// Nothing was received (`+inf`): for devices and places where near and dark objects were shown not to read 0.
    Nothing,
}

impl NoEcho {
    pub(crate) fn range_m(self) -> f32 {
        match self {
            Self::Unknown => f32::NAN,
            Self::Nothing => f32::INFINITY,
        }
    }
}

/// What is configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Model; the device does not say which it is.
    pub model: Model,
    /// Meaning of a range of 0.
    pub no_echo: NoEcho,
}

/// An LD06, LD19 or STL-19P.
pub type LdLidar = Lidar<Packets>;

impl LdLidar {
    /// A lidar of this model.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self::with(Packets::new(config))
    }
}
