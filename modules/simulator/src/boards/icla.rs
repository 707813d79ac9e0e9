//! Berger Lahr IclA N065, the steering: what [`canopen::axis::servo`] has not of its own (docs/facts/canopen.md 3).
//!
//! No document of the real drive was found; this is the stated assumption: CiA 402 with the objects of
//! [`canopen::drives::icla::dictionary`].
//!
//! Units     position in counts, velocity in rpm of the motor, acceleration in rpm/s
//! Power-up  mode 0; the position counts from where it stands; bit 15 of the statusword: homed
//! Homing    methods 17 and 27 (off the switch), 28 (onto it), 35 and 37 (here); others end in a homing error
//! Silence   the heartbeat consumer's event: emergency 0x8130 and what 0x6007 says, by default quick stop

use super::encoder::Reading;
use super::epos::{Emergency, HEARTBEAT};
use super::mirror::Mirror;
use crate::body::Body;
use base::{Duration, Instant};
use canopen::axis::drive::Kind;
use canopen::axis::modes::Mode;
use canopen::axis::options::Options;
use canopen::axis::servo::{Config, Sensed, Servo};
use canopen::axis::status;
use canopen::drives::icla::HOMED;
use canopen::{Dictionary, Node};

/// Deceleration at the current limit, rpm/s.
const HARDEST: f64 = 60_000.0;

/// Conversion of the motor's counts to a steering angle.
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

/// The drive behind its objects. Inside, positions count from the steering's true middle.
#[derive(Debug)]
pub struct Icla {
    gearing: Gearing,
    servo: Servo,
    mirror: Mirror<8>,
    remote: bool,
}

impl Icla {
    /// Makes a drive after power-on, with what its encoder reads.
    #[must_use]
    pub(crate) fn new(gearing: Gearing, reading: Reading) -> Self {
        let rate = gearing.counts_per_turn / 60.0;
        let config = Config {
            kind: Kind::Standard { enables_from_ready: true },
            options: Options::default(),
            velocity: rate,
            acceleration: rate,
            hardest: HARDEST * rate,
            standstill: f64::INFINITY,
            index: gearing.counts_per_turn,
            methods: &[17, 27, 28, 35, 37],
            offset_moves: false,
            following_fault: false,
            enabling: Duration::ZERO,
        };
        let servo = Servo::new(config, reading.way * gearing.counts_per_radian());
        Self { gearing, servo, mirror: Mirror::default(), remote: false }
    }

    /// Restarts as after power-on.
    pub(crate) fn renew(&mut self, objects: &Dictionary, reading: Reading) {
        *self = Self::new(self.gearing, reading);
        self.servo.configure(objects);
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

    /// The NMT state became Operational, or is so no more.
    pub fn set_remote(&mut self, operational: bool) {
        self.remote = operational;
    }

    /// The one switch is home switch and, to homing alone, limit switch at the end where it is.
    fn sensed(&self, body: &Body, reading: Reading, speed: f64) -> Sensed {
        let per_radian = self.gearing.counts_per_radian();
        let homing = self.servo.mode() == Some(Mode::Homing);
        let (negative, positive) = body.limits_closed(per_radian);
        Sensed {
            position: reading.way * per_radian,
            speed: speed * per_radian,
            negative: negative && homing,
            positive: positive && homing,
            home: body.switch_closed(),
        }
    }

    /// The master wrote an object, of a PDO the controlword last.
    pub(crate) fn written(
        &mut self,
        now: Instant,
        index: u16,
        objects: &Dictionary,
        body: &Body,
        reading: Reading,
    ) -> Option<Emergency> {
        let sensed = self.sensed(body, reading, 0.0);
        self.servo.written(now, index, objects, &sensed).then_some(Emergency::NONE)
    }

    /// Heartbeat consumer event: reacts by 0x6007.
    pub fn heartbeat_lost(&mut self) -> Emergency {
        self.servo.connection_lost();
        Emergency { code: HEARTBEAT, register: 0x11 }
    }

    /// Fault: stops by 0x605E, then off.
    pub fn fault(&mut self, code: u16) -> Option<Emergency> {
        self.servo.fault().then_some(Emergency { code, register: 0x01 })
    }

    /// True if time alone changes nothing.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.servo.rests()
    }

    /// Goes on by `dt` s; answers the demanded angle of the steering, rad; none with the power stage off.
    pub(crate) fn step(&mut self, now: Instant, body: &Body, reading: Reading, dt: f64) -> Option<f64> {
        let sensed = self.sensed(body, reading, 0.0);
        let demand = self.servo.step(now, &sensed, dt)?;
        Some(demand.demand / self.gearing.counts_per_radian())
    }

    /// Writes what the drive measures into its objects: by its encoder; the speed of the steering, rad/s, and its
    /// digital inputs but the switch.
    pub(crate) fn feedback(&mut self, node: &mut Node, body: &Body, reading: Reading, (speed, inputs): (f64, i64)) {
        let sensed = self.sensed(body, reading, speed);
        // The gear holds the wheels: without power they stand.
        self.servo.sense(&Sensed { speed: 0.0, ..sensed });
        let [mode, demanded, position, velocity_demanded, velocity, lag] = self.servo.measured(&sensed);
        let objects = [
            position,
            demanded,
            lag,
            velocity_demanded,
            velocity,
            (0x60FD, inputs | i64::from(body.switch_closed()) << 2),
            mode,
            (0x6041, i64::from(self.status(&sensed))),
        ];
        self.mirror.write(node, objects);
    }

    fn status(&self, sensed: &Sensed) -> u16 {
        let bit = |on: bool, bit: u16| if on { bit } else { 0 };
        // The supply is there.
        self.servo.statusword(sensed)
            | status::VOLTAGE
            | bit(self.remote, status::REMOTE)
            | bit(self.servo.is_homed(), HOMED)
    }
}
