//! VESC, firmware 6 and later, by CAN or UART: one axis.
//!
//! Protocol  payloads of a command and its data, most significant byte first; source of the VESC firmware, commit
//!           b9d287b (7.01): `comm/commands.c`, `comm/packet.c` (UART), `comm/comm_can.c` and
//!           `documentation/comm_can.md` (CAN), `confgenerator.c`, `timeout.c`
//! Units     ERPM (revolutions of the electrical field in a minute), tachometer of six steps for one of them
//! Silence   `timeout_msec`: brakes with `timeout_brake_current`; with 0 A, the default, the axis rolls
//! Feedback  asked for, each period: COMM_GET_VALUES_SELECTIVE; status messages on CAN are not needed
//! Traps     below `s_pid_min_erpm` the speed control releases the motor, so the engine brakes there; a brake current
//!           does not hold an axis that stands; reads do not feed the timeout, commands do
//!
//! The timeout is read back, not set: a write stores the whole configuration in flash, and its layout behind the first
//! fields differs from version to version. Those fields (signature, id, timeout, brake current) are the same in 5.03,
//! 6.00, 6.05 and 7.01; the id is compared. That the timeout has acted is bit 0 of the last byte of the values, which
//! firmware has since June 2021.
//!
//! Not verified: the firmware was read, not run; behaviour of the second motor of dual controllers.

use crate::config::{Config, ConfigError, Timing};
use crate::engine::Engine;
use base::Instant;

pub mod can;
pub mod device;
pub mod payload;
mod protocol;
#[cfg(test)]
mod tests;
pub mod uart;

pub use protocol::Commands;

/// Engine of one VESC on CAN.
pub type VescCan = Engine<Commands<can::Link>, 1>;
/// Engine of one VESC on a UART, 115200 bit/s by default.
pub type VescUart = Engine<Commands<uart::Link>, 1>;

/// Greatest payload of the firmware, `PACKET_MAX_PL_LEN`.
pub const PAYLOAD_MAX: usize = 512;

/// A way of payloads to the other end and back.
pub trait Link {
    /// What arrives: a frame, or bytes.
    type Rx: ?Sized;
    /// What is sent.
    type Tx;

    /// Queues a payload of 1 to [`PAYLOAD_MAX`] bytes; one without room is not sent.
    fn send(&mut self, payload: &[u8]);
    /// Takes input and passes on each payload that is complete and undamaged; returns the number of damaged ones.
    fn receive(&mut self, now: Instant, rx: &Self::Rx, take: &mut dyn FnMut(&[u8])) -> u32;
    /// Next output.
    fn poll_tx(&mut self) -> Option<Self::Tx>;
    /// Forgets what waits to be sent.
    fn clear(&mut self);
}

/// Which VESC it must be, and what its motor needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Device {
    /// VESC id.
    pub id: u8,
    /// Pairs of poles of the motor.
    pub pole_pairs: u8,
    /// `s_pid_min_erpm` of the device: slower setpoints brake. 900 by default.
    pub erpm_min: f64,
    /// Brake current near and at zero velocity, A.
    pub hold_current_a: f64,
    /// Brake current of a quick stop, A.
    pub quick_stop_current_a: f64,
}

impl Device {
    /// A device as the emulation has it.
    pub const EXAMPLE: Self =
        Self { id: 23, pole_pairs: 7, erpm_min: 900.0, hold_current_a: 10.0, quick_stop_current_a: 30.0 };

    /// ERPM at one motor turn per second.
    pub(crate) fn erpm_per_turn(&self) -> f64 {
        60.0 * f64::from(self.pole_pairs)
    }

    /// Steps of the tachometer for one motor turn.
    pub(crate) fn steps_per_turn(&self) -> f64 {
        6.0 * f64::from(self.pole_pairs)
    }

    fn check(&self) -> Result<(), ConfigError> {
        let allowed = |current: f64| current > 0.0 && current <= 1000.0;
        let currents = allowed(self.hold_current_a) && allowed(self.quick_stop_current_a);
        let erpm = self.erpm_min.is_finite() && self.erpm_min >= 0.0;
        if currents && erpm && self.pole_pairs > 0 { Ok(()) } else { Err(ConfigError::Device) }
    }
}

impl VescUart {
    /// An engine for this device on a UART. Its first [`Engine::handle_timeout`] starts it.
    ///
    /// # Errors
    /// What is wrong with the configuration.
    pub fn uart(config: &Config<1>, device: Device) -> Result<Self, ConfigError> {
        config.check()?;
        device.check()?;
        Ok(Self::with(Commands::new(device, config.timing, uart::Link::new()), config))
    }
}

impl VescCan {
    /// An engine for this device on CAN. `host` is the id to which it answers: each engine on the bus needs its own,
    /// and no VESC may have it. The first [`Engine::handle_timeout`] starts it.
    ///
    /// # Errors
    /// What is wrong with the configuration.
    pub fn can(config: &Config<1>, device: Device, host: u8) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self::with(Commands::on_can(device, host, config.timing)?, config))
    }
}

impl Commands<can::Link> {
    pub(crate) fn on_can(device: Device, host: u8, timing: Timing) -> Result<Self, ConfigError> {
        device.check()?;
        if host == device.id || [host, device.id].contains(&can::TO_ALL) {
            return Err(ConfigError::Device);
        }
        Ok(Self::new(device, timing, can::Link::host(host, device.id)))
    }
}
