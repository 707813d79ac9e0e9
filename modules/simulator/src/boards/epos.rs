//! maxon EPOS 70/10, the drive of a wheel: what [`canopen::axis::servo`] has not of its own (docs/facts/canopen.md 2).
//!
//! Units     position in quadcounts, velocity in rpm of the motor, acceleration in rpm/s
//! Power-up  mode 1; only TPDO1 is on; Enable Operation takes 40 ms (Refresh, Measure Init)
//! Silence   the heartbeat consumer's event: emergency 0x8130, quick stop ramp, then Fault
//! Quick stop is kept until told otherwise: there is no 0x605A

use super::encoder::Reading;
use super::mirror::Mirror;
use crate::body::Body;
use base::{Duration, Instant};
use canopen::axis::drive::{Kind, Passage};
use canopen::axis::modes::{Mode, method};
use canopen::axis::options::{Options, Stop};
use canopen::axis::servo::{Config, Sensed, Servo};
use canopen::axis::status;
use canopen::{Dictionary, Node};

/// Refresh and Measure Init together; the real duration was not found.
pub const ENABLING: Duration = Duration::from_millis(40);
/// Heartbeat or life guarding event.
pub const HEARTBEAT: u16 = 0x8130;
/// The motor's feed is off.
const UNDERVOLTAGE: u16 = 0x3220;
/// Wheel force per motor current, N/A (docs/facts/robot.md 1.2: 83 N at 10 A).
pub(super) const FORCE_PER_AMPERE: f64 = 8.3;
/// Speed below which the motor counts as stopped, rpm.
const STANDSTILL: f64 = 10.0;
/// Deceleration at the current limit, rpm/s.
const HARDEST: f64 = 20_000.0;
/// Default of encoder pulses per turn (0x2210:1).
const PULSES: i64 = 500;
/// Gain of the position loop, 1/s.
const POSITION_GAIN: f64 = 5.0;

/// Offset measured; power stage refreshed.
const OFFSET_MEASURED: u16 = 1 << 8;
const REFRESH: u16 = 1 << 14;

/// Emergency to be sent: code and error register. Code 0: no errors any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emergency {
    /// The code.
    pub code: u16,
    /// The error register.
    pub register: u8,
}

impl Emergency {
    /// No errors any more.
    pub const NONE: Self = Self { code: 0, register: 0 };
}

/// The drive behind its objects.
#[derive(Debug)]
pub struct Epos {
    servo: Servo,
    mirror: Mirror<10>,
    /// Number of its wheel.
    wheel: u8,
    /// Motor turns per turn of the wheel.
    gear: f64,
    enabling: Duration,
    sensed: Sensed,
    quadcounts_per_turn: f64,
    remote: bool,
    /// The motor has its feed.
    fed: bool,
}

impl Epos {
    /// Makes a drive after power-on; `wheel`: number of its wheel; `gear`: motor turns per turn of the wheel; `enabling`: Refresh and Measure Init
    /// together, [`ENABLING`] as assumed.
    #[must_use]
    pub fn new(wheel: u8, gear: f64, enabling: Duration) -> Self {
        let quadcounts_per_turn = 4.0 * PULSES as f64;
        let config = Config {
            kind: Kind::Epos,
            options: Options::EPOS,
            velocity: quadcounts_per_turn / 60.0,
            acceleration: quadcounts_per_turn / 60.0,
            hardest: HARDEST * quadcounts_per_turn / 60.0,
            standstill: STANDSTILL,
            index: quadcounts_per_turn,
            methods: method::EPOS,
            offset_moves: true,
            following_fault: true,
            enabling,
        };
        Self {
            servo: Servo::new(config, 0.0),
            mirror: Mirror::default(),
            wheel,
            gear,
            enabling,
            sensed: Sensed::default(),
            quadcounts_per_turn,
            remote: false,
            fed: true,
        }
    }

    /// The servo.
    #[must_use]
    pub fn servo(&self) -> &Servo {
        &self.servo
    }

    /// Completes the self test.
    pub fn initialised(&mut self) {
        self.servo.initialised();
    }

    /// The motor's feed came or went. Without it the drive is in fault, and that cannot be reset: its cause persists.
    pub fn feed(&mut self, fed: bool) -> Option<Emergency> {
        self.fed = fed;
        self.servo.set_cause(!fed);
        if fed { None } else { self.fault(UNDERVOLTAGE) }
    }

    /// Restarts as after power-on; the motor's supply is separate.
    pub fn renew(&mut self, objects: &Dictionary) {
        let fed = self.fed;
        *self = Self { sensed: self.sensed, ..Self::new(self.wheel, self.gear, self.enabling) };
        self.configure(objects);
        self.feed(fed);
    }

