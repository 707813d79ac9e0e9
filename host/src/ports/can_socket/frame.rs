//! `struct can_frame` (linux/can.h) and the kernel's error frames (linux/can/error.h).

use base::can::{BusState, Frame, Health, Id, Notice};

/// Size of a frame: identifier and flags, length, three bytes of padding, data.
pub const FRAME: usize = 16;
// linux/can.h
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;
// linux/can/error.h: classes
const TX_TIMEOUT: u32 = 0x0001;
const CONTROLLER: u32 = 0x0004;
const PROTOCOL: u32 = 0x0008;
const TRANSCEIVER: u32 = 0x0010;
const ACK: u32 = 0x0020;
const BUS_OFF: u32 = 0x0040;
const BUS_ERROR: u32 = 0x0080;
const RESTARTED: u32 = 0x0100;
const COUNTERS: u32 = 0x0200;
/// All classes except lost arbitration, which is not an error.
pub const ERRORS: u32 =
    TX_TIMEOUT | CONTROLLER | PROTOCOL | TRANSCEIVER | ACK | BUS_OFF | BUS_ERROR | RESTARTED | COUNTERS;
// The controller's state, byte 1.
const RX_OVERFLOW: u8 = 0x01;
const TX_OVERFLOW: u8 = 0x02;
const WARNING: u8 = 0x04 | 0x08;
const PASSIVE: u8 = 0x10 | 0x20;
const ACTIVE: u8 = 0x40;
/// Position of an error in a frame, byte 3: the acknowledge slot.
const IN_ACK_SLOT: u8 = 0x19;

/// Decoded frame of the socket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KernelFrame {
    /// A frame from the bus.
    Frame(Frame),
    /// An error frame of the kernel.
    Error(Error),
}

/// Content of an error frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Error {
    /// State and error counters of the controller, if contained.
    pub health: Option<Health>,
    /// No node acknowledged a frame.
    pub no_acknowledge: bool,
    /// A frame had an error on the wire.
    pub on_the_wire: bool,
    /// The controller's receive buffer overflowed.
    pub lost: bool,
    /// Explanation for people.
    pub note: Option<&'static str>,
}

impl Error {
    /// True if the controller is bus-off.
    pub fn is_off(&self) -> bool {
        self.health.is_some_and(|health| health.state == BusState::Off)
    }

    /// Notices for the module; errors on the wire are counted instead.
    pub fn notices(&self) -> impl Iterator<Item = Notice> {
        let lost = self.lost.then_some(Notice::Lost(1));
        let alone = self.no_acknowledge.then_some(Notice::NoAcknowledge);
        self.health.map(Notice::Health).into_iter().chain(alone).chain(lost)
    }
}

/// Encodes a frame in the kernel's layout.
pub fn encode(frame: &Frame) -> [u8; FRAME] {
    let id = match frame.id() {
        Id::Standard(id) => u32::from(id),
        Id::Extended(id) => id | EXTENDED,
    };
    let id = if frame.is_remote() { id | REMOTE } else { id };
    let mut raw = [0; FRAME];
    raw[..4].copy_from_slice(&id.to_ne_bytes());
    raw[4] = frame.dlc();
    raw[8..8 + frame.data().len()].copy_from_slice(frame.data());
    raw
}

/// Decodes a frame in the kernel's layout; `None` if it is invalid.
pub fn decode(raw: &[u8; FRAME]) -> Option<KernelFrame> {
    let flags = u32::from_ne_bytes([raw[0], raw[1], raw[2], raw[3]]);
    if flags & ERROR != 0 {
        return Some(KernelFrame::Error(error(flags, &raw[8..])));
    }
    let id = match flags & EXTENDED {
        0 => Id::Standard((flags & 0x7FF) as u16),
        _ => Id::Extended(flags & 0x1FFF_FFFF),
    };
    let length = raw[4].min(8);
    let frame = match flags & REMOTE {
        0 => Frame::new(id, &raw[8..8 + usize::from(length)]),
        _ => Frame::remote(id, length),
    };
    frame.map(KernelFrame::Frame)
}

