//! Samples from packets.

use super::*;
use crate::event::{Sample, Status};
use crate::frame::Rotation;
use crate::shared::Shared;
use base::Instant;
use heapless::Vec;

/// Protocol. The packets of a sample come in the order of their kinds; the last kind of a round is that of the round
/// before, so a sample is complete without waiting for the next one.
#[derive(Debug)]
pub(crate) struct Packets {
    rx: Vec<u8, LENGTH>,
    /// When the first of those bytes arrived.
    first_at: Instant,
    /// Bytes that belonged to no packet, since the last one that was counted.
    skipped: u8,
    /// Kind of the last packet of this round, and of the round before.
    last: u8,
    closing: u8,
    round: Round,
}

/// Values of a sample, as far as they have arrived.
#[derive(Debug, Default)]
struct Round {
    at: Instant,
    acceleration: Option<[f64; 3]>,
    rotation: Option<[f64; 3]>,
    orientation: Option<Rotation>,
    temperature_c: Option<f64>,
}

impl Packets {
    pub fn new() -> Self {
        Self { rx: Vec::new(), first_at: Instant::ZERO, skipped: 0, last: 0, closing: 0, round: Round::default() }
    }

    pub fn start(&mut self) {
        *self = Self::new();
    }

    pub fn handle_byte(&mut self, now: Instant, byte: u8, shared: &mut Shared) {
        if self.rx.is_empty() {
            self.first_at = now;
        }
        // There is room: a full buffer is emptied below.
        let _ = self.rx.push(byte);
        while self.rx.first().is_some_and(|first| *first != HEADER) || self.rx.is_full() {
            match <&[u8; LENGTH]>::try_from(&self.rx[..]).ok().and_then(decode) {
                Some((kind, values)) => {
                    self.skipped = 0;
                    self.rx.clear();
                    shared.accept();
                    self.take(kind, values, shared);
                }
                None => self.skip(shared),
            }
        }
    }

    /// Leaves out a byte, and what follows it up to the next header. Counted once for each lost packet.
    fn skip(&mut self, shared: &mut Shared) {
        if self.skipped == 0 {
            shared.reject();
        }
        let count = 1 + self.rx[1..].iter().take_while(|byte| **byte != HEADER).count();
        self.rx.rotate_left(count);
        self.rx.truncate(self.rx.len() - count);
        self.skipped = (self.skipped + count as u8) % LENGTH as u8;
    }

    fn take(&mut self, kind: u8, values: [i16; 4], shared: &mut Shared) {
        if ![ACCELERATION, ROTATION, ANGLE, QUATERNION].contains(&kind) {
            return;
        }
        if kind <= self.last {
            self.closing = self.last;
            self.round = Round { at: self.first_at, ..Round::default() };
        }
        self.last = kind;
        let [a, b, c, d] = values.map(f64::from);
        let scaled = |digit: f64| Some([a, b, c].map(|value| digit * value));
        match kind {
            ACCELERATION => {
                self.round.acceleration = scaled(ACCELERATION_MPS2);
                self.round.temperature_c = Some(TEMPERATURE_C * d);
            }
            ROTATION => self.round.rotation = scaled(ROTATION_RADPS),
            ANGLE => {
                self.round.orientation = Some(Rotation::from_angles(ANGLE_RAD * a, ANGLE_RAD * b, ANGLE_RAD * c));
            }
            _ => self.round.orientation = Rotation::new([b, c, d, a]).or(self.round.orientation),
        }
        if let (true, Some(acceleration_mps2), Some(rotation_radps)) =
            (kind == self.closing, self.round.acceleration, self.round.rotation)
        {
            shared.sample(Sample {
                at: self.round.at,
                status: Status::Ok,
                acceleration_mps2,
                rotation_radps,
                orientation: self.round.orientation.map(Rotation::quaternion),
                temperature_c: self.round.temperature_c.unwrap_or(f64::NAN),
            });
        }
    }
}
