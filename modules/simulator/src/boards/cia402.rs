//! Any CiA 402 drive as its data sheet describes it: what [`canopen::axis::servo`] has not of its own.
//!
//! Objects, limits and values are the sheet's; what the sheet lacks, the drive lacks. Of a DCF the units are those of
//! the configured device, as they are stored in it. Windows and position limits that the sheet leaves open are wide.
//!
//! Units     those of its own objects (0x608F, 0x6091, 0x6092, 0x60A9, 0x60AA), whatever its master believes; what no
//!           object says is as the configuration has it
//! Enabling  step by step: no controlword takes two transitions
//! Silence   of the master, by 0x1016 or 0x100C and 0x100D: emergency 0x8130 and what 0x6007 says; so does NMT stopped.
//!           Without 0x6007 it is a fault to leave Operational (0x1029:1 = 0)
//! Stops     without 0x605A, 0x605E or 0x6007, and no word in the manual that it stops nevertheless: it rolls on
//! Lag       none of its own: it feeds the demanded velocity forward

use super::encoder::{Axis, Reading};
use super::epos::{Emergency, HEARTBEAT};
use super::mirror::Mirror;
use super::motor::MotorObjects;
use crate::body::Body;
use base::{Duration, Instant};
use canopen::axis::drive::Kind;
use canopen::axis::modes::Mode;
use canopen::axis::options::{Options, Stop};
use canopen::axis::servo::{Config, Sensed, Servo, error_register};
use canopen::axis::status;
use canopen::dictionary::Entry;
use canopen::drives::derive::VelocityUnit;
use canopen::drives::motor::Own;
use canopen::eds::Eds;
use canopen::{Dictionary, NmtState, Node};
use std::f64::consts::TAU;
use std::sync::Arc;

/// The motor's feed is off.
const UNDERVOLTAGE: u16 = 0x3220;
/// Position units per turn of the motor where nothing says it.
const COUNTS: f64 = 4096.0;
/// Deceleration at the current limit, turns of the motor/s².
const HARDEST: f64 = 20_000.0 / 60.0;
/// Speed below which the motor counts as stopped, turns/s.
const STANDSTILL: f64 = 10.0 / 60.0;
/// Gain of the position loop of a wheel, 1/s.
const POSITION_GAIN: f64 = 5.0;
/// Objects that say what a unit is.
const UNITS: [u16; 6] = [0x608F, 0x6091, 0x6092, 0x60A8, 0x60A9, 0x60AA];
/// Windows, of the following error, of the position, of the velocity, and the greatest speed of the motor. The greatest
/// value switches them off.
const WINDOWS: [u16; 4] = [0x6065, 0x6067, 0x606D, 0x6080];
/// Least and greatest position.
const RANGE: u16 = 0x607D;

/// A drive by its data sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Cia402Config {
    /// What it moves.
    pub axis: Axis,
    /// Its objects.
    pub sheet: Arc<Eds>,
    /// Turns of the motor per turn of the output, a wheel or the steering; absent: 0x6091.
    pub gear: Option<f64>,
    /// Position units per turn of the motor, where no object says it.
    pub counts_per_turn: Option<u32>,
    /// Unit of velocities, where no object says it; absent: position units per second.
    pub velocity_unit: Option<VelocityUnit>,
    /// It stays in Quick Stop Active where it has no 0x605A.
    pub keeps_quick_stop: bool,
    /// Objects that it lacks, and without which it stops nevertheless.
    pub stops_without: Vec<u16>,
    /// Object of the motor's current by its manual, and its unit; absent: 0x6078, where it has that.
    pub current: Option<Own>,
    /// The same of a temperature; absent: none.
    pub temperature: Option<Own>,
    /// Bit of the statusword that says that the position counts from home; 0: none.
    pub homed: u16,
    /// A holding brake is on its brake output: spring-applied, so that it holds without the motor's feed, too.
    pub brake: bool,
}

impl Cia402Config {
    /// Turns of the motor per turn of the output.
    fn gear(&self, objects: &Dictionary) -> f64 {
        self.gear.or_else(|| ratio(objects, 0x6091)).unwrap_or(1.0)
    }

    /// Velocity units per m/s of the wheel, or per rad/s of the steering; `per_turn`: what a turn of the output is, m
    /// or rad.
    #[must_use]
    pub fn velocity_units(&self, node: u8, per_turn: f64) -> f64 {
        let mut objects = self.sheet.dictionary(node);
        for (index, sub, value) in stored(&self.sheet, node) {
            objects.set(index, sub, value);
        }
        self.gear(&objects) / per_turn / Scale::of(&objects, self).velocity
    }

