//! What a drive measures of its motor beside its motion: objects, and how their values become SI.
//!
//! CiA 402-2 states currents and torques per mille of a rated value: 0x6078 of 0x6075 (mA), 0x6077 of 0x6076 (mN m).
//! Drives older than it, the EPOS for one, have 0x6078 in mA. Read by SDO: in an event-driven PDO a current, which
//! changes with each sample, would send a frame at each end of the inhibit time.

use crate::dictionary::DataType;
use base::listed;

listed! {
    /// What an object says of the motor.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Topic {
        /// Rated current, A. It does not change, and is read once.
        RatedCurrent => "rated current",
        /// Rated torque, N m. The same.
        RatedTorque => "rated torque",
        /// Current, A.
        Current => "current",
        /// Torque at the shaft of the motor, N m.
        Torque => "torque",
        /// Temperature of power stage or motor, degC.
        Temperature => "temperature",
    }
}

impl Topic {
    /// True if the value is a property of motor or drive, and does not change.
    #[must_use]
    pub const fn is_rating(self) -> bool {
        matches!(self, Self::RatedCurrent | Self::RatedTorque)
    }
}

/// Unit of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// This power of ten of A, N m or degC.
    Decimal(i8),
    /// Per mille of the rated value of the same kind.
    PerMille,
}

/// An object that says something of the motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// What it says.
    pub topic: Topic,
    /// The object's index.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// Its type: an integer of at most 32 bits.
    pub data_type: DataType,
    /// Its unit.
    pub unit: Unit,
}

impl Reading {
    /// Sub-index 0 of an object.
    #[must_use]
    pub const fn new(topic: Topic, index: u16, data_type: DataType, unit: Unit) -> Self {
        Self { topic, index, sub: 0, data_type, unit }
    }

    /// The number in the answer of the drive; `None`: its length is not that of the type.
    #[must_use]
    pub fn number(&self, data: &[u8]) -> Option<i64> {
        let width = self.data_type.width().filter(|width| *width == data.len() && *width <= 8)?;
        let mut bytes = [0; 8];
        bytes[..width].copy_from_slice(data);
        let (raw, unused) = (u64::from_le_bytes(bytes), u64::BITS - 8 * width as u32);
        Some(if self.data_type.is_signed() { (raw << unused) as i64 >> unused } else { raw as i64 })
    }
}

/// Value of a number with this power of ten.
#[must_use]
pub fn decimal(number: i64, exponent: i8) -> f64 {
    // Exact: the power of ten is, and there is one rounding.
    let power = (0..exponent.unsigned_abs().min(9)).fold(1.0, |power, _| power * 10.0);
    if exponent < 0 { number as f64 / power } else { number as f64 * power }
}

/// What was read of a motor last; `None`: not known, or the drive has no such object.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motor {
    /// A.
    pub rated_current: Option<f64>,
    /// N m.
    pub rated_torque: Option<f64>,
    /// Number and unit.
    pub current: Option<(i64, Unit)>,
    /// Number and unit.
    pub torque: Option<(i64, Unit)>,
    /// degC.
    pub temperature: Option<f64>,
}

impl Motor {
    /// Takes the answer to a reading; false if its length is not that of the object's type.
    pub fn take(&mut self, reading: &Reading, data: &[u8]) -> bool {
        let Some(number) = reading.number(data) else {
            return false;
        };
        let si = match reading.unit {
            Unit::Decimal(exponent) => Some(decimal(number, exponent)),
            Unit::PerMille => None,
        };
        match reading.topic {
            // A rated value that is not above zero was never set: nothing is measured by it.
            Topic::RatedCurrent => self.rated_current = si.filter(|rated| *rated > 0.0),
            Topic::RatedTorque => self.rated_torque = si.filter(|rated| *rated > 0.0),
            Topic::Current => self.current = Some((number, reading.unit)),
            Topic::Torque => self.torque = Some((number, reading.unit)),
            Topic::Temperature => self.temperature = si,
        }
        true
    }

    /// Forgets what is measured, and keeps what is rated.
    pub fn forget(&mut self, topic: Topic) {
        match topic {
            Topic::RatedCurrent | Topic::RatedTorque => {}
            Topic::Current => self.current = None,
            Topic::Torque => self.torque = None,
            Topic::Temperature => self.temperature = None,
        }
    }

    /// Current, A; NaN if unknown.
    #[must_use]
    pub fn current_a(&self) -> f64 {
        absolute(self.current, self.rated_current)
    }

