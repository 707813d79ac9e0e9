//! Payloads on CAN, `comm/comm_can.c` and `documentation/comm_can.md` of the firmware: 29-bit identifiers
//! `command << 8 | id of the receiver`. Up to six bytes go in one frame, longer ones in fragments of seven bytes with
//! an offset of one byte, then of six with one of two, and a last frame with length and CRC-16. Currents and ERPM have
//! frames of their own. Both ends use it.
//!
//! Fragments do not name their sender: two devices that answer to one id at the same time damage each other's answers.

use super::{Link as Way, PAYLOAD_MAX};
use crate::crc::crc16;
use base::can::{Frame, Id};
use base::{Instant, Queue};
use heapless::Vec;

/// The id that all devices receive.
pub const TO_ALL: u8 = 255;

const SET_CURRENT: u32 = 1;
const SET_RPM: u32 = 3;
const FILL: u32 = 5;
const FILL_LONG: u32 = 6;
const PROCESS: u32 = 7;
const PROCESS_SHORT: u32 = 8;
/// The payload of a command with a frame of its own begins with the number of the frame's command and this.
const PAYLOAD_OFFSET: u32 = 5;

/// Commands that move the motor or configure it, and have frames of their own (`datatypes.h`): duty cycle, current,
/// brake current, ERPM, position, the currents relative to their limits, detection of the motor, limits of current and
/// ERPM, limits of the battery, shutdown.
const SETS: [u32; 19] = [0, SET_CURRENT, 2, SET_RPM, 4, 10, 11, 12, 13, 19, 21, 22, 23, 24, 25, 26, 29, 30, 31];
/// Payloads that only ask, and their answers: COMM_FW_VERSION, COMM_GET_VALUES, COMM_GET_MCCONF and COMM_GET_APPCONF
/// with their defaults, COMM_PRINT, COMM_ROTOR_POSITION, COMM_GET_DECODED_PPM, _ADC and _CHUK, COMM_GET_VALUES_SETUP,
/// and the selective ones. Any other payload counts as a command, COMM_ALIVE too, which feeds the timeout.
const ASKS_IN_PAYLOADS: [u8; 14] = [0, 4, 14, 15, 17, 18, 21, 22, 31, 32, 33, 47, 50, 51];

/// Bytes of a payload that go in one frame.
const SHORT_MAX: usize = 6;
/// Greatest offset of one byte.
const FILL_OFFSET_MAX: usize = 255;
/// Frames of the longest payload, and some more.
const FRAMES: usize = 96;

/// True for a frame by which anybody but the host `own` commands or configures the device `id`, or all. Frames of
/// commands do not name their sender: those of the host count, too.
#[must_use]
pub(crate) fn is_command(frame: &Frame, id: u8, own: u8) -> bool {
    let Id::Extended(identifier) = frame.id() else { return false };
    if ![id, TO_ALL].contains(&(identifier as u8)) || frame.is_remote() {
        return false;
    }
    match (identifier >> 8, frame.data()) {
        (PROCESS_SHORT, [sender, _, command, ..]) => *sender != own && !ASKS_IN_PAYLOADS.contains(command),
        (FILL, [0, command, ..]) => !ASKS_IN_PAYLOADS.contains(command),
        (command, _) => SETS.contains(&command),
    }
}

/// Whether a payload is a request, or the answer to one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Host,
    Device,
}

impl Role {
    /// What the frame says of a payload that this end sends: to be answered, or an answer.
    fn sends(self) -> u8 {
        match self {
            Self::Host => 0,
            Self::Device => 1,
        }
    }
}

/// One end of the bus.
#[derive(Debug)]
pub struct Link {
    role: Role,
    own: u8,
    peer: u8,
    /// Fragments received so far.
    rx: Vec<u8, PAYLOAD_MAX>,
    frames: Queue<Frame, FRAMES>,
}

