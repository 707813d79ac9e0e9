//! An emulated CiA 402 drive behind its objects: the power state machine of [`Drive`], trajectory generators for pp,
//! pv, hm, ip, csp and csv, option codes, halt and following error. Motor, load and switches belong to the caller, who
//! passes what is sensed and takes what is demanded. [`twin::Twin`] is all of it on a bus.
//!
//! Units     counts and seconds inside; [`Config`] says what a unit of the rate objects is
//! Positions count inside from wherever the caller likes, outside from home, or from where the drive was switched on

mod homing;
pub mod profile;
mod setpoints;
mod settings;
#[cfg(test)]
mod tests;
pub mod twin;

use super::drive::{Drive, Kind, Motion, Transition};
use super::modes::Mode;
use super::modes::method::{Method, Switch};
use super::options::{Options, Stop};
use super::{PowerState, control, status};
use crate::Dictionary;
use base::{Duration, Instant};
use homing::{Homing, Wish};
use profile::{Limits, PositionProfile};
use setpoints::Setpoints;
use settings::Settings;

/// The emergency of a following error.
pub const FOLLOWING_ERROR: u16 = 0x8611;

/// Value of the error register (0x1001) with an emergency: the bits of its class, and generic with every one (CiA 301,
/// 7.2.7.1). Code 0: no errors any more.
#[must_use]
pub const fn error_register(code: u16) -> u8 {
    match code >> 12 {
        0 => 0x00,
        2 => 0x03,
        3 => 0x05,
        4 => 0x09,
        8 if code < 0x8600 => 0x11,
        8 => 0x21,
        0xF => 0x81,
        _ => 0x01,
    }
}

/// Properties of a drive beyond its objects.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// State machine.
    pub kind: Kind,
    /// Option codes for which it has no objects.
    pub options: Options,
    /// Counts/s per unit of the velocity objects.
    pub velocity: f64,
    /// Counts/s² per unit of the acceleration objects.
    pub acceleration: f64,
    /// Braking at the current or the voltage limit, counts/s².
    pub hardest: f64,
    /// Velocity below which the motor counts as stopped, in the unit of the velocity objects.
    pub standstill: f64,
    /// From one index pulse to the next, counts.
    pub index: f64,
    /// The homing methods that it knows.
    pub methods: &'static [i8],
    /// True if the home offset is a motion away from the switch, after which 0x2081 is where it is (EPOS).
    pub offset_moves: bool,
    /// True if a following error is a fault.
    pub following_fault: bool,
    /// Duration of the two passages of an EPOS together.
    pub enabling: Duration,
}

impl Default for Config {
    /// A drive whose rates are in counts/s and counts/s².
    fn default() -> Self {
        Self {
            kind: Kind::Standard { enables_from_ready: true },
            options: Options::default(),
            velocity: 1.0,
            acceleration: 1.0,
            hardest: 1e6,
            standstill: 1.0,
            index: 1000.0,
            methods: &[
                1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30,
                33, 34, 35, 37,
            ],
            offset_moves: false,
            following_fault: true,
            enabling: Duration::ZERO,
        }
    }
}

/// Sensed state of motor and switches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensed {
    /// Counts.
    pub position: f64,
    /// Counts/s.
    pub speed: f64,
    /// The negative limit switch is active.
    pub negative: bool,
    /// The positive one.
    pub positive: bool,
    /// The home switch.
    pub home: bool,
}

impl Sensed {
    fn closed(&self, switch: Switch) -> bool {
        match switch {
            Switch::NegativeLimit => self.negative,
            Switch::PositiveLimit => self.positive,
            Switch::Home => self.home,
        }
    }

    /// 0x60FD.
    #[must_use]
    pub fn inputs(&self) -> i64 {
        i64::from(self.negative) | i64::from(self.positive) << 1 | i64::from(self.home) << 2
    }
}

/// Set-point of ip or csp, approached linearly over the interpolation period.
#[derive(Clone, Copy, Debug, Default)]
struct Line {
    to: f64,
    left: f64,
}

