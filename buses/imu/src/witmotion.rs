//! WitMotion sensors with the standard protocol on a serial line, which they send on without being asked: WT61C,
//! WT901C, HWT901B, HWT905 and others.
//!
//! Source: WitMotion, *HWT905-TTL: Protocol* and *BWT61CL data sheet v20-0630*, section 6.1 (packets, units, checksum);
//! quaternion packet: *WT901C data sheet*, quaternion output.
//!
//! Nothing is sent to the device. It must be set, with the maker's tool, to send acceleration and rotation, and to a
//! rate that its line can carry; angles or the quaternion give the orientation. It has no clock that is used: the
//! instant of a sample is that at which the first byte of its first packet arrived.

pub(crate) mod emulated;
mod packets;
#[cfg(test)]
mod tests;

use crate::GRAVITY_MPS2;
use crate::judge::Limits;
use core::f64::consts::PI;
pub(crate) use packets::Packets;

/// Rate of the line of a WT61C, and that needed for 100 samples a second, Bd; a WT901C is delivered with 9600 Bd.
pub const BAUD: u32 = 115_200;
/// Length of a packet, bytes.
pub const LENGTH: usize = 11;
/// First byte of a packet.
pub const HEADER: u8 = 0x55;
/// Acceleration x, y, z, and temperature.
pub const ACCELERATION: u8 = 0x51;
/// Rotation x, y, z.
pub const ROTATION: u8 = 0x52;
/// Roll, pitch, yaw.
pub const ANGLE: u8 = 0x53;
/// Quaternion w, x, y, z.
pub const QUATERNION: u8 = 0x59;

/// m/s² of a digit: 16 g are 32768.
pub const ACCELERATION_MPS2: f64 = 16.0 * GRAVITY_MPS2 / 32768.0;
/// rad/s of a digit: 2000 °/s are 32768.
pub const ROTATION_RADPS: f64 = 2000.0 / 32768.0 * PI / 180.0;
/// rad of a digit: 180° are 32768.
pub const ANGLE_RAD: f64 = PI / 32768.0;
/// °C of a digit.
pub const TEMPERATURE_C: f64 = 0.01;

/// Less a few digits than the range.
pub(crate) const LIMITS: Limits = Limits { acceleration_mps2: 156.8, rotation_radps: 34.9 };

/// Lower byte of the sum of the bytes before the checksum.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// A packet of this kind with four values.
#[must_use]
pub fn encode(kind: u8, values: [i16; 4]) -> [u8; LENGTH] {
    let mut packet = [0; LENGTH];
    (packet[0], packet[1]) = (HEADER, kind);
    for (n, value) in values.into_iter().enumerate() {
        packet[2 + 2 * n..4 + 2 * n].copy_from_slice(&value.to_le_bytes());
    }
    packet[LENGTH - 1] = checksum(&packet[..LENGTH - 1]);
    packet
}

/// Kind and values of a packet; `None`: header or checksum is wrong.
#[must_use]
pub fn decode(packet: &[u8; LENGTH]) -> Option<(u8, [i16; 4])> {
    let valid = packet[0] == HEADER && checksum(&packet[..LENGTH - 1]) == packet[LENGTH - 1];
    let value = |n: usize| i16::from_le_bytes([packet[2 + 2 * n], packet[3 + 2 * n]]);
    valid.then(|| (packet[1], core::array::from_fn(value)))
}
