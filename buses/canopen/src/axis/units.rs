//! Units by factor: SI on one side, the numbers of a drive's objects on the other.
//! A drive counts positions in its own unit, velocities and accelerations in rpm of the motor (EPOS, IclA) or in
//! position units per second. Gear, encoder, and the objects 0x608F, 0x6091 and 0x6092 convert them.

use core::f64::consts::TAU;

/// Unit of the velocity objects; of the acceleration objects, per second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// A turn of the motor per minute.
    MotorRpm,
    /// A position unit per second.
    PositionPerSecond,
}

/// Conversion factors read from a drive, as far as they were read: numerator and denominator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Factors {
    /// 0x608F: encoder increments, motor turns.
    pub encoder: Option<(u32, u32)>,
    /// 0x6091: motor turns, driving shaft turns.
    pub gear: Option<(u32, u32)>,
    /// 0x6092: feed in position units, driving shaft turns.
    pub feed: Option<(u32, u32)>,
}

impl Factors {
    /// Position units per turn of the driving shaft: the feed where there is one, else increments times gear
    /// (CiA 402-2, 8.1). `None`: neither was read, or a factor is zero.
    #[must_use]
    pub fn units_per_shaft_turn(&self) -> Option<f64> {
        let ratio = |(above, below): (u32, u32)| (above > 0 && below > 0).then(|| f64::from(above) / f64::from(below));
        match self.feed {
            Some(feed) => ratio(feed),
            None => Some(ratio(self.encoder?)? * ratio(self.gear.unwrap_or((1, 1)))?),
        }
    }
}

/// Factors from SI (rad or m, and per s, and per s²) to a drive's units. A negative factor turns the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    position: f64,
    velocity: f64,
    acceleration: f64,
}

impl Units {
    /// Position units per rad or m; velocity units per rad/s or m/s; acceleration units per rad/s² or m/s². A factor
    /// that is zero or not finite is no factor: then everything is zero, which moves nothing.
    #[must_use]
    pub fn new(position: f64, velocity: f64, acceleration: f64) -> Self {
        let sound = [position, velocity, acceleration].iter().all(|factor| factor.is_finite() && *factor != 0.0);
        if sound {
            Self { position, velocity, acceleration }
        } else {
            Self { position: 0.0, velocity: 0.0, acceleration: 0.0 }
        }
    }

    /// An angle behind a gear: `counts_per_turn` of the motor, which turns `gear` times per turn of the output.
    #[must_use]
    pub fn rotary(counts_per_turn: f64, gear: f64, rate: Rate) -> Self {
        Self::of(counts_per_turn * gear / TAU, gear / TAU, rate)
    }

    /// A way: the motor turns `turns_per_metre`, and counts `counts_per_turn`.
    #[must_use]
    pub fn linear(counts_per_turn: f64, turns_per_metre: f64, rate: Rate) -> Self {
        Self::of(counts_per_turn * turns_per_metre, turns_per_metre, rate)
    }

    /// Units of an angle of the driving shaft, for a drive with known factors; rates are position units per second.
    #[must_use]
    pub fn from_factors(factors: &Factors) -> Option<Self> {
        let position = factors.units_per_shaft_turn()? / TAU;
        Some(Self::new(position, position, position))
    }

    fn of(position: f64, turns: f64, rate: Rate) -> Self {
        match rate {
            Rate::MotorRpm => Self::new(position, turns * 60.0, turns * 60.0),
            Rate::PositionPerSecond => Self::new(position, position, position),
        }
    }

    /// A position for 0x607A: to the nearest unit, saturating; NaN is 0.
    #[must_use]
    pub fn position(&self, si: f64) -> i32 {
        nearest(si * self.position)
    }

    /// Position, rad or m, of a drive's position value; NaN without a factor.
    #[must_use]
    pub fn position_si(&self, units: i32) -> f64 {
        f64::from(units) / self.position
    }

    /// A velocity for 0x60FF: to the nearest unit, saturating; NaN is 0.
    #[must_use]
    pub fn velocity(&self, si: f64) -> i32 {
        nearest(si * self.velocity)
    }

    /// Velocity, rad/s or m/s, of a drive's velocity value; NaN without a factor.
    #[must_use]
    pub fn velocity_si(&self, units: i32) -> f64 {
        f64::from(units) / self.velocity
    }

