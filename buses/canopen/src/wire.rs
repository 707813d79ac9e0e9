//! Wire formats: identifiers, NMT, error control, emergency, SYNC. Stateless; all numbers are little endian. SDO
//! frames: [`sdo`].

pub mod sdo;

use base::can::{Frame, Id};
use base::listed;

/// The service that an 11-bit identifier belongs to in the pre-defined connection set (CiA 301, 9.3.2). PDOs are
/// named from the node's side and numbered 1 to 4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)] // node: 1..=127, number: 1..=4
pub enum Service {
    Nmt,
    Sync,
    Time,
    Emergency {
        node: u8,
    },
    Tpdo {
        node: u8,
        number: u8,
    },
    Rpdo {
        node: u8,
        number: u8,
    },
    SdoResponse {
        node: u8,
    },
    SdoRequest {
        node: u8,
    },
    ErrorControl {
        node: u8,
    },
    /// From the LSS slave (CiA 305).
    LssResponse,
    /// From the LSS master.
    LssRequest,
}

impl Service {
    /// The identifier of a service.
    #[must_use]
    pub const fn cob_id(self) -> u16 {
        let (base, node) = match self {
            Self::Nmt => (0x000, 0),
            Self::Sync => (0x080, 0),
            Self::Time => (0x100, 0),
            Self::Emergency { node } => (0x080, node),
            Self::Tpdo { node, number } => (0x080 + 0x100 * number as u16, node),
            Self::Rpdo { node, number } => (0x100 + 0x100 * number as u16, node),
            Self::SdoResponse { node } => (0x580, node),
            Self::SdoRequest { node } => (0x600, node),
            Self::ErrorControl { node } => (0x700, node),
            Self::LssResponse => (0x7E4, 0),
            Self::LssRequest => (0x7E5, 0),
        };
        base + node as u16
    }

    /// The service of a frame; `None` for 29-bit identifiers and those the set does not name.
    #[must_use]
    pub fn of(frame: &Frame) -> Option<Self> {
        let Id::Standard(id) = frame.id() else {
            return None;
        };
        let node = (id & 0x7F) as u8;
        let function = id >> 7;
        Some(match (function, node) {
            (0x0, 0) => Self::Nmt,
            (0x1, 0) => Self::Sync,
            (0x2, 0) => Self::Time,
            (_, 0) => return None,
            (0x1, node) => Self::Emergency { node },
            (0x3 | 0x5 | 0x7 | 0x9, node) => Self::Tpdo { node, number: ((function - 1) / 2) as u8 },
            (0x4 | 0x6 | 0x8 | 0xA, node) => Self::Rpdo { node, number: ((function - 2) / 2) as u8 },
            (0xB, node) => Self::SdoResponse { node },
            (0xC, node) => Self::SdoRequest { node },
            (0xE, node) => Self::ErrorControl { node },
            (0xF, 0x64) => Self::LssResponse,
            (0xF, 0x65) => Self::LssRequest,
            _ => return None,
        })
    }
}

/// True if an identifier must not be given to a configurable object (CiA 301, Table 39).
#[must_use]
pub const fn is_restricted(cob_id: u16) -> bool {
    matches!(cob_id, 0..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF | 0x701..)
}

listed! {
    /// An NMT command (CiA 301, 9.2.6.1).
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[repr(u8)]
    pub enum NmtCommand {
        /// To Operational.
        Start = 0x01,
        /// To Stopped.
        Stop = 0x02,
        /// To Pre-operational.
        EnterPreOperational = 0x80,
        /// Everything to power-on values, then boot-up.
        ResetNode = 0x81,
        /// The communication profile to power-on values, then boot-up.
        ResetCommunication = 0x82,
    }
}

impl NmtCommand {
    fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|command| *command as u8 == byte)
    }
}

/// The NMT state of a node, as its heartbeat names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum NmtState {
    /// Initialising; on the wire the boot-up message.
    Initialising = 0x00,
    /// NMT and error control only.
    Stopped = 0x04,
    /// Everything.
    Operational = 0x05,
    /// Everything but PDO.
    PreOperational = 0x7F,
}

impl NmtState {
    /// The state a byte names; the toggle bit of node guarding (bit 7) does not count.
    #[must_use]
    pub const fn from_byte(byte: u8) -> Option<Self> {
        Some(match byte & 0x7F {
            0x00 => Self::Initialising,
            0x04 => Self::Stopped,
            0x05 => Self::Operational,
            0x7F => Self::PreOperational,
            _ => return None,
        })
    }
}

/// An NMT command to `node`, or to all nodes when 0.
#[must_use]
pub fn nmt(command: NmtCommand, node: u8) -> Frame {
    Frame::standard(Service::Nmt.cob_id(), &[command as u8, node])
}

/// Command and addressee (0: all) of an NMT frame's data; `None` when malformed.
#[must_use]
pub fn decode_nmt(data: &[u8]) -> Option<(NmtCommand, u8)> {
    match *data {
        [command, node @ 0..=127] => Some((NmtCommand::from_byte(command)?, node)),
        _ => None,
    }
}