    /// What it does where it has no object that says it: by its manual what the standard does, else nothing.
    fn options(&self) -> Options {
        let by_manual = |index, standard| if self.stops_without.contains(&index) { standard } else { 0 };
        Options {
            quick_stop: if self.keeps_quick_stop { 6 } else { by_manual(0x605A, 2) },
            fault: by_manual(0x605E, 2),
            abort_connection: by_manual(0x6007, 1),
            ..Options::default()
        }
    }
}

/// The objects of another version of a drive: each of its PDOs carries what that of the next number does by the sheet.
pub(super) fn other_version(sheet: &Eds, node: u8) -> Dictionary {
    let objects = sheet.dictionary(node);
    let entries: Vec<Entry> = [0x1600, 0x1A00].into_iter().flat_map(|first| turned(sheet, &objects, first)).collect();
    objects.with(&entries)
}

/// The mappings of the first four PDOs of a direction, each with the contents of the next.
fn turned(sheet: &Eds, objects: &Dictionary, first: u16) -> Vec<Entry> {
    let count = (0..4).take_while(|number| sheet.group(first + number).is_some()).count() as u16;
    let moved = |number: u16, sub: u8| {
        let object = sheet.object(first + number, sub)?;
        let value = objects.get(first + (number + 1) % count, sub).unwrap_or(0);
        Some(Entry::new(object.index, object.sub, object.data_type, object.access, value))
    };
    (0..count).flat_map(|number| (0..=8).filter_map(move |sub| moved(number, sub))).collect()
}

/// What is stored in the device: index, sub-index, value.
fn stored(sheet: &Eds, node: u8) -> Vec<(u16, u8, i64)> {
    let value = |object: &canopen::eds::Object| {
        let (index, (least, greatest)) = (object.index, object.data_type.range());
        let is_open = object.default.is_none() && object.parameter.is_none();
        match &object.parameter {
            Some(parameter) if UNITS.contains(&index) => Some(parameter.number(object.data_type, node)),
            _ if is_open && (WINDOWS.contains(&index) || (index, object.sub) == (RANGE, 2)) => Some(greatest),
            _ if is_open && (index, object.sub) == (RANGE, 1) => Some(least),
            _ => None,
        }
    };
    sheet.objects().iter().filter_map(|object| Some((object.index, object.sub, value(object)?))).collect()
}

/// Sub-index 1 by sub-index 2, if both are above 0.
fn ratio(objects: &Dictionary, index: u16) -> Option<f64> {
    let part = |sub| objects.get(index, sub).filter(|part| *part > 0).map(|part| part as f64);
    Some(part(1)? / part(2)?)
}

/// Units in turns of the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scale {
    /// Position units per turn.
    counts: f64,
    /// Unit of velocities, turns/s.
    velocity: f64,
    /// Unit of accelerations, turns/s².
    acceleration: f64,
}

impl Scale {
    fn of(objects: &Dictionary, config: &Cia402Config) -> Self {
        // A feed counts from the shaft behind the gear.
        let feed = ratio(objects, 0x6092).map(|feed| feed / ratio(objects, 0x6091).unwrap_or(1.0));
        let counts = feed.or_else(|| ratio(objects, 0x608F)).or(config.counts_per_turn.map(f64::from));
        let counts = counts.unwrap_or(COUNTS);
        let stated = |index, of: fn(u8, u8, f64) -> Option<f64>| {
            // CiA 303-2: exponent of ten, numerator, denominator, reserved.
            let [_, denominator, numerator, exponent] = (objects.get(index, 0)? as u32).to_le_bytes();
            Some(of(numerator, denominator, counts)? * libm::exp10(f64::from(exponent as i8)))
        };
        let velocity = stated(0x60A9, velocity).unwrap_or_else(|| match config.velocity_unit {
            Some(VelocityUnit::Rpm) => 1.0 / 60.0,
            Some(VelocityUnit::TenthRpm) => 0.1 / 60.0,
            Some(VelocityUnit::MilliRpm) => 0.001 / 60.0,
            Some(VelocityUnit::CountsPerSecond) | None => 1.0 / counts,
        });
        Self { counts, velocity, acceleration: stated(0x60AA, acceleration).unwrap_or(velocity) }
    }
}

/// Revolutions (B4h) per minute (47h) or per second (03h), increments (B5h) per second.
fn velocity(numerator: u8, denominator: u8, counts: f64) -> Option<f64> {
    match (numerator, denominator) {
        (0xB4, 0x47) => Some(1.0 / 60.0),
        (0xB4, 0x03) => Some(1.0),
        (0xB5, 0x03) => Some(1.0 / counts),
        _ => None,
    }
}

/// Revolutions per minute (C0h) per second; any other is the unit of velocity per second.
fn acceleration(numerator: u8, denominator: u8, _: f64) -> Option<f64> {
    ((numerator, denominator) == (0xC0, 0x03)).then_some(1.0 / 60.0)
}

