//! Configuration of a virtual machine.

use base::{Duration, Epoch};
use module::admission::Policy;

/// Parameters of the virtual machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Seed of all randomness.
    pub seed: u64,
    /// Origin of message timestamps.
    pub epoch: Epoch,
    /// Minimum latency of a message; up to `lcm_jitter` is added.
    pub lcm_latency: Duration,
    /// See `lcm_latency`. Messages of one process keep their order, as on one host.
    pub lcm_jitter: Duration,
    /// Probability that a receiver misses a message.
    pub lcm_loss: f64,
    /// Time from the command to start a process to its first event.
    pub start_delay: Duration,
    /// Time from the end of a process to its report.
    pub exit_delay: Duration,
    /// Maximum delay before a supervised process ([`Virtual::keep`](super::Virtual::keep)) is restarted.
    pub restart_delay_max: Duration,
    /// Serial buses with separate wire pairs for each direction.
    pub full_duplex: Vec<String>,
    /// Serial buses whose adapters hand on 64 words at once, as those on USB do; others hand on 14, as a 16550 does.
    pub usb: Vec<String>,
    /// Which senders the modules accept.
    pub policy: Policy,
    /// True if the sender of a CAN frame receives it too (UDP does, `SocketCAN` does not).
    pub can_echo: bool,
    /// Number of a frame, counted from 1 on each CAN bus as in [`Traffic::sent`](super::Traffic::sent), that no node
    /// receives although it is acknowledged: one overrun of a receiver.
    pub can_loss: Option<u64>,
    /// True if the caller publishes `SIM_DATA_CLOCK`, because it alone knows the factor: what a process publishes there
    /// is dropped.
    pub own_clock: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 1,
            // 2026-01-01T00:00:00Z.
            epoch: Epoch { offset_us: 1_767_225_600_000_000 },
            lcm_latency: Duration::from_micros(50),
            lcm_jitter: Duration::ZERO,
            lcm_loss: 0.0,
            start_delay: Duration::from_millis(20),
            exit_delay: Duration::from_micros(100),
            restart_delay_max: Duration::from_secs(10),
            full_duplex: Vec::new(),
            usb: Vec::new(),
            policy: Policy::default(),
            can_echo: false,
            can_loss: None,
            own_clock: false,
        }
    }
}
