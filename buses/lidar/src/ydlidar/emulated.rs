//! The other end: a YDLIDAR that answers, turns and scans.
//!
//! Assumed, where the manuals are silent: while it scans a device takes no command but stop; a motor that is to turn
//! and stands ends the scan, and is an error; a beam between a near and a far surface has no echo; a restart takes
//! 300 ms.

use super::Model;
use super::wire::{Packet, RATES, SAMPLES_MAX, TURN_Q6, answer, command, correction_rad, far_rad};
use crate::emulated::{Faults, Line, Scene, swept};
use crate::rplidar::wire::{Descriptor, Info, SYNC};
use base::{Duration, Instant, earliest};
use core::f64::consts::TAU;
use heapless::Vec;

/// Change of speed of the motor, Hz/s.
const SPIN_UP_HZ_PER_S: f64 = 20.0;
/// Time of a restart.
const RESTART: Duration = Duration::from_millis(300);
/// Angles at least as great as any by which the beam lies behind the head, and before it, rad: 8° of what is far away,
/// and -2.4° of what is at the shortest range of an X4.
const BEHIND_RAD: f64 = 9.0 / 360.0 * TAU;
const BEFORE_RAD: f64 = 3.0 / 360.0 * TAU;
/// Surfaces along a beam that are tried: each gives the direction of the next one.
const SURFACES: usize = 4;
/// A beam meets a surface that is so near to its direction, rad: half a direction of the scene.
const MEETS_RAD: f64 = TAU / 1440.0;

/// A device.
#[derive(Debug)]
pub struct Device {
    model: Model,
    /// Number of its rate of samples, of a G4 (see [`RATES`]).
    pub rate: u8,
    faults: Faults,
    scene: Scene,
    line: Line,
    /// The first byte of a command has arrived.
    is_called: bool,
    scan: Option<Scan>,
    rate_hz: f64,
    /// Direction of the head, rad clockwise.
    angle: f64,
    at: Instant,
    restarts_until: Option<Instant>,
}

#[derive(Debug)]
struct Scan {
    /// When the next sample is taken.
    next: Instant,
    first_q6: u16,
    last_q6: u16,
    samples: Vec<u16, SAMPLES_MAX>,
    last_angle: f64,
}

impl Device {
    /// A device at power-on.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self {
            model,
            rate: 2,
            faults: Faults::default(),
            scene: Scene::default(),
            line: Line::new(model.baud() / 10),
            is_called: false,
            scan: None,
            rate_hz: 0.0,
            angle: 0.0,
            at: Instant::ZERO,
            restarts_until: None,
        }
    }

    /// True while it scans.
    #[must_use]
    pub fn scans(&self) -> bool {
        self.scan.is_some()
    }

    /// Revolutions per second when nothing is wrong.
    fn full_hz(&self) -> f64 {
        match self.model {
            Model::X4 => 7.0,
            Model::G4 => 10.0,
        }
    }

    fn period_s(&self) -> f64 {
        let samples_per_s = match self.model {
            Model::X4 => self.model.samples_per_s(),
            Model::G4 => RATES.get(usize::from(self.rate)).map_or(9000, |(samples_per_s, _)| *samples_per_s),
        };
        1.0 / f64::from(samples_per_s)
    }

    fn answer(&mut self, now: Instant, kind: u8, payload: &[u8]) {
        let descriptor = Descriptor { len: payload.len() as u32, many: false, kind };
        let mut bytes = Vec::<u8, 32>::new();
        // Answers are shorter.
        let _ = bytes.extend_from_slice(&descriptor.encode());
        let _ = bytes.extend_from_slice(payload);
        self.line.begin(now);
        self.line.send(&bytes, &self.faults);
    }

    fn serve(&mut self, now: Instant, command: u8) {
        if self.faults.refuses || self.faults.hangs || self.scans() && command != command::STOP {
            return;
        }
        let is_g4 = self.model == Model::G4;
        match command {
            command::STOP => {
                self.scan = None;
                self.line.clear();
            }
            command::GET_INFO => {
                let info = Info {
                    model: if self.faults.stranger { 8 } else { self.model.number() },
                    firmware: (1, 10),
                    hardware: 1,
                    serial: [2, 0, 2, 0, 0, 6, 2, 2, 0, 0, 0, 0, 2, 2, 0, 9],
                };
                self.answer(now, answer::VALUE, &info.encode());
            }
            command::GET_HEALTH => {
                let (status, code) = match self.faults {
                    Faults { motor_stopped: true, .. } => (2, 1),
                    Faults { error: true, .. } => (2, 2),
                    Faults { dirty: true, .. } => (1, 4),
                    _ => (0, 0),
                };
                self.answer(now, answer::HEALTH, &[status, code, 0]);
            }
            command::GET_RATE if is_g4 => self.answer(now, answer::VALUE, &[self.rate]),
            command::GET_SPEED if is_g4 => {
                let speed = (self.full_hz() * 100.0) as u32;
                self.answer(now, answer::VALUE, &speed.to_le_bytes());
            }
            command::SCAN if !self.faults.error && !self.faults.motor_stopped => {
                let descriptor = Descriptor { len: 5, many: true, kind: answer::PACKETS };
                self.line.begin(now);
                self.line.send(&descriptor.encode(), &self.faults);
                let (next, last_angle) = (now + Duration::from_secs_f64(self.period_s()), self.angle);
                self.scan = Some(Scan { next, first_q6: 0, last_q6: 0, samples: Vec::new(), last_angle });
            }
            _ if command == self.model.restart() => {
                self.line.clear();
                self.restarts_until = Some(now + RESTART);
            }
            _ => {}
        }
    }

    /// Range that is measured, mm in 1/4, while the head points there.
    ///
    /// The direction of a beam's end depends on its range: that of the surface in one direction tells where to look
    /// next, until the beam meets it.
    fn measure(&self, angle: f64) -> u16 {
        let (min_m, max_m) = self.model.range_m();
        let mut direction = angle + far_rad();
        for _ in 0..SURFACES {
            let range_m = self.scene.range_m(-direction);
            if range_m > max_m || self.faults.blocked {
                return 0;
            }
            let towards = angle + correction_rad(f64::from(range_m.max(min_m)) * 1000.0);
            if (towards - direction).abs() <= MEETS_RAD {
                return libm::roundf(range_m * 4000.0) as u16;
            }
            direction = towards;
        }
        0
    }

    /// Sends the samples since the last packet.
    fn send(&mut self, starts: bool) {
        let told = starts && self.model == Model::G4;
        let speed = if told { libm::round(self.rate_hz * 10.0) as u8 } else { 0 };
        let Some(scan) = self.scan.as_mut().filter(|scan| !scan.samples.is_empty()) else { return };
        let (first_q6, last_q6) = (scan.first_q6, scan.last_q6);
        let packet = Packet { starts, speed, first_q6, last_q6, samples: core::mem::take(&mut scan.samples) };
        self.line.begin(self.at);
        self.line.send(&packet.encode(), &self.faults);
    }

    /// Takes a sample at the present angle, and sends what is complete.
    fn sample(&mut self) {
        let range = self.measure(self.angle);
        let angle_q6 = (libm::floor(self.angle / TAU * f64::from(TURN_Q6)) as u32 % u32::from(TURN_Q6)) as u16;
        let (angle, samples_max) = (self.angle, self.model.samples_max());
        let starts = self.scan.as_ref().is_some_and(|scan| angle < scan.last_angle);
        if starts {
            self.send(false);
        }
        let Some(scan) = &mut self.scan else { return };
        if scan.samples.is_empty() {
            scan.first_q6 = angle_q6;
        }
        (scan.last_q6, scan.last_angle) = (angle_q6, angle);
        // There is room: a full packet is sent below.
        let _ = scan.samples.push(range);
        if starts || scan.samples.len() >= samples_max {
            self.send(starts);
        }
    }

    fn turn(&mut self, elapsed: Duration) {
        let wanted = match self.faults {
            Faults { motor_stopped: true, .. } => 0.0,
            Faults { motor_slow: true, .. } => self.full_hz() / 3.0,
            _ if self.scans() => self.full_hz(),
            _ => 0.0,
        };
        let elapsed = elapsed.as_secs_f64();
        let change = (wanted - self.rate_hz).clamp(-SPIN_UP_HZ_PER_S * elapsed, SPIN_UP_HZ_PER_S * elapsed);
        self.rate_hz += change;
        // Many turns at the first call: the clock may have begun long before.
        self.angle = (self.angle + TAU * self.rate_hz * elapsed) % TAU;
    }

    /// Samples until a packet is complete, as the motor turns now.
    fn missing(&self, scan: &Scan) -> usize {
        let to_start = (TAU - self.angle) / (TAU * self.rate_hz.max(0.1) * self.period_s());
        (self.model.samples_max() - scan.samples.len()).min(libm::ceil(to_start) as usize).max(1)
    }
}