/// The drive behind its objects.
#[derive(Debug)]
pub(crate) struct Cia402 {
    config: Cia402Config,
    stored: Vec<(u16, u8, i64)>,
    scale: Scale,
    gear: f64,
    servo: Servo,
    mirror: Mirror<8>,
    sensed: Sensed,
    motor: MotorObjects,
    nmt: Option<NmtState>,
    /// The motor has its feed.
    fed: bool,
    /// The brake output is that of its master (0x60FE:2), and sets the brake (0x60FE:1).
    output: (bool, bool),
}

impl Cia402 {
    /// Makes a drive after power-on, with these objects.
    pub fn new(config: Cia402Config, objects: &Dictionary, body: &Body, reading: Reading) -> Self {
        let stored = stored(&config.sheet, objects.node());
        let (scale, gear) = (Scale::of(objects, &config), config.gear(objects));
        let servo = Servo::new(servo_config(&config, scale), 0.0);
        let motor = MotorObjects::new(objects, config.current, config.temperature);
        let (mirror, sensed) = (Mirror::default(), Sensed::default());
        let output = (false, false);
        let mut new = Self { config, stored, scale, gear, servo, mirror, sensed, motor, nmt: None, fed: true, output };
        new.restart(objects, body, reading);
        new
    }

    /// Its configuration.
    pub fn config(&self) -> &Cia402Config {
        &self.config
    }

    /// Restarts as after power-on: what is stored is there again. The motor's supply is separate.
    pub fn renew(&mut self, node: &mut Node, body: &Body, reading: Reading) {
        for (index, sub, value) in &self.stored {
            node.set(*index, *sub, *value);
        }
        self.restart(node.dictionary(), body, reading);
        let fed = self.fed;
        self.feed(fed);
    }

    fn restart(&mut self, objects: &Dictionary, body: &Body, reading: Reading) {
        self.scale = Scale::of(objects, &self.config);
        self.gear = self.config.gear(objects);
        self.sensed = self.sense(body, 0.0, reading);
        self.servo = Servo::new(servo_config(&self.config, self.scale), self.sensed.position);
        self.servo.configure(objects);
        self.set_outputs(objects);
        self.motor.restart(objects);
        (self.mirror, self.nmt) = (Mirror::default(), None);
    }

    /// Completes the self test.
    pub fn initialised(&mut self) {
        self.servo.initialised();
    }

    /// The NMT state has changed.
    pub fn set_nmt_state(&mut self, state: NmtState, objects: &Dictionary) {
        let was = self.nmt.replace(state);
        let (left, stopped) = (was == Some(NmtState::Operational), state == NmtState::Stopped);
        if objects.get(0x6007, 0).is_none() {
            if left && matches!(state, NmtState::PreOperational | NmtState::Stopped) {
                self.servo.fault();
            }
        } else if stopped && was != Some(state) {
            self.servo.connection_lost();
        }
    }

    /// The motor's feed came or went. Without it the drive is in fault, and that cannot be reset: its cause persists.
    pub fn feed(&mut self, fed: bool) -> Option<Emergency> {
        self.fed = fed;
        self.servo.set_cause(!fed);
        let new = !fed && self.servo.fault_by(Stop::Coast);
        new.then(|| emergency(UNDERVOLTAGE))
    }

    /// Its stop input: brakes on the quick stop ramp, then switches off.
    pub fn brake(&mut self) {
        self.servo.fault_by(Stop::QuickStop);
    }

    /// A fault: stops by 0x605E, then off.
    pub fn fault(&mut self, code: u16) -> Option<Emergency> {
        self.servo.fault().then(|| emergency(code))
    }

    /// A fault that it found itself.
    pub fn poll_fault(&mut self) -> Option<Emergency> {
        self.servo.poll_fault().map(emergency)
    }

    /// The master is silent: reacts by 0x6007.
    pub fn heartbeat_lost(&mut self) -> Emergency {
        self.servo.connection_lost();
        emergency(HEARTBEAT)
    }

    /// The master wrote an object, of a PDO the controlword last.
    pub fn written(&mut self, now: Instant, index: u16, objects: &Dictionary) -> Option<Emergency> {
        if UNITS.contains(&index) {
            self.scale = Scale::of(objects, &self.config);
            let Config { velocity, acceleration, .. } = servo_config(&self.config, self.scale);
            self.servo.set_scale(velocity, acceleration);
        }
        if index == 0x60FE {
            self.set_outputs(objects);
        }
        if matches!(index, 0x6075 | 0x6076) {
            self.motor.rate(objects);
        }
        self.servo.written(now, index, objects, &self.sensed).then_some(Emergency::NONE)
    }

    /// Bit 0 of the outputs sets the brake, if the mask has that bit or the drive has no mask.
    fn set_outputs(&mut self, objects: &Dictionary) {
        let bit = |sub| objects.get(0x60FE, sub).map(|value| value & 1 != 0);
        self.output = (bit(1).is_some() && bit(2).unwrap_or(true), bit(1) == Some(true));
    }

