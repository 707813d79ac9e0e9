//! The start-up of an RPLIDAR, and its data to sectors.

use super::capsule::{self, Capsule};
use super::wire::{Descriptor, Info, Node, answer, conf, encode, get_conf, request};
use super::{Config, Mode, Model, Motor};
use crate::builder::{Builder, EIGHTHS, SIXTEENTHS, Sample, Step};
use crate::dialog::{Dialog, Received};
use crate::engine::{Bytes, Optics, Progress, Protocol, Shared};
use crate::event::{Fault, Health, LostReason, text};
use crate::framing::Framing;
use crate::scan::wrap;
use base::{Duration, Instant};
use core::f64::consts::TAU;

/// Time limit of the first data after a scan was asked for; they come while the motor spins up.
const DATA_WITHIN: Duration = Duration::from_millis(1000);
/// Speed of the motor, Hz: the widest range of the data sheets.
const RATE_HZ: core::ops::RangeInclusive<f64> = 4.5..=16.0;
/// A capsule or sample that is farther from the last than at this speed is not believed, Hz.
const RATE_MAX_HZ: f64 = 25.0;
/// Time limit of a revolution of single samples, s.
const TURN_WITHIN_S: f64 = 0.35;
/// The motor turns steadily while the angles of two capsules in succession differ by at most one part in this many:
/// 0.29° of the 28.8° of a C1 at 10 Hz, less than the 0.72° between two samples.
const STEADY: u32 = 100;
/// Samples in order after which single samples are believed.
const SETTLED: u16 = 16;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Ask {
    Info,
    Health,
    Rate,
    Typical,
    Period { mode: u16 },
    Kind { mode: u16 },
    Scan { mode: u16 },
}

/// The protocol of RPLIDARs.
#[derive(Debug)]
pub struct Requests {
    config: Config,
    dialog: Dialog<Ask>,
    /// A device that reported an error was reset.
    was_reset: bool,
    /// The device answers requests for its configuration.
    has_conf: bool,
    /// Time of a sample, s.
    period_s: f64,
    capsule: Capsule,
    last: Option<Last>,
    framing: Framing,
    node: NodeState,
    builder: Builder,
}

/// The last valid capsule.
#[derive(Debug)]
struct Last {
    arrived: Instant,
    capsule: Capsule,
    /// Its samples were added when it arrived.
    is_taken: bool,
    /// From the capsule before to this one, 1/64°.
    advance_q6: Option<u32>,
}

#[derive(Clone, Copy, Debug, Default)]
struct NodeState {
    angle_rad: Option<f64>,
    settled: u16,
    /// Samples since the revolution began, and of the last whole one.
    count: u16,
    per_turn: u16,
    /// No sample of this revolution is missing.
    is_whole: bool,
}

/// Sectors of a revolution: an S2 sends a capsule each 1.25 ms, and single samples come one by one.
fn sectors(config: Config) -> u8 {
    if config.model == Model::S2 || config.mode == Mode::Standard { EIGHTHS } else { SIXTEENTHS }
}

impl Requests {
    pub(super) fn new(config: Config) -> Self {
        Self {
            config,
            dialog: Dialog::new(Ask::Info),
            was_reset: false,
            has_conf: false,
            period_s: 0.0,
            capsule: Capsule::new(),
            last: None,
            framing: Framing::default(),
            node: NodeState::default(),
            builder: Builder::new(true, sectors(config)),
        }
    }

    fn request(&self, ask: Ask) -> Bytes {
        match ask {
            Ask::Info => encode(request::GET_INFO, &[]),
            Ask::Health => encode(request::GET_HEALTH, &[]),
            Ask::Rate => encode(request::GET_SAMPLERATE, &[]),
            Ask::Typical => get_conf(conf::TYPICAL_MODE, None),
            Ask::Period { mode } => get_conf(conf::US_PER_SAMPLE, Some(mode)),
            Ask::Kind { mode } => get_conf(conf::ANSWER_TYPE, Some(mode)),
            Ask::Scan { .. } if self.config.mode == Mode::Standard => encode(request::SCAN, &[]),
            // Modes are below 16.
            Ask::Scan { mode } => encode(request::EXPRESS_SCAN, &[mode as u8, 0, 0, 0, 0]),
        }
    }

    fn ask(&mut self, now: Instant, ask: Ask, shared: &mut Shared) -> Progress {
        self.dialog.ask(now, ask, self.request(ask), shared)
    }

