//! SLAMTEC RPLIDAR A1, A2, A3, C1 and S2: requests and answers on a serial line.
//!
//! Start-up: stop; identity; health; motor; time of a sample; scan. An identity of another model is refused, and a
//! device that reports an error is reset once for each start-up. While it scans a device answers nothing else, so its
//! health is read at each start-up only.
//!
//! Three kinds of data are read besides single samples: express ("cabins"), ultra and dense capsules. Single samples
//! have no checksum, only three fixed bits: prefer a capsule where the device has one.
//!
//! Sources: SLAMTEC, *RPLIDAR S & A & C series interface protocol and application notes* (LR001), chapters 2 (packets)
//! and 4 (requests); SLAMTEC's published `rplidar_sdk`, `sl_lidar_cmd.h` (numbers) and its unpackers, for what the
//! notes leave open: angles of ultra capsules, and which models have which control of the motor.

mod capsule;
pub mod emulated;
mod protocol;
#[cfg(test)]
mod tests;
pub mod wire;

pub use protocol::Requests;

use crate::engine::Lidar;
use crate::ld::NoEcho;
use base::listed;

listed! {
    /// Models.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Model {
        /// A1; its motor turns while DTR is low: the host sets it.
        A1 => "rplidar-a1",
        /// A2.
        A2 => "rplidar-a2",
        /// A3.
        A3 => "rplidar-a3",
        /// C1; its motor turns by itself.
        C1 => "rplidar-c1",
        /// S2.
        S2 => "rplidar-s2",
    }
}

listed! {
    /// What is asked for.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Mode {
        /// Single samples: all models; without a checksum.
        Standard => "standard",
        /// Express capsules of 32 samples: A1, A2, A3.
        Express => "express",
        /// Ultra capsules of 96 samples: A3, and A2 from firmware 1.24 on.
        Ultra => "ultra",
        /// Dense capsules of 40 samples: C1, S2.
        Dense => "dense",
    }
}

/// How the motor is commanded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Motor {
    /// By a wire, or not at all.
    None,
    /// Duty cycle, 0 to 1023.
    Pwm(u16),
    /// Revolutions per minute.
    Rpm(u16),
}

impl Model {
    /// Upper half of the model number of the identity.
    #[must_use]
    pub fn major(self) -> u8 {
        match self {
            Self::A1 => 1,
            Self::A2 => 2,
            Self::A3 => 3,
            Self::C1 => 4,
            Self::S2 => 7,
        }
    }

    /// Bits per second of the line, as delivered.
    #[must_use]
    pub fn baud(self) -> u32 {
        match self {
            Self::A1 | Self::A2 => 115_200,
            Self::A3 => 256_000,
            Self::C1 => 460_800,
            Self::S2 => 1_000_000,
        }
    }

    /// The capsules that the model has.
    #[must_use]
    pub fn mode(self) -> Mode {
        match self {
            Self::A1 | Self::A2 => Mode::Express,
            Self::A3 => Mode::Ultra,
            Self::C1 | Self::S2 => Mode::Dense,
        }
    }

    pub(crate) fn motor(self) -> Motor {
        match self {
            Self::A1 | Self::C1 => Motor::None,
            Self::A2 | Self::A3 => Motor::Pwm(660),
            Self::S2 => Motor::Rpm(600),
        }
    }

    /// Shortest and longest range, m (data sheets).
    pub(crate) fn range_m(self) -> (f32, f32) {
        match self {
            Self::A1 => (0.15, 12.0),
            Self::A2 => (0.2, 16.0),
            Self::A3 => (0.2, 25.0),
            Self::C1 => (0.05, 12.0),
            Self::S2 => (0.05, 30.0),
        }
    }
}

/// What is configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Model; another one is refused.
    pub model: Model,
    /// What is asked for; [`Model::mode`] fits all firmware.
    pub mode: Mode,
    /// Meaning of a range of 0.
    pub no_echo: NoEcho,
}

impl Config {
    /// The usual configuration of a model.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self { model, mode: model.mode(), no_echo: NoEcho::Unknown }
    }
}

/// An RPLIDAR.
pub type Rplidar = Lidar<Requests>;

impl Rplidar {
    /// A lidar of this model.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self::with(Requests::new(config))
    }
}
