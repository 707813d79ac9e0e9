//! Encoder of the motor of a wheel, or of the steering, as its drive reads it: true, or wrong by an injected fault.

use crate::body::Body;
use base::Instant;

/// What a drive moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The driven wheel of this number; 0 of a driven axle. Its drive loses its motor's feed with the PAUSE line and the
    /// second way to stop.
    Wheel(u8),
    /// The front wheels' angle. The gear holds them; their drive has a supply of its own.
    Steering,
}

/// How an encoder is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wrong {
    /// It counts this multiple of the truth: 0 if it is dead, -1 if it is reversed.
    Scaled(f64),
    /// It is connected to the wheel of this number.
    Of(u8),
}

/// What an encoder reads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Reading {
    /// Way of the tread, m, or angle of the steering's output, rad.
    pub way: f64,
    /// Speed of the tread, m/s; 0 of the steering: [`Encoder::rate`].
    pub speed: f64,
}

/// The encoder of what a drive moves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Encoder {
    axis: Axis,
    /// The fault, and when it ends.
    wrong: Option<(Wrong, Instant)>,
    /// Added to the way, so that it does not jump when a fault begins or ends, m or rad.
    offset: f64,
}

impl Encoder {
    /// The true one.
    pub fn new(axis: Axis) -> Self {
        Self { axis, wrong: None, offset: 0.0 }
    }

    /// From now until then it is wrong, or true again.
    pub fn deviate(&mut self, wrong: Option<Wrong>, until: Instant, body: &Body) {
        let before = self.read(body).way;
        (self.wrong, self.offset) = (wrong.map(|wrong| (wrong, until)), 0.0);
        self.offset = before - self.read(body).way;
    }

    /// Ends a fault that is over.
    pub fn expire(&mut self, now: Instant, body: &Body) {
        if self.wrong.is_some_and(|(_, until)| until <= now) {
            self.deviate(None, now, body);
        }
    }

    /// Reads it.
    pub fn read(&self, body: &Body) -> Reading {
        let (axis, factor) = match self.wrong {
            None => (self.axis, 1.0),
            Some((Wrong::Scaled(factor), _)) => (self.axis, factor),
            Some((Wrong::Of(other), _)) => (Axis::Wheel(other), 1.0),
        };
        let Reading { way, speed } = truth(axis, body);
        Reading { way: factor * way + self.offset, speed: factor * speed }
    }

    /// How fast the steering turns as it reads it, which turns at `turned`, rad/s.
    pub fn rate(&self, turned: f64) -> f64 {
        if let Some((Wrong::Scaled(factor), _)) = self.wrong { factor * turned } else { turned }
    }

    /// What the loop makes of its axis that should roll at `demand`, m/s, or stand at it, rad: it removes the deviation
    /// that it reads, so it goes on without end where the reading does not follow. Without a deviation there is no
    /// torque.
    pub fn controlled(&self, demand: f64, body: &Body) -> Option<f64> {
        if self.wrong.is_none() {
            return Some(demand);
        }
        let controlled = |reading: Reading| if self.axis == Axis::Steering { reading.way } else { reading.speed };
        let deviation = demand - controlled(self.read(body));
        (deviation != 0.0).then(|| controlled(truth(self.axis, body)) + deviation)
    }
}

/// What a true encoder reads.
fn truth(axis: Axis, body: &Body) -> Reading {
    match axis {
        Axis::Wheel(wheel) => Reading { way: body.motor_way(wheel.into()), speed: body.wheel_speed(wheel.into()) },
        Axis::Steering => Reading { way: body.steering_output(), speed: 0.0 },
    }
}
