//! The wire of a gamepad: one end tells, the others hear it at once.

use super::owner::Owner;
use base::gamepad::{self, Device, Event};

/// One wire.
#[derive(Debug, Default)]
pub(super) struct GamepadWire {
    pub ports: Vec<Owner>,
    /// What is plugged in, as it was told, and by which process; 0: by the test.
    device: Option<Box<Device>>,
    by: u32,
}

impl GamepadWire {
    /// A process tells something.
    pub fn tell(&mut self, pid: u32, event: &Event) {
        if let Event::Found(_) = event {
            self.by = pid;
        }
        gamepad::keep(&mut self.device, event);
    }

    /// What a port that is opened now has to know.
    pub fn present(&self) -> Option<Event> {
        self.device.clone().map(Event::Found)
    }

    /// A process has ended; true when the gamepad goes with it.
    pub fn close(&mut self, pid: u32) -> bool {
        self.ports.retain(|owner| owner.pid != pid);
        self.by == pid && self.device.take().is_some()
    }
}