impl Link {
    /// The end of the host `own`, for the device `peer`.
    #[must_use]
    pub fn host(own: u8, peer: u8) -> Self {
        Self { role: Role::Host, own, peer, rx: Vec::new(), frames: Queue::new() }
    }

    /// The end of a device, which answers to whom it was asked by.
    #[must_use]
    pub fn device(own: u8) -> Self {
        Self { role: Role::Device, own, peer: TO_ALL, rx: Vec::new(), frames: Queue::new() }
    }

    fn push(&mut self, command: u32, head: &[u8], data: &[u8]) {
        let bytes: Vec<u8, 8> = head.iter().chain(data).copied().collect();
        let id = Id::Extended(command << 8 | u32::from(self.peer));
        self.frames.push(Frame::new(id, &bytes).expect("an id of 16 bits, at most 8 bytes"));
    }

    fn fragments(&mut self, payload: &[u8]) {
        let mut offset = 0;
        while offset < payload.len() {
            let is_long = offset > FILL_OFFSET_MAX;
            let end = payload.len().min(offset + if is_long { 6 } else { 7 });
            let [high, low] = (offset as u16).to_be_bytes();
            let (command, head) = if is_long { (FILL_LONG, &[high, low][..]) } else { (FILL, &[low][..]) };
            self.push(command, head, &payload[offset..end]);
            offset = end;
        }
        let [length, crc] = [payload.len() as u16, crc16(0, payload)].map(u16::to_be_bytes);
        let head = [self.own, self.role.sends()];
        self.push(PROCESS, &head, &[length[0], length[1], crc[0], crc[1]]);
    }

    /// Takes a fragment; false if it does not continue what was received.
    fn fill(&mut self, offset: usize, data: &[u8]) -> bool {
        if offset == 0 {
            self.rx.clear();
        }
        offset == self.rx.len() && self.rx.extend_from_slice(data).is_ok()
    }

    /// True if a payload from this sender, with this byte of its use, is for this end.
    fn accepts(&mut self, sender: u8, sends: u8) -> bool {
        match self.role {
            Role::Host => sender == self.peer && sends == Role::Device.sends(),
            Role::Device => {
                self.peer = sender;
                sends == Role::Host.sends()
            }
        }
    }
}

impl Way for Link {
    type Rx = Frame;
    type Tx = Frame;

    fn send(&mut self, payload: &[u8]) {
        match *payload {
            [] => {}
            [command @ 6..=8, ref value @ ..] if value.len() == 4 && self.role == Role::Host => {
                self.push(u32::from(command) - PAYLOAD_OFFSET, &[], value);
            }
            _ if payload.len() <= SHORT_MAX => self.push(PROCESS_SHORT, &[self.own, self.role.sends()], payload),
            _ if payload.len() <= PAYLOAD_MAX => self.fragments(payload),
            _ => {}
        }
    }

    fn receive(&mut self, _: Instant, frame: &Frame, take: &mut dyn FnMut(&[u8])) -> u32 {
        let Id::Extended(id) = frame.id() else { return 0 };
        if id as u8 != self.own || frame.is_remote() {
            return 0;
        }
        let is_taken = match (id >> 8, frame.data()) {
            (FILL, [offset, data @ ..]) => self.fill(usize::from(*offset), data),
            (FILL_LONG, [high, low, data @ ..]) => self.fill(usize::from(u16::from_be_bytes([*high, *low])), data),
            (PROCESS, [sender, sends, length @ .., crc_high, crc_low]) => {
                let payload = core::mem::take(&mut self.rx);
                let is_whole = *length == (payload.len() as u16).to_be_bytes()
                    && crc16(0, &payload).to_be_bytes() == [*crc_high, *crc_low];
                let is_taken = is_whole && self.accepts(*sender, *sends);
                if is_taken {
                    take(&payload);
                }
                is_taken
            }
            (PROCESS_SHORT, [sender, sends, payload @ ..]) => {
                let is_taken = self.accepts(*sender, *sends);
                if is_taken {
                    take(payload);
                }
                is_taken
            }
            (command @ SET_CURRENT..=SET_RPM, [a, b, c, d]) if self.role == Role::Device => {
                take(&[(command + PAYLOAD_OFFSET) as u8, *a, *b, *c, *d]);
                true
            }
            _ => false,
        };
        u32::from(!is_taken)
    }

