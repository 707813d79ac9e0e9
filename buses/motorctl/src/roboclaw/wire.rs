//! Packet serial: requests and answers, for both ends; stateless.
//!
//! A request that writes ends with a CRC-16 over all its bytes, and is answered by 0xFF alone. A request that reads has
//! none; its answer ends with a CRC-16 over address, command and data. Numbers are sent most significant byte first.
//! "RoboClaw Series User Manual": Packet Serial (addresses, packet timeout, acknowledgement, CRC), Advanced Packet
//! Serial (14, 15, 21, 24, 49, 82, 90), and the commands of encoders (16 to 19, 34, 37).

use crate::crc::crc16;
use crate::event::Text;
use base::Duration;
use core::ops::RangeInclusive;
use heapless::Vec;

/// Addresses of a bus.
pub const ADDRESSES: RangeInclusive<u8> = 0x80..=0x87;
/// Unit of the serial timeout.
pub const TIME_UNIT: Duration = Duration::from_millis(100);
/// A longer pause between two bytes of a request discards it.
pub const GAP: Duration = Duration::from_millis(10);

/// Bits of the status that are errors; the others are warnings and signals.
pub const ERRORS: u32 = 0x0000_3FFF;
/// Emergency stop input.
pub const E_STOP: u32 = 0x0000_0001;
/// Current of motor 1 above its limit.
pub const M1_CURRENT_ERROR: u32 = 0x0000_1000;

/// Answer to a request that writes.
const ACKNOWLEDGED: u8 = 0xFF;
/// Bytes of the firmware's text, its end included.
const TEXT_MAX: usize = 48;
/// End of the firmware's text.
const TEXT_END: [u8; 2] = [10, 0];

/// Bytes of the firmware's text, without its end.
pub const TEXT_LEN_MAX: usize = TEXT_MAX - TEXT_END.len();

/// Bytes of a request.
pub type Packet = Vec<u8, 16>;
/// Bytes of an answer.
pub type Bytes = Vec<u8, { TEXT_MAX + 2 }>;

/// Request of the master. Motors are numbered 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// 14: serial timeout, in [`TIME_UNIT`]s.
    SetTimeLimit(u8),
    /// 15.
    TimeLimit,
    /// 16 and 17: encoder counts.
    Position(usize),
    /// 18 and 19: counts/s.
    Speed(usize),
    /// 21.
    Version,
    /// 24: main battery.
    Supply,
    /// 34: duty cycle of both motors.
    Duty([i16; 2]),
    /// 37: speed of both motors, counts/s.
    Drive([i32; 2]),
    /// 49.
    Currents,
    /// 82.
    Temperature,
    /// 90.
    Status,
}

/// Answer of the device.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// A write was taken.
    Acknowledged,
    /// Serial timeout, in [`TIME_UNIT`]s.
    TimeLimit(u8),
    /// Encoder counts; the counter wraps.
    Position(i32),
    /// counts/s.
    Speed(i32),
    /// Model and firmware, without the end.
    Version(Text),
    /// V.
    Supply(f64),
    /// A.
    Currents([f64; 2]),
    /// °C.
    Temperature(f64),
    /// Bits of errors, warnings and signals.
    Status(u32),
}

/// What the bytes of an answer are so far.
#[derive(Clone, Debug, PartialEq)]
pub enum Received {
    /// Not complete.
    More,
    /// An answer.
    Answer(Answer),
    /// No answer to this request.
    Garbled,
}

fn pair<const N: usize>(data: &[u8]) -> Option<([u8; N], [u8; N])> {
    Some((*data.first_chunk()?, *data.get(N..)?.first_chunk()?))
}

fn join(head: &[u8], tail: &[u8]) -> Packet {
    head.iter().chain(tail).copied().collect()
}