/// The drive behind its objects.
#[derive(Debug)]
pub struct Servo {
    config: Config,
    settings: Settings,
    drive: Drive,
    mode: Option<Mode>,
    profile: PositionProfile,
    line: Line,
    setpoints: Setpoints,
    homing: Homing,
    /// Position that is shown as zero.
    zero: f64,
    homed: bool,
    word: u16,
    /// Instant at which the passage of an EPOS ends.
    passage: Instant,
    lags_since: Option<Instant>,
    lags: bool,
    position_before: f64,
    /// True while the cause of a fault persists: the fault cannot be reset.
    persists: bool,
    fault: Option<u16>,
}

impl Servo {
    /// Makes a drive after power-on at this position: Not Ready to Switch On until [`Self::initialised`].
    #[must_use]
    pub fn new(config: Config, position: f64) -> Self {
        Self {
            settings: Settings::default(),
            drive: Drive::power_on(config.kind, config.options),
            config,
            mode: None,
            profile: PositionProfile { demand: position, speed: 0.0 },
            line: Line::default(),
            setpoints: Setpoints::default(),
            homing: Homing::Idle,
            zero: position,
            homed: false,
            word: 0,
            passage: Instant::NEVER,
            lags_since: None,
            lags: false,
            position_before: position,
            persists: false,
            fault: None,
        }
    }

    /// Completes the self test.
    pub fn initialised(&mut self) {
        self.drive.initialised();
    }

    /// The power state machine.
    #[must_use]
    pub fn drive(&self) -> &Drive {
        &self.drive
    }

    /// True if the motor is under power.
    #[must_use]
    pub fn is_powered(&self) -> bool {
        self.drive.motion() != Motion::Off
    }

    /// True if its position counts from home.
    #[must_use]
    pub fn is_homed(&self) -> bool {
        self.homed
    }

    /// The mode it is in.
    #[must_use]
    pub fn mode(&self) -> Option<Mode> {
        self.mode
    }

    /// Sets the units of the rate objects, for drives where they can change.
    pub fn set_scale(&mut self, velocity: f64, acceleration: f64) {
        (self.config.velocity, self.config.acceleration) = (velocity, acceleration);
    }

    /// Takes over the sensed position and velocity, as a speed loop does with a position.
    pub fn resync(&mut self, sensed: &Sensed) {
        self.profile.demand = sensed.position;
    }

    /// The cause of a fault persists, or is gone: meanwhile a reset does nothing.
    pub fn set_cause(&mut self, persists: bool) {
        self.persists = persists;
    }

    /// The objects may all have changed.
    pub fn configure(&mut self, objects: &Dictionary) {
        self.settings = Settings::read(objects, &self.config);
        self.drive.set_options(Options::read(objects, self.config.options));
        let mode = self.settings.mode.filter(|mode| mode.is_supported(self.settings.supported));
        // An unsupported mode changes nothing: 0x6061 shows it.
        if mode.is_some() && mode != self.mode || objects.get(0x6060, 0) == Some(0) {
            self.mode = mode;
            self.forget();
            // An error is one of the homing before.
            if self.homing == Homing::Failed {
                self.homing = Homing::Idle;
            }
        }
    }

    /// Takes a written object. All values of a PDO are stored before the first is passed, and its controlword is passed
    /// last. Returns true if it has reset a fault.
    pub fn written(&mut self, now: Instant, index: u16, objects: &Dictionary, sensed: &Sensed) -> bool {
        match index {
            0x6040 => return self.obey(now, objects.get(0x6040, 0).unwrap_or(0) as u16, objects, sensed),
            0x607A | 0x60C1 | 0x60FF => {
                self.settings.targets(objects, &self.config);
                match (index, self.mode) {
                    (0x607A, Some(Mode::CyclicPosition)) => self.aim(self.settings.position),
                    (0x60C1, Some(Mode::Interpolated)) => self.aim(self.settings.interpolated),
                    _ => {}
                }
            }
            _ => self.configure(objects),
        }
        false
    }