    /// A speed without direction for 0x6081, 0x607F or 0x6099: at least 1, as drives refuse 0.
    #[must_use]
    pub fn speed(&self, si: f64) -> u32 {
        magnitude(si * self.velocity)
    }

    /// A ramp for 0x6083 to 0x6085 or 0x609A: at least 1, as drives refuse 0.
    #[must_use]
    pub fn acceleration(&self, si: f64) -> u32 {
        magnitude(si * self.acceleration)
    }
}

/// The nearest whole number, halves away from zero; casts saturate, and NaN is 0.
fn nearest(value: f64) -> i32 {
    libm::round(value) as i32
}

fn magnitude(value: f64) -> u32 {
    (libm::round(libm::fabs(value)) as u32).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The steering of the robot: 4096 counts, 180:1, rpm.
    fn steering() -> Units {
        Units::rotary(4096.0, 180.0, Rate::MotorRpm)
    }

    #[test]
    fn an_angle_behind_a_gear_is_counts_and_rpm() {
        let units = steering();
        assert_eq!(units.position(TAU), 4096 * 180);
        assert_eq!(units.position(-TAU / 2.0), -4096 * 90);
        // 10 deg/s at the output are 300 rpm of the motor.
        assert_eq!((units.velocity(10f64.to_radians()), units.speed(-10f64.to_radians())), (300, 300));
        assert_eq!(units.acceleration(100f64.to_radians()), 3000);
        assert_eq!(Units::rotary(4096.0, -180.0, Rate::MotorRpm).position(TAU), -4096 * 180);
    }

    #[test]
    fn a_way_is_counts_and_rpm() {
        // 2483 rpm at 1 m/s; 2000 quadcounts per turn.
        let units = Units::linear(2000.0, 2483.0 / 60.0, Rate::MotorRpm);
        assert_eq!((units.velocity(0.8), units.velocity(-0.8), units.acceleration(0.5)), (1986, -1986, 1242));
        assert_eq!(units.position(1.0), 82_767);
        let units = Units::linear(2000.0, 10.0, Rate::PositionPerSecond);
        assert_eq!((units.position(1.0), units.velocity(1.0)), (20_000, 20_000));
    }

    #[test]
    fn what_a_drive_says_goes_through_si_and_back_unchanged() {
        let units = [steering(), Units::linear(2000.0, 41.38333, Rate::MotorRpm), Units::new(1e-3, -7.7, 1.0)];
        let numbers = (0..31).flat_map(|bit| [1 << bit, -(1 << bit), (1 << bit) - 1, i32::MAX - bit, i32::MIN + bit]);
        for (units, number) in units.iter().flat_map(|units| numbers.clone().map(move |number| (units, number))) {
            assert_eq!(units.position(units.position_si(number)), number);
            assert_eq!(units.velocity(units.velocity_si(number)), number);
        }
    }

    #[test]
    fn what_does_not_fit_saturates_and_what_is_no_number_moves_nothing() {
        let units = steering();
        assert_eq!((units.position(1e9), units.position(f64::NEG_INFINITY)), (i32::MAX, i32::MIN));
        assert_eq!((units.position(f64::NAN), units.velocity(f64::NAN)), (0, 0));
        assert_eq!((units.speed(0.0), units.acceleration(f64::INFINITY)), (1, u32::MAX));
        for factor in [0.0, f64::NAN, f64::INFINITY] {
            let none = Units::new(factor, 1.0, 1.0);
            assert_eq!((none.position(1.0), none.velocity(1.0)), (0, 0));
        }
    }

    #[test]
    fn the_factors_of_a_drive_make_its_units() {
        let factors = Factors { encoder: Some((4096, 1)), gear: Some((26, 1)), feed: None };
        assert_eq!(factors.units_per_shaft_turn(), Some(106_496.0));
        // With a feed constant the position unit is the feed's, independent of the encoder.
        let factors = Factors { feed: Some((36_000, 1)), ..factors };
        assert_eq!(Units::from_factors(&factors).unwrap().position(TAU), 36_000);
        for factors in [
            Factors::default(),
            Factors { encoder: Some((4096, 0)), ..Factors::default() },
            Factors { feed: Some((0, 1)), ..factors },
        ] {
            assert_eq!(Units::from_factors(&factors), None);
        }
    }
}
