//! Requests, descriptors, answers and samples of RPLIDARs: encode and decode, without state.

use crate::engine::Bytes;

/// First byte of requests and descriptors.
pub const SYNC: u8 = 0xA5;
/// Second byte of descriptors.
pub const SYNC_2: u8 = 0x5A;
/// Length of a descriptor.
pub const DESCRIPTOR: usize = 7;

/// Numbers of requests.
pub mod request {
    /// Stops scanning; no answer.
    pub const STOP: u8 = 0x25;
    /// Starts the device again; no answer.
    pub const RESET: u8 = 0x40;
    /// Single samples.
    pub const SCAN: u8 = 0x20;
    /// Capsules.
    pub const EXPRESS_SCAN: u8 = 0x82;
    /// Model, firmware, hardware and serial number.
    pub const GET_INFO: u8 = 0x50;
    /// Health.
    pub const GET_HEALTH: u8 = 0x52;
    /// Times of a sample, for devices without [`GET_LIDAR_CONF`].
    pub const GET_SAMPLERATE: u8 = 0x59;
    /// An entry of the configuration.
    pub const GET_LIDAR_CONF: u8 = 0x84;
    /// Duty cycle of the motor; no answer.
    pub const SET_MOTOR_PWM: u8 = 0xF0;
    /// Speed of the motor; no answer.
    pub const SET_MOTOR_RPM: u8 = 0xA8;
    /// What the accessory board can do.
    pub const GET_ACC_BOARD_FLAG: u8 = 0xFF;
}

/// Types of answers.
pub mod answer {
    /// To [`GET_INFO`](super::request::GET_INFO).
    pub const INFO: u8 = 0x04;
    /// To [`GET_HEALTH`](super::request::GET_HEALTH).
    pub const HEALTH: u8 = 0x06;
    /// To [`GET_SAMPLERATE`](super::request::GET_SAMPLERATE).
    pub const SAMPLERATE: u8 = 0x15;
    /// To [`GET_LIDAR_CONF`](super::request::GET_LIDAR_CONF).
    pub const CONF: u8 = 0x20;
    /// To [`GET_ACC_BOARD_FLAG`](super::request::GET_ACC_BOARD_FLAG).
    pub const ACC_BOARD_FLAG: u8 = 0xFF;
    /// Single samples.
    pub const SAMPLES: u8 = 0x81;
    /// Express capsules.
    pub const EXPRESS: u8 = 0x82;
    /// Ultra capsules.
    pub const ULTRA: u8 = 0x84;
    /// Dense capsules.
    pub const DENSE: u8 = 0x85;
}

/// Entries of the configuration.
pub mod conf {
    /// Desired speed: revolutions per minute, and the duty cycle for it.
    pub const DESIRED_SPEED: u32 = 0x01;
    /// Number of modes.
    pub const MODE_COUNT: u32 = 0x70;
    /// Time of a sample in a mode, µs in 1/256.
    pub const US_PER_SAMPLE: u32 = 0x71;
    /// Longest range in a mode, m in 1/256.
    pub const MAX_DISTANCE: u32 = 0x74;
    /// Type of the answer in a mode.
    pub const ANSWER_TYPE: u32 = 0x75;
    /// The mode that the maker recommends.
    pub const TYPICAL_MODE: u32 = 0x7C;
    /// Name of a mode, ended by a zero.
    pub const MODE_NAME: u32 = 0x7F;
}

/// A request. The checksum follows a payload only.
#[must_use]
pub fn encode(request: u8, payload: &[u8]) -> Bytes {
    let mut bytes = Bytes::new();
    // Requests of this crate are far shorter than the buffer.
    let _ = bytes.extend_from_slice(&[SYNC, request]);
    if !payload.is_empty() {
        let _ = bytes.push(payload.len() as u8);
        let _ = bytes.extend_from_slice(payload);
        let sum = bytes.iter().fold(0, |sum, byte| sum ^ byte);
        let _ = bytes.push(sum);
    }
    bytes
}

