//! The wire of a gamepad: events of one end reach the others at once.

use super::owner::Owner;
use base::gamepad::{self, Device, Event};

/// One wire.
#[derive(Debug, Default)]
pub(super) struct GamepadWire {
    pub ports: Vec<Owner>,
    /// The gamepad as described last, and the process that simulates it; 0: the test.
    device: Option<Box<Device>>,
    by: u32,
}

impl GamepadWire {
    /// Processes an event sent by a process.
    pub fn tell(&mut self, pid: u32, event: &Event) {
        if let Event::Found(_) = event {
            self.by = pid;
        }
        gamepad::keep(&mut self.device, event);
    }

    /// Event that describes the gamepad to a newly opened port.
    pub fn present(&self) -> Option<Event> {
        self.device.clone().map(Event::Found)
    }

    /// A process has ended; true if the gamepad disappears with it.
    pub fn close(&mut self, pid: u32) -> bool {
        self.ports.retain(|owner| owner.pid != pid);
        self.by == pid && self.device.take().is_some()
    }
}
