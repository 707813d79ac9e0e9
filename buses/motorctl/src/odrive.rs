//! ODrive, CAN Simple, firmware 0.6 (ODrive Pro, S1, Micro): one axis.
//!
//! Protocol  CAN Simple, 11-bit identifiers `node << 5 | command`, little endian; ODrive documentation, "CAN Protocol"
//!           0.5.6 (frame format) and the messages of 0.6.10 in ODriveArduino (commit f52eef5)
//! Units     turns and turns/s of the motor
//! Silence   `axis0.config.watchdog_timeout`: the axis is disarmed (`WATCHDOG_TIMER_EXPIRED`) and rolls
//! Feedback  cyclic: heartbeat, encoder estimates; asked for in turn: supply, current, temperature
//! Traps     the numbers of parameters (endpoints) differ from firmware to firmware, so the version must be equal;
//!           firmware 0.5 (ODrive v3) has neither version nor endpoints on CAN and is refused as silent
//!
//! Not verified, since the documentation of 0.6 was not available: which messages feed the watchdog of 0.6 (in the
//! source of 0.5.6, `can_simple.cpp`, every one to the axis; setpoints do in each), and whether it expires in IDLE
//! (it does in 0.5.6). The start-up needs neither.

use crate::config::{Config, ConfigError, Timing};
use crate::engine::Engine;
use base::Duration;

pub mod device;
mod protocol;
#[cfg(test)]
mod tests;
pub mod wire;

pub use protocol::CanSimple;
use wire::Version;

/// Engine of one ODrive axis.
pub type Odrive = Engine<CanSimple, 1>;

/// Numbers of the parameters that the engine writes, from the file `flat_endpoints.json` of exactly this firmware and
/// hardware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Endpoints {
    /// `axis0.config.enable_watchdog`, a bool.
    pub enable_watchdog: u16,
    /// `axis0.config.watchdog_timeout`, a float in seconds.
    pub watchdog_timeout: u16,
}

/// Which ODrive it must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Device {
    /// Node id, 0 to 62.
    pub node: u8,
    /// Hardware and firmware for which the endpoints are valid.
    pub version: Version,
    /// Endpoints.
    pub endpoints: Endpoints,
    /// Age of the heartbeat at which the device counts as lost: at least twice its period, at most 100 ms.
    pub heartbeat_within: Duration,
}

impl Device {
    /// A device as the emulation has it. The endpoints of a real one differ.
    pub const EXAMPLE: Self = Self {
        node: 0,
        version: Version { protocol: 2, hardware: [4, 4, 58], firmware: [0, 6, 10], unreleased: 0 },
        endpoints: Endpoints { enable_watchdog: 0x00FB, watchdog_timeout: 0x00FA },
        heartbeat_within: Duration::from_millis(60),
    };
}

impl Odrive {
    /// An engine for this device. Its first [`Engine::handle_timeout`] starts it.
    ///
    /// # Errors
    /// What is wrong with the configuration.
    pub fn new(config: &Config<1>, device: Device) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self::with(CanSimple::checked(device, config.timing)?, config))
    }
}

impl CanSimple {
    pub(crate) fn checked(device: Device, timing: Timing) -> Result<Self, ConfigError> {
        let heartbeat = device.heartbeat_within;
        if device.node > wire::NODE_MAX || heartbeat.is_zero() || heartbeat > crate::FEEDBACK_WITHIN_MAX {
            return Err(ConfigError::Device);
        }
        Ok(Self::new(device, timing))
    }
}