    fn kind(&self) -> u8 {
        match self.config.mode {
            Mode::Standard => answer::SAMPLES,
            Mode::Express => answer::EXPRESS,
            Mode::Ultra => answer::ULTRA,
            Mode::Dense => answer::DENSE,
        }
    }

    fn answered(
        &mut self,
        now: Instant,
        ask: Ask,
        descriptor: Descriptor,
        answer: &[u8],
        shared: &mut Shared,
    ) -> Progress {
        let entry = |entry: u32| answer.strip_prefix(&entry.to_le_bytes());
        shared.accept();
        match (ask, descriptor.kind) {
            (Ask::Info, answer::INFO) => {
                let Some(info) = Info::decode(answer) else { return self.unfit(shared) };
                self.identified(now, &info, shared)
            }
            (Ask::Health, answer::HEALTH) => match *answer {
                [status, low, high] => self.healthy(now, status, u16::from_le_bytes([low, high]).into(), shared),
                _ => self.unfit(shared),
            },
            (Ask::Rate, answer::SAMPLERATE) => {
                let [a, b, c, d] = *answer else { return self.unfit(shared) };
                let [single, express] = [[a, b], [c, d]].map(u16::from_le_bytes);
                let period = if self.config.mode == Mode::Standard { single } else { express };
                self.timed(now, f64::from(period), 0, shared)
            }
            (Ask::Typical, answer::CONF) => match entry(conf::TYPICAL_MODE) {
                Some([low, high, ..]) if *high == 0 && *low < 16 => {
                    self.ask(now, Ask::Kind { mode: u16::from(*low) }, shared)
                }
                _ => self.unfit(shared),
            },
            (Ask::Kind { mode }, answer::CONF) => match entry(conf::ANSWER_TYPE) {
                Some([kind, ..]) if *kind == self.kind() => self.ask(now, Ask::Period { mode }, shared),
                // The recommended mode has other data: the others are tried in turn.
                Some([_, ..]) if mode > 0 => self.ask(now, Ask::Kind { mode: mode - 1 }, shared),
                Some([kind, ..]) => Progress::Lost(LostReason::Refused { code: u32::from(*kind) }),
                _ => self.unfit(shared),
            },
            (Ask::Period { mode }, answer::CONF) => match entry(conf::US_PER_SAMPLE) {
                Some([a, b, c, d]) => {
                    let us = f64::from(u32::from_le_bytes([*a, *b, *c, *d])) / 256.0;
                    self.timed(now, us, mode, shared)
                }
                _ => self.unfit(shared),
            },
            (Ask::Scan { .. }, kind) if kind == self.kind() && descriptor.many => self.dialog.scan(now + DATA_WITHIN),
            _ => self.unfit(shared),
        }
    }

    /// An answer that does not fit; the request is repeated when its time is over.
    fn unfit(&mut self, shared: &mut Shared) -> Progress {
        shared.reject();
        Progress::Pending
    }

    fn identified(&mut self, now: Instant, info: &Info, shared: &mut Shared) -> Progress {
        let serial = info.serial.iter().fold(0_u128, |all, byte| all << 8 | u128::from(*byte));
        let (major, minor) = info.firmware;
        shared.identify(text(format_args!(
            "RPLIDAR model 0x{:02X} firmware {major}.{minor:02} hardware {} serial {serial:032X}",
            info.model, info.hardware
        )));
        if info.model >> 4 != self.config.model.major() {
            return Progress::Lost(LostReason::Identity);
        }
        self.has_conf = info.has_conf();
        self.ask(now, Ask::Health, shared)
    }

    fn healthy(&mut self, now: Instant, status: u8, code: u32, shared: &mut Shared) -> Progress {
        // LR001, GET_HEALTH: what a status means. No document says what a code does.
        let (health, meaning) = match status {
            0 => (Health::Good, ""),
            1 => (Health::Warning { code }, "it may fail soon"),
            _ => (Health::Error { code }, "it protects itself from damage"),
        };
        shared.health_of(health, text(format_args!("{meaning}")));
        if matches!(health, Health::Error { .. }) {
            if !self.was_reset {
                shared.send(&encode(request::RESET, &[]));
            }
            self.was_reset = !self.was_reset;
            return Progress::Lost(LostReason::Device { code });
        }
        self.was_reset = false;
        match self.config.model.motor() {
            Motor::None => {}
            Motor::Pwm(duty) => shared.send(&encode(request::SET_MOTOR_PWM, &duty.to_le_bytes())),
            Motor::Rpm(rpm) => shared.send(&encode(request::SET_MOTOR_RPM, &rpm.to_le_bytes())),
        }
        let ask = match self.config.mode {
            // Mode 0 is that of single samples.
            Mode::Standard if self.has_conf => Ask::Period { mode: 0 },
            _ if self.has_conf => Ask::Typical,
            _ => Ask::Rate,
        };
        self.ask(now, ask, shared)
    }