    /// A set-point of ip or csp.
    fn aim(&mut self, target: f64) {
        let [low, high] = self.settings.range;
        self.line = Line { to: self.zero + target.max(low).min(high), left: self.settings.interpolation };
    }

    fn obey(&mut self, now: Instant, word: u16, objects: &Dictionary, sensed: &Sensed) -> bool {
        let word = if self.persists { word & !control::FAULT_RESET } else { word };
        let before = core::mem::replace(&mut self.word, word);
        let rising = word & !before & control::NEW_SETPOINT != 0;
        let taken = self.drive.apply(word);
        if taken.contains(&4) {
            self.passage = now + self.config.enabling / 2;
            self.elapse(now);
        }
        if self.drive.motion() != Motion::Follow {
            self.forget();
        } else if self.mode == Some(Mode::ProfilePosition) {
            let range = self.settings.range.map(|limit| self.zero + limit);
            self.settings.targets(objects, &self.config);
            let from = [self.zero, self.profile.demand];
            self.setpoints.command(word, rising, self.settings.position, from, range);
        } else if self.mode == Some(Mode::Homing) {
            if rising {
                self.homing = Homing::start(self.method(objects), sensed);
            } else if word & control::NEW_SETPOINT == 0 {
                self.homing.interrupt();
            }
        }
        taken.contains(&15)
    }

    /// The homing method that is set, if the drive knows it, and lists it where it has such a list (0x60E3).
    fn method(&self, objects: &Dictionary) -> Option<Method> {
        let number = self.settings.homing_method;
        let listed = |sub| objects.get(0x60E3, sub) == Some(number.into());
        let lists = objects.get(0x60E3, 1).is_some();
        let known = self.config.methods.contains(&number) && (!lists || (1..=254).any(listed));
        Method::of(number).filter(|_| known)
    }

    fn forget(&mut self) {
        self.setpoints.forget();
        self.homing.interrupt();
        self.line = Line { to: self.profile.demand, left: 0.0 };
        (self.lags, self.lags_since) = (false, None);
    }

    /// Effects of time alone: the passages of an EPOS.
    fn elapse(&mut self, now: Instant) {
        while self.drive.passage().is_some() && self.passage <= now {
            self.drive.passed();
            self.passage += self.config.enabling / 2;
        }
    }

    /// Raises a fault, with the stop of 0x605E. Returns false if one is active already.
    pub fn fault(&mut self) -> bool {
        self.told(Drive::fault)
    }

    /// A fault that stops so.
    pub fn fault_by(&mut self, stop: Stop) -> bool {
        self.told(|drive| drive.fault_by(stop))
    }

    /// Reports the loss of the connection to the master: reacts by 0x6007.
    pub fn connection_lost(&mut self) {
        self.told(Drive::connection_lost);
    }

    fn told(&mut self, act: impl FnOnce(&mut Drive) -> Option<Transition>) -> bool {
        let taken = act(&mut self.drive).is_some();
        if self.drive.motion() != Motion::Follow {
            self.forget();
        }
        taken
    }

    /// The code of a fault that it found itself, once.
    pub fn poll_fault(&mut self) -> Option<u16> {
        self.fault.take()
    }

    /// Goes on by `dt` s. What the motor shall do, as position and speed; `None` with the power stage off.
    pub fn step(&mut self, now: Instant, sensed: &Sensed, dt: f64) -> Option<PositionProfile> {
        self.elapse(now);
        // What is sensed answers the demand of the step before.
        self.watch(now, sensed);
        match self.drive.motion() {
            Motion::Off => return None,
            Motion::Follow if self.is_halted() => self.brake(self.drive.halt(), dt),
            Motion::Follow => self.follow(sensed, dt),
            Motion::Stop(stop) => {
                self.brake(stop, dt);
                if self.profile.speed == 0.0 && libm::fabs(sensed.speed) < self.config.standstill * self.config.velocity
                {
                    self.drive.stands();
                }
            }
        }
        self.position_before = sensed.position;
        self.is_powered().then_some(self.profile)
    }

    fn is_halted(&self) -> bool {
        self.word & control::HALT != 0
    }

