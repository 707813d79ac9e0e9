//! How a virtual machine is made.

use base::{Duration, Epoch};

/// Parameters of the virtual machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The one source of chance.
    pub seed: u64,
    /// Message timestamps count from here.
    pub epoch: Epoch,
    /// A message takes this long, and up to `lcm_jitter` longer.
    pub lcm_latency: Duration,
    /// See `lcm_latency`. Messages of one process keep their order, as on one host.
    pub lcm_jitter: Duration,
    /// Probability that a receiver misses a message.
    pub lcm_loss: f64,
    /// From the order to start a process to its first event.
    pub start_delay: Duration,
    /// From the end of a process to the news of it.
    pub exit_delay: Duration,
    /// The greatest delay before a process that is kept ([`Virtual::keep`](super::Virtual::keep)) is started again.
    pub restart_delay_max: Duration,
    /// Serial buses with a pair of wires each way.
    pub full_duplex: Vec<String>,
    /// True if who sends a CAN frame receives it too (UDP does, `SocketCAN` does not).
    pub can_echo: bool,
    /// Number of a frame, counted from 1 on each CAN bus as in [`Traffic::sent`](super::Traffic::sent), that no node
    /// receives although it is acknowledged: one overrun of a receiver.
    pub can_loss: Option<u64>,
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
            can_echo: false,
            can_loss: None,
        }
    }
}