    fn timed(&mut self, now: Instant, us: f64, mode: u16, shared: &mut Shared) -> Progress {
        if !(10.0..=2000.0).contains(&us) {
            return self.unfit(shared);
        }
        self.period_s = us * 1e-6;
        self.ask(now, Ask::Scan { mode }, shared)
    }

    fn take_data(&mut self, now: Instant, byte: u8, shared: &mut Shared) {
        let length = capsule::shape(self.config.mode).map_or(Node::LENGTH, |(length, _)| length);
        let may_begin = match self.config.mode {
            Mode::Standard => Node::may_begin,
            _ => capsule::may_begin,
        };
        // There is room: a whole capsule is taken below.
        let _ = self.capsule.push(byte);
        while !self.capsule.is_empty() {
            let is_whole = self.capsule.len() == length;
            if may_begin(&self.capsule) && !is_whole {
                return;
            }
            if is_whole && self.take_whole(now, shared) {
                self.capsule.clear();
                self.framing.found();
                self.dialog.scanned();
                return;
            }
            self.node = NodeState { per_turn: self.node.per_turn, ..NodeState::default() };
            self.last = None;
            self.framing.skip(&mut self.capsule, length, may_begin, shared);
        }
    }

    /// Takes a whole sample or capsule; false if it is not valid.
    fn take_whole(&mut self, now: Instant, shared: &mut Shared) -> bool {
        if self.config.mode == Mode::Standard {
            let node = <&[u8; Node::LENGTH]>::try_from(&self.capsule[..]).ok().and_then(Node::decode);
            return node.is_some_and(|node| self.take_node(now, node, shared));
        }
        if !capsule::is_valid(&self.capsule) {
            return false;
        }
        let mut new = Last { arrived: now, capsule: self.capsule.clone(), is_taken: false, advance_q6: None };
        if capsule::is_first(&new.capsule) && self.last.is_some() {
            // The device began again.
            shared.reject();
            self.builder.reset();
        } else if let Some(last) = self.last.take() {
            self.take_capsule(&last, &mut new, shared);
        }
        self.last = Some(new);
        true
    }

    fn on_wire(&self, bytes: usize) -> Duration {
        Duration::from_secs_f64(bytes as f64 * 10.0 / f64::from(self.config.model.baud()))
    }

    fn range_m(&self, range_mm: f32) -> f32 {
        let range_m = range_mm / 1000.0;
        match range_m {
            _ if range_m <= 0.0 => self.config.no_echo.range_m(),
            _ if range_m < self.config.model.range_m().0 => f32::NEG_INFINITY,
            _ => range_m,
        }
    }

    /// Takes what two capsules in succession tell: the samples of the earlier one, and of the new one, too, if it
    /// needs no later one.
    fn take_capsule(&mut self, last: &Last, new: &mut Last, shared: &mut Shared) {
        let (_, count) = capsule::shape(self.config.mode).unwrap_or((0, 1));
        let advance_q6 = capsule::advance_q6(&last.capsule, &new.capsule);
        let advance_rad = f64::from(advance_q6) / f64::from(360 * 64) * TAU;
        let step = Step { angle_rad: advance_rad / count as f64, time_s: self.period_s };
        let rate_hz = step.angle_rad / TAU / self.period_s;
        if advance_rad <= 0.0 {
            self.builder.reset();
            return shared.stale();
        }
        if rate_hz > RATE_MAX_HZ {
            // Capsules between were lost.
            self.builder.reset();
            return shared.reject();
        }
        shared.accept();
        shared.fault(Fault::Slow, !RATE_HZ.contains(&rate_hz));
        if !last.is_taken {
            let samples = capsule::decode(self.config.mode, &last.capsule, &new.capsule);
            self.take_samples(last, &samples, step, shared);
        }
        new.advance_q6 = Some(advance_q6);
        let is_steady = |before: u32| before.abs_diff(advance_q6) * STEADY <= advance_q6;
        if self.config.mode != Mode::Ultra && last.advance_q6.is_some_and(is_steady) {
            new.is_taken = true;
            let samples = capsule::ahead(self.config.mode, &new.capsule, advance_q6);
            self.take_samples(new, &samples, step, shared);
        }
    }

