//! VESC, on CAN with 29-bit identifiers or on a UART, by the published source of its firmware (`datatypes.h`,
//! `comm/comm_can.c`, `comm/packet.c`, `comm/commands.c`).
//!
//! Command: ERPM, or a brake current. The current of a quick stop is a stop, unless it is the one that holds the wheel
//! near zero, too; a motor current of 0 takes the torque away. Report: the answer to the question for its values, which
//! has the fault code and whether the command time limit has acted.

use super::telegram::{
    DRIVE, FAULT, Heartbeat, Meaning, NO_POWER, OPERATION_ENABLED, QUICK_STOP, Reader, SWITCH_ON_DISABLED, crc16,
};
use base::can::{Frame, Id};
use base::serial::Word;

/// Payloads: COMM_SET_CURRENT, COMM_SET_CURRENT_BRAKE, COMM_SET_RPM, COMM_GET_VALUES_SELECTIVE.
const SET_CURRENT: u8 = 6;
const SET_CURRENT_BRAKE: u8 = 7;
const SET_RPM: u8 = 8;
const GET_VALUES_SELECTIVE: u8 = 50;
/// Bytes of the values that the driver asks for: command, mask, power stage, current, ERPM, supply, tachometer; behind
/// them fault, id and state.
const VALUES_HEAD: usize = 1 + 4 + 2 + 4 + 4 + 2 + 4;
/// Bit of the state: the command time limit has acted.
const TIMED_OUT: u8 = 1;

/// Frames of CAN: the commands above, less this; fragments of a payload, its end, a short payload.
const PAYLOAD_OFFSET: u32 = 5;
const FILL: u32 = 5;
const FILL_LONG: u32 = 6;
const PROCESS: u32 = 7;
const PROCESS_SHORT: u32 = 8;
/// Frame of CAN that sets the limits of the motor's currents (CAN_PACKET_CONF_CURRENT_LIMITS).
const CONF_CURRENT_LIMITS: u32 = 21;
/// Frames that ask for nothing, and change something: commands of the motor and its limits, shutdown.
const CHANGES: [u32; 19] = [0, 1, 2, 3, 4, 10, 11, 12, 13, 19, 21, 22, 23, 24, 25, 26, 29, 30, 31];
/// The id that all devices receive.
const TO_ALL: u8 = 255;

/// UART: first byte of a packet with a length of one byte, and of two; last byte.
const SHORT: u8 = 2;
const LONG: u8 = 3;
const END: u8 = 3;
/// The longest payload.
const PAYLOAD_MAX: usize = 512;

/// A VESC as it is on the wire.
#[derive(Clone, Debug, PartialEq)]
pub struct Vesc {
    /// VESC id.
    pub id: u8,
    /// The id to which it answers on CAN; on a UART no matter.
    pub host: u8,
    /// Brake current near and at zero velocity, mA.
    pub hold_ma: i32,
    /// Brake current of a quick stop, mA.
    pub quick_stop_ma: i32,
}

impl Vesc {
    /// Meaning of a payload of the driver.
    fn commanded(&self, payload: &[u8]) -> Option<Meaning> {
        let (command, value) = payload.split_first()?;
        let value = i32::from_be_bytes(*value.first_chunk().filter(|bytes| bytes.len() == value.len())?);
        Some(match *command {
            SET_RPM => Meaning::Command(DRIVE, f64::from(value)),
            SET_CURRENT_BRAKE if value == self.quick_stop_ma && value != self.hold_ma => {
                Meaning::Command(QUICK_STOP, 0.0)
            }
            SET_CURRENT_BRAKE => Meaning::Command(DRIVE, 0.0),
            SET_CURRENT => Meaning::Command(NO_POWER, 0.0),
            _ => return None,
        })
    }

    /// Meaning of a payload of the device.
    fn reported(&self, payload: &[u8], tell: &mut dyn FnMut(Meaning)) {
        let Some((head, &[fault, id, state])) = payload.split_at_checked(VALUES_HEAD) else { return };
        if head.first() != Some(&GET_VALUES_SELECTIVE) || id != self.id {
            return;
        }
        let timed_out = state & TIMED_OUT != 0;
        let (status, heartbeat) = match (fault, timed_out) {
            (0, false) => (OPERATION_ENABLED, Heartbeat::Operational),
            (0, true) => (SWITCH_ON_DISABLED, Heartbeat::Down),
            _ => (FAULT, Heartbeat::Other),
        };
        tell(Meaning::Heartbeat(heartbeat));
        tell(Meaning::Status(status));
    }

    /// The frame that commands this ERPM.
    #[must_use]
    pub fn drive_at(&self, erpm: f64) -> Option<Frame> {
        self.frame(u32::from(SET_RPM) - PAYLOAD_OFFSET, &(erpm as i32).to_be_bytes())
    }

    /// The frame by which another program takes the torque away.
    #[must_use]
    pub fn foreign_stop(&self) -> Option<Frame> {
        self.frame(u32::from(SET_CURRENT) - PAYLOAD_OFFSET, &[0; 4])
    }

