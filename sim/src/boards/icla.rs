//! Berger Lahr IclA N065, the steering: profile position, homing to a mechanical switch (docs/facts/canopen.md 3).
//!
//! No document of the real drive was found; this is the stated assumption: CiA 402 with the objects of [`canopen::drives::icla::dictionary`].
//!
//! Units     position in counts, velocity in rpm of the motor, acceleration in rpm/s
//! Power-up  mode 0; the position counts from where it stands; bit 15 of the statusword: homed
//! Homing    methods 17 and 27 (off the switch), 28 (onto it), 35 and 37 (here); others end in a homing error
//! Silence   the heartbeat consumer's event: emergency 0x8130 and what 0x6007 says, by default quick stop

mod homing;

use super::epos::{Emergency, HEARTBEAT};
use super::mirror::Mirror;
use super::motion::{Limits, PositionProfile, SpeedRamp};
use super::power::{Power, Stage};
use crate::body::Body;
use base::{Duration, Instant};
use canopen::axis::control;
use canopen::{Dictionary, Node};
use homing::Homing;

const POSITION: i64 = 1;
const VELOCITY: i64 = 3;
const HOMING: i64 = 6;

const START: u16 = 1 << 4;
const IMMEDIATELY: u16 = 1 << 5;
const RELATIVE: u16 = 1 << 6;
const HALT: u16 = 1 << 8;

/// How the motor's counts become an angle of the steering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gearing {
    /// Counts per turn of the motor.
    pub counts_per_turn: f64,
    /// Turns of the motor per turn of the steering.
    pub gear: f64,
}

impl Default for Gearing {
    /// 4096 counts and 180:1: the dictionary's homing speed of 300 rpm turns the steering by 10°/s.
    fn default() -> Self {
        Self { counts_per_turn: 4096.0, gear: 180.0 }
    }
}

impl Gearing {
    /// Counts per radian of the steering.
    #[must_use]
    pub fn counts_per_radian(&self) -> f64 {
        self.counts_per_turn * self.gear / (2.0 * core::f64::consts::PI)
    }
}

/// The drive behind its objects. Inside, positions count from the steering's true middle; outside from `zero`.
#[derive(Debug)]
pub struct Icla {
    gearing: Gearing,
    mirror: Mirror<8>,
    power: Power,
    before: u16,
    remote: bool,
    zero: f64,
    homed: bool,
    profile: PositionProfile,
    target: Option<f64>,
    /// A set-point that waits for the one before it to be reached.
    next: Option<f64>,
    reached: bool,
    acknowledged: bool,
    limited: bool,
    homing: Homing,
}

impl Icla {
    /// As after power-on, with the steering where `body` has it.
    #[must_use]
    pub fn new(gearing: Gearing, body: &Body) -> Self {
        let position = body.steering_output() * gearing.counts_per_radian();
        Self {
            gearing,
            mirror: Mirror::default(),
            power: Power::new(2, Duration::ZERO),
            before: 0,
            remote: false,
            zero: position,
            homed: false,
            profile: PositionProfile { demand: position, speed: 0.0 },
            target: None,
            next: None,
            reached: false,
            acknowledged: false,
            limited: false,
            homing: Homing::Idle,
        }
    }

    /// The state of the power stage.
    #[must_use]
    pub fn stage(&self) -> Stage {
        self.power.stage()
    }

    /// Whether its position counts from the switch.
    #[must_use]
    pub fn homed(&self) -> bool {
        self.homed
    }

    /// The NMT state became Operational, or is so no more.
    pub fn set_remote(&mut self, operational: bool) {
        self.remote = operational;
    }

    /// The master wrote objects, of a PDO all of them: obeys the controlword.
    pub fn written(&mut self, now: Instant, objects: &Dictionary, body: &Body) -> Option<Emergency> {
        let word = objects.get(0x6040, 0).unwrap_or(0) as u16;
        let faulty = self.stage() == Stage::Fault;
        self.power.set_quick_stop_option(objects.get(0x605A, 0).unwrap_or(2) as i16);
        self.power.command(now, word);
        let rising = word & !self.before & START != 0;
        self.before = word;
        if self.stage() == Stage::Enabled {
            match objects.get(0x6060, 0) {
                Some(POSITION) => self.set_point(objects, word, rising),
                Some(HOMING) if rising => self.homing = Homing::start(objects, body),
                Some(HOMING) if word & START == 0 => self.homing.interrupt(),
                _ => {}
            }
        } else {
            self.forget();
        }
        (faulty && self.stage() != Stage::Fault).then_some(Emergency { code: 0, register: 0 })
    }