    /// Torque at the shaft of the motor, N m; NaN if unknown.
    #[must_use]
    pub fn torque_nm(&self) -> f64 {
        absolute(self.torque, self.rated_torque)
    }

    /// Temperature, degC; NaN if unknown.
    #[must_use]
    pub fn temperature_c(&self) -> f64 {
        self.temperature.unwrap_or(f64::NAN)
    }

    /// Share of the rated current, of a drive without one of the rated torque: 1 is what the motor bears for ever. NaN
    /// if unknown.
    #[must_use]
    pub fn load(&self) -> f64 {
        let current = share(self.current, self.rated_current);
        if current.is_nan() { share(self.torque, self.rated_torque) } else { current }
    }
}

fn absolute(value: Option<(i64, Unit)>, rated: Option<f64>) -> f64 {
    match (value, rated) {
        (Some((number, Unit::Decimal(exponent))), _) => decimal(number, exponent),
        (Some((number, Unit::PerMille)), Some(rated)) => decimal(number, -3) * rated,
        _ => f64::NAN,
    }
}

fn share(value: Option<(i64, Unit)>, rated: Option<f64>) -> f64 {
    match (value, rated) {
        (Some((number, Unit::PerMille)), _) => decimal(number, -3).abs(),
        (Some((number, Unit::Decimal(exponent))), Some(rated)) => decimal(number, exponent).abs() / rated,
        _ => f64::NAN,
    }
}

/// An object of the maker's for a quantity, and its unit, by the manual of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Own {
    /// The object's index.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// Its unit.
    pub unit: Unit,
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLI: Unit = Unit::Decimal(-3);

    #[test]
    fn the_epos_has_milliamperes_and_the_profile_per_mille_of_the_rated_current() {
        let mut epos = Motor::default();
        let current = Reading::new(Topic::Current, 0x6078, DataType::I16, MILLI);
        assert!(epos.take(&current, &[0x0C, 0xFE]));
        assert_eq!(epos.current_a(), -0.5);
        assert!(epos.load().is_nan(), "its rated current is not known yet");
        let rated = Reading { sub: 1, ..Reading::new(Topic::RatedCurrent, 0x6410, DataType::U16, MILLI) };
        assert!(epos.take(&rated, &[0x88, 0x13]));
        assert_eq!((epos.current_a(), epos.load()), (-0.5, 0.1));

        let mut profile = Motor::default();
        let current = Reading::new(Topic::Current, 0x6078, DataType::I16, Unit::PerMille);
        assert!(profile.take(&current, &[0x0C, 0xFE]));
        assert!(profile.current_a().is_nan(), "per mille of what is not known yet");
        assert_eq!(profile.load(), 0.5);
        assert!(profile.take(&Reading::new(Topic::RatedCurrent, 0x6075, DataType::U32, MILLI), &[0x70, 0x17, 0, 0]));
        assert_eq!(profile.current_a(), -3.0);
    }

    #[test]
    fn a_torque_stands_in_for_the_load_and_a_rated_value_of_zero_for_nothing() {
        let mut motor = Motor::default();
        assert!(motor.take(&Reading::new(Topic::Torque, 0x6077, DataType::I16, Unit::PerMille), &[0xF4, 0x01]));
        let rated = Reading::new(Topic::RatedTorque, 0x6076, DataType::U32, MILLI);
        assert!(motor.take(&rated, &[0, 0, 0, 0]));
        assert!(motor.torque_nm().is_nan());
        assert!(motor.take(&rated, &[0xD0, 0x07, 0, 0]));
        assert_eq!((motor.torque_nm(), motor.load()), (1.0, 0.5));
        motor.forget(Topic::Torque);
        assert!(motor.torque_nm().is_nan() && motor.load().is_nan());
    }

    #[test]
    fn an_answer_of_another_length_says_nothing() {
        let mut motor = Motor::default();
        let current = Reading::new(Topic::Current, 0x6078, DataType::I16, MILLI);
        for data in [&[][..], &[1], &[1, 2, 3], &[1, 2, 3, 4, 5, 6, 7, 8, 9]] {
            assert!(!motor.take(&current, data));
        }
        assert_eq!(motor, Motor::default());
        assert!(motor.take(&Reading::new(Topic::Temperature, 0x3201, DataType::I16, Unit::Decimal(-1)), &[0xC9, 0x01]));
        assert_eq!(motor.temperature_c(), 45.7);
    }
}