    /// True if the brake holds: by the output, where that is the master's; else without power. Always without the feed.
    fn is_braked(&self) -> bool {
        let (by_master, set) = self.output;
        self.config.brake && (!self.fed || if by_master { set } else { !self.servo.is_powered() })
    }

    /// True if time alone changes nothing.
    pub fn rests(&self) -> bool {
        self.servo.rests()
    }

    /// Goes on by `dt` s; answers the demanded speed, m/s, or angle, rad; none with the power stage off.
    pub fn step(&mut self, now: Instant, body: &Body, dt: f64) -> Option<f64> {
        let demand = self.servo.step(now, &self.sensed, dt);
        if self.is_braked() {
            return Some(0.0).filter(|_| matches!(self.config.axis, Axis::Wheel(_)));
        }
        let demand = demand?;
        let counts = self.counts(body);
        let aim = if self.loops_speed() { self.sensed.position } else { demand.demand };
        Some(match self.config.axis {
            Axis::Wheel(_) => (demand.speed + POSITION_GAIN * (aim - self.sensed.position)) / counts,
            Axis::Steering => (aim + demand.speed * body.parameters().steering_lag) / counts,
        })
    }

    /// True if no position is demanded: the speed loop determines it.
    fn loops_speed(&self) -> bool {
        let of_position = [Mode::ProfilePosition, Mode::Homing, Mode::Interpolated, Mode::CyclicPosition];
        !self.servo.mode().is_some_and(|mode| of_position.contains(&mode))
    }

    /// Position units per m or rad.
    fn counts(&self, body: &Body) -> f64 {
        let turns = match self.config.axis {
            Axis::Wheel(_) => body.parameters().motor_turns_per_metre(self.gear),
            Axis::Steering => self.gear / TAU,
        };
        self.scale.counts * turns
    }

    /// What its encoder reads. The steering's one switch is its home switch and, to homing alone, the limit at the end
    /// where it is; the gear holds its wheels.
    fn sense(&self, body: &Body, turned: f64, reading: Reading) -> Sensed {
        let counts = self.counts(body);
        match self.config.axis {
            Axis::Wheel(_) => {
                Sensed { position: reading.way * counts, speed: reading.speed * counts, ..Sensed::default() }
            }
            Axis::Steering => {
                let homing = self.servo.mode() == Some(Mode::Homing);
                let (negative, positive) = body.limits_closed(counts);
                Sensed {
                    position: reading.way * counts,
                    speed: turned * counts,
                    negative: negative && homing,
                    positive: positive && homing,
                    home: body.switch_closed(),
                }
            }
        }
    }

    /// Writes what the drive measures into its objects; `turned`: how fast the steering turns, rad/s, and the
    /// digital inputs but the switch; `reading`: of its encoder.
    pub fn feedback(
        &mut self,
        now: Instant,
        node: &mut Node,
        body: &Body,
        (turned, inputs): (f64, i64),
        reading: Reading,
    ) {
        self.sensed = self.sense(body, turned, reading);
        self.servo.sense(&self.sensed);
        if self.loops_speed() {
            self.servo.resync(&self.sensed);
        }
        let [mode, demanded, position, velocity_demanded, velocity, lag] = self.servo.measured(&self.sensed);
        let inputs = inputs | i64::from(self.sensed.home) << 2;
        let status = i64::from(self.status());
        let objects = [position, demanded, lag, velocity_demanded, velocity, (0x60FD, inputs), mode, (0x6041, status)];
        self.mirror.write(node, objects);
        // The model of the steering has no force.
        if let Axis::Wheel(wheel) = self.config.axis {
            self.motor.write(now, node, body.force(wheel.into()), body.parameters().motor_turns_per_metre(self.gear));
        }
    }

    fn status(&self) -> u16 {
        let bit = |on: bool, bit: u16| if on { bit } else { 0 };
        self.servo.statusword(&self.sensed)
            | bit(self.fed, status::VOLTAGE)
            | bit(self.nmt == Some(NmtState::Operational), status::REMOTE)
            | bit(self.servo.is_homed(), self.config.homed)
    }
}

fn servo_config(config: &Cia402Config, scale: Scale) -> Config {
    Config {
        kind: Kind::Standard { enables_from_ready: false },
        options: config.options(),
        velocity: scale.velocity * scale.counts,
        acceleration: scale.acceleration * scale.counts,
        hardest: HARDEST * scale.counts,
        standstill: STANDSTILL / scale.velocity,
        index: scale.counts,
        offset_moves: false,
        following_fault: true,
        enabling: Duration::ZERO,
        ..Config::default()
    }
}

fn emergency(code: u16) -> Emergency {
    Emergency { code, register: error_register(code) }
}