    /// The frame by which another program takes the brake away: no current in either direction.
    #[must_use]
    pub fn foreign_parameter(&self) -> Option<Frame> {
        self.frame(CONF_CURRENT_LIMITS, &[0; 8])
    }

    fn frame(&self, command: u32, data: &[u8]) -> Option<Frame> {
        Frame::new(Id::Extended(command << 8 | u32::from(self.id)), data)
    }

    /// True for a frame that commands the device, or changes something in it.
    #[must_use]
    pub fn is_command(&self, frame: &Frame) -> bool {
        let Id::Extended(id) = frame.id() else { return false };
        let [_, _, _, to] = id.to_be_bytes();
        [self.id, TO_ALL].contains(&to) && CHANGES.contains(&(id >> 8))
    }
}

/// Reads a VESC on CAN.
#[derive(Debug)]
pub struct OnCan {
    vesc: Vesc,
    /// Fragments of its answer so far.
    answer: Vec<u8>,
}

impl OnCan {
    /// Reads this one.
    #[must_use]
    pub fn new(vesc: Vesc) -> Self {
        Self { vesc, answer: Vec::new() }
    }

    fn fill(&mut self, offset: usize, data: &[u8]) {
        if offset == 0 {
            self.answer.clear();
        }
        if offset == self.answer.len() && offset + data.len() <= PAYLOAD_MAX {
            self.answer.extend_from_slice(data);
        }
    }
}

impl Reader for OnCan {
    fn on_frame(&mut self, frame: &Frame, tell: &mut dyn FnMut(Meaning)) -> bool {
        let Id::Extended(id) = frame.id() else { return false };
        let ([_, _, _, to], command) = (id.to_be_bytes(), id >> 8);
        if to == self.vesc.id {
            if let 1..=3 = command {
                let payload: Vec<u8> = [(command + PAYLOAD_OFFSET) as u8].iter().chain(frame.data()).copied().collect();
                self.vesc.commanded(&payload).into_iter().for_each(tell);
            }
            return true;
        }
        if to != self.vesc.host {
            return false;
        }
        match (command, frame.data()) {
            (FILL, [offset, data @ ..]) => self.fill(usize::from(*offset), data),
            (FILL_LONG, [high, low, data @ ..]) => self.fill(usize::from(u16::from_be_bytes([*high, *low])), data),
            (PROCESS, [sender, _, length @ .., high, low]) => {
                let payload = std::mem::take(&mut self.answer);
                let is_whole = *length == (payload.len() as u16).to_be_bytes()
                    && crc16(payload.iter().copied()) == u16::from_be_bytes([*high, *low]);
                if is_whole && *sender == self.vesc.id {
                    self.vesc.reported(&payload, tell);
                }
            }
            (PROCESS_SHORT, [sender, _, payload @ ..]) if *sender == self.vesc.id => self.vesc.reported(payload, tell),
            _ => {}
        }
        true
    }
}

/// Bytes of one direction of a UART that are no whole packet yet.
#[derive(Debug, Default)]
struct Packets(Vec<u8>);

impl Packets {
    /// The next whole payload.
    fn next(&mut self) -> Option<Vec<u8>> {
        loop {
            let (start, length) = match *self.0 {
                [] | [SHORT] | [LONG] | [LONG, _] => return None,
                [SHORT, length, ..] if length > 0 => (2, usize::from(length)),
                [LONG, high, low, ..] => (3, usize::from(u16::from_be_bytes([high, low]))),
                _ => (0, 0),
            };
            if length == 0 || length > PAYLOAD_MAX {
                self.0.remove(0);
                continue;
            }
            let end = start + length;
            let tail = self.0.get(end..end + 3)?;
            let [high, low] = crc16(self.0[start..end].iter().copied()).to_be_bytes();
            if *tail != [high, low, END] {
                self.0.remove(0);
                continue;
            }
            let payload = self.0[start..end].to_vec();
            self.0.drain(..end + 3);
            return Some(payload);
        }
    }
}

/// Reads a VESC on a UART.
#[derive(Debug)]
pub struct OnUart {
    vesc: Vesc,
    of_driver: Packets,
    of_device: Packets,
}

impl OnUart {
    /// Reads this one.
    #[must_use]
    pub fn new(vesc: Vesc) -> Self {
        Self { vesc, of_driver: Packets::default(), of_device: Packets::default() }
    }
}