/// A heartbeat; with [`NmtState::Initialising`] the boot-up message.
#[must_use]
pub fn heartbeat(node: u8, state: NmtState) -> Frame {
    Frame::standard(Service::ErrorControl { node }.cob_id(), &[state as u8])
}

/// The state in a heartbeat's or boot-up message's data; `None` when malformed.
#[must_use]
pub fn decode_heartbeat(data: &[u8]) -> Option<NmtState> {
    match *data {
        [state] => NmtState::from_byte(state),
        _ => None,
    }
}

/// Request of node guarding: a remote frame (CiA 301, 7.2.8.2.2.1).
#[must_use]
pub fn guard_request(node: u8) -> Frame {
    Frame::standard_remote(Service::ErrorControl { node }.cob_id(), 1)
}

/// The answer to a guard request: the state, and a bit that alternates from answer to answer.
#[must_use]
pub fn guard_answer(node: u8, state: NmtState, toggle: bool) -> Frame {
    Frame::standard(Service::ErrorControl { node }.cob_id(), &[state as u8 | u8::from(toggle) << 7])
}

/// True if the toggle bit of node guarding is set in error control data.
#[must_use]
pub fn guard_toggle(data: &[u8]) -> bool {
    data.first().is_some_and(|byte| byte & 0x80 != 0)
}

/// A SYNC without counter.
#[must_use]
pub fn sync() -> Frame {
    Frame::standard(Service::Sync.cob_id(), &[])
}

/// A SYNC with its counter, 1 to 240 (CiA 301, 0x1019).
#[must_use]
pub fn sync_counted(counter: u8) -> Frame {
    Frame::standard(Service::Sync.cob_id(), &[counter])
}

/// The counter in a SYNC's data: `Some(None)` without one; `None` when malformed.
#[must_use]
pub fn decode_sync(data: &[u8]) -> Option<Option<u8>> {
    match *data {
        [] => Some(None),
        [counter @ 1..=240] => Some(Some(counter)),
        _ => None,
    }
}

/// Time of day of a TIME object (CiA 301, TIME_OF_DAY).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct TimeOfDay {
    /// Milliseconds after midnight, below 2^28.
    pub millis: u32,
    /// Days since 1984-01-01.
    pub days: u16,
}

impl TimeOfDay {
    /// Days from 1970-01-01 to 1984-01-01.
    const DAYS_TO_1984: i64 = 5113;
    const DAY_US: i64 = 86_400_000_000;

    /// Time of day of a Unix time, microseconds since 1970-01-01 (UTC); clamped to 1984 to 2163.
    #[must_use]
    pub const fn from_unix_us(timestamp: i64) -> Self {
        let days = timestamp.div_euclid(Self::DAY_US) - Self::DAYS_TO_1984;
        match days {
            ..0 => Self { millis: 0, days: 0 },
            0..=0xFFFF => Self { millis: (timestamp.rem_euclid(Self::DAY_US) / 1000) as u32, days: days as u16 },
            _ => Self { millis: 0, days: u16::MAX },
        }
    }

    /// The data of the frame.
    #[must_use]
    pub fn encode(self) -> [u8; 6] {
        let ([a, b, c, d], [e, f]) = ((self.millis & 0x0FFF_FFFF).to_le_bytes(), self.days.to_le_bytes());
        [a, b, c, d, e, f]
    }

    /// From the data of a frame; `None` when it is not 6 bytes.
    #[must_use]
    pub fn decode(data: &[u8]) -> Option<Self> {
        let &[a, b, c, d, e, f] = data else {
            return None;
        };
        let millis = u32::from_le_bytes([a, b, c, d]) & 0x0FFF_FFFF;
        Some(Self { millis, days: u16::from_le_bytes([e, f]) })
    }
}

/// A TIME object.
#[must_use]
pub fn time(time: TimeOfDay) -> Frame {
    Frame::standard(Service::Time.cob_id(), &time.encode())
}

/// An emergency object (CiA 301, 9.2.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Emergency {
    /// Emergency error code; 0: an error went away.
    pub code: u16,
    /// Error register, object 0x1001: active errors.
    pub register: u8,
    /// Manufacturer specific.
    pub info: [u8; 5],
}

impl Emergency {
    /// The data of the frame.
    #[must_use]
    pub fn encode(self) -> [u8; 8] {
        let [low, high] = self.code.to_le_bytes();
        let [a, b, c, d, e] = self.info;
        [low, high, self.register, a, b, c, d, e]
    }

    /// From the data of a frame; `None` when it is not 8 bytes.
    #[must_use]
    pub fn decode(data: &[u8]) -> Option<Self> {
        let &[low, high, register, a, b, c, d, e] = data else {
            return None;
        };
        Some(Self { code: u16::from_le_bytes([low, high]), register, info: [a, b, c, d, e] })
    }