    fn forget(&mut self) {
        (self.target, self.next, self.acknowledged) = (None, None, false);
        self.homing.interrupt();
    }

    /// The handshake of set-points: bit 4 here, bit 12 there.
    fn set_point(&mut self, objects: &Dictionary, word: u16, rising: bool) {
        if rising && !self.acknowledged {
            let target = objects.get(0x607A, 0).unwrap_or(0) as f64;
            let from = if word & RELATIVE != 0 { self.target.unwrap_or(self.profile.demand) } else { self.zero };
            let low = self.zero + objects.get(0x607D, 1).unwrap_or(i64::from(i32::MIN)) as f64;
            let high = self.zero + objects.get(0x607D, 2).unwrap_or(i64::from(i32::MAX)) as f64;
            let wanted = from + target;
            let allowed = wanted.max(low).min(high);
            self.limited = allowed != wanted;
            if word & IMMEDIATELY != 0 || self.target.is_none() || self.reached {
                (self.target, self.next, self.reached) = (Some(allowed), None, false);
            } else {
                self.next = Some(allowed);
            }
            self.acknowledged = true;
        }
        if word & START == 0 && self.next.is_none() {
            self.acknowledged = false;
        }
    }

    /// The heartbeat consumer's event: does what 0x6007 says.
    pub fn heartbeat_lost(&mut self, now: Instant, objects: &Dictionary) -> Emergency {
        match objects.get(0x6007, 0) {
            Some(1) => drop(self.power.fault(true)),
            Some(2) => self.power.command(now, control::DISABLE_VOLTAGE),
            Some(3) => self.power.command(now, control::QUICK_STOP),
            _ => {}
        }
        self.forget();
        Emergency { code: HEARTBEAT, register: 0x11 }
    }

    /// A fault: brakes on the quick stop ramp, then off.
    pub fn fault(&mut self, code: u16) -> Option<Emergency> {
        self.forget();
        self.power.fault(true).then_some(Emergency { code, register: 0x01 })
    }

    /// Whether time alone changes nothing.
    #[must_use]
    pub fn rests(&self, objects: &Dictionary) -> bool {
        match self.stage() {
            Stage::Enabled => {
                let idle = self.target.is_none() || self.reached;
                let turning = objects.get(0x6060, 0) == Some(VELOCITY) && objects.get(0x60FF, 0) != Some(0);
                self.profile.speed == 0.0 && idle && !turning && !self.homing.runs()
            }
            Stage::QuickStop => self.profile.speed == 0.0 && self.keeps_quick_stop(objects),
            Stage::FaultReaction | Stage::Enabling { .. } => false,
            _ => true,
        }
    }

    fn keeps_quick_stop(&self, objects: &Dictionary) -> bool {
        objects.get(0x605A, 0).unwrap_or(2) >= 5
    }

    /// Goes on by `dt` s; answers the demanded angle of the steering, rad; none with the power stage off.
    pub fn step(&mut self, now: Instant, objects: &Dictionary, body: &Body, dt: f64) -> Option<f64> {
        self.power.elapse(now);
        let braking = self.counts(objects, 0x6085, 0);
        match self.stage() {
            Stage::Enabled => self.operate(objects, body, dt),
            Stage::QuickStop | Stage::FaultReaction => self.brake(braking, dt),
            _ => {}
        }
        self.stage().drives().then(|| self.profile.demand / self.gearing.counts_per_radian())
    }

    fn brake(&mut self, deceleration: f64, dt: f64) {
        if self.profile.stop(deceleration, dt) {
            self.power.stands();
        }
    }

    fn operate(&mut self, objects: &Dictionary, body: &Body, dt: f64) {
        let limits = Limits {
            speed: self.counts(objects, 0x6081, 0).min(self.counts(objects, 0x607F, 0)),
            acceleration: self.counts(objects, 0x6083, 0),
            deceleration: self.counts(objects, 0x6084, 0),
        };
        match (objects.get(0x6060, 0), self.target) {
            _ if self.before & HALT != 0 => drop(self.profile.stop(limits.deceleration, dt)),
            (Some(POSITION), Some(target)) => {
                self.reached = self.profile.step(target, limits, dt);
                if self.reached
                    && let Some(next) = self.next.take()
                {
                    (self.target, self.reached) = (Some(next), false);
                    self.acknowledged = self.before & START != 0;
                }
            }
            (Some(VELOCITY), _) => {
                let most = objects.get(0x607F, 0).unwrap_or(0);
                let rpm = objects.get(0x60FF, 0).unwrap_or(0).clamp(-most, most) as f64;
                let speed = rpm / 60.0 * self.gearing.counts_per_turn;
                self.run(speed, limits.acceleration, limits.deceleration, dt);
            }
            (Some(HOMING), _) => self.home(objects, body, dt),
            _ => drop(self.profile.stop(limits.deceleration, dt)),
        }
    }

