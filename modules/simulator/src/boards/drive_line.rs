//! A motor controller on a serial line of its own: the emulation of `motorctl`, with its motors in the robot's body,
//! and what is wrong with it and with the line.
//!
//! Supply    of the motors' feed alone: without it the controller neither sends nor receives; it starts anew with it
//! Motors    turn with their wheels; their demand is what the controller wants of them, none of one without torque

use super::drive::{Disobedience, Obedience};
use super::encoder::{Encoder, Reading, Wrong};
use crate::body::Body;
use crate::disturbance::{Disturbance, garbled};
use crate::faults::InjectedFault;
use crate::random::Random;
use base::serial::Word;
use base::{Duration, Instant};
use motorctl::motor::Drive;
use motorctl::serial::{Device, Emulated};
use std::collections::VecDeque;

/// From power or reset to the first message.
const BOOT_TIME: Duration = Duration::from_millis(100);
/// Bits of a byte on the wire.
const BITS_PER_BYTE: u64 = 10;

/// A serial line with a motor controller.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveLineConfig {
    /// The line's name, as its driver has it: `serial.left`. The target of its faults.
    pub bus: String,
    /// Bd.
    pub baud: u32,
    /// Which one it is.
    pub device: Device,
    /// Its motors, in the order of the device.
    pub motors: Vec<MotorConfig>,
}

/// A motor of a controller.
#[derive(Clone, Debug, PartialEq)]
pub struct MotorConfig {
    /// Name, the target of faults: `left`.
    pub name: String,
    /// Number of the wheel.
    pub wheel: u8,
    /// Motor turns per turn of the wheel.
    pub gear: f64,
}

/// A motor with its wheel.
struct Wheel {
    config: MotorConfig,
    encoder: Encoder,
    obedience: Obedience,
}

/// The line, and what is on it.
pub(crate) struct DriveLine {
    pub config: DriveLineConfig,
    device: Emulated,
    wheels: Vec<Wheel>,
    /// It has its supply.
    fed: bool,
    /// When it has started.
    started: Instant,
    /// Neither receives nor sends until this instant.
    silent: Instant,
    /// Until then nothing passes the line.
    cut: Instant,
    /// Until then each byte that it sends is wrong with this probability.
    garbled: (Instant, f64),
    /// What the line does, where the host models no wire.
    imitates: bool,
    disturbance: Disturbance,
    random: Random,
    /// Bytes on the wire, with the instants at which they arrive.
    wire: VecDeque<(Instant, Vec<Word>)>,
}

impl DriveLine {
    /// A line whose device is switched off; `imitates`: the host models no wire.
    pub fn new(config: DriveLineConfig, imitates: bool, random: Random) -> Self {
        let wheel = |motor: &MotorConfig| Wheel {
            config: motor.clone(),
            encoder: Encoder::new(motor.wheel),
            obedience: Obedience::default(),
        };
        Self {
            device: Emulated::new(config.device),
            wheels: config.motors.iter().map(wheel).collect(),
            config,
            fed: true,
            started: Instant::ZERO,
            silent: Instant::ZERO,
            cut: Instant::ZERO,
            garbled: (Instant::ZERO, 0.0),
            imitates,
            disturbance: Disturbance::default(),
            random,
            wire: VecDeque::new(),
        }
    }

    /// Switches it on, or off and on again: what was written to it is forgotten.
    pub fn power_on(&mut self, now: Instant, body: &Body) {
        self.device = Emulated::new(self.config.device);
        self.started = now + BOOT_TIME;
        self.wire.clear();
        self.place(body);
    }

    /// The supply comes or goes.
    pub fn feed(&mut self, now: Instant, fed: bool, body: &Body) {
        self.fed = fed;
        self.power_on(now, body);
    }

    fn is_on(&self, now: Instant) -> bool {
        self.fed && self.started <= now
    }

    fn place(&mut self, body: &Body) {
        for (wheel, motor) in self.wheels.iter().zip(self.device.motors_mut()) {
            let scale = body.parameters().motor_turns_per_metre(wheel.config.gear);
            let Reading { way, speed } = wheel.encoder.read(body);
            motor.place(way * scale, speed * scale);
        }
    }

    /// Bytes from the driver.
    pub fn handle_rx(&mut self, now: Instant, words: &[Word], body: &Body) {
        let lost = self.cut > now || self.silent > now || self.random.chance(self.disturbance.loss(now));
        if lost || !self.is_on(now) {
            return;
        }
        self.place(body);
        let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
        self.device.handle_rx(now, &bytes);
        self.send(now);
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant, body: &Body) {
        if self.is_on(now) {
            self.place(body);
            self.device.handle_timeout(now);
            self.send(now);
        }
    }