    /// The NMT state became Operational, or is so no more.
    pub fn set_remote(&mut self, operational: bool) {
        self.remote = operational;
    }

    fn configure(&mut self, objects: &Dictionary) {
        self.quadcounts_per_turn = 4.0 * objects.get(0x2210, 1).unwrap_or(PULSES).max(1) as f64;
        let rate = self.quadcounts_per_turn / 60.0;
        self.servo.set_scale(rate, rate);
        self.servo.configure(objects);
    }

    /// The master wrote an object, of a PDO the controlword last.
    pub fn written(&mut self, now: Instant, index: u16, objects: &Dictionary) -> Option<Emergency> {
        if index == 0x2210 {
            self.configure(objects);
        }
        self.servo.written(now, index, objects, &self.sensed).then_some(Emergency::NONE)
    }

    /// A fault: some brake on the quick stop ramp, most switch off at once (docs/facts/canopen.md 2.5).
    pub fn fault(&mut self, code: u16) -> Option<Emergency> {
        let brakes = matches!(code, 0x8110..=0x8FFF | 0xFF06..=0xFF09);
        let new = self.servo.fault_by(if brakes { Stop::QuickStop } else { Stop::Coast });
        new.then(|| Self::emergency(code))
    }

    /// Its stop input: brakes on the quick stop ramp, then switches off.
    pub fn brake(&mut self) {
        self.servo.fault_by(Stop::QuickStop);
    }

    fn emergency(code: u16) -> Emergency {
        let register = match code {
            0x2000..=0x2FFF => 0x02,
            0x3000..=0x3FFF | 0x5113 => 0x04,
            0x4000..=0x4FFF => 0x08,
            0x8000..=0x85FF => 0x10,
            0x6000..=0x7FFF | 0x8611 | 0xFF0B => 0x20,
            0xFF00..=0xFFFF => 0x80,
            _ => 0x01,
        };
        Emergency { code, register }
    }

    /// A fault that it found itself.
    pub fn poll_fault(&mut self) -> Option<Emergency> {
        self.servo.poll_fault().map(Self::emergency)
    }

    /// True if time alone changes nothing.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.servo.rests()
    }

    /// Goes on by `dt` s; answers the demanded speed, m/s; none with the power stage off.
    pub fn step(&mut self, now: Instant, body: &Body, dt: f64) -> Option<f64> {
        let demand = self.servo.step(now, &self.sensed, dt)?;
        let gap = if self.loops_speed() { 0.0 } else { demand.demand - self.sensed.position };
        let rpm = (demand.speed + POSITION_GAIN * gap) * 60.0 / self.quadcounts_per_turn;
        Some(rpm / 60.0 / body.parameters().motor_turns_per_metre(self.gear))
    }

    /// True if no position is demanded: the speed loop determines it.
    fn loops_speed(&self) -> bool {
        !matches!(self.servo.mode(), Some(Mode::ProfilePosition | Mode::Homing))
    }

    /// Writes what the drive measures into its objects.
    pub(crate) fn feedback(&mut self, node: &mut Node, body: &Body, reading: Reading) {
        let quadcounts_per_metre = body.parameters().motor_turns_per_metre(self.gear) * self.quadcounts_per_turn;
        self.sensed = Sensed {
            position: reading.way * quadcounts_per_metre,
            speed: reading.speed * quadcounts_per_metre,
            ..Sensed::default()
        };
        self.servo.sense(&self.sensed);
        if self.loops_speed() {
            self.servo.resync(&self.sensed);
        }
        let milliamperes = body.force(self.wheel.into()) / FORCE_PER_AMPERE * 1000.0;
        let [mode, demanded, position, velocity_demanded, velocity, lag] = self.servo.measured(&self.sensed);
        let objects = [
            velocity,
            (0x6069, velocity.1),
            (0x2028, velocity.1),
            velocity_demanded,
            demanded,
            position,
            lag,
            (0x6078, libm::round(milliamperes) as i64),
            mode,
            (0x6041, i64::from(self.status())),
        ];
        self.mirror.write(node, objects);
    }

    fn status(&self) -> u16 {
        let passage = self.servo.drive().passage();
        let bit = |on: bool, bit: u16| if on { bit } else { 0 };
        self.servo.statusword(&self.sensed)
            | OFFSET_MEASURED
            | bit(passage == Some(Passage::MeasureInit) || self.servo.is_powered(), status::VOLTAGE)
            | bit(passage == Some(Passage::Refresh), REFRESH)
            | bit(self.remote, status::REMOTE)
    }
}