    /// Kind of error of the code (CiA 301, Table 21; the 81xx and 82xx codes by name).
    #[must_use]
    pub const fn class(self) -> &'static str {
        match self.code {
            0x0000..=0x00FF => "error reset or no error",
            0x1000..=0x10FF => "generic error",
            0x2000..=0x20FF => "current",
            0x2100..=0x21FF => "current, device input side",
            0x2200..=0x22FF => "current inside the device",
            0x2300..=0x23FF => "current, device output side",
            0x3000..=0x30FF => "voltage",
            0x3100..=0x31FF => "mains voltage",
            0x3200..=0x32FF => "voltage inside the device",
            0x3300..=0x33FF => "output voltage",
            0x4000..=0x40FF => "temperature",
            0x4100..=0x41FF => "ambient temperature",
            0x4200..=0x42FF => "device temperature",
            0x5000..=0x50FF => "device hardware",
            0x6000..=0x60FF => "device software",
            0x6100..=0x61FF => "internal software",
            0x6200..=0x62FF => "user software",
            0x6300..=0x63FF => "data set",
            0x7000..=0x70FF => "additional modules",
            0x8000..=0x80FF => "monitoring",
            0x8110 => "CAN overrun",
            0x8120 => "CAN in error passive mode",
            0x8130 => "life guard or heartbeat error",
            0x8140 => "recovered from bus-off",
            0x8150 => "transmit COB-ID collision",
            0x8100..=0x81FF => "communication",
            0x8210 => "PDO not processed due to length error",
            0x8220 => "PDO length exceeded",
            0x8250 => "RPDO timeout",
            0x8200..=0x82FF => "protocol error",
            0x9000..=0x90FF => "external error",
            0xF000..=0xF0FF => "additional functions",
            0xFF00..=0xFFFF => "device specific",
            _ => "unnamed error",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_identifier_and_its_service_agree() {
        for id in 0..=0x7FF {
            let frame = Frame::standard(id, &[]);
            if let Some(service) = Service::of(&frame) {
                assert_eq!(service.cob_id(), id, "{service:?}");
            }
        }
        assert_eq!(Service::Rpdo { node: 1, number: 4 }.cob_id(), 0x501);
        assert_eq!(Service::Tpdo { node: 2, number: 2 }.cob_id(), 0x282);
        assert_eq!(Service::of(&Frame::new(Id::Extended(0x181), &[]).unwrap()), None);
        assert!(is_restricted(0x701) && is_restricted(0x101) && !is_restricted(0x181) && !is_restricted(0x080));
    }

    #[test]
    fn nmt_and_heartbeat_stand_on_the_wire_as_the_standard_says() {
        assert_eq!(nmt(NmtCommand::ResetCommunication, 5).data(), [0x82, 5]);
        assert_eq!(heartbeat(1, NmtState::Initialising), Frame::standard(0x701, &[0]));
        assert_eq!(decode_nmt(&[1, 0]), Some((NmtCommand::Start, 0)));
        assert_eq!(decode_nmt(&[1, 128]), None);
        assert_eq!(decode_nmt(&[3, 1]), None);
        assert_eq!(decode_nmt(&[1]), None);
        assert_eq!(decode_heartbeat(&[0x7F]), Some(NmtState::PreOperational));
        assert_eq!(decode_heartbeat(&[0x06]), None);
        assert_eq!(decode_heartbeat(&[]), None);
    }

    #[test]
    fn sync_time_and_guarding_stand_on_the_wire_as_the_standard_says() {
        assert_eq!(sync_counted(7), Frame::standard(0x80, &[7]));
        assert_eq!(
            [&[][..], &[7], &[0], &[241], &[1, 2]].map(decode_sync),
            [Some(None), Some(Some(7)), None, None, None]
        );
        assert_eq!(guard_request(5), Frame::remote(Id::Standard(0x705), 1).unwrap());
        assert_eq!(guard_answer(5, NmtState::Operational, true), Frame::standard(0x705, &[0x85]));
        assert!(guard_toggle(&[0x85]) && !guard_toggle(&[0x05]) && !guard_toggle(&[]));
        // 2011-06-01 12:00:00 UTC: 10 013 days after 1984-01-01.
        let noon = TimeOfDay::from_unix_us(1_306_929_600_000_000);
        assert_eq!(noon, TimeOfDay { millis: 43_200_000, days: 10_013 });
        assert_eq!(time(noon), Frame::standard(0x100, &[0x00, 0x2E, 0x93, 0x02, 0x1D, 0x27]));
        assert_eq!(TimeOfDay::decode(&noon.encode()), Some(noon));
        assert_eq!(TimeOfDay::decode(&[0; 5]), None);
        assert_eq!(TimeOfDay::from_unix_us(-1), TimeOfDay::default());
    }

    #[test]
    fn an_emergency_keeps_code_register_and_information() {
        let emergency = Emergency { code: 0x8130, register: 0x10, info: [1, 2, 3, 4, 5] };
        assert_eq!(emergency.encode(), [0x30, 0x81, 0x10, 1, 2, 3, 4, 5]);
        assert_eq!(Emergency::decode(&emergency.encode()), Some(emergency));
        assert_eq!(Emergency::decode(&[0; 7]), None);
        assert_eq!(emergency.class(), "life guard or heartbeat error");
        assert_eq!(Emergency { code: 0x3210, ..emergency }.class(), "voltage inside the device");
    }
}