    fn home(&mut self, objects: &Dictionary, body: &Body, dt: f64) {
        let acceleration = self.counts(objects, 0x609A, 0);
        let speeds = [self.counts(objects, 0x6099, 1), self.counts(objects, 0x6099, 2)];
        let position = body.steering_output() * self.gearing.counts_per_radian();
        let lag = libm::fabs(self.profile.demand - position);
        let stalled = lag > objects.get(0x6065, 0).unwrap_or(0) as f64;
        match self.homing.step(body.switch_closed(), stalled, speeds) {
            homing::Demand::Run(speed) => self.run(speed, acceleration, acceleration, dt),
            homing::Demand::Stop => drop(self.profile.stop(acceleration, dt)),
            homing::Demand::Here => {
                self.zero = position - objects.get(0x607C, 0).unwrap_or(0) as f64;
                self.homed = true;
                self.target = None;
                self.profile.stop(acceleration, dt);
            }
        }
    }

    fn run(&mut self, speed: f64, acceleration: f64, deceleration: f64, dt: f64) {
        let mut ramp = SpeedRamp { demand: self.profile.speed };
        ramp.step(speed, acceleration, deceleration, dt);
        self.profile.demand += (self.profile.speed + ramp.demand) / 2.0 * dt;
        self.profile.speed = ramp.demand;
    }

    /// A rate object in rpm (or rpm/s) as counts/s (or counts/s²).
    fn counts(&self, objects: &Dictionary, index: u16, sub: u8) -> f64 {
        objects.get(index, sub).unwrap_or(1).max(1) as f64 / 60.0 * self.gearing.counts_per_turn
    }

    /// Writes what the drive measures into its objects; `speed` is the steering's, rad/s.
    pub fn feedback(&mut self, node: &mut Node, body: &Body, speed: f64) {
        let per_radian = self.gearing.counts_per_radian();
        let position = body.steering_output() * per_radian;
        if !self.stage().drives() {
            self.profile = PositionProfile { demand: position, speed: 0.0 };
        }
        let turn = self.gearing.counts_per_turn;
        let rpm = |counts: f64| libm::round(counts / turn * 60.0) as i64;
        let whole = |counts: f64| libm::round(counts) as i64;
        let window = node.get(0x6067, 0).unwrap_or(0) as f64;
        let near = libm::fabs(self.profile.demand - position) <= window;
        let status = i64::from(self.status(node.dictionary(), near));
        let objects = [
            (0x6064, whole(position - self.zero)),
            (0x6062, whole(self.profile.demand - self.zero)),
            (0x60F4, whole(self.profile.demand - position)),
            (0x606B, rpm(self.profile.speed)),
            (0x606C, rpm(speed * per_radian)),
            (0x60FD, i64::from(body.switch_closed()) << 2),
            (0x6061, node.get(0x6060, 0).unwrap_or(0)),
            (0x6041, status),
        ];
        self.mirror.write(node, objects);
    }

    fn status(&self, objects: &Dictionary, near: bool) -> u16 {
        let bit = |on: bool, bit: u16| u16::from(on) << bit;
        let stopped = self.profile.speed == 0.0;
        let mode = match (self.stage(), objects.get(0x6060, 0)) {
            (Stage::Enabled, _) if self.before & HALT != 0 => bit(stopped, 10) | bit(self.acknowledged, 12),
            (Stage::Enabled, Some(POSITION)) => {
                let there = self.target.is_none() || self.reached;
                bit(there && stopped && near, 10) | bit(self.limited, 11) | bit(self.acknowledged, 12)
            }
            (Stage::Enabled, Some(VELOCITY)) => bit(stopped, 12),
            (Stage::Enabled, Some(HOMING)) => self.homing.status(stopped),
            (Stage::QuickStop, _) => bit(stopped, 10),
            _ => 0,
        };
        // Bit 4: the supply is there.
        self.power.status() | bit(true, 4) | bit(self.remote, 9) | bit(self.homed, 15) | mode
    }
}