impl Reader for OnUart {
    fn on_words(&mut self, by_driver: bool, words: &[Word], tell: &mut dyn FnMut(Meaning)) {
        let packets = if by_driver { &mut self.of_driver } else { &mut self.of_device };
        packets.0.extend(words.iter().map(|word| word.byte));
        while let Some(payload) = packets.next() {
            if by_driver {
                self.vesc.commanded(&payload).into_iter().for_each(&mut *tell);
            } else {
                self.vesc.reported(&payload, tell);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vesc() -> Vesc {
        Vesc { id: 23, host: 151, hold_ma: 10_000, quick_stop_ma: 30_000 }
    }

    /// Payload of the answer with fault, id and state.
    fn values(fault: u8, id: u8, state: u8) -> Vec<u8> {
        [[GET_VALUES_SELECTIVE].as_slice(), &[0; VALUES_HEAD - 1], &[fault, id, state]].concat()
    }

    fn read(of: impl FnOnce(&mut dyn FnMut(Meaning))) -> Vec<Meaning> {
        let mut all = Vec::new();
        of(&mut |meaning| all.push(meaning));
        all
    }

    const STATES: [(u8, u8, Heartbeat, u16); 3] = [
        (0, 0, Heartbeat::Operational, OPERATION_ENABLED),
        (0, TIMED_OUT, Heartbeat::Down, SWITCH_ON_DISABLED),
        (4, 0, Heartbeat::Other, FAULT),
    ];

    #[test]
    fn frames_of_can_are_commands_and_reports() {
        // documentation/comm_can.md: ERPM to VESC 23 is 0x0317, a brake current 0x0217, a current 0x0117.
        let frame = |id, data: &[u8]| Frame::new(Id::Extended(id), data).unwrap();
        let mut reader = OnCan::new(vesc());
        for (id, data, expected) in [
            (0x0317, 3000_i32.to_be_bytes(), vec![Meaning::Command(DRIVE, 3000.0)]),
            (0x0317, (-3000_i32).to_be_bytes(), vec![Meaning::Command(DRIVE, -3000.0)]),
            (0x0217, 10_000_i32.to_be_bytes(), vec![Meaning::Command(DRIVE, 0.0)]),
            (0x0217, 30_000_i32.to_be_bytes(), vec![Meaning::Command(QUICK_STOP, 0.0)]),
            (0x0117, [0; 4], vec![Meaning::Command(NO_POWER, 0.0)]),
            (0x0817, [151, 0, 50, 0], vec![]),
            (0x0318, 3000_i32.to_be_bytes(), vec![]),
        ] {
            let of = frame(id, &data);
            assert_eq!(read(|tell| _ = reader.on_frame(&of, tell)), expected, "{id:#x} {data:?}");
        }
        for (fault, state, heartbeat, status) in STATES {
            let payload = values(fault, 23, state);
            let [high, low] = crc16(payload.iter().copied()).to_be_bytes();
            let mut frames: Vec<Frame> = Vec::new();
            for (number, part) in payload.chunks(7).enumerate() {
                frames.push(frame(0x0597, &[&[number as u8 * 7], part].concat()));
            }
            frames.push(frame(0x0797, &[23, 1, 0, payload.len() as u8, high, low]));
            let all = read(|tell| frames.iter().for_each(|frame| _ = reader.on_frame(frame, tell)));
            assert_eq!(all, [Meaning::Heartbeat(heartbeat), Meaning::Status(status)]);
            // A fragment less.
            frames.remove(1);
            assert_eq!(read(|tell| frames.iter().for_each(|frame| _ = reader.on_frame(frame, tell))), []);
        }
    }

    #[test]
    fn packets_of_a_uart_are_commands_and_reports_in_any_pieces() {
        let packet = |payload: &[u8]| {
            let [high, low] = crc16(payload.iter().copied()).to_be_bytes();
            [&[SHORT, payload.len() as u8], payload, &[high, low, END]].concat()
        };
        let command = packet(&[&[SET_RPM][..], &(-700_i32).to_be_bytes()].concat());
        for piece in [1, 3, 64] {
            let mut reader = OnUart::new(vesc());
            let mut pass = |by_driver, bytes: &[u8]| {
                let words: Vec<Word> = bytes.iter().copied().map(Word::data).collect();
                read(|tell| words.chunks(piece).for_each(|words| reader.on_words(by_driver, words, tell)))
            };
            // Noise before a packet does not take the packet away.
            assert_eq!(pass(true, &[&[0xFF, SHORT, 0], &command[..]].concat()), [Meaning::Command(DRIVE, -700.0)]);
            let broken: Vec<u8> = command.iter().enumerate().map(|(at, byte)| byte ^ u8::from(at == 4)).collect();
            assert_eq!(pass(true, &broken), []);
            assert_eq!(pass(true, &command), [Meaning::Command(DRIVE, -700.0)]);
            for (fault, state, heartbeat, status) in STATES {
                let expected = [Meaning::Heartbeat(heartbeat), Meaning::Status(status)];
                assert_eq!(pass(false, &packet(&values(fault, 23, state))), expected);
                assert_eq!(pass(false, &packet(&values(fault, 24, state))), []);
            }
        }
    }

    #[test]
    fn what_another_program_sends_is_a_command() {
        let vesc = vesc();
        for frame in [vesc.drive_at(300.0), vesc.foreign_stop(), vesc.foreign_parameter()].map(Option::unwrap) {
            assert!(vesc.is_command(&frame), "{frame:?}");
            assert!(!Vesc { id: 24, ..vesc.clone() }.is_command(&frame), "{frame:?}");
        }
        assert!(!vesc.is_command(&Frame::new(Id::Extended(0x0817), &[151, 0, 50]).unwrap()));
        assert!(!vesc.is_command(&Frame::standard(0x317, &[0; 4])));
    }
}