impl Request {
    /// Code of the command.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::SetTimeLimit(_) => 14,
            Self::TimeLimit => 15,
            Self::Position(motor) => 16 + u8::from(motor != 0),
            Self::Speed(motor) => 18 + u8::from(motor != 0),
            Self::Version => 21,
            Self::Supply => 24,
            Self::Duty(_) => 34,
            Self::Drive(_) => 37,
            Self::Currents => 49,
            Self::Temperature => 82,
            Self::Status => 90,
        }
    }

    /// The bytes to the device with this address.
    #[must_use]
    pub fn packet(self, address: u8) -> Packet {
        let head = [address, self.code()];
        let packet = match self {
            Self::SetTimeLimit(units) => join(&head, &[units]),
            Self::Duty([first, second]) => join(&head, &join(&first.to_be_bytes(), &second.to_be_bytes())),
            Self::Drive([first, second]) => join(&head, &join(&first.to_be_bytes(), &second.to_be_bytes())),
            _ => return join(&head, &[]),
        };
        let crc = crc16(0, &packet).to_be_bytes();
        join(&packet, &crc)
    }

    /// Bytes of the answer; at most, for the text of the firmware.
    #[must_use]
    pub fn answer_len(self) -> usize {
        match self {
            Self::SetTimeLimit(_) | Self::Duty(_) | Self::Drive(_) => 1,
            Self::TimeLimit => 1 + 2,
            Self::Position(_) | Self::Speed(_) => 5 + 2,
            Self::Version => TEXT_MAX + 2,
            Self::Supply | Self::Temperature => 2 + 2,
            Self::Currents | Self::Status => 4 + 2,
        }
    }

    /// Reads the bytes of an answer from the device with this address.
    #[must_use]
    pub fn read(self, address: u8, bytes: &[u8]) -> Received {
        let len = match self {
            // The text ends with the first zero.
            Self::Version => {
                bytes.iter().take(TEXT_MAX).position(|byte| *byte == 0).map_or(TEXT_MAX, |end| end + 1) + 2
            }
            _ => self.answer_len(),
        };
        if bytes.len() < len {
            return Received::More;
        }
        let answer = match bytes {
            [ACKNOWLEDGED] if len == 1 => Some(Answer::Acknowledged),
            _ => self.checked(address, bytes).and_then(|data| self.answer(data)),
        };
        answer.map_or(Received::Garbled, Received::Answer)
    }

    /// Data of an answer with its CRC.
    fn checked(self, address: u8, bytes: &[u8]) -> Option<&[u8]> {
        let (data, crc) = bytes.split_last_chunk::<2>()?;
        let expected = crc16(crc16(0, &[address, self.code()]), data);
        (expected == u16::from_be_bytes(*crc)).then_some(data)
    }

    fn answer(self, data: &[u8]) -> Option<Answer> {
        let word = |data: &[u8]| data.first_chunk().map(|bytes| i16::from_be_bytes(*bytes));
        let long = |data: &[u8]| data.first_chunk().map(|bytes| i32::from_be_bytes(*bytes));
        Some(match self {
            Self::SetTimeLimit(_) | Self::Duty(_) | Self::Drive(_) => return None,
            Self::TimeLimit => Answer::TimeLimit(*data.first()?),
            Self::Position(_) => Answer::Position(long(data)?),
            Self::Speed(_) => {
                let (speed, is_backward) = (long(data)?, data.get(4)? & 1 != 0);
                Answer::Speed(if is_backward && speed > 0 { -speed } else { speed })
            }
            Self::Version => Answer::Version(data.strip_suffix(&TEXT_END)?.iter().copied().collect()),
            Self::Supply => Answer::Supply(f64::from(word(data)?) / 10.0),
            Self::Currents => {
                let (first, second) = pair(data)?;
                Answer::Currents([first, second].map(|current| f64::from(i16::from_be_bytes(current)) / 100.0))
            }
            Self::Temperature => Answer::Temperature(f64::from(word(data)?) / 10.0),
            Self::Status => Answer::Status(u32::from_be_bytes(*data.first_chunk()?)),
        })
    }
}

