//! Samples from frames.

use super::*;
use crate::event::{Fault, Sample, Status};
use crate::frame::Rotation;
use crate::shared::Shared;
use base::can::{Frame, Id};
use base::{Duration, Instant};

/// An orientation or a temperature older than this is not used.
const AGE_MAX: Duration = Duration::from_millis(100);
/// A temperature may come rarely.
const TEMPERATURE_AGE_MAX: Duration = Duration::from_secs(5);
/// An error counts as active for this time after its frame.
const ERROR_FOR: Duration = Duration::from_millis(500);

/// Protocol: a sample is complete when rate of turn and acceleration have come, in either order.
#[derive(Debug)]
pub(crate) struct Frames {
    rotation: Option<(Instant, [f64; 3])>,
    acceleration: Option<(Instant, [f64; 3])>,
    orientation: Option<(Instant, Rotation)>,
    temperature_c: Option<(Instant, f64)>,
    /// By the status word; true until one comes.
    oriented: bool,
    error: Option<Instant>,
}

impl Frames {
    pub fn new() -> Self {
        Self { rotation: None, acceleration: None, orientation: None, temperature_c: None, oriented: true, error: None }
    }

    pub fn start(&mut self) {
        *self = Self::new();
    }

    pub fn handle_frame(&mut self, now: Instant, frame: &Frame, shared: &mut Shared) {
        let Id::Standard(number) = frame.id() else { return };
        let data = frame.data();
        let length = match number {
            id::ERROR => 1,
            id::STATUS => 4,
            id::QUATERNION => 8,
            id::RATE_OF_TURN | id::ACCELERATION => 6,
            id::TEMPERATURE => 2,
            _ => return,
        };
        if frame.is_remote() || data.len() != length {
            shared.reject();
            return;
        }
        shared.accept();
        let value = |n: usize| f64::from(i16::from_be_bytes([data[2 * n], data[2 * n + 1]]));
        let vector = |digit: f64| core::array::from_fn(|n| digit * value(n));
        match number {
            id::ERROR => {
                self.error = Some(now);
                shared.error = data[0];
                shared.fault(Fault::Device, true);
            }
            id::STATUS => self.oriented = data[3] & 2 != 0,
            id::QUATERNION => {
                let [w, x, y, z]: [f64; 4] = core::array::from_fn(|n| QUATERNION * value(n));
                self.orientation = Rotation::new([x, y, z, w]).map(|rotation| (now, rotation));
            }
            id::TEMPERATURE => self.temperature_c = Some((now, TEMPERATURE_C * value(0))),
            id::RATE_OF_TURN => self.rotation = Some((now, vector(ROTATION_RADPS))),
            _ => self.acceleration = Some((now, vector(ACCELERATION_MPS2))),
        }
        self.complete(now, shared);
    }

    fn complete(&mut self, now: Instant, shared: &mut Shared) {
        let (Some((turned, rotation_radps)), Some((accelerated, acceleration_mps2))) =
            (self.rotation, self.acceleration)
        else {
            return;
        };
        (self.rotation, self.acceleration) = (None, None);
        if self.error.is_some_and(|at| now.since(at) >= ERROR_FOR) {
            self.error = None;
            shared.fault(Fault::Device, false);
        }
        let orientation = self.orientation.filter(|(at, _)| self.oriented && now.since(*at) <= AGE_MAX);
        let temperature = self.temperature_c.filter(|(at, _)| now.since(*at) <= TEMPERATURE_AGE_MAX);
        shared.sample(Sample {
            at: turned.min(accelerated),
            status: Status::Ok,
            acceleration_mps2,
            rotation_radps,
            orientation: orientation.map(|(_, rotation)| rotation.quaternion()),
            temperature_c: temperature.map_or(f64::NAN, |(_, value)| value),
        });
    }
}
