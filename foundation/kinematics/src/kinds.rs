//! The named kinds of bases: each makes the list of wheels from a few lengths.

use crate::chassis::Chassis;
use crate::error::{Error, in_range};
use crate::wheel::{Kind, Limits, PerWheel, Steering, WHEELS_MAX, Wheel};
use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

/// Range of lengths, m.
const LENGTH_M: (f64, f64) = (0.01, 100.0);

/// End of the base at which the steered wheels are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// In front of the fixed axle.
    Front,
    /// Behind the fixed axle, as on a fork-lift truck.
    Rear,
}

/// Wheels that have motors and are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Driven {
    /// Those of the fixed axle.
    Fixed,
    /// The steered ones.
    Steered,
    /// All of them.
    All,
}

/// Base with a fixed and a steered axle; the origin is in the middle of the fixed one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteeredBase {
    /// Distance between the axles, m; 0.01 to 100.
    pub wheelbase_m: f64,
    /// End with the steered wheels.
    pub end: End,
    /// Driven wheels.
    pub driven: Driven,
    /// Range of the angle of a single wheel in the middle of the steered axle, and rate of each steered wheel.
    pub steering: Steering,
    /// Limits of each driven wheel.
    pub limits: Limits,
}

impl Chassis {
    /// Differential base: two driven wheels `track_m` apart, left and right of the origin (*Modern Robotics*, 13.3.1).
    /// Castors have no part in it.
    ///
    /// Wheels: left, right.
    ///
    /// # Errors
    /// As [`Chassis::new`].
    pub fn differential(track_m: f64, limits: Limits) -> Result<Self, Error> {
        in_range(None, "track_m", track_m, LENGTH_M)?;
        let half = track_m / 2.0;
        Self::new(&[half, -half].map(|y_m| driven(0.0, y_m, 0.0, Kind::Fixed, limits)))
    }

    /// Skid-steer base: two rows of parallel wheels, one pair at each of `axles_m`, m forward of the origin. It turns
    /// about the middle of the axles. Tracks are one such base, with the places of their rollers.
    ///
    /// The effective track is greater than the real one, often by a half, and depends on the floor: divide the
    /// difference of the distances of both sides by the angle that the base has turned by, on the spot.
    ///
    /// Wheels: left, right of the first axle, left, right of the second, and so on.
    ///
    /// # Errors
    /// As [`Chassis::new`].
    pub fn skid_steer(effective_track_m: f64, axles_m: &[f64], limits: Limits) -> Result<Self, Error> {
        in_range(None, "effective_track_m", effective_track_m, LENGTH_M)?;
        let half = effective_track_m / 2.0;
        let pair = |x_m: &f64| [half, -half].map(|y_m| driven(*x_m, y_m, 0.0, Kind::Skid, limits));
        several(2 * axles_m.len(), axles_m.iter().flat_map(pair))
    }

    /// Base with a single wheel on each axle; also the model of a car with one motor for the driven axle, through a
    /// differential gear, and one for the linkage of both steered wheels (*Modern Robotics*, 13.3.1).
    ///
    /// Wheels: fixed, steered.
    ///
    /// # Errors
    /// As [`Chassis::new`].
    pub fn bicycle(base: &SteeredBase) -> Result<Self, Error> {
        base.build(&[0.0], &[0.0])
    }

    /// Base with two fixed wheels `track_m` apart and a single steered one.
    ///
    /// Wheels: fixed left, fixed right, steered.
    ///
    /// # Errors
    /// As [`Chassis::new`].
    pub fn tricycle(base: &SteeredBase, track_m: f64) -> Result<Self, Error> {
        in_range(None, "track_m", track_m, LENGTH_M)?;
        base.build(&[track_m / 2.0, -track_m / 2.0], &[0.0])
    }

    /// Base with two fixed and two steered wheels, `track_m` apart on both axles. Each steered wheel has its own angle,
    /// and the range that belongs to that of the single wheel in their middle.
    ///
    /// Wheels: fixed left, fixed right, steered left, steered right.
    ///
    /// # Errors
    /// As [`Chassis::new`]; the range of the steering is also refused if the inner wheel would turn across.
    pub fn ackermann(base: &SteeredBase, track_m: f64) -> Result<Self, Error> {
        in_range(None, "track_m", track_m, LENGTH_M)?;
        let both = [track_m / 2.0, -track_m / 2.0];
        // The turn about the inner wheel of the fixed axle, where the inner steered wheel is across.
        let greatest = libm::atan2(base.wheelbase_m, track_m / 2.0) - 1e-3;
        in_range(None, "min_rad", base.steering.min_rad, (-greatest, -1e-3))?;
        in_range(None, "max_rad", base.steering.max_rad, (1e-3, greatest))?;
        base.build(&both, &both)
    }

