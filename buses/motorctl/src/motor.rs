//! The motor of an emulated device: what turns when a command acts on it.

use base::{Duration, Instant};

/// Steps of the motion.
const STEP: Duration = Duration::from_millis(1);
/// After this time without a call everything has settled.
const CATCH_UP: Duration = Duration::from_secs(60);

/// What acts on the motor; velocities in motor turns/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// No torque: it rolls, slowed by friction alone.
    Free,
    /// Braked with the strongest torque of the device.
    Brake,
    /// Velocity control.
    Velocity(f64),
}

/// Condition of the encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// It counts as the motor turns.
    Intact,
    /// It counts in the opposite direction.
    Reversed,
    /// It counts nothing.
    Dead,
}

/// A motor with its load and encoder.
#[derive(Clone, Debug)]
pub struct Motor {
    /// What acts on it.
    pub drive: Drive,
    /// Condition of its encoder.
    pub encoder: Encoder,
    velocity: f64,
    counted: f64,
    at: Instant,
    /// Moved by [`Self::place`] alone.
    is_placed: bool,
}

impl Motor {
    /// Strongest torque: a change of the velocity by 100 turns/s within a second.
    const TORQUE: f64 = 100.0;
    /// Friction: 5 turns/s within a second.
    const FRICTION: f64 = 5.0;

    /// A motor at standstill, without torque.
    #[must_use]
    pub fn new() -> Self {
        Self {
            drive: Drive::Free,
            encoder: Encoder::Intact,
            velocity: 0.0,
            counted: 0.0,
            at: Instant::ZERO,
            is_placed: false,
        }
    }

    /// True velocity, motor turns/s.
    #[must_use]
    pub fn velocity(&self) -> f64 {
        self.velocity
    }

    /// Velocity that the encoder shows, motor turns/s.
    #[must_use]
    pub fn measured(&self) -> f64 {
        match self.encoder {
            Encoder::Intact => self.velocity,
            Encoder::Reversed => -self.velocity,
            Encoder::Dead => 0.0,
        }
    }

    /// Turns that the encoder has counted.
    #[must_use]
    pub fn turns(&self) -> f64 {
        self.counted
    }

    /// Pushes the motor to this velocity, turns/s.
    pub fn push(&mut self, velocity: f64) {
        self.velocity = velocity;
    }

    /// Sets the counted turns and the velocity, turns/s, of a motor in a body that the caller moves as [`Self::drive`]
    /// demands. From the first call on it moves by these calls alone.
    pub fn place(&mut self, turns: f64, velocity: f64) {
        (self.counted, self.velocity, self.is_placed) = (turns, velocity, true);
    }

    /// Moves on to `now`.
    pub fn advance(&mut self, now: Instant) {
        if self.is_placed {
            return;
        }
        self.at = self.at.max(now - CATCH_UP);
        while self.at < now {
            let step = now.since(self.at).min(STEP);
            self.at += step;
            self.step(step.as_secs_f64());
        }
    }

    fn step(&mut self, seconds: f64) {
        let (target, strength) = match self.drive {
            Drive::Free => (0.0, Self::FRICTION),
            Drive::Brake => (0.0, Self::TORQUE),
            Drive::Velocity(target) => (target, Self::TORQUE),
        };
        let change = strength * seconds;
        self.velocity += (target - self.velocity).clamp(-change, change);
        self.counted += self.measured() * seconds;
    }
}

impl Default for Motor {
    fn default() -> Self {
        Self::new()
    }
}
