//! A motor controller without CANopen: the emulation of `motorctl`, with its motor in the robot's body.
//!
//! Supply    of the motors' feed alone: without it the controller neither sends nor receives, and it starts anew with it
//! Motor     turns with the wheel; its demand is what the controller wants of it, and nothing if that has no torque

use super::encoder::{Axis, Encoder, Reading};
use crate::body::Body;
use base::can::Frame;
use base::{Duration, Instant};
use motorctl::can::{Device, Emulated};
use motorctl::motor::Drive;

/// From power or reset to the first message.
const BOOT_TIME: Duration = Duration::from_millis(100);

/// A controller of a wheel.
pub(super) struct Controller {
    pub encoder: Encoder,
    gear: f64,
    identity: Device,
    device: Emulated,
    /// It has its supply.
    fed: bool,
    /// When it has started.
    started: Instant,
}

impl Controller {
    /// Of a wheel of this number; `gear`: motor turns per turn of the wheel.
    pub fn new(wheel: u8, gear: f64, identity: Device) -> Self {
        let device = Emulated::new(identity);
        Self { encoder: Encoder::new(Axis::Wheel(wheel)), gear, identity, device, fed: true, started: Instant::ZERO }
    }

    /// Switches it on, or off and on again: what was written to it is forgotten.
    pub fn power_on(&mut self, now: Instant, body: &Body) {
        self.device = Emulated::new(self.identity);
        self.started = now + BOOT_TIME;
        self.place(body);
    }

    /// The supply comes or goes.
    pub fn feed(&mut self, now: Instant, fed: bool, body: &Body) {
        self.fed = fed;
        self.power_on(now, body);
    }

    fn is_on(&self, now: Instant) -> bool {
        self.fed && self.started <= now
    }

    /// Motor turns per metre of the wheel.
    fn turns_per_metre(&self, body: &Body) -> f64 {
        body.parameters().motor_turns_per_metre(self.gear)
    }

    fn place(&mut self, body: &Body) {
        let scale = self.turns_per_metre(body);
        let Reading { way, speed } = self.encoder.read(body);
        self.device.motor_mut().place(way * scale, speed * scale);
    }

    pub fn handle_rx(&mut self, now: Instant, frame: &Frame, body: &Body) {
        if self.is_on(now) {
            self.place(body);
            self.device.handle_rx(now, frame);
        }
    }

    pub fn handle_timeout(&mut self, now: Instant, body: &Body) {
        if self.is_on(now) {
            self.place(body);
            self.device.handle_timeout(now);
        }
    }

    /// Raises a fault, as its own checks do.
    pub fn fault(&mut self, fault: u16) {
        self.device.raise(fault);
    }

    /// True if time alone changes nothing.
    pub fn rests(&self) -> bool {
        !matches!(self.device.motor().drive, Drive::Velocity(turns) if turns != 0.0)
    }

    /// Speed that its motor demands of the wheel, m/s; none without torque.
    pub fn demand(&self, body: &Body) -> Option<f64> {
        match self.device.motor().drive {
            Drive::Free => None,
            Drive::Brake => Some(0.0),
            Drive::Velocity(turns) => Some(turns / self.turns_per_metre(body)),
        }
    }

    pub fn poll_tx(&mut self) -> Option<Frame> {
        self.device.poll_tx()
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let due = self.device.poll_timeout().map(|due| due.max(self.started));
        due.filter(|_| self.fed)
    }
}