/// What the bytes that a device received are so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Not complete.
    More,
    /// A complete request for this device.
    Request(Request),
    /// Not a request for this device, or one that it does not know.
    Unknown,
}

impl Request {
    /// Reads the bytes that a device with this address received.
    #[must_use]
    pub fn decode(address: u8, bytes: &[u8]) -> Asked {
        let Some([to, code]) = bytes.first_chunk() else { return Asked::More };
        let zeros = match code {
            14 => Self::SetTimeLimit(0),
            15 => Self::TimeLimit,
            16 | 17 => Self::Position(usize::from(code - 16)),
            18 | 19 => Self::Speed(usize::from(code - 18)),
            21 => Self::Version,
            24 => Self::Supply,
            34 => Self::Duty([0; 2]),
            37 => Self::Drive([0; 2]),
            49 => Self::Currents,
            82 => Self::Temperature,
            90 => Self::Status,
            _ => return Asked::Unknown,
        };
        if *to != address {
            return Asked::Unknown;
        }
        if bytes.len() < zeros.packet(address).len() {
            return Asked::More;
        }
        zeros.filled(bytes).map_or(Asked::Unknown, Asked::Request)
    }

    /// A request with the data of its bytes.
    fn filled(self, bytes: &[u8]) -> Option<Self> {
        let data = bytes.get(2..)?;
        let filled = match self {
            Self::SetTimeLimit(_) => Self::SetTimeLimit(*data.first()?),
            Self::Duty(_) => {
                let (first, second) = pair(data)?;
                Self::Duty([i16::from_be_bytes(first), i16::from_be_bytes(second)])
            }
            Self::Drive(_) => {
                let (first, second) = pair(data)?;
                Self::Drive([i32::from_be_bytes(first), i32::from_be_bytes(second)])
            }
            read => return Some(read),
        };
        // The CRC is part of the packet.
        (filled.packet(*bytes.first()?) == *bytes).then_some(filled)
    }
}

