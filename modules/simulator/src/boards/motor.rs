//! What a drive by its data sheet measures of its motor: current, torque and temperature, in the objects and units that
//! sheet and manual name.
//!
//! Current   that of the force at the wheel, as the EPOS has it
//! Torque    that of the same force at the shaft of the motor, without friction in the gear
//! Heat      of the power stage: of first order, by the square of the current

use super::epos::FORCE_PER_AMPERE;
use base::Instant;
use canopen::drives::motor::{Own, Topic, Unit, decimal};
use canopen::{Dictionary, Node};

/// Temperature without current, degC.
const AMBIENT_C: f64 = 25.0;
/// Rise at a steady current, K/A².
const RISE_PER_A2: f64 = 0.4;
/// Time constant of the rise, s.
const HEATING_S: f64 = 120.0;

/// An object of the drive, and the number last written to it.
#[derive(Clone, Debug)]
struct Item {
    topic: Topic,
    index: u16,
    sub: u8,
    unit: Unit,
    last: Option<i64>,
}

/// The objects of one drive.
#[derive(Clone, Debug)]
pub(super) struct MotorObjects {
    items: Vec<Item>,
    /// A, N m; 0 where the drive has no such object, or it was never set.
    rated: (f64, f64),
    /// Current since `at`, A, and the rise of the temperature at that time, K.
    current: f64,
    rise: f64,
    at: Instant,
}

impl MotorObjects {
    /// Those of CiA 402 that the drive has, and those of its manual.
    pub fn new(objects: &Dictionary, current: Option<Own>, temperature: Option<Own>) -> Self {
        let own = |topic, Own { index, sub, unit }| Item { topic, index, sub, unit, last: None };
        let standard = |topic, index| own(topic, Own { index, sub: 0, unit: Unit::PerMille });
        let all = [
            Some(standard(Topic::Current, 0x6078)),
            Some(standard(Topic::Torque, 0x6077)),
            current.map(|named| own(Topic::Current, named)),
            temperature.map(|named| own(Topic::Temperature, named)),
        ];
        let mut items: Vec<Item> = Vec::new();
        for item in all.into_iter().flatten().filter(|item| objects.get(item.index, item.sub).is_some()) {
            // An object that the manual names has the unit of the manual.
            items.retain(|other| (other.index, other.sub) != (item.index, item.sub));
            items.push(item);
        }
        let mut new = Self { items, rated: (0.0, 0.0), current: 0.0, rise: 0.0, at: Instant::ZERO };
        new.restart(objects);
        new
    }

    /// The drive was restarted: its objects have the values of its sheet. What is hot stays so.
    pub fn restart(&mut self, objects: &Dictionary) {
        self.rate(objects);
        self.items.iter_mut().for_each(|item| item.last = None);
    }

    /// A rated value may have been written.
    pub fn rate(&mut self, objects: &Dictionary) {
        let rated = |index| decimal(objects.get(index, 0).unwrap_or(0), -3);
        self.rated = (rated(0x6075), rated(0x6076));
    }

    /// Writes what a wheel's motor gives at `now`; `force` at the wheel, N; `turns_per_metre` of the motor.
    pub fn write(&mut self, now: Instant, node: &mut Node, force: f64, turns_per_metre: f64) {
        if self.items.is_empty() {
            return;
        }
        let elapsed = now.since(self.at).as_secs_f64();
        let steady = RISE_PER_A2 * self.current * self.current;
        self.rise = steady + (self.rise - steady) * libm::exp(-elapsed / HEATING_S);
        (self.at, self.current) = (now, force / FORCE_PER_AMPERE);
        let torque = force / (core::f64::consts::TAU * turns_per_metre);
        for item in &mut self.items {
            let (value, rated) = match item.topic {
                Topic::Torque => (torque, self.rated.1),
                Topic::Temperature => (AMBIENT_C + self.rise, 0.0),
                Topic::Current | Topic::RatedCurrent | Topic::RatedTorque => (self.current, self.rated.0),
            };
            let number = match item.unit {
                Unit::Decimal(exponent) => value / decimal(1, exponent),
                Unit::PerMille if rated > 0.0 => 1000.0 * value / rated,
                Unit::PerMille => 0.0,
            };
            let number = libm::round(number) as i64;
            if item.last.replace(number) != Some(number) {
                node.set(item.index, item.sub, number);
            }
        }
    }
}