    fn brake(&mut self, stop: Stop, dt: f64) {
        let deceleration = match stop {
            Stop::SlowDown => self.settings.deceleration,
            Stop::QuickStop => self.settings.quick_stop,
            Stop::CurrentLimit | Stop::VoltageLimit | Stop::Coast => self.config.hardest,
        };
        self.profile.stop(deceleration, dt);
    }

    fn follow(&mut self, sensed: &Sensed, dt: f64) {
        let settings = self.settings;
        let limits = settings.limits(settings.profile_speed);
        match self.mode {
            Some(Mode::ProfilePosition) => self.setpoints.step(&mut self.profile, limits, self.word, dt),
            Some(Mode::ProfileVelocity) => self.profile.run(settings.velocity, limits, dt),
            Some(Mode::Homing) => self.home(sensed, dt),
            Some(Mode::Interpolated) if self.word & control::NEW_SETPOINT != 0 => self.interpolate(dt),
            Some(Mode::CyclicPosition) => self.interpolate(dt),
            Some(Mode::CyclicVelocity) => {
                self.profile.speed = settings.velocity;
                self.profile.demand += settings.velocity * dt;
            }
            _ => drop(self.profile.stop(settings.deceleration, dt)),
        }
    }

    /// Moves along the line to the newest set-point, and stays there.
    fn interpolate(&mut self, dt: f64) {
        let way = self.line.to - self.profile.demand;
        let share = if self.line.left > dt { dt / self.line.left } else { 1.0 };
        self.line.left = (self.line.left - dt).max(0.0);
        self.profile.speed = way * share / dt;
        self.profile.demand = if share < 1.0 { self.profile.demand + way * share } else { self.line.to };
    }

    fn home(&mut self, sensed: &Sensed, dt: f64) {
        let acceleration = self.settings.homing_acceleration;
        let limits = Limits { speed: f64::INFINITY, acceleration, deceleration: acceleration };
        if libm::fabs(self.profile.demand - sensed.position) > self.settings.following_window {
            self.homing.fail();
        }
        let pulses = |position: f64| libm::floor(position / self.config.index);
        let index = pulses(sensed.position) != pulses(self.position_before);
        match self.homing.step(sensed, index, self.settings.homing_speeds) {
            Wish::Run(speed) => self.profile.run(speed, limits, dt),
            Wish::Stop => drop(self.profile.stop(acceleration, dt)),
            Wish::Here if self.config.offset_moves => {
                self.homing = Homing::Offset { target: sensed.position + self.settings.home_offset };
            }
            Wish::Here => {
                self.zero = sensed.position - self.settings.home_offset;
                self.homed = true;
                self.profile.stop(acceleration, dt);
            }
            Wish::Go(target) => {
                if self.profile.step(target, Limits { speed: self.settings.homing_speeds[0], ..limits }, dt) {
                    self.zero = target - self.settings.home_position;
                    self.homed = true;
                    self.homing = Homing::Attained;
                }
            }
        }
    }

    /// Following error (0x6065, 0x6066), where a position is demanded.
    fn watch(&mut self, now: Instant, sensed: &Sensed) {
        let positions = [Mode::ProfilePosition, Mode::Interpolated, Mode::CyclicPosition];
        let watched = self.drive.motion() == Motion::Follow && self.mode.is_some_and(|mode| positions.contains(&mode));
        let lag = libm::fabs(self.profile.demand - sensed.position);
        if !watched || lag <= self.settings.following_window {
            (self.lags, self.lags_since) = (false, None);
            return;
        }
        let since = *self.lags_since.get_or_insert(now);
        self.lags = now.since(since) >= self.settings.following_time;
        if self.lags && self.config.following_fault && self.fault() {
            self.fault = Some(FOLLOWING_ERROR);
        }
    }

