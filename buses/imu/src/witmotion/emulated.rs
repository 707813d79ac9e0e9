//! A WitMotion on its line.

use super::*;
use crate::emulated::{Body, digits};
use heapless::Deque;

/// Bytes in the buffers of the line's ends.
const CAPACITY: usize = 256;

#[derive(Debug, Default)]
pub(crate) struct Sender {
    bytes: Deque<u8, CAPACITY>,
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
        for byte in packets.into_iter().flatten() {
            if body.faults.cut {
                continue;
            }
            let wrong = u8::from(body.chance(body.faults.noise_ppm)) << 5;
            let byte = if body.faults.stranger { !byte } else { byte ^ wrong };
            // What has no room is lost, as in the buffer of a port.
            let _ = self.bytes.push_back(byte);
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