/// Request for an entry of the configuration, of a mode if it has one.
#[must_use]
pub fn get_conf(entry: u32, mode: Option<u16>) -> Bytes {
    let mut payload = [0; 6];
    payload[..4].copy_from_slice(&entry.to_le_bytes());
    payload[4..].copy_from_slice(&mode.unwrap_or(0).to_le_bytes());
    encode(request::GET_LIDAR_CONF, &payload[..if mode.is_some() { 6 } else { 4 }])
}

/// A descriptor: what follows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Descriptor {
    /// Length of an answer, bytes, below 2^30.
    pub len: u32,
    /// True: answers follow for ever.
    pub many: bool,
    /// Type of the answers.
    pub kind: u8,
}

impl Descriptor {
    /// Decodes a descriptor. `None`: it does not begin as one.
    #[must_use]
    pub fn decode(bytes: &[u8; DESCRIPTOR]) -> Option<Self> {
        let [SYNC, SYNC_2, a, b, c, d, kind] = *bytes else { return None };
        let word = u32::from_le_bytes([a, b, c, d]);
        Some(Self { len: word & 0x3FFF_FFFF, many: word >> 30 == 1, kind })
    }

    /// Encodes a descriptor.
    #[must_use]
    pub fn encode(&self) -> [u8; DESCRIPTOR] {
        let [a, b, c, d] = (self.len & 0x3FFF_FFFF | u32::from(self.many) << 30).to_le_bytes();
        [SYNC, SYNC_2, a, b, c, d, self.kind]
    }
}

/// Identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Info {
    /// Model: its series in the upper half.
    pub model: u8,
    /// Firmware, major and minor.
    pub firmware: (u8, u8),
    /// Revision of the hardware.
    pub hardware: u8,
    /// Serial number.
    pub serial: [u8; 16],
}

impl Info {
    /// Decodes an answer.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let [model, minor, major, hardware, serial @ ..] = bytes else { return None };
        Some(Self { model: *model, firmware: (*major, *minor), hardware: *hardware, serial: serial.try_into().ok()? })
    }

    /// Encodes an answer.
    #[must_use]
    pub fn encode(&self) -> [u8; 20] {
        let mut bytes = [0; 20];
        bytes[..4].copy_from_slice(&[self.model, self.firmware.1, self.firmware.0, self.hardware]);
        bytes[4..].copy_from_slice(&self.serial);
        bytes
    }

    /// True if the device answers [`request::GET_LIDAR_CONF`].
    #[must_use]
    pub fn has_conf(&self) -> bool {
        self.model >> 4 >= 4 || self.firmware >= (1, 24)
    }
}

/// A single sample. The angle counts clockwise, seen from above, from the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// First sample of a revolution.
    pub starts: bool,
    /// 0 to 63; 0: nothing was measured.
    pub quality: u8,
    /// 1/64°.
    pub angle_q6: u16,
    /// 1/4 mm; 0: no echo.
    pub range_q2: u16,
}

impl Node {
    /// Length.
    pub const LENGTH: usize = 5;

    /// True if these bytes may begin a sample: its fixed bits are right as far as they are there.
    #[must_use]
    pub fn may_begin(bytes: &[u8]) -> bool {
        bytes.first().is_none_or(|byte| (byte ^ byte >> 1) & 1 == 1) && bytes.get(1).is_none_or(|byte| byte & 1 == 1)
    }

    /// Decodes a sample. `None`: a fixed bit is wrong, or the angle is not below a turn.
    #[must_use]
    pub fn decode(bytes: &[u8; Self::LENGTH]) -> Option<Self> {
        let [first, a, b, c, d] = *bytes;
        let angle_q6 = u16::from_le_bytes([a, b]) >> 1;
        let node = Self { starts: first & 1 == 1, quality: first >> 2, angle_q6, range_q2: u16::from_le_bytes([c, d]) };
        (Self::may_begin(bytes) && angle_q6 < 360 * 64).then_some(node)
    }

    /// Encodes a sample.
    #[must_use]
    pub fn encode(&self) -> [u8; Self::LENGTH] {
        let [a, b] = (self.angle_q6 << 1 | 1).to_le_bytes();
        let [c, d] = self.range_q2.to_le_bytes();
        [self.quality << 2 | if self.starts { 1 } else { 2 }, a, b, c, d]
    }
}
