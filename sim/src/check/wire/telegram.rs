//! What the messages of a motor controller mean, in the terms of CiA 402, by which the rules judge every drive.

use base::can::Frame;
use base::serial::Word;
use std::fmt;

/// What a heartbeat reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heartbeat {
    /// It has restarted, or was disarmed: it is not driven before it is started again.
    Down,
    /// It is started.
    Operational,
    /// Another state.
    Other,
}

/// Low byte of a controlword that drives (CiA 402-2: operation enabled).
pub(super) const DRIVE: u8 = 0x0F;
/// The one of a quick stop, and the one that takes the power away (CiA 402-2: quick stop, disable voltage).
pub(super) const QUICK_STOP: u8 = 0x0B;
pub(super) const NO_POWER: u8 = 0;
/// Statuswords (CiA 402-2): operation enabled; fault; switch on disabled.
pub(super) const OPERATION_ENABLED: u16 = 0x27;
pub(super) const FAULT: u16 = 0x08;
pub(super) const SWITCH_ON_DISABLED: u16 = 0x40;

/// What a message of a controller, or to it, means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meaning {
    /// The driver commands it: low byte of the controlword, and the target in units of the controller.
    Command(u8, f64),
    /// It reports its state: the statusword of CiA 402 that corresponds to it.
    Status(u16),
    /// It shows that it is there.
    Heartbeat(Heartbeat),
}

/// Reads the messages of one motor of a controller that is no CANopen node. It receives all traffic of its bus or line,
/// as it is sent; what has no meaning for the rules it passes over.
pub trait Reader: fmt::Debug {
    /// Takes a frame of a CAN bus; false if it is not one of this controller.
    fn on_frame(&mut self, _frame: &Frame, _tell: &mut dyn FnMut(Meaning)) -> bool {
        false
    }

    /// Takes bytes of a serial line, of the driver or of the controller.
    fn on_words(&mut self, _by_driver: bool, _words: &[Word], _tell: &mut dyn FnMut(Meaning)) {}
}

/// CRC-16 of the polynomial 0x1021 over these bytes, beginning with 0, as VESC and RoboClaw have it.
pub(super) fn crc16(bytes: impl IntoIterator<Item = u8>) -> u16 {
    bytes.into_iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ u16::from(byte) << 8, |crc, _| if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        // CRC-16/XMODEM: the check value of "123456789".
        assert_eq!(crc16(*b"123456789"), 0x31C3);
    }
}