    /// Takes what the device sends.
    fn send(&mut self, now: Instant) {
        while let Some(bytes) = self.device.poll_tx(now) {
            let mut words: Vec<Word> = bytes.iter().copied().map(Word::data).collect();
            if self.cut > now || self.silent > now || self.random.chance(self.disturbance.loss(now)) {
                continue;
            }
            let chance = if self.garbled.0 > now { self.garbled.1 } else { 0.0 };
            for word in &mut words {
                if self.random.chance(chance) {
                    // There is no ninth bit.
                    *word = Word::data(garbled(&mut self.random, *word).byte);
                }
            }
            self.disturbance.garble(now, &mut words, &mut self.random);
            let nanos = words.len() as u64 * BITS_PER_BYTE * 1_000_000_000 / u64::from(self.config.baud.max(1));
            let played = if self.imitates { Duration::from_nanos(nanos) } else { Duration::ZERO };
            let begin = self.wire.back().map_or(now, |(due, _)| now.max(*due));
            let due = self.disturbance.arrival(now, begin + played);
            if self.disturbance.duplicates(now, &mut self.random) {
                self.wire.push_back((due, words.clone()));
            }
            self.wire.push_back((due, words));
        }
    }

    /// True if time alone changes nothing.
    pub fn rests(&self) -> bool {
        !self.device.motors().iter().any(|motor| matches!(motor.drive, Drive::Velocity(turns) if turns != 0.0))
    }

    /// What its motors demand at `now` of their wheels, by their numbers: speed, m/s; none without torque.
    pub fn demands(&mut self, now: Instant, body: &Body) -> impl Iterator<Item = (u8, Option<f64>)> {
        self.wheels.iter_mut().zip(self.device.motors()).map(move |(wheel, motor)| {
            wheel.encoder.expire(now, body);
            let number = wheel.config.wheel;
            let demand = match motor.drive {
                Drive::Free => None,
                Drive::Brake => Some(0.0),
                Drive::Velocity(turns) => Some(turns / body.parameters().motor_turns_per_metre(wheel.config.gear)),
            };
            let obeyed = demand.map(|demand| wheel.obedience.demand(now, demand, body.wheel_speed(number.into())));
            (number, obeyed.and_then(|demand| wheel.encoder.controlled(demand, body)))
        })
    }

    /// Names of its motors.
    pub fn motors(&self) -> impl Iterator<Item = &str> {
        self.wheels.iter().map(|wheel| wheel.config.name.as_str())
    }

    /// Injects a fault into the device or the wheel `target`; false if neither has such a fault. `wheels`: number of
    /// wheels of the robot.
    pub fn inject(
        &mut self,
        now: Instant,
        target: &str,
        injected: InjectedFault,
        until: Instant,
        (wheels, body): (usize, &Body),
    ) -> bool {
        let Some(wheel) = self.wheels.iter_mut().find(|wheel| wheel.config.name == target) else { return false };
        match injected {
            InjectedFault::Silent => self.silent = until,
            InjectedFault::Garbled(chance) => self.garbled = (until, chance),
            InjectedFault::None => {
                wheel.obedience.set(None, now);
                wheel.encoder.deviate(None, now, body);
                (self.silent, self.garbled.0) = (now, now);
            }
            InjectedFault::Fault(code) => self.device.raise(code),
            InjectedFault::Reboot => self.power_on(now, body),
            InjectedFault::Unbraked => wheel.obedience.set(Some(Disobedience::Unbraked), until),
            InjectedFault::Runaway(by) => wheel.obedience.set(Some(Disobedience::Runaway(by)), until),
            InjectedFault::Encoder(factor) => wheel.encoder.deviate(Some(Wrong::Scaled(factor)), until, body),
            InjectedFault::Swapped(other) if (1..=wheels).contains(&usize::from(other)) => {
                wheel.encoder.deviate(Some(Wrong::Of(other - 1)), until, body);
            }
            _ => return false,
        }
        true
    }

    /// Injects a fault into the line; false if a line has no such fault. Where the host models a wire, it does all but
    /// the cut.
    pub fn disturb(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        match injected {
            InjectedFault::Cut => self.cut = until,
            InjectedFault::None => self.cut = now,
            InjectedFault::Noise(_)
            | InjectedFault::Loss(_)
            | InjectedFault::Duplicate(_)
            | InjectedFault::Delay(_) => {}
            _ => return false,
        }
        if self.imitates {
            self.disturbance.inject(now, injected, until);
        }
        true
    }

    /// Next bytes for the port.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Vec<Word>> {
        let (due, _) = self.wire.front()?;
        if *due > now { None } else { self.wire.pop_front().map(|(_, words)| words) }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let device = self.device.poll_timeout().map(|due| due.max(self.started)).filter(|_| self.fed);
        device.into_iter().chain(self.wire.front().map(|(due, _)| *due)).min()
    }
}
