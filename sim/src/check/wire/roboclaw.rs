//! RoboClaw, packet serial, by its user manual: the speed of both motors is one request, and an answer has no number,
//! so it is read by the request before it.
//!
//! Command: the speeds of both motors (37), or their duty cycle (34), which takes the torque away with 0. It has no
//! command that is a stop and nothing else. Report: the confirmation of a command shows that it is obeyed, the status
//! (90) has the errors, and a serial timeout (15) that is off that it has restarted.

use super::telegram::{
    DRIVE, FAULT, Heartbeat, Meaning, NO_POWER, OPERATION_ENABLED, Reader, SWITCH_ON_DISABLED, crc16,
};
use base::serial::Word;

/// Requests.
const SET_TIMEOUT: u8 = 14;
const TIMEOUT: u8 = 15;
const VERSION: u8 = 21;
const DUTY: u8 = 34;
const SPEED: u8 = 37;
const STATUS: u8 = 90;
/// Confirmation of a request that writes.
const CONFIRMED: u8 = 0xFF;
/// Bits of the status that are errors.
const ERRORS: u32 = 0x0000_3FFF;
/// Bytes of the longest answer, the version with its checksum.
const ANSWER_MAX: usize = 50;

/// A motor of a RoboClaw as it is on the wire.
#[derive(Clone, Debug, PartialEq)]
pub struct RoboClaw {
    /// Address of the device.
    pub address: u8,
    /// Number of the motor, 0 or 1.
    pub motor: u8,
}

/// Reads a motor of a RoboClaw.
#[derive(Debug)]
pub struct OnLine {
    of: RoboClaw,
    /// Bytes of the request so far.
    request: Vec<u8>,
    /// The request that waits for its answer; true: its duty cycle or speed is 0 torque.
    asked: Option<(u8, bool)>,
    answer: Vec<u8>,
}

impl OnLine {
    /// Reads this one.
    #[must_use]
    pub fn new(of: RoboClaw) -> Self {
        Self { of, request: Vec::new(), asked: None, answer: Vec::new() }
    }

    /// Takes a byte of the driver.
    fn on_request(&mut self, byte: u8, tell: &mut dyn FnMut(Meaning)) {
        self.request.push(byte);
        let [address, code, ref data @ ..] = *self.request else { return };
        let length = match code {
            SET_TIMEOUT => 1 + 2,
            DUTY => 4 + 2,
            SPEED => 8 + 2,
            _ => 0,
        };
        if address != self.of.address {
            // Not the beginning of a request.
            self.request.remove(0);
            return;
        }
        if data.len() < length {
            return;
        }
        let motor = usize::from(self.of.motor);
        if code == SPEED
            && let Some(speed) = data.get(4 * motor..).and_then(|data| data.first_chunk())
        {
            tell(Meaning::Command(DRIVE, f64::from(i32::from_be_bytes(*speed))));
        }
        let released = code == DUTY && data[..4] == [0; 4];
        if released {
            tell(Meaning::Command(NO_POWER, 0.0));
        }
        self.asked = Some((code, released));
        self.request.clear();
        self.answer.clear();
    }

    /// Takes a byte of the device.
    fn on_answer(&mut self, byte: u8, tell: &mut dyn FnMut(Meaning)) {
        let Some((code, released)) = self.asked else { return };
        self.answer.push(byte);
        if self.answer.len() > ANSWER_MAX {
            self.asked = None;
            return;
        }
        if let SET_TIMEOUT | DUTY | SPEED = code {
            self.asked = None;
            if byte == CONFIRMED {
                tell(Meaning::Heartbeat(Heartbeat::Other));
                if code == SPEED {
                    tell(Meaning::Status(OPERATION_ENABLED));
                } else if released {
                    tell(Meaning::Status(SWITCH_ON_DISABLED));
                }
            }
            return;
        }
        let Some((data, crc)) = self.answer.split_last_chunk::<2>() else { return };
        // The text of the version ends with a zero.
        if data.is_empty() || code == VERSION && data.last() != Some(&0) {
            return;
        }
        let bytes = [self.of.address, code].into_iter().chain(data.iter().copied());
        if crc16(bytes) != u16::from_be_bytes(*crc) {
            return;
        }
        self.asked = None;
        match (code, data) {
            (STATUS, &[a, b, c, d]) => {
                tell(Meaning::Heartbeat(Heartbeat::Other));
                if u32::from_be_bytes([a, b, c, d]) & ERRORS != 0 {
                    tell(Meaning::Status(FAULT));
                }
            }
            (TIMEOUT, &[0]) => {
                tell(Meaning::Heartbeat(Heartbeat::Down));
                tell(Meaning::Status(SWITCH_ON_DISABLED));
            }
            (TIMEOUT, _) => tell(Meaning::Heartbeat(Heartbeat::Operational)),
            _ => tell(Meaning::Heartbeat(Heartbeat::Other)),
        }
    }
}

