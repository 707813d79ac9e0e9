//! Encoder of a wheel's motor, as its drive reads it: true, or wrong by an injected fault.

use crate::body::Body;
use base::Instant;

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
    /// Way of the tread, m.
    pub way: f64,
    /// Speed of the tread, m/s.
    pub speed: f64,
}

/// The encoder of a wheel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Encoder {
    wheel: u8,
    /// The fault, and when it ends.
    wrong: Option<(Wrong, Instant)>,
    /// Added to the way, so that it does not jump when a fault begins or ends, m.
    offset: f64,
}

impl Encoder {
    /// The true one of a wheel.
    pub fn new(wheel: u8) -> Self {
        Self { wheel, wrong: None, offset: 0.0 }
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
        let (wheel, factor) = match self.wrong {
            None => (self.wheel, 1.0),
            Some((Wrong::Scaled(factor), _)) => (self.wheel, factor),
            Some((Wrong::Of(other), _)) => (other, 1.0),
        };
        let wheel = usize::from(wheel);
        Reading { way: factor * body.motor_way(wheel) + self.offset, speed: factor * body.wheel_speed(wheel) }
    }

    /// What the speed loop makes the wheel do that should roll at `demand`, m/s: it removes the deviation that it
    /// reads, so it accelerates without end where the reading does not follow. Without a deviation there is no torque.
    pub fn controlled(&self, demand: f64, body: &Body) -> Option<f64> {
        if self.wrong.is_none() {
            return Some(demand);
        }
        let deviation = demand - self.read(body).speed;
        (deviation != 0.0).then(|| body.wheel_speed(self.wheel.into()) + deviation)
    }
}
