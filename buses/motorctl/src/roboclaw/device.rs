//! The other end: a RoboClaw with two motors, byte by byte, by the manual that [`super`] names. For the simulator and
//! for tests.
//!
//! Assumed, where the manual is silent: any valid packet for this address feeds the serial timeout; when it expires,
//! and at a duty cycle of 0, the motors roll, which is the worse case; answers begin 500 µs after the request.

use super::wire::{Answer, Asked, Bytes, GAP, Packet, Request, TIME_UNIT};
use super::{Device as Identity, Model, wire};
use crate::motor::{Drive, Motor};
use base::{Duration, Instant, Queue, earliest};

/// From the request's last byte to the answer's first.
const DELAY: Duration = Duration::from_micros(500);

/// What is wrong with the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Neither receives nor sends; the motors run on as the serial timeout lets them.
    pub unplugged: bool,
    /// Receives, acts, and does not answer.
    pub mute: bool,
    /// Does not take drive commands, and answers all else.
    pub deaf: bool,
    /// Every answer is damaged.
    pub garbled: bool,
    /// The serial timeout keeps its value.
    pub read_only: bool,
}

/// A RoboClaw.
#[derive(Debug)]
pub struct Device {
    identity: Identity,
    /// Model and firmware.
    pub model: Model,
    /// What is wrong with it.
    pub faults: Faults,
    /// Its motors.
    pub motors: [Motor; 2],
    /// Counters of the encoders at power-on.
    pub offset: i32,
    /// Serial timeout, in [`TIME_UNIT`]s; 0: off.
    pub time_limit: u8,
    status: u32,
    fed: Instant,
    received: Instant,
    rx: Packet,
    answers: Queue<(Instant, Bytes), 4>,
}

impl Device {
    /// A device at power-on, with the serial timeout off.
    #[must_use]
    pub fn new(identity: Identity) -> Self {
        Self {
            identity,
            model: identity.model,
            faults: Faults::default(),
            motors: [Motor::new(), Motor::new()],
            offset: 0,
            time_limit: 0,
            status: 0,
            fed: Instant::ZERO,
            received: Instant::ZERO,
            rx: Packet::new(),
            answers: Queue::new(),
        }
    }

    /// Raises bits of the status; the device shuts both motors down.
    pub fn raise(&mut self, bits: u32) {
        self.status |= bits;
        if bits & wire::ERRORS != 0 {
            self.drive([Drive::Free; 2]);
        }
    }

    /// Clears the status.
    pub fn clear(&mut self) {
        self.status = 0;
    }

    /// Takes bytes from the line.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        if self.faults.unplugged {
            return;
        }
        self.handle_timeout(now);
        if self.received + GAP < now {
            self.rx.clear();
        }
        self.received = now;
        for byte in bytes {
            // A request is complete, or unknown, before the buffer is full.
            let _ = self.rx.push(*byte);
            match Request::decode(self.identity.address, &self.rx) {
                Asked::More => {}
                Asked::Unknown => self.rx.clear(),
                Asked::Request(request) => {
                    self.rx.clear();
                    self.fed = now;
                    self.execute(now, request);
                }
            }
        }
    }

    fn execute(&mut self, now: Instant, request: Request) {
        let answer = match request {
            Request::Drive(_) | Request::Duty(_) if self.faults.deaf => return,
            Request::SetTimeLimit(units) => {
                if !self.faults.read_only {
                    self.time_limit = units;
                }
                Answer::Acknowledged
            }
            Request::Drive(speeds) => {
                let turns = |motor: usize| f64::from(speeds[motor]) / self.identity.counts_per_turn[motor];
                if self.status & wire::ERRORS == 0 {
                    self.drive([Drive::Velocity(turns(0)), Drive::Velocity(turns(1))]);
                }
                Answer::Acknowledged
            }
            Request::Duty(_) => {
                self.drive([Drive::Free; 2]);
                Answer::Acknowledged
            }
            Request::TimeLimit => Answer::TimeLimit(self.time_limit),
            // The counter wraps at 32 bits.
            Request::Position(motor) => {
                let counts = self.counts(motor, self.motors[motor].turns()) as i64;
                Answer::Position((counts + i64::from(self.offset)) as i32)
            }
            Request::Speed(motor) => Answer::Speed(self.counts(motor, self.motors[motor].measured()) as i32),
            Request::Version => Answer::Version(self.model.as_bytes().iter().copied().collect()),
            Request::Supply => Answer::Supply(24.0),
            Request::Currents => Answer::Currents([0.5, 0.6]),
            Request::Temperature => Answer::Temperature(35.0),
            Request::Status => Answer::Status(self.status),
        };
        if self.faults.mute {
            return;
        }
        let mut bytes = answer.bytes(self.identity.address, request);
        if self.faults.garbled
            && let Some(byte) = bytes.last_mut()
        {
            *byte ^= 0x55;
        }
        self.answers.push((now + DELAY, bytes));
    }

    fn counts(&self, motor: usize, turns: f64) -> f64 {
        libm::round(turns * self.identity.counts_per_turn[motor])
    }

    fn drive(&mut self, drives: [Drive; 2]) {
        self.motors.iter_mut().zip(drives).for_each(|(motor, drive)| motor.drive = drive);
    }

    /// When the serial timeout expires; none while it is off or the motors are not driven.
    fn expiry(&self) -> Option<Instant> {
        let driven = self.motors.iter().any(|motor| motor.drive != Drive::Free);
        (self.time_limit != 0 && driven).then_some(self.fed + TIME_UNIT * u32::from(self.time_limit))
    }

    /// Moves the motors, and checks the serial timeout.
    pub fn handle_timeout(&mut self, now: Instant) {
        if let Some(expiry) = self.expiry().filter(|expiry| *expiry <= now) {
            self.motors.iter_mut().for_each(|motor| motor.advance(expiry));
            self.drive([Drive::Free; 2]);
        }
        self.motors.iter_mut().for_each(|motor| motor.advance(now));
    }

    /// Next bytes for the line.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        self.answers.front().filter(|(due, _)| *due <= now)?;
        let (_, bytes) = self.answers.pop()?;
        (!self.faults.unplugged).then_some(bytes)
    }

    /// Instant of the next [`Self::handle_timeout`] and [`Self::poll_tx`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        earliest([self.expiry(), self.answers.front().map(|(due, _)| *due)])
    }
}