fn error(class: u32, data: &[u8]) -> Error {
    let is = |mask: u32| class & mask != 0;
    let controller = if is(CONTROLLER) { data[1] } else { 0 };
    let in_ack_slot = is(PROTOCOL) && data[3] == IN_ACK_SLOT;
    Error {
        health: health(class, controller, data[6], data[7]),
        no_acknowledge: is(ACK) || in_ack_slot,
        on_the_wire: is(PROTOCOL | BUS_ERROR) && !is(ACK) && !in_ack_slot,
        lost: controller & RX_OVERFLOW != 0,
        note: match () {
            () if is(TX_TIMEOUT) => Some("a frame did not leave the controller and was dropped by the kernel"),
            () if is(TRANSCEIVER) => Some("the transceiver reports an error: check the cable and its supply"),
            () if controller & TX_OVERFLOW != 0 => Some("the controller's transmit buffer overflowed"),
            () if is(RESTARTED) => Some("the controller was restarted"),
            () => None,
        },
    }
}

/// The counters are in bytes 6 and 7. Before Linux 6.0 no flag marks them, but many drivers fill them in when they
/// report a change of state.
fn health(class: u32, controller: u8, transmit_errors: u8, receive_errors: u8) -> Option<Health> {
    let counted = BusState::of(transmit_errors, receive_errors);
    let state = match () {
        () if class & BUS_OFF != 0 => BusState::Off,
        () if class & RESTARTED != 0 => counted,
        () if controller & PASSIVE != 0 => BusState::Passive,
        () if controller & WARNING != 0 => BusState::Warning,
        () if controller & ACTIVE != 0 => BusState::Active,
        () if class & COUNTERS != 0 => counted,
        () => return None,
    };
    Some(Health { state, transmit_errors, receive_errors })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_survive_the_kernel_s_layout() {
        let frames = [
            Frame::standard(0x181, &[1, 2, 3]),
            Frame::remote(Id::Standard(0x701), 1).unwrap(),
            Frame::new(Id::Extended(0x1FFF_FFFF), &[0xFF; 8]).unwrap(),
        ];
        for frame in frames {
            assert_eq!(decode(&encode(&frame)), Some(KernelFrame::Frame(frame)));
        }
    }

    /// An error frame as `candump -L` prints it: class, data.
    fn told(class: u32, data: u64) -> Error {
        let mut raw = [0; FRAME];
        raw[..4].copy_from_slice(&(ERROR | class).to_ne_bytes());
        raw[4] = 8;
        raw[8..].copy_from_slice(&data.to_be_bytes());
        let Some(KernelFrame::Error(error)) = decode(&raw) else { panic!("{class:x}") };
        error
    }

    #[test]
    fn every_error_class_says_what_it_means() {
        let health = |state, transmit_errors, receive_errors| Some(Health { state, transmit_errors, receive_errors });
        // As can-dev and the SJA1000's driver fill it (linux/can/error.h).
        let passive = told(0x204, 0x0020_0000_0000_8000);
        assert_eq!(passive, Error { health: health(BusState::Passive, 128, 0), ..Error::default() });
        assert_eq!(told(0x204, 0x0008_0000_0000_6000).health, health(BusState::Warning, 96, 0));
        assert_eq!(told(0x204, 0x0040_0000_0000_0510).health, health(BusState::Active, 5, 16));
        let off = told(0x240, 0x0000_0000_0000_F800);
        assert!(off.is_off() && off.health == health(BusState::Off, 248, 0));
        assert_eq!(told(0x100, 0).health, health(BusState::Active, 0, 0));
        assert_eq!(told(0x20, 0), Error { no_acknowledge: true, ..Error::default() });
        // A bus error in the acknowledge slot, then one in the data.
        assert_eq!(told(0x88, 0x0000_8019_0000_0000), Error { no_acknowledge: true, ..Error::default() });
        assert_eq!(told(0x88, 0x0000_040A_0000_0000), Error { on_the_wire: true, ..Error::default() });
        assert!(told(0x204, 0x0001_0000_0000_0000).lost);
        assert!(told(0x001, 0).note.is_some() && told(0x010, 0).note.is_some());
        // Before 6.0: class CONTROLLER with counters but without their flag.
        assert_eq!(told(0x004, 0x0010_0000_0000_0080).health, health(BusState::Passive, 0, 128));
        assert_eq!(told(0x002, 0xFF00_0000_0000_0000), Error::default());
    }

    #[test]
    fn no_flags_and_data_do_harm() {
        let mut random = 1u64;
        for _ in 0..100_000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let mut raw = [0; FRAME];
            raw[..8].copy_from_slice(&random.to_le_bytes());
            raw[8..].copy_from_slice(&random.rotate_left(17).to_le_bytes());
            let _ = decode(&raw);
        }
    }
}
