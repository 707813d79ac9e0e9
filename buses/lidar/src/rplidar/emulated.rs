//! The other end: an RPLIDAR that answers, turns and scans.
//!
//! Assumed, where the notes are silent: a motor that stands goes on to be sampled in one direction; any request but one
//! for the motor ends a scan; a reset takes 300 ms.

use super::capsule;
use super::wire::{Descriptor, Info, Node, SYNC, answer, conf, request};
use super::{Mode, Model, Motor};
use crate::emulated::{Faults, Line, Scene, swept};
use base::{Duration, Instant, earliest};
use core::f64::consts::TAU;
use heapless::Vec;

/// Revolutions per second.
const RATE_HZ: f64 = 10.0;
/// Change of speed of the motor, Hz/s.
const SPIN_UP_HZ_PER_S: f64 = 20.0;
/// Time of a reset.
const RESET: Duration = Duration::from_millis(300);
/// Request with a payload at most.
const REQUEST_MAX: usize = 40;

/// A mode: its data, the time of a sample in 1/256 µs, its name.
type ModeOf = (Mode, u32, &'static [u8]);

/// A device.
#[derive(Debug)]
pub struct Device {
    model: Model,
    /// Firmware, major and minor.
    pub firmware: (u8, u8),
    faults: Faults,
    scene: Scene,
    line: Line,
    rx: Vec<u8, REQUEST_MAX>,
    scan: Option<Scan>,
    /// The motor is commanded to turn, by request or wire.
    turns: bool,
    rate_hz: f64,
    /// Direction of the head, rad clockwise.
    angle: f64,
    at: Instant,
    resets_until: Option<Instant>,
}

#[derive(Debug)]
struct Scan {
    mode: Mode,
    period: Duration,
    /// When the next sample is taken.
    next: Instant,
    is_first: bool,
    start_q6: u16,
    ranges: Vec<u16, { capsule::SAMPLES_MAX }>,
    last_angle: f64,
}

/// Correction of the angles of express capsules, 1/8°.
const OFFSET_Q3: u8 = 21;

/// Angles at least as great as any by which the beam lies behind the sweep, and before it, rad: 8° of what is far away,
/// and -20.5° of what is at 50 mm.
const BEHIND_RAD: f64 = 9.0 / 360.0 * TAU;
const BEFORE_RAD: f64 = 21.0 / 360.0 * TAU;

fn modes(model: Model) -> &'static [ModeOf] {
    const US: u32 = 256;
    match model {
        Model::A1 => &[
            (Mode::Standard, 508 * US, b"Standard\0"),
            (Mode::Express, 254 * US, b"Express\0"),
            (Mode::Ultra, 127 * US, b"Boost\0"),
        ],
        Model::A2 => &[(Mode::Standard, 500 * US, b"Standard\0"), (Mode::Express, 250 * US, b"Express\0")],
        Model::A3 => &[
            (Mode::Standard, 252 * US, b"Standard\0"),
            (Mode::Express, 126 * US, b"Express\0"),
            (Mode::Ultra, 16_128, b"Boost\0"),
        ],
        Model::C1 => &[(Mode::Standard, 200 * US, b"Standard\0"), (Mode::Dense, 200 * US, b"DenseBoost\0")],
        Model::S2 => &[(Mode::Standard, 64 * US, b"Standard\0"), (Mode::Dense, 8000, b"DenseBoost\0")],
    }
}

fn kind(mode: Mode) -> u8 {
    match mode {
        Mode::Standard => answer::SAMPLES,
        Mode::Express => answer::EXPRESS,
        Mode::Ultra => answer::ULTRA,
        Mode::Dense => answer::DENSE,
    }
}

