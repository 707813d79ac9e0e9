//! Digital output of a CANopen node that feeds the motors, as of an output module (CiA 401) with a relay on it.
//!
//! Power-up  it feeds the motors
//! Silence   of the master: the output stays as it is (0x6206 = 0)

use base::can::Frame;
use base::{Duration, Instant};
use canopen::dictionary::{Access, DataType, Entry};
use canopen::{Dictionary, Node};

/// From power or reset to the boot-up message.
const BOOT_TIME: Duration = Duration::from_millis(100);
/// Period of its heartbeat, ms.
const HEARTBEAT_MS: i64 = 200;

/// The output's object, and what it means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputConfig {
    /// Node id.
    pub node: u8,
    /// Index of the object.
    pub index: u16,
    /// Its sub-index.
    pub sub: u8,
    /// Its size: 8, 16 or 32.
    pub bits: u8,
    /// Value with which the motors are fed; with any other they are not.
    pub on: u32,
}

/// The node.
pub(crate) struct Output {
    config: OutputConfig,
    node: Node,
    /// The node neither receives nor sends until this instant.
    pub silent_until: Instant,
}

impl Output {
    /// Name, the target of faults.
    pub const NAME: &str = "output";

    pub fn new(config: OutputConfig, now: Instant) -> Self {
        let data_type = match config.bits {
            8 => DataType::U8,
            16 => DataType::U16,
            _ => DataType::U32,
        };
        let dictionary = Dictionary::new(config.node).with(&[
            // An output module.
            Entry::new(0x1000, 0, DataType::U32, Access::ReadOnly, 0x0002_0191),
            Entry::new(0x1001, 0, DataType::U8, Access::ReadOnly, 0),
            Entry::new(0x1017, 0, DataType::U16, Access::ReadWrite, HEARTBEAT_MS),
            Entry::new(config.index, config.sub, data_type, Access::ReadWrite, i64::from(config.on)),
        ]);
        let mut node = Node::new(dictionary, BOOT_TIME).without_block();
        node.power_on(now);
        Self { config, node, silent_until: Instant::ZERO }
    }

    /// True if the motors are fed.
    pub fn feeds(&self) -> bool {
        self.node.get(self.config.index, self.config.sub) == Some(i64::from(self.config.on))
    }

    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        if self.silent_until <= now {
            self.node.handle_rx(now, frame);
        }
    }

    pub fn handle_timeout(&mut self, now: Instant) {
        self.node.handle_timeout(now);
    }

    /// Next frame to send.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Frame> {
        // Events of its objects have no consumer.
        while self.node.poll_event().is_some() {}
        while let Some(frame) = self.node.poll_tx() {
            if self.silent_until <= now {
                return Some(frame);
            }
        }
        None
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.node.poll_timeout()
    }
}