    /// True if time alone changes nothing.
    #[must_use]
    pub fn rests(&self) -> bool {
        let stands = self.profile.speed == 0.0;
        match self.drive.motion() {
            Motion::Off => self.drive.passage().is_none(),
            // Only a quick stop that is kept has no end by itself.
            Motion::Stop(_) => {
                stands && self.drive.state() == PowerState::QuickStopActive && self.drive.keeps_quick_stop()
            }
            Motion::Follow if self.is_halted() => stands,
            Motion::Follow => {
                let idle = match self.mode {
                    Some(Mode::ProfilePosition) => self.setpoints.is_there(),
                    Some(Mode::ProfileVelocity | Mode::CyclicVelocity) => self.settings.velocity == 0.0,
                    Some(Mode::Homing) => !self.homing.runs(),
                    Some(Mode::Interpolated | Mode::CyclicPosition) => self.line.to == self.profile.demand,
                    _ => true,
                };
                stands && idle && self.lags_since.is_none()
            }
        }
    }

    /// Takes the sensed motion while the drive does not drive; to be called after each measurement.
    pub fn sense(&mut self, sensed: &Sensed) {
        if !self.is_powered() {
            // Enabled while it turns, it continues from the present velocity.
            self.profile = PositionProfile { demand: sensed.position, speed: sensed.speed };
            self.position_before = sensed.position;
        }
    }

    /// Index and value of 0x6061, 0x6062, 0x6064, 0x606B, 0x606C and 0x60F4.
    #[must_use]
    pub fn measured(&self, sensed: &Sensed) -> [(u16, i64); 6] {
        let whole = |value: f64| libm::round(value) as i64;
        [
            (0x6061, self.mode.map_or(0, |mode| i64::from(mode.code()))),
            (0x6062, whole(self.profile.demand - self.zero)),
            (0x6064, whole(sensed.position - self.zero)),
            (0x606B, whole(self.profile.speed / self.config.velocity)),
            (0x606C, whole(sensed.speed / self.config.velocity)),
            (0x60F4, whole(self.profile.demand - sensed.position)),
        ]
    }

    /// The statusword but for bits 4 (voltage), 7, 8, 9 (remote), 14 and 15: those are the device's.
    #[must_use]
    pub fn statusword(&self, sensed: &Sensed) -> u16 {
        let bit = |on: bool, bit: u16| if on { bit } else { 0 };
        let settings = &self.settings;
        let stands = self.profile.speed == 0.0;
        let near = libm::fabs(self.profile.demand - sensed.position) <= settings.position_window;
        let slow = libm::fabs(sensed.speed) < settings.standstill;
        let follows = self.drive.motion() == Motion::Follow;
        let acknowledged = bit(follows && self.setpoints.acknowledged(), status::MODE_12);
        let speed_is_zero = bit(self.mode == Some(Mode::ProfileVelocity) && slow, status::MODE_12);
        let mode = match (self.drive.motion(), self.mode) {
            (Motion::Off, _) => 0,
            (Motion::Stop(_), _) => bit(stands, status::TARGET_REACHED),
            (Motion::Follow, _) if self.is_halted() => bit(stands, status::TARGET_REACHED) | acknowledged,
            (Motion::Follow, Some(Mode::ProfilePosition)) => {
                bit(self.setpoints.is_there() && stands && near, status::TARGET_REACHED)
                    | bit(self.setpoints.limited(), status::LIMIT)
                    | acknowledged
            }
            (Motion::Follow, Some(Mode::ProfileVelocity)) => {
                let window = libm::fabs(sensed.speed - settings.velocity) <= settings.velocity_window;
                bit(self.profile.speed == settings.velocity && window, status::TARGET_REACHED)
            }
            (Motion::Follow, Some(Mode::Homing)) => self.homing.status(stands),
            (Motion::Follow, Some(Mode::Interpolated)) => {
                bit(self.line.to == self.profile.demand, status::TARGET_REACHED)
                    | bit(self.word & control::NEW_SETPOINT != 0, status::MODE_12)
            }
            (Motion::Follow, Some(Mode::CyclicPosition | Mode::CyclicVelocity)) => status::MODE_12,
            (Motion::Follow, _) => bit(stands, status::TARGET_REACHED),
        };
        self.drive.statusword() & 0x6F | mode | speed_is_zero | bit(self.lags, status::MODE_13)
    }
}