impl Device {
    /// A device at power-on.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self {
            model,
            // An A2 of before the requests for the configuration.
            firmware: if model == Model::A2 { (1, 20) } else { (1, 29) },
            faults: Faults::default(),
            scene: Scene::default(),
            line: Line::new(model.baud() / 10),
            rx: Vec::new(),
            scan: None,
            turns: model.motor() == Motor::None,
            rate_hz: 0.0,
            angle: 0.0,
            at: Instant::ZERO,
            resets_until: None,
        }
    }

    /// True while it scans.
    #[must_use]
    pub fn scans(&self) -> bool {
        self.scan.is_some()
    }

    fn info(&self) -> Info {
        let major = if self.faults.stranger { 0xB } else { self.model.major() };
        Info {
            model: major << 4 | 8,
            firmware: self.firmware,
            hardware: 7,
            serial: *b"\x8B\xB6\xED\xF9\xC7\xE2\x9B\xD1\xA7\xE3\x9E\xF2\x6E\x3F\x43\x02",
        }
    }

    fn answer(&mut self, kind: u8, payload: &[u8]) {
        let descriptor = Descriptor { len: payload.len() as u32, many: false, kind };
        let mut bytes = Vec::<u8, 64>::new();
        // Answers are shorter.
        let _ = bytes.extend_from_slice(&descriptor.encode());
        let _ = bytes.extend_from_slice(payload);
        self.line.send(&bytes, &self.faults);
    }

    fn begin(&mut self, now: Instant, mode: Mode, period_256: u32) {
        let len = capsule::shape(mode).map_or(Node::LENGTH, |(length, _)| length);
        let descriptor = Descriptor { len: len as u32, many: true, kind: kind(mode) };
        self.line.send(&descriptor.encode(), &self.faults);
        let period = Duration::from_nanos(u64::from(period_256) * 1000 / 256);
        self.scan = Some(Scan {
            mode,
            period,
            next: now + period,
            is_first: true,
            start_q6: 0,
            ranges: Vec::new(),
            last_angle: self.angle,
        });
    }

    fn serve(&mut self, now: Instant, request: u8, payload: &[u8]) {
        if self.faults.refuses || self.faults.hangs {
            return;
        }
        if ![request::SET_MOTOR_PWM, request::SET_MOTOR_RPM].contains(&request) {
            self.scan = None;
        }
        match request {
            request::RESET => {
                self.line.clear();
                self.resets_until = Some(now + RESET);
            }
            request::GET_INFO => self.answer(answer::INFO, &self.info().encode()),
            request::GET_HEALTH => {
                let (status, code) = match self.faults {
                    Faults { error: true, .. } => (2, 0x8002_u16),
                    Faults { dirty: true, .. } => (1, 1),
                    _ => (0, 0),
                };
                let [low, high] = code.to_le_bytes();
                self.answer(answer::HEALTH, &[status, low, high]);
            }
            request::GET_SAMPLERATE => {
                let us = |mode: usize| (modes(self.model)[mode].1 / 256) as u16;
                let mut bytes = [0; 4];
                bytes[..2].copy_from_slice(&us(0).to_le_bytes());
                bytes[2..].copy_from_slice(&us(1).to_le_bytes());
                self.answer(answer::SAMPLERATE, &bytes);
            }
            request::GET_LIDAR_CONF if self.info().has_conf() => self.configuration(payload),
            request::GET_ACC_BOARD_FLAG => {
                let flag = u8::from(matches!(self.model.motor(), Motor::Pwm(_)));
                self.answer(answer::ACC_BOARD_FLAG, &[flag, 0, 0, 0]);
            }
            request::SET_MOTOR_PWM | request::SET_MOTOR_RPM if self.model.motor() != Motor::None => {
                self.turns = payload.iter().any(|byte| *byte != 0);
            }
            request::SCAN if !self.faults.error => self.begin(now, Mode::Standard, modes(self.model)[0].1),
            request::EXPRESS_SCAN if !self.faults.error => {
                // Without a configuration the number of the mode is 0 or 1 for the only one.
                let number = if self.info().has_conf() { usize::from(payload[0]) } else { 1 };
                match modes(self.model).get(number) {
                    Some((mode, period, _)) => self.begin(now, *mode, *period),
                    None => self.scan = None,
                }
            }
            _ => {}
        }
    }

    fn configuration(&mut self, payload: &[u8]) {
        let Some((entry, mode)) = payload.split_first_chunk::<4>() else { return };
        let entry = u32::from_le_bytes(*entry);
        let modes = modes(self.model);
        let mode = modes.get(usize::from(mode.first().copied().unwrap_or(0)));
        let mut bytes = Vec::<u8, 32>::from_slice(&entry.to_le_bytes()).unwrap_or_default();
        let added = match (entry, mode) {
            (conf::MODE_COUNT, _) => bytes.extend_from_slice(&(modes.len() as u16).to_le_bytes()),
            (conf::TYPICAL_MODE, _) => bytes.extend_from_slice(&(modes.len() as u16 - 1).to_le_bytes()),
            (conf::DESIRED_SPEED, _) => bytes.extend_from_slice(&[0x58, 2, 0x94, 2]),
            (conf::US_PER_SAMPLE, Some((_, period, _))) => bytes.extend_from_slice(&period.to_le_bytes()),
            (conf::MAX_DISTANCE, Some(_)) => {
                bytes.extend_from_slice(&((self.model.range_m().1 * 256.0) as u32).to_le_bytes())
            }
            (conf::ANSWER_TYPE, Some((mode, ..))) => bytes.push(kind(*mode)).map_err(|_| Default::default()),
            (conf::MODE_NAME, Some((.., name))) => bytes.extend_from_slice(name),
            _ => return,
        };
        // All of them have room.
        let _ = added;
        self.answer(answer::CONF, &bytes);
    }

    fn range_mm(&self, clockwise_rad: f64) -> u16 {
        let range_m = self.scene.range_m(-clockwise_rad);
        let is_seen = range_m <= self.model.range_m().1 && !self.faults.blocked;
        if is_seen { libm::roundf(range_m * 1000.0) as u16 } else { 0 }
    }

    /// Takes a sample at the present angle, and sends what is complete.
    fn sample(&mut self) {
        let angle = self.angle;
        let q6 = |angle: f64| (libm::floor(angle / TAU * f64::from(360 * 64)) as u32 % (360 * 64)) as u16;
        let mode = match &self.scan {
            Some(scan) => scan.mode,
            None => return,
        };
        // The beam of triangulating devices lies behind the sweep.
        let behind = match mode {
            Mode::Express => f64::from(OFFSET_Q3) / 8.0 / 360.0 * TAU,
            Mode::Ultra => capsule::ultra_offset_rad(self.range_mm(angle - 8.0 / 360.0 * TAU).into()),
            _ => 0.0,
        };
        let range = self.range_mm(angle - behind);
        let Some(scan) = &mut self.scan else { return };
        let starts = angle < scan.last_angle;
        scan.last_angle = angle;
        let Some((_, count)) = capsule::shape(mode) else {
            let quality = if range == 0 { 0 } else { 47 };
            let node = Node { starts, quality, angle_q6: q6(angle), range_q2: range.saturating_mul(4) };
            return self.line.send(&node.encode(), &self.faults);
        };
        if scan.ranges.len() == count {
            let bytes = capsule::encode(mode, scan.start_q6, scan.is_first, &scan.ranges, range, OFFSET_Q3);
            scan.is_first = false;
            scan.ranges.clear();
            self.line.send(&bytes, &self.faults);
        }
        if scan.ranges.is_empty() {
            scan.start_q6 = q6(angle);
        }
        // There is room: a full capsule was sent above.
        let _ = scan.ranges.push(range);
    }

    fn turn(&mut self, elapsed: Duration) {
        let wanted = match self.faults {
            Faults { motor_stopped: true, .. } => 0.0,
            Faults { motor_slow: true, .. } => RATE_HZ / 3.0,
            _ if self.turns => RATE_HZ,
            _ => 0.0,
        };
        let elapsed = elapsed.as_secs_f64();
        let change = (wanted - self.rate_hz).clamp(-SPIN_UP_HZ_PER_S * elapsed, SPIN_UP_HZ_PER_S * elapsed);
        self.rate_hz += change;
        // Many turns at the first call: the clock may have begun long before.
        self.angle = (self.angle + TAU * self.rate_hz * elapsed) % TAU;
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
        let turns_rad = TAU * RATE_HZ * until.since(self.at).as_secs_f64();
        swept(self.angle - BEHIND_RAD, self.angle + turns_rad + BEFORE_RAD)
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        let Faults { unpowered, cut, deaf, wrong_baud, .. } = self.faults;
        if unpowered || cut || deaf || wrong_baud || self.resets_until.is_some() {
            return;
        }
        for byte in bytes {
            if self.rx.is_empty() && *byte != SYNC || self.rx.push(*byte).is_err() {
                self.rx.clear();
                continue;
            }
            let request = match self.rx[..] {
                [_, request] if request & 0x80 == 0 => (request, 2..2),
                [_, request, len, ..] if self.rx.len() == usize::from(len) + 4 => (request, 3..usize::from(len) + 3),
                _ => continue,
            };
            let bytes = core::mem::take(&mut self.rx);
            let is_valid = bytes.len() == 2 || bytes.iter().fold(0, |sum, byte| sum ^ byte) == 0;
            let (request, payload) = request;
            if is_valid && (request != request::EXPRESS_SCAN || payload.len() == 5) {
                self.serve(now, request, &bytes[payload]);
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.faults.unpowered {
            (self.scan, self.resets_until, self.rate_hz, self.at) = (None, None, 0.0, now);
            self.turns = self.model.motor() == Motor::None;
            self.rx.clear();
            self.line.clear();
            return;
        }
        if self.resets_until.is_some_and(|until| until <= now) {
            self.resets_until = None;
            if self.model == Model::A1 {
                self.line.send(b"RP LIDAR System.\r\nFirmware Ver 1.29\r\n", &self.faults);
            }
        }
        while let Some(next) = self.scan.as_ref().map(|scan| scan.next).filter(|next| *next <= now) {
            self.turn(next.since(self.at));
            self.at = next;
            if !self.faults.hangs && !self.faults.error {
                self.sample();
            }
            if let Some(scan) = &mut self.scan {
                scan.next = next + scan.period;
            }
        }
        self.turn(now.since(self.at));
        self.at = now;
    }

    fn poll_tx(&mut self, now: Instant, bytes: &mut [u8]) -> usize {
        self.line.poll(now, bytes, &self.faults)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let next = self.scan.as_ref().map(|scan| scan.next);
        earliest([next, self.resets_until, self.line.is_busy().then_some(Instant::ZERO)])
    }
}
