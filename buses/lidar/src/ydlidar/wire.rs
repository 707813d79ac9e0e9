//! Commands, answers and packets of YDLIDARs: encode and decode, without state.
//!
//! The frames of commands and answers, and the identity, are in [`crate::rplidar::wire`].

use core::f64::consts::TAU;
use heapless::Vec;

/// Numbers of commands.
pub mod command {
    /// Starts scanning.
    pub const SCAN: u8 = 0x60;
    /// Stops scanning; no answer.
    pub const STOP: u8 = 0x65;
    /// Model, firmware, hardware and serial number.
    pub const GET_INFO: u8 = 0x90;
    /// Health.
    pub const GET_HEALTH: u8 = 0x91;
    /// G4: set revolutions per second, Hz in 1/100.
    pub const GET_SPEED: u8 = 0x0D;
    /// G4: number of its rate of samples, see [`RATES`](super::RATES).
    pub const GET_RATE: u8 = 0xD1;
    /// Restarts an X4; no answer.
    pub const RESTART_X4: u8 = 0x80;
    /// Restarts a G4; no answer.
    pub const RESTART_G4: u8 = 0x40;
}

/// Types of answers.
pub mod answer {
    /// To commands that read or set a value; they differ in length.
    pub const VALUE: u8 = 0x04;
    /// To [`GET_HEALTH`](super::command::GET_HEALTH).
    pub const HEALTH: u8 = 0x06;
    /// Packets.
    pub const PACKETS: u8 = 0x81;
}

/// Rates of a G4 by their numbers: samples per second, and the shortest range of each, m.
pub const RATES: [(u32, f32); 3] = [(4000, 0.1), (8000, 0.26), (9000, 0.28)];

/// First bytes of a packet.
pub const HEADER: [u8; 2] = [0xAA, 0x55];
/// Bytes of a packet before its samples.
pub const HEAD: usize = 10;
/// Most samples of a packet.
pub const SAMPLES_MAX: usize = 80;
/// Longest packet, bytes.
pub const LENGTH_MAX: usize = HEAD + 2 * SAMPLES_MAX;
/// A turn, 1/64°.
pub const TURN_Q6: u16 = 360 * 64;

/// Distance of the beam from the axis of the head, and the range at which it points to where the head does, mm
/// (*Communication Protocol*, "Second-level analysis").
const BESIDE_MM: f64 = 21.8;
const STRAIGHT_MM: f64 = 155.3;

/// Angle by which what was measured at a range lies clockwise of where the head points, rad; 0 for a range of 0, mm.
#[must_use]
pub fn correction_rad(range_mm: f64) -> f64 {
    if range_mm > 0.0 { libm::atan(BESIDE_MM * (STRAIGHT_MM - range_mm) / (STRAIGHT_MM * range_mm)) } else { 0.0 }
}

/// [`correction_rad`] of what is far away: that of a beam that met nothing, too.
#[must_use]
pub fn far_rad() -> f64 {
    -libm::atan(BESIDE_MM / STRAIGHT_MM)
}

/// The angle in rad, clockwise.
#[must_use]
pub fn radians(q6: f64) -> f64 {
    q6 / f64::from(TURN_Q6) * TAU
}

/// A packet. Angles count clockwise, seen from above, and are those of the head, without the correction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// First sample of a revolution; usually the only one of its packet.
    pub starts: bool,
    /// Of a packet that starts a revolution: revolutions per second, Hz in 1/10; 0: unknown.
    pub speed: u8,
    /// Angle of the first sample, 1/64°.
    pub first_q6: u16,
    /// Angle of the last sample, 1/64°.
    pub last_q6: u16,
    /// Ranges, mm in 1/4; 0: no echo. Equally spaced from the first angle to the last.
    pub samples: Vec<u16, SAMPLES_MAX>,
}

fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

/// Exclusive or of all words of a packet; 0 if its checksum, which is one of them, is right. A single wrong bit is
/// found, and two in the same place of two words are not.
fn sum(bytes: &[u8]) -> u16 {
    bytes.chunks_exact(2).fold(0, |sum, word| sum ^ u16::from_le_bytes([word[0], word[1]]))
}

impl Packet {
    /// True if these bytes may begin a packet of at most `samples_max` samples.
    #[must_use]
    pub fn may_begin(bytes: &[u8], samples_max: usize) -> bool {
        let is_checked = |at: usize| bytes.get(at).is_none_or(|byte| byte & 1 == 1);
        bytes.first().is_none_or(|byte| *byte == HEADER[0])
            && bytes.get(1).is_none_or(|byte| *byte == HEADER[1])
            && bytes.get(3).is_none_or(|count| (1..=samples_max).contains(&usize::from(*count)))
            && is_checked(4)
            && is_checked(6)
    }

    /// Length of the packet that begins so; none before its number of samples is there.
    #[must_use]
    pub fn length(bytes: &[u8]) -> Option<usize> {
        bytes.get(3).map(|count| HEAD + 2 * usize::from(*count))
    }

    /// Decodes a packet. `None`: header, length, checksum, a check bit or an angle is not valid.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        if !Self::may_begin(bytes, SAMPLES_MAX) || Self::length(bytes) != Some(bytes.len()) || sum(bytes) != 0 {
            return None;
        }
        let (kind, first_q6, last_q6) = (bytes[2], word(bytes, 4) >> 1, word(bytes, 6) >> 1);
        let starts = kind & 1 == 1;
        let samples = bytes[HEAD..].chunks_exact(2).map(|range| word(range, 0)).collect();
        let packet = Self { starts, speed: if starts { kind >> 1 } else { 0 }, first_q6, last_q6, samples };
        (first_q6 < TURN_Q6 && last_q6 < TURN_Q6).then_some(packet)
    }

    /// Encodes a packet.
    #[must_use]
    pub fn encode(&self) -> Vec<u8, LENGTH_MAX> {
        let mut bytes = Vec::new();
        let kind = if self.starts { self.speed << 1 | 1 } else { 0 };
        let [first, last] = [self.first_q6, self.last_q6].map(|angle| (angle << 1 | 1).to_le_bytes());
        // LENGTH_MAX is the longest.
        let _ = bytes.extend_from_slice(&[HEADER[0], HEADER[1], kind, self.samples.len() as u8]);
        let _ = bytes.extend_from_slice(&[first[0], first[1], last[0], last[1], 0, 0]);
        for range in &self.samples {
            let _ = bytes.extend_from_slice(&range.to_le_bytes());
        }
        let sum = sum(&bytes).to_le_bytes();
        bytes[8..HEAD].copy_from_slice(&sum);
        bytes
    }

    /// Angle from the first sample to the last, 1/64°.
    #[must_use]
    pub fn span_q6(&self) -> u16 {
        ahead_q6(self.first_q6, self.last_q6)
    }
}

/// Angle clockwise from one direction to another, 1/64°, below a turn.
#[must_use]
pub fn ahead_q6(from_q6: u16, to_q6: u16) -> u16 {
    let [from, to] = [from_q6, to_q6].map(|angle| angle % TURN_Q6);
    (TURN_Q6 + to - from) % TURN_Q6
}