impl crate::emulated::Device for Device {
    fn faults(&mut self) -> &mut Faults {
        &mut self.faults
    }

    fn scene(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// As far as the motor turns at its full speed, and what lies beside the sweep.
    fn measures(&self, until: Instant) -> (usize, usize) {
        let turns_rad = TAU * self.full_hz() * until.since(self.at).as_secs_f64();
        swept(self.angle - BEHIND_RAD, self.angle + turns_rad + BEFORE_RAD)
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        let Faults { unpowered, cut, deaf, wrong_baud, .. } = self.faults;
        if unpowered || cut || deaf || wrong_baud || self.restarts_until.is_some() {
            return;
        }
        for byte in bytes {
            if core::mem::take(&mut self.is_called) {
                self.serve(now, *byte);
            } else {
                self.is_called = *byte == SYNC;
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.faults.unpowered {
            (self.scan, self.restarts_until, self.rate_hz, self.at) = (None, None, 0.0, now);
            self.is_called = false;
            self.line.clear();
            return;
        }
        if self.restarts_until.is_some_and(|until| until <= now) {
            self.restarts_until = None;
        }
        let period = Duration::from_secs_f64(self.period_s());
        while let Some(next) = self.scan.as_ref().map(|scan| scan.next).filter(|next| *next <= now) {
            self.turn(next.since(self.at));
            self.at = next;
            if self.faults.motor_stopped && self.rate_hz <= 0.0 {
                self.scan = None;
                break;
            }
            if !self.faults.hangs && !self.faults.error {
                self.sample();
            }
            if let Some(scan) = &mut self.scan {
                scan.next = next + period;
            }
        }
        self.turn(now.since(self.at));
        self.at = now;
    }

    fn poll_tx(&mut self, now: Instant, bytes: &mut [u8]) -> usize {
        self.line.poll(now, bytes, &self.faults)
    }

    /// A packet is of interest when it has arrived: it is made then, as of the instant at which it was complete.
    fn poll_timeout(&self) -> Option<Instant> {
        let complete = self.scan.as_ref().map(|scan| {
            let missing = self.missing(scan);
            let length = super::wire::HEAD + 2 * (scan.samples.len() + missing);
            scan.next + Duration::from_secs_f64((missing - 1) as f64 * self.period_s()) + self.line.time(length)
        });
        earliest([self.line.arrives().or(complete), self.restarts_until])
    }
}
