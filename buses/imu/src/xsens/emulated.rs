//! An MTi on its bus.

use super::*;
use crate::emulated::{Body, Faults, digits};
use base::can::{Frame, Id};
use heapless::Deque;

/// Samples between two temperatures.
const TEMPERATURE_EVERY: u32 = 100;
/// Code of an emulated error: output buffer overflow (MT1604P, 6.1.1).
const ERROR: u8 = 1;

/// Bits of a frame with 11-bit identifier and eight bytes, without stuffed ones.
const BITS: u32 = 111;

#[derive(Debug, Default)]
pub(crate) struct Sender {
    frames: Deque<Frame, 16>,
    last: Option<Frame>,
    samples: u32,
}

impl Sender {
    pub fn send(&mut self, body: &mut Body) {
        let truth = body.measure();
        if let (true, Some(last)) = (body.faults.half_for_ever, self.last) {
            if !body.faults.cut {
                let _ = self.frames.push_back(last);
            }
            return;
        }
        let [x, y, z, w] = truth.orientation.map(|value| digits(value, QUATERNION));
        // Self-test passed, filter valid.
        let status = [0, 0, 0, 3];
        self.put(id::STATUS, &status, body);
        self.put_values(id::QUATERNION, &[w, x, y, z], body);
        if !body.faults.without_rotation {
            self.put_values(id::RATE_OF_TURN, &truth.rotation_radps.map(|value| digits(value, ROTATION_RADPS)), body);
        }
        if !body.faults.without_acceleration {
            let values = truth.acceleration_mps2.map(|value| digits(value, ACCELERATION_MPS2));
            self.put_values(id::ACCELERATION, &values, body);
        }
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
        let faults = body.faults;
        if faults.cut || faults.wrong_baud {
            return;
        }
        let short = body.chance(faults.noise_ppm) || body.chance(BITS * faults.wrong_bits_ppm);
        let end = if faults.halves { data.len() / 2 } else { data.len() - usize::from(short) };
        // A device with other identifiers: those of a CANopen heartbeat.
        let number = if faults.stranger { 0x700 | number } else { number };
        let mut received = [0; 8];
        for (place, byte) in received.iter_mut().zip(data) {
            *place = faults.received(*byte);
        }
        let frame = match faults {
            Faults { remote: true, .. } => Frame::standard_remote(number, data.len() as u8),
            Faults { extended: true, .. } => match Frame::new(Id::Extended(number.into()), &received[..end]) {
                Some(frame) => frame,
                None => return,
            },
            _ => Frame::standard(number, &received[..end]),
        };
        self.last = Some(Frame::standard(number, &received[..data.len() / 2]));
        // What has no room is lost.
        let _ = self.frames.push_back(frame);
    }

    pub fn poll(&mut self) -> Option<Frame> {
        self.frames.pop_front()
    }
}
