//! maxon EPOS 70/10, the propulsion: profile velocity through its ramps (docs/facts/canopen.md 2).
//!
//! Units     position in quadcounts, velocity in rpm of the motor, acceleration in rpm/s
//! Power-up  mode 1; only TPDO1 is on; Enable Operation takes 40 ms (Refresh, Measure Init)
//! Silence   the heartbeat consumer's event: emergency 0x8130, quick stop ramp, then Fault
//! Quick stop is kept until told otherwise: there is no 0x605A

use super::mirror::Mirror;
use super::motion::SpeedRamp;
use super::power::{Power, Stage};
use crate::body::Body;
use base::{Duration, Instant};
use canopen::{Dictionary, Node};

/// Refresh and Measure Init together; the real duration was not found.
const ENABLING: Duration = Duration::from_millis(40);
/// There is no 0x605A; it behaves as 6 would: braked, it stays in Quick Stop Active.
const QUICK_STOP_OPTION: i16 = 6;
/// Heartbeat or life guarding event.
pub const HEARTBEAT: u16 = 0x8130;
/// The motor's feed is off.
const UNDERVOLTAGE: u16 = 0x3220;
/// Wheel force per motor current, N/A (docs/facts/robot.md 1.2: 83 N at 10 A).
const FORCE_PER_AMPERE: f64 = 8.3;

/// Below this the motor stands, rpm.
const STANDSTILL: f64 = 10.0;

const PROFILE_VELOCITY: i64 = 3;
const HALT: u16 = 1 << 8;
const FAULT_RESET: u16 = 1 << 7;

/// An emergency to be sent: code and error register. Code 0: all errors are over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emergency {
    /// The code.
    pub code: u16,
    /// The error register.
    pub register: u8,
}

/// What the objects ask of the drive; read when they were written, not at every step.
#[derive(Clone, Copy, Debug, Default)]
struct Settings {
    /// Profile velocity is the mode; the other modes are not driven here and hold still.
    profile_velocity: bool,
    mode: i64,
    /// Target velocity within its limit, rpm.
    target: f64,
    acceleration: f64,
    deceleration: f64,
    quick_stop: f64,
    quadcounts_per_turn: f64,
}

/// The drive behind its objects.
#[derive(Debug)]
pub struct Epos {
    settings: Settings,
    mirror: Mirror<8>,
    power: Power,
    halted: bool,
    ramp: SpeedRamp,
    /// rpm.
    actual: f64,
    remote: bool,
    /// The motor has its feed.
    fed: bool,
}

impl Epos {
    /// As after power-on.
    #[must_use]
    pub fn new() -> Self {
        Self {
            settings: Settings::default(),
            mirror: Mirror::default(),
            power: Power::new(QUICK_STOP_OPTION, ENABLING),
            halted: false,
            ramp: SpeedRamp::default(),
            actual: 0.0,
            remote: false,
            fed: true,
        }
    }

    /// The state of the power stage.
    #[must_use]
    pub fn stage(&self) -> Stage {
        self.power.stage()
    }

    /// The motor's feed came or went. Without it the drive is in fault, and that cannot be reset: its cause persists.
    pub fn feed(&mut self, fed: bool) -> Option<Emergency> {
        self.fed = fed;
        if fed { None } else { self.fault(UNDERVOLTAGE) }
    }

    /// As after power-on; the motor's feed is another one.
    pub fn renew(&mut self) {
        let fed = self.fed;
        *self = Self::new();
        self.feed(fed);
    }

    /// The NMT state became Operational, or is so no more.
    pub fn set_remote(&mut self, operational: bool) {
        self.remote = operational;
    }

    /// The objects may have changed.
    pub fn configure(&mut self, objects: &Dictionary) {
        let number = |index| objects.get(index, 0).unwrap_or(0);
        let rate = |index| number(index).max(1) as f64;
        let most = number(0x607F).max(0);
        self.settings = Settings {
            profile_velocity: number(0x6060) == PROFILE_VELOCITY,
            mode: number(0x6060),
            target: number(0x60FF).clamp(-most, most) as f64,
            acceleration: rate(0x6083),
            deceleration: rate(0x6084),
            quick_stop: rate(0x6085),
            quadcounts_per_turn: 4.0 * objects.get(0x2210, 1).unwrap_or(500) as f64,
        };
    }