impl Reader for OnLine {
    fn on_words(&mut self, by_driver: bool, words: &[Word], tell: &mut dyn FnMut(Meaning)) {
        if by_driver {
            // A request is one piece: what is left of another one ended with its sender.
            self.request.clear();
        }
        for word in words {
            if by_driver {
                self.on_request(word.byte, tell);
            } else {
                self.on_answer(word.byte, tell);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the second motor is commanded and reports.
    fn exchange(reader: &mut OnLine, request: &[u8], answer: &[u8]) -> Vec<Meaning> {
        let mut all = Vec::new();
        let words = |bytes: &[u8]| bytes.iter().copied().map(Word::data).collect::<Vec<_>>();
        reader.on_words(true, &words(request), &mut |meaning| all.push(meaning));
        reader.on_words(false, &words(answer), &mut |meaning| all.push(meaning));
        all
    }

    fn written(head: &[u8], data: &[u8]) -> Vec<u8> {
        let bytes = [head, data].concat();
        let crc = crc16(bytes.iter().copied()).to_be_bytes();
        [&bytes[..], &crc].concat()
    }

    fn answered(code: u8, data: &[u8]) -> Vec<u8> {
        let crc = crc16([0x80, code].iter().chain(data).copied()).to_be_bytes();
        [data, &crc].concat()
    }

    #[test]
    fn requests_are_commands_and_answers_reports() {
        let mut reader = OnLine::new(RoboClaw { address: 0x80, motor: 1 });
        let speeds = [1000_i32.to_be_bytes(), (-2000_i32).to_be_bytes()].concat();
        let there = Meaning::Heartbeat(Heartbeat::Other);
        let enabled = Meaning::Status(OPERATION_ENABLED);
        let (drives, off) = (Meaning::Command(DRIVE, -2000.0), Meaning::Status(SWITCH_ON_DISABLED));
        for (request, answer, expected) in [
            (written(&[0x80, SPEED], &speeds), vec![CONFIRMED], vec![drives, there, enabled]),
            // Not confirmed.
            (written(&[0x80, SPEED], &speeds), vec![], vec![drives]),
            (written(&[0x80, SPEED], &[0; 8]), vec![CONFIRMED], vec![Meaning::Command(DRIVE, 0.0), there, enabled]),
            (written(&[0x80, DUTY], &[0; 4]), vec![CONFIRMED], vec![Meaning::Command(NO_POWER, 0.0), there, off]),
            (written(&[0x80, SET_TIMEOUT], &[2]), vec![CONFIRMED], vec![there]),
            (vec![0x80, STATUS], answered(STATUS, &[0; 4]), vec![there]),
            (vec![0x80, STATUS], answered(STATUS, &[0, 0, 0x10, 0]), vec![there, Meaning::Status(FAULT)]),
            // A warning is no error.
            (vec![0x80, STATUS], answered(STATUS, &[0, 1, 0, 0]), vec![there]),
            (vec![0x80, TIMEOUT], answered(TIMEOUT, &[0]), vec![Meaning::Heartbeat(Heartbeat::Down), off]),
            (vec![0x80, TIMEOUT], answered(TIMEOUT, &[2]), vec![Meaning::Heartbeat(Heartbeat::Operational)]),
            (vec![0x80, VERSION], answered(VERSION, b"RoboClaw 2x15a v4.1.34\n\0"), vec![there]),
            (vec![0x80, 18], answered(18, &[0, 0, 1, 0, 0]), vec![there]),
            // Its checksum is that of another request.
            (vec![0x80, 18], answered(19, &[0, 0, 1, 0, 0]), vec![]),
            // Noise, then a request.
            ([vec![0x11, 0x22], vec![0x80, TIMEOUT]].concat(), vec![], vec![]),
        ] {
            assert_eq!(exchange(&mut reader, &request, &answer), expected, "{request:x?} {answer:x?}");
        }
    }
}
