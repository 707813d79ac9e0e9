//! A WitMotion on its line.

use super::*;
use crate::emulated::{Body, digits};
use heapless::Deque;

/// Bytes in the buffers of the line's ends.
const CAPACITY: usize = 256;

/// Bits of a character that change what a receiver takes it for: the start bit and eight data bits.
const BITS: u32 = 9;

#[derive(Debug, Default)]
pub(crate) struct Sender {
    bytes: Deque<u8, CAPACITY>,
    last: [u8; LENGTH],
}

impl Sender {
    /// Sends a sample: acceleration, rotation, angles' place left out, quaternion.
    pub fn send(&mut self, body: &mut Body) {
        let truth = body.measure();
        let packet = |kind, values: [f64; 3], digit: f64, last: i16| {
            let [a, b, c] = values.map(|value| digits(value, digit));
            encode(kind, [a, b, c, last])
        };
        let [x, y, z, w] = truth.orientation.map(|value| digits(value, 1.0 / 32768.0));
        let temperature = digits(truth.temperature_c, TEMPERATURE_C);
        let packets = [
            packet(ACCELERATION, truth.acceleration_mps2, ACCELERATION_MPS2, temperature),
            packet(ROTATION, truth.rotation_radps, ROTATION_RADPS, 0),
            encode(QUATERNION, [w, x, y, z]),
        ];
        let faults = body.faults;
        if faults.half_for_ever {
            let last = self.last;
            return self.put(&last[..LENGTH / 2], body);
        }
        for (n, packet) in packets.into_iter().enumerate() {
            let end = if faults.halves { LENGTH / 2 } else { LENGTH };
            if !(faults.without_acceleration && n == 0 || faults.without_rotation && n == 1) {
                self.last = packet;
                self.put(&packet[..end], body);
            }
        }
    }

    fn put(&mut self, bytes: &[u8], body: &mut Body) {
        let faults = body.faults;
        for byte in bytes {
            if faults.cut || body.chance(1000 * u32::from(faults.lost_per_mille)) {
                continue;
            }
            let wrong = u8::from(body.chance(faults.noise_ppm)) << 5;
            let mut byte = if faults.stranger { !byte } else { byte ^ wrong };
            if body.chance(BITS * faults.wrong_bits_ppm) {
                // Two of one character are too rare to matter.
                match body.below(u64::from(BITS)) {
                    // Without its start bit it is not received.
                    8 => continue,
                    bit => byte ^= 1 << bit,
                }
            }
            if faults.wrong_baud {
                // At half the bit rate each bit is read twice.
                byte = [0x00, 0x18, 0x86, 0x9E, 0x60, 0x78, 0xE6, 0xFE][usize::from(byte % 8)];
            }
            // What has no room is lost, as in the buffer of a port.
            let _ = self.bytes.push_back(faults.received(byte));
            if body.chance(1000 * u32::from(faults.added_per_mille)) {
                let _ = self.bytes.push_back(body.below(256) as u8);
            }
        }
    }

    pub fn poll(&mut self, bytes: &mut [u8]) -> usize {
        let mut count = 0;
        while let Some(byte) = (count < bytes.len()).then(|| self.bytes.pop_front()).flatten() {
            bytes[count] = byte;
            count += 1;
        }
        count
    }
}
