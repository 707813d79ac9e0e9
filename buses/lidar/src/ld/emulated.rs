//! The other end: an LD06, LD19 or STL-19P that turns and sends by itself.
//!
//! Assumed, where the manuals are silent: a motor that stands or spins up sends nothing.

use super::Model;
use super::wire::{BAUD, CLOCK_MODULUS_MS, LENGTH, Packet, SAMPLES, Sample};
use crate::emulated::{Faults, Line, Scene, swept};
use base::{Duration, Instant};

/// Speed of the motor, degrees per second.
const SPEED: u16 = 3600;
/// Time from power-on to the first packet.
const SPIN_UP: Duration = Duration::from_millis(500);

/// A device.
#[derive(Debug)]
pub struct Device {
    model: Model,
    faults: Faults,
    scene: Scene,
    line: Line,
    /// When the next packet is complete.
    next: Option<Instant>,
    /// Direction of the next sample, 0.01°, clockwise.
    angle: f64,
}

impl Device {
    /// A device at power-on.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self {
            model,
            faults: Faults::default(),
            scene: Scene::default(),
            line: Line::new(BAUD / 10),
            next: None,
            angle: 0.0,
        }
    }

    fn interval(&self) -> Duration {
        Duration::from_secs_f64(SAMPLES as f64 / f64::from(self.model.samples_per_s()))
    }

    fn packet(&mut self, at: Instant) {
        let speed = match self.faults {
            Faults { motor_slow: true, .. } => SPEED / 3,
            _ => SPEED,
        };
        let step = f64::from(speed) * 100.0 / f64::from(self.model.samples_per_s());
        let begin = self.angle;
        let mut samples = [Sample::default(); SAMPLES];
        for (n, sample) in samples.iter_mut().enumerate() {
            let angle = (begin + n as f64 * step) / 36_000.0 * core::f64::consts::TAU;
            let range_mm = self.scene.range_m(-angle) * 1000.0;
            let is_seen = range_mm <= 12_000.0 && !self.faults.blocked;
            *sample = if is_seen { Sample { range_mm: range_mm as u16, intensity: 200 } } else { Sample::default() };
        }
        let angle = |n: usize| (libm::round(begin + n as f64 * step) as u32 % 36_000) as u16;
        let packet = Packet {
            speed,
            start_angle: angle(0),
            samples,
            end_angle: angle(SAMPLES - 1),
            timestamp_ms: (at.as_nanos() / 1_000_000 % u64::from(CLOCK_MODULUS_MS)) as u16,
        };
        self.angle = (begin + SAMPLES as f64 * step) % 36_000.0;
        self.line.begin(at);
        self.line.send(&packet.encode(), &self.faults);
    }
}

impl crate::emulated::Device for Device {
    fn faults(&mut self) -> &mut Faults {
        &mut self.faults
    }

    fn scene(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// As far as the motor turns at its full speed. One that stands spins up first.
    fn measures(&self, until: Instant) -> (usize, usize) {
        let Some(next) = self.next.filter(|next| *next <= until) else { return (0, 0) };
        let packets = 1.0 + until.since(next).as_secs_f64() / self.interval().as_secs_f64();
        let swept_deg = packets * self.interval().as_secs_f64() * f64::from(SPEED);
        let from = self.angle / 100.0;
        swept(from.to_radians(), (from + swept_deg).to_radians())
    }

    /// The device has no input.
    fn handle_rx(&mut self, _: Instant, _: &[u8]) {}

    fn handle_timeout(&mut self, now: Instant) {
        if self.faults.unpowered || self.faults.motor_stopped || self.faults.hangs {
            self.next = None;
            return;
        }
        let interval = self.interval();
        let mut next = self.next.unwrap_or(now + SPIN_UP);
        while next <= now {
            self.packet(next);
            next += interval;
        }
        self.next = Some(next);
    }

    fn poll_tx(&mut self, now: Instant, bytes: &mut [u8]) -> usize {
        self.line.poll(now, bytes, &self.faults)
    }

    /// A packet is of interest when it has arrived: it is made then, as of the instant at which it was complete.
    fn poll_timeout(&self) -> Option<Instant> {
        self.line.arrives().or_else(|| self.next.map(|next| next + self.line.time(LENGTH)))
    }
}
