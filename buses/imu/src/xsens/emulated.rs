//! An MTi on its bus.

use super::*;
use crate::emulated::{Body, digits};
use base::can::Frame;
use heapless::Deque;

/// Samples between two temperatures.
const TEMPERATURE_EVERY: u32 = 100;
/// Code of an emulated error: output buffer overflow (MT1604P, 6.1.1).
const ERROR: u8 = 1;

#[derive(Debug, Default)]
pub(crate) struct Sender {
    frames: Deque<Frame, 16>,
    samples: u32,
}

impl Sender {
    pub fn send(&mut self, body: &mut Body) {
        let truth = body.measure();
        let [x, y, z, w] = truth.orientation.map(|value| digits(value, QUATERNION));
        // Self-test passed, filter valid.
        let status = [0, 0, 0, 3];
        self.put(id::STATUS, &status, body);
        self.put_values(id::QUATERNION, &[w, x, y, z], body);
        self.put_values(id::RATE_OF_TURN, &truth.rotation_radps.map(|value| digits(value, ROTATION_RADPS)), body);
        self.put_values(id::ACCELERATION, &truth.acceleration_mps2.map(|value| digits(value, ACCELERATION_MPS2)), body);
        if self.samples.is_multiple_of(TEMPERATURE_EVERY) {
            self.put_values(id::TEMPERATURE, &[digits(truth.temperature_c, TEMPERATURE_C)], body);
        }
        if body.faults.error {
            self.put(id::ERROR, &[ERROR], body);
        }
        self.samples = self.samples.wrapping_add(1);
    }

    fn put_values(&mut self, number: u16, values: &[i16], body: &mut Body) {
        let mut data = [0; 8];
        let length = 2 * values.len();
        for (place, value) in data.chunks_exact_mut(2).zip(values) {
            place.copy_from_slice(&value.to_be_bytes());
        }
        self.put(number, &data[..length], body);
    }

    fn put(&mut self, number: u16, data: &[u8], body: &mut Body) {
        if body.faults.cut {
            return;
        }
        let short = usize::from(body.chance(body.faults.noise_ppm));
        // A device with other identifiers: those of a CANopen heartbeat.
        let number = if body.faults.stranger { 0x700 | number } else { number };
        // What has no room is lost.
        let _ = self.frames.push_back(Frame::standard(number, &data[..data.len() - short]));
    }

    pub fn poll(&mut self) -> Option<Frame> {
        self.frames.pop_front()
    }
}
