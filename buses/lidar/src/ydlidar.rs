//! YDLIDAR X4 and G4: triangulating lidars that are commanded on a serial line.
//!
//! Start-up: stop; identity; health; of a G4 its samples per second; scan. An identity of another model is refused, and
//! a device that reports an error is restarted once for each start-up. While it scans a device answers nothing else, so
//! its health is read at each start-up only.
//!
//! Commands and answers have the frame of RPLIDARs, and the identity their layout ([`crate::rplidar::wire`]). Data are
//! packets of 40 samples at most, of a G4 80, with the angles of their first and last one, and a checksum of 16 bits. A
//! beam lies beside the axis of the head, so its direction depends on its range.
//!
//! The motor of an X4 turns while DTR of its USB adapter is set, as it is while a port is open, and its speed goes by a
//! wire. That of a G4 turns while it scans; it controls its speed.
//!
//! Sources: EAI, *YDLIDAR G4 Development Manual* (01.13.000008), sections "System command", "System messages", "Data
//! protocol"; *YDLIDAR X4 Development Manual* (01.13.000001) V1.6, contents, chapter 3 (commands); *YDLIDAR G4 Data
//! Sheet*, sections "Data communication", "Polar coordinate definition"; of YDLIDAR's published `YDLidar-SDK`
//! *Communication Protocol* (packets, angles, speed in packets), *Dataset* (models, rates, ranges) and
//! `ydlidar_protocol.h`, for what the manuals leave open: numbers of models, samples of a packet, DTR.

pub mod emulated;
mod protocol;
#[cfg(test)]
mod tests;
pub mod wire;

pub use protocol::Commands;

use crate::engine::Lidar;
use crate::event::Text;
use crate::ld::NoEcho;
use crate::rplidar::wire::Info;
use base::listed;

listed! {
    /// Models.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Model {
        /// X4.
        X4 => "ydlidar-x4",
        /// G4.
        G4 => "ydlidar-g4",
    }
}

/// Number of the model in the manual of the G4, and of other models.
const ANY: u8 = 4;

impl Model {
    /// Number of the model in the identity (`YDLidar-SDK`, *Dataset*).
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::X4 => 6,
            Self::G4 => 5,
        }
    }

    /// True if a device with this number in its identity may be this model. Manuals of several models have 4.
    #[must_use]
    pub fn may_have(self, number: u8) -> bool {
        [self.number(), ANY].contains(&number)
    }

    /// Bits per second of the line.
    #[must_use]
    pub fn baud(self) -> u32 {
        match self {
            Self::X4 => 128_000,
            Self::G4 => 230_400,
        }
    }

    /// Samples per second as delivered; a G4 can be set to another rate ([`wire::RATES`]).
    #[must_use]
    pub fn samples_per_s(self) -> u32 {
        match self {
            Self::X4 => 5000,
            Self::G4 => 9000,
        }
    }

    /// Samples of a packet at most (`ydlidar_protocol.h`).
    #[must_use]
    pub fn samples_max(self) -> usize {
        match self {
            Self::X4 => 40,
            Self::G4 => wire::SAMPLES_MAX,
        }
    }

    /// Number of the command that restarts it.
    #[must_use]
    pub fn restart(self) -> u8 {
        match self {
            Self::X4 => wire::command::RESTART_X4,
            Self::G4 => wire::command::RESTART_G4,
        }
    }

    /// Shortest and longest range, m (*Dataset*), as delivered.
    pub(crate) fn range_m(self) -> (f32, f32) {
        match self {
            Self::X4 => (0.12, 10.0),
            Self::G4 => (0.28, 16.0),
        }
    }
}

/// Serial number of a device for people: digits, one in a byte of the identity.
pub(crate) fn serial(info: &Info) -> Text {
    info.serial.iter().map(|digit| if *digit < 10 { b'0' + digit } else { b'?' }).collect()
}

/// What is configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Model; another one is refused.
    pub model: Model,
    /// Meaning of a range of 0.
    pub no_echo: NoEcho,
}

impl Config {
    /// The usual configuration of a model.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self { model, no_echo: NoEcho::Unknown }
    }
}

/// A YDLIDAR.
pub type Ydlidar = Lidar<Commands>;

impl Ydlidar {
    /// A lidar of this model.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self::with(Commands::new(config))
    }
}