    fn take_samples(&mut self, of: &Last, samples: &[capsule::Sample], step: Step, shared: &mut Shared) {
        // The last sample was measured when the capsule began on the wire.
        let length = samples.len() as f64;
        let first = of.arrived - self.on_wire(of.capsule.len()) - Duration::from_secs_f64(length * self.period_s);
        for (n, sample) in samples.iter().enumerate() {
            let at = first + Duration::from_secs_f64(n as f64 * self.period_s);
            let range_m = self.range_m(sample.range_mm);
            let intensity = if sample.range_mm > 0.0 { 1.0 } else { 0.0 };
            self.builder.push(Sample { angle_rad: sample.angle_rad, at, range_m, intensity }, step, shared);
        }
    }

    /// Takes a sample; false if it does not follow the last one.
    fn take_node(&mut self, now: Instant, node: Node, shared: &mut Shared) -> bool {
        let angle_rad = f64::from(node.angle_q6) / f64::from(360 * 64) * TAU;
        let step_max = TAU * RATE_MAX_HZ * self.period_s;
        let Some(before) = self.node.angle_rad.replace(angle_rad) else { return true };
        let ahead = wrap(angle_rad - before);
        // Angles are corrected for the range, and may go back a little.
        if ahead > step_max.max(0.06) || ahead < -0.06 {
            self.node.angle_rad = None;
            return false;
        }
        self.node.settled = self.node.settled.saturating_add(1);
        self.node.count = self.node.count.saturating_add(1);
        if node.starts {
            // A start that is not at the front, or is repeated by a motor that stands, is not one.
            if self.node.is_whole && self.node.count > 32 && !(0.5..TAU - 0.5).contains(&angle_rad) {
                self.node.per_turn = self.node.count;
                let rate_hz = 1.0 / (f64::from(self.node.count) * self.period_s);
                shared.fault(Fault::Slow, !RATE_HZ.contains(&rate_hz));
            }
            (self.node.count, self.node.is_whole) = (0, true);
        }
        if f64::from(self.node.count) * self.period_s > TURN_WITHIN_S {
            self.node.per_turn = 0;
            self.builder.reset();
            if self.node.count.is_multiple_of(64) {
                shared.stale();
            }
            return true;
        }
        if self.node.settled < SETTLED || self.node.per_turn == 0 {
            return true;
        }
        if self.node.settled.is_multiple_of(64) {
            shared.accept();
        }
        let step = Step { angle_rad: TAU / f64::from(self.node.per_turn), time_s: self.period_s };
        let at = now - self.on_wire(Node::LENGTH) - Duration::from_secs_f64(self.period_s);
        let range_mm = f32::from(node.range_q2) / 4.0;
        let range_m = self.range_m(if node.quality == 0 { 0.0 } else { range_mm });
        self.builder.push(Sample { angle_rad, at, range_m, intensity: node.quality.into() }, step, shared);
        true
    }
}

impl Protocol for Requests {
    fn start(&mut self, now: Instant, shared: &mut Shared) {
        self.capsule.clear();
        self.last = None;
        self.framing.reset();
        self.node = NodeState::default();
        self.builder.reset();
        let request = self.request(Ask::Info);
        self.dialog.start(now, &encode(request::STOP, &[]), Ask::Info, request, shared);
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8], shared: &mut Shared) -> Progress {
        for byte in bytes {
            match self.dialog.receive(*byte, shared) {
                Received::Nothing => {}
                Received::Data => self.take_data(now, *byte, shared),
                Received::Answer { ask, descriptor, bytes } => {
                    let progress = self.answered(now, ask, descriptor, &bytes, shared);
                    if progress != Progress::Pending {
                        return progress;
                    }
                }
            }
        }
        Progress::Pending
    }

    fn handle_timeout(&mut self, now: Instant, shared: &mut Shared) -> Progress {
        self.dialog.handle_timeout(now, shared)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.dialog.poll_timeout()
    }

    fn optics(&self) -> Optics {
        let (range_min_m, range_max_m) = self.config.model.range_m();
        Optics { range_min_m, range_max_m, view_rad: TAU, rate_min_hz: *RATE_HZ.start() }
    }
}