impl Answer {
    /// The bytes of the answer to `request`, from the device with this address.
    #[must_use]
    pub fn bytes(&self, address: u8, request: Request) -> Bytes {
        let tenths = |value: f64| (libm::round(value * 10.0) as i16).to_be_bytes();
        let mut bytes = Bytes::new();
        // Every answer fits: the longest is a text.
        let mut extend = |data: &[u8]| data.iter().for_each(|byte| _ = bytes.push(*byte));
        match self {
            Self::Acknowledged => {
                extend(&[ACKNOWLEDGED]);
                return bytes;
            }
            Self::TimeLimit(units) => extend(&[*units]),
            Self::Position(counts) => {
                extend(&counts.to_be_bytes());
                extend(&[0]);
            }
            Self::Speed(speed) => {
                extend(&speed.to_be_bytes());
                extend(&[u8::from(*speed < 0)]);
            }
            Self::Version(text) => {
                extend(&text[..text.len().min(TEXT_LEN_MAX)]);
                extend(&TEXT_END);
            }
            Self::Supply(value) | Self::Temperature(value) => extend(&tenths(*value)),
            Self::Currents(currents) => {
                currents.iter().for_each(|current| extend(&(libm::round(current * 100.0) as i16).to_be_bytes()));
            }
            Self::Status(bits) => extend(&bits.to_be_bytes()),
        }
        let crc = crc16(crc16(0, &[address, request.code()]), &bytes).to_be_bytes();
        crc.iter().for_each(|byte| _ = bytes.push(*byte));
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Random;

    /// Typed from the manual, which has no checksum in its examples: those were computed bit by bit, as it describes.
    #[test]
    fn requests_are_the_bytes_of_the_manual() {
        let cases: [(Request, &[u8]); 6] = [
            (Request::TimeLimit, &[0x80, 15]),
            (Request::Speed(1), &[0x80, 19]),
            (Request::Status, &[0x80, 90]),
            (Request::SetTimeLimit(2), &[0x80, 14, 2, 0x38, 0x17]),
            (Request::Duty([0, 0]), &[0x80, 34, 0, 0, 0, 0, 0x98, 0x17]),
            (Request::Drive([1000, -1000]), &[0x80, 37, 0, 0, 0x03, 0xE8, 0xFF, 0xFF, 0xFC, 0x18, 0x82, 0x90]),
        ];
        for (request, bytes) in cases {
            assert_eq!(request.packet(0x80), bytes, "{request:?}: {:02X?}", request.packet(0x80));
            assert_eq!(Request::decode(0x80, bytes), Asked::Request(request));
            assert_eq!(Request::decode(0x80, &bytes[..bytes.len() - 1]), Asked::More);
            assert_eq!(Request::decode(0x81, bytes), Asked::Unknown);
        }
    }

    #[test]
    fn the_text_of_the_manual_is_read() {
        let mut bytes: std::vec::Vec<u8> = b"RoboClaw 10.2A v4.1.11\n\0".to_vec();
        let crc = crc16(crc16(0, &[0x80, 21]), &bytes);
        bytes.extend(crc.to_be_bytes());
        let Received::Answer(Answer::Version(text)) = Request::Version.read(0x80, &bytes) else { panic!() };
        assert_eq!(text.as_slice(), b"RoboClaw 10.2A v4.1.11");
        assert_eq!(Request::Version.read(0x80, &bytes[..bytes.len() - 1]), Received::More);
    }

    #[test]
    fn a_speed_backward_is_negative_in_both_forms() {
        for speed in [-1000_i32, 1000] {
            let mut bytes: std::vec::Vec<u8> = speed.to_be_bytes().to_vec();
            bytes.push(1);
            bytes.extend(crc16(crc16(0, &[0x80, 18]), &bytes).to_be_bytes());
            assert_eq!(Request::Speed(0).read(0x80, &bytes), Received::Answer(Answer::Speed(-1000)));
        }
    }

    #[test]
    fn answers_are_read_as_they_were_built_and_damage_is_found() {
        let text: Text = b"RoboClaw".iter().copied().collect();
        let cases = [
            (Request::Drive([0; 2]), Answer::Acknowledged),
            (Request::TimeLimit, Answer::TimeLimit(2)),
            (Request::Position(0), Answer::Position(-5)),
            (Request::Speed(1), Answer::Speed(-70_000)),
            (Request::Version, Answer::Version(text)),
            (Request::Supply, Answer::Supply(24.3)),
            (Request::Currents, Answer::Currents([1.25, -0.5])),
            (Request::Temperature, Answer::Temperature(-3.5)),
            (Request::Status, Answer::Status(0x0200_1000)),
        ];
        for (request, answer) in cases {
            let mut bytes = answer.bytes(0x80, request);
            assert_eq!(request.read(0x80, &bytes), Received::Answer(answer));
            bytes[0] ^= 1;
            assert_eq!(request.read(0x80, &bytes), Received::Garbled, "{request:?}");
        }
    }

    #[test]
    fn any_bytes_are_read_without_a_panic() {
        let mut random = Random::new(3);
        for _ in 0..100_000 {
            let len = random.index(52);
            let bytes = random.bytes(len);
            for request in [Request::Version, Request::Speed(0), Request::Status, Request::Drive([0; 2])] {
                let _ = request.read(0x80, &bytes);
            }
            let mut asked = bytes;
            if let [to, code, ..] = &mut asked[..] {
                (*to, *code) = (0x80, [14, 15, 21, 34, 37, 90][random.index(6)]);
            }
            if let Asked::Request(request) = Request::decode(0x80, &asked) {
                assert!(asked.starts_with(&request.packet(0x80)));
            }
        }
    }
}