    fn poll_tx(&mut self) -> Option<Frame> {
        self.frames.pop()
    }

    fn clear(&mut self) {
        self.frames.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::super::payload::Request;
    use super::*;
    use testing::Random;

    fn received(link: &mut Link, frame: &Frame) -> (std::vec::Vec<std::vec::Vec<u8>>, u32) {
        let mut payloads = std::vec::Vec::new();
        let damaged = link.receive(Instant::ZERO, frame, &mut |payload| payloads.push(payload.to_vec()));
        (payloads, damaged)
    }

    /// documentation/comm_can.md: 51 A to VESC 23 is 0x0117 with 00 00 C7 38.
    #[test]
    fn commands_are_the_frames_of_the_documents() {
        let mut link = Link::host(254, 23);
        link.send(&Request::SetCurrent(51.0).bytes());
        link.send(&Request::SetBrake(0.5).bytes());
        link.send(&Request::SetRpm(3000).bytes());
        link.send(&Request::Values.bytes());
        let expected: [(u32, &[u8]); 4] = [
            (0x0117, &[0x00, 0x00, 0xC7, 0x38]),
            (0x0217, &[0x00, 0x00, 0x01, 0xF4]),
            (0x0317, &[0x00, 0x00, 0x0B, 0xB8]),
            (0x0817, &[254, 0, 50, 0x00, 0x22, 0xA1, 0x85]),
        ];
        for (id, data) in expected {
            assert_eq!(link.poll_tx(), Frame::new(Id::Extended(id), data));
        }
    }

    #[test]
    fn payloads_of_all_lengths_return_from_the_device() {
        let (mut host, mut device, mut random) = (Link::host(254, 23), Link::device(23), Random::new(2));
        for len in 1..=PAYLOAD_MAX {
            host.send(&[0]);
            let asked = host.poll_tx().unwrap();
            assert_eq!(received(&mut device, &asked), (std::vec![std::vec![0]], 0));
            let payload = random.bytes(len);
            device.send(&payload);
            let mut payloads = std::vec::Vec::new();
            while let Some(frame) = device.poll_tx() {
                let (more, damaged) = received(&mut host, &frame);
                assert_eq!(damaged, 0);
                payloads.extend(more);
            }
            assert_eq!(payloads, [payload], "{len}");
        }
    }

    #[test]
    fn lost_fragments_other_senders_and_other_ids_pass_nothing_on() {
        let mut device = Link::device(23);
        received(&mut device, &Frame::new(Id::Extended(0x0817), &[254, 0, 0]).unwrap());
        device.send(&[9; 40]);
        let frames: std::vec::Vec<Frame> = core::iter::from_fn(|| device.poll_tx()).collect();
        for lost in 0..frames.len() - 1 {
            let mut host = Link::host(254, 23);
            for (_, frame) in frames.iter().enumerate().filter(|(n, _)| *n != lost) {
                assert_eq!(received(&mut host, frame).0.len(), 0);
            }
        }
        for mut host in [Link::host(254, 22), Link::host(253, 23)] {
            assert!(frames.iter().all(|frame| received(&mut host, frame).0.is_empty()));
        }
    }

    #[test]
    fn any_frames_are_received_without_a_panic() {
        let (mut host, mut device, mut random) = (Link::host(254, 23), Link::device(254), Random::new(6));
        for _ in 0..100_000 {
            let len = random.index(9);
            let data: std::vec::Vec<u8> = (0..len).map(|_| random.edge_byte()).collect();
            let frame = Frame::new(Id::Extended((random.below(12) << 8 | 254) as u32), &data).unwrap();
            received(&mut host, &frame);
            received(&mut device, &frame);
        }
    }
}