    /// Base with four mecanum wheels, whose rollers seen from above form an X; the origin is in their middle (*Modern
    /// Robotics*, 13.2.1).
    ///
    /// Wheels: front left, front right, rear left, rear right.
    ///
    /// # Errors
    /// As [`Chassis::new`].
    pub fn mecanum(wheelbase_m: f64, track_m: f64, limits: Limits) -> Result<Self, Error> {
        in_range(None, "wheelbase_m", wheelbase_m, LENGTH_M)?;
        in_range(None, "track_m", track_m, LENGTH_M)?;
        let (x, y) = (wheelbase_m / 2.0, track_m / 2.0);
        let corner = |x_m, y_m, angle_rad| driven(x_m, y_m, 0.0, Kind::Rollers { angle_rad }, limits);
        Self::new(&[
            corner(x, y, -FRAC_PI_4),
            corner(x, -y, FRAC_PI_4),
            corner(-x, y, FRAC_PI_4),
            corner(-x, -y, -FRAC_PI_4),
        ])
    }

    /// Base with three or more omni wheels evenly on a circle about the origin, each rolling along it counter-clockwise
    /// (*Modern Robotics*, 13.2.1).
    ///
    /// Wheels: the one in the direction `first_rad` from the origin, then counter-clockwise.
    ///
    /// # Errors
    /// As [`Chassis::new`].
    pub fn omni(radius_m: f64, count: usize, first_rad: f64, limits: Limits) -> Result<Self, Error> {
        in_range(None, "radius_m", radius_m, LENGTH_M)?;
        in_range(None, "first_rad", first_rad, (-TAU, TAU))?;
        let wheel = |index| {
            let place = libm::remainder(first_rad + TAU * index as f64 / count as f64, TAU);
            let (sin, cos) = libm::sincos(place);
            let kind = Kind::Rollers { angle_rad: 0.0 };
            driven(radius_m * cos, radius_m * sin, place + FRAC_PI_2, kind, limits)
        };
        several(count, (0..count.min(WHEELS_MAX)).map(wheel))
    }
}

impl SteeredBase {
    /// Base with fixed and steered wheels at these places to the left of its middle.
    fn build(&self, fixed_m: &[f64], steered_m: &[f64]) -> Result<Chassis, Error> {
        in_range(None, "wheelbase_m", self.wheelbase_m, LENGTH_M)?;
        let x_m = if self.end == End::Front { self.wheelbase_m } else { -self.wheelbase_m };
        let wheel = |x_m, y_m, kind, driven| Wheel {
            x_m,
            y_m,
            direction_rad: 0.0,
            kind,
            driven,
            measured: driven,
            limits: self.limits,
        };
        let fixed = fixed_m.iter().map(|y_m| wheel(0.0, *y_m, Kind::Fixed, self.driven != Driven::Steered));
        let steered = steered_m.iter().map(|y_m| {
            let kind = Kind::Steered(self.steering_at(x_m, *y_m));
            wheel(x_m, *y_m, kind, self.driven != Driven::Fixed)
        });
        several(fixed_m.len() + steered_m.len(), fixed.chain(steered))
    }

    /// Range of the wheel at (x, y) while the one at (x, 0) uses its own.
    fn steering_at(&self, x_m: f64, y_m: f64) -> Steering {
        // While the middle one rolls at 1 m/s along its angle, (cos, sin), the base turns at sin / x.
        let own = |middle_rad: f64| {
            let (sin, cos) = libm::sincos(middle_rad);
            if y_m == 0.0 { middle_rad } else { libm::atan2(sin, cos - sin / x_m * y_m) }
        };
        Steering { min_rad: own(self.steering.min_rad), max_rad: own(self.steering.max_rad), ..self.steering }
    }
}

/// Driven and measured wheel.
fn driven(x_m: f64, y_m: f64, direction_rad: f64, kind: Kind, limits: Limits) -> Wheel {
    Wheel { x_m, y_m, direction_rad, kind, driven: true, measured: true, limits }
}

/// Base of wheels that are made one after the other.
fn several(count: usize, wheels: impl Iterator<Item = Wheel>) -> Result<Chassis, Error> {
    let wheels: PerWheel<Wheel> = match count {
        0 => return Err(Error::NoWheels),
        1..=WHEELS_MAX => wheels.collect(),
        _ => return Err(Error::TooManyWheels { count }),
    };
    Chassis::new(&wheels)
}