    /// The master wrote objects, of a PDO all of them: obeys the controlword.
    pub fn written(&mut self, now: Instant, objects: &Dictionary) -> Option<Emergency> {
        let word = objects.get(0x6040, 0).unwrap_or(0) as u16;
        let word = if self.fed { word } else { word & !FAULT_RESET };
        let faulty = self.stage() == Stage::Fault;
        self.power.command(now, word);
        self.halted = word & HALT != 0;
        (faulty && self.stage() != Stage::Fault).then_some(Emergency { code: 0, register: 0 })
    }

    /// A fault: some brake on the quick stop ramp, most switch off at once (docs/facts/canopen.md 2.5).
    pub fn fault(&mut self, code: u16) -> Option<Emergency> {
        let brakes = matches!(code, 0x8110..=0x8FFF | 0xFF06..=0xFF09);
        if !self.power.fault(brakes) {
            return None;
        }
        let register = match code {
            0x2000..=0x2FFF => 0x02,
            0x3000..=0x3FFF | 0x5113 => 0x04,
            0x4000..=0x4FFF => 0x08,
            0x8000..=0x85FF => 0x10,
            0x6000..=0x7FFF | 0x8611 | 0xFF0B => 0x20,
            0xFF00..=0xFFFF => 0x80,
            _ => 0x01,
        };
        Some(Emergency { code, register })
    }

    /// Whether time alone changes nothing.
    #[must_use]
    pub fn rests(&self) -> bool {
        match self.stage() {
            Stage::Enabling { .. } | Stage::FaultReaction => false,
            Stage::Enabled => self.ramp.demand == 0.0 && self.target() == 0.0,
            Stage::QuickStop => self.ramp.demand == 0.0,
            _ => true,
        }
    }

    /// Goes on by `dt` s; answers the motor's demanded speed, rpm; none with the power stage off.
    pub fn step(&mut self, now: Instant, dt: f64) -> Option<f64> {
        self.power.elapse(now);
        let Settings { acceleration, deceleration, quick_stop, .. } = self.settings;
        match self.stage() {
            Stage::Enabled => self.ramp.step(self.target(), acceleration, deceleration, dt),
            Stage::QuickStop | Stage::FaultReaction => {
                self.ramp.step(0.0, quick_stop, quick_stop, dt);
            }
            _ => return None,
        }
        let stands = self.ramp.demand == 0.0 && libm::fabs(self.actual) < STANDSTILL;
        if stands && self.stage() == Stage::FaultReaction {
            self.power.stands();
            return None;
        }
        Some(self.ramp.demand)
    }

    /// What profile velocity aims at, rpm.
    fn target(&self) -> f64 {
        let moves = self.settings.profile_velocity && !self.halted;
        if moves { self.settings.target } else { 0.0 }
    }

    /// Writes what the drive measures into its objects.
    pub fn feedback(&mut self, now: Instant, node: &mut Node, body: &Body) {
        let turns = body.parameters().motor_turns_per_metre();
        let rpm = body.speed() * turns * 60.0;
        if !self.stage().drives() {
            // Switched on again while it rolls, it takes over at the speed it has.
            self.ramp.demand = rpm;
        }
        self.actual = rpm;
        let velocity = libm::round(rpm) as i64;
        let quadcounts = body.travelled() * turns * self.settings.quadcounts_per_turn;
        let milliamperes = body.force() / FORCE_PER_AMPERE * 1000.0;
        let status = i64::from(self.status(now, velocity));
        let objects = [
            (0x606C, velocity),
            (0x6069, velocity),
            (0x2028, velocity),
            (0x606B, libm::round(self.ramp.demand) as i64),
            (0x6064, libm::floor(quadcounts) as i64),
            (0x6078, libm::round(milliamperes) as i64),
            (0x6061, self.settings.mode),
            (0x6041, status),
        ];
        self.mirror.write(node, objects);
    }

    fn status(&self, now: Instant, velocity: i64) -> u16 {
        let (refresh, measure) = match self.stage() {
            Stage::Enabling { until } => (now + ENABLING / 2 < until, now + ENABLING / 2 >= until),
            _ => (false, false),
        };
        let reached = match self.stage() {
            Stage::Enabled => self.ramp.demand == self.target(),
            Stage::QuickStop => self.ramp.demand == 0.0,
            _ => false,
        };
        let standing = velocity == 0 && self.settings.profile_velocity;
        let bit = |on: bool, bit: u16| u16::from(on) << bit;
        self.power.status()
            | bit(measure || self.stage().drives(), 4)
            | bit(true, 8)
            | bit(self.remote, 9)
            | bit(reached, 10)
            | bit(standing, 12)
            | bit(refresh, 14)
    }
}

impl Default for Epos {
    fn default() -> Self {
        Self::new()
    }
}
