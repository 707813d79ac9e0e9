//! A base as a list of wheels that was found to be possible.

use crate::error::Error;
use crate::least_squares::{EQUATIONS_MAX, Inverse, dependent, pseudo_inverse};
use crate::twist::{Twist, is_usable};
use crate::wheel::{Kind, PerWheel, Steering, Wheel, WheelState};
use core::f64::consts::FRAC_PI_2;
use heapless::Vec;

/// Distance of two contact points below which they are one, m.
const PLACE_MIN_M: f64 = 1e-3;
/// Offset of a wheel from an axle line, m, and sine of its angle to the line's normal, that count as rounding.
const AXLE_TOLERANCE: f64 = 1e-6;

/// Kinematics of a wheeled base.
#[derive(Clone, Debug, PartialEq)]
pub struct Chassis {
    pub(crate) wheels: PerWheel<Wheel>,
    pub(crate) motions: Vec<Twist, 3>,
    /// Pseudo-inverse of the constraints of all measured wheels; `None` if it depends on steering angles.
    pub(crate) inverse: Option<Inverse>,
}

impl Chassis {
    /// Creates a base from its wheels; the named kinds ([`Chassis::differential`] and others) make that list.
    ///
    /// # Errors
    /// The first flaw of the description: a quantity out of its range, two wheels at one place, fixed wheels that no
    /// common axle carries, wheels whose drives or measurements leave a motion of the base open.
    pub fn new(wheels: &[Wheel]) -> Result<Self, Error> {
        let count = wheels.len();
        let wheels: PerWheel<Wheel> = Vec::from_slice(wheels).map_err(|_| Error::TooManyWheels { count })?;
        if wheels.is_empty() {
            return Err(Error::NoWheels);
        }
        for (index, wheel) in wheels.iter().enumerate() {
            wheel.check(index)?;
            let same = |other: &Wheel| libm::hypot(wheel.x_m - other.x_m, wheel.y_m - other.y_m) < PLACE_MIN_M;
            if let Some(other) = wheels[..index].iter().position(same) {
                return Err(Error::SamePlace { wheel: index, other });
            }
        }
        let motions = motions(&wheels)?;
        let mut chassis = Self { wheels, motions, inverse: None };
        chassis.check_drives()?;
        let measured = chassis.constraints(|wheel| wheel.measured, |_| 0.0);
        chassis.determines(&measured).map_err(|wheel| Error::NotMeasured { wheel })?;
        chassis.inverse = (!chassis.is_steered()).then(|| chassis.inverse_of(&measured).0);
        Ok(chassis)
    }

    /// Wheels in the order of the description.
    #[must_use]
    pub fn wheels(&self) -> &[Wheel] {
        &self.wheels
    }

    /// Independent motions that the unsteered wheels permit: two, along and about their axle, or all three. Every
    /// velocity of the base is a sum of multiples of them.
    #[must_use]
    pub fn motions(&self) -> &[Twist] {
        &self.motions
    }

    /// True if at least one wheel is steered.
    #[must_use]
    pub fn is_steered(&self) -> bool {
        self.wheels.iter().any(|wheel| wheel.steering().is_some())
    }

    /// States of all wheels at standstill, steered straight ahead.
    #[must_use]
    pub fn standing(&self) -> PerWheel<WheelState> {
        self.wheels.iter().map(|_| WheelState::default()).collect()
    }

    /// Speed and steering angle of each wheel, driven or not, at a velocity of the base; inverse of
    /// [`Chassis::estimate`].
    ///
    /// `present` has the steering angles from which the nearest ones are chosen; a wheel rolls in reverse where that is
    /// nearer. Pass a velocity that is [feasible](Chassis::feasible): of others, each wheel does the part that it can.
    /// A velocity that is not finite or beyond 1e6 is standing still.
    #[must_use]
    pub fn wheel_states(&self, twist: Twist, present: &[WheelState]) -> PerWheel<WheelState> {
        let twist = twist.usable().unwrap_or_default();
        let states = self.wheels.iter().zip(self.present(present)).map(|(wheel, present)| {
            let steering_rad = wheel.steer(twist, present.steering_rad);
            WheelState { speed_mps: twist.dot(wheel.rolling(steering_rad)), steering_rad }
        });
        states.collect()
    }

    /// States of all wheels; missing, unusable and out of range ones are replaced by the nearest that are possible.
    pub(crate) fn present<'a>(&'a self, states: &'a [WheelState]) -> impl Iterator<Item = WheelState> + 'a {
        self.wheels.iter().enumerate().map(|(index, wheel)| {
            let state = states.get(index).copied().unwrap_or_default();
            let usable = |number| if is_usable(number) { number } else { 0.0 };
            let angle = |range: Steering| usable(state.steering_rad).clamp(range.min_rad, range.max_rad);
            WheelState { speed_mps: usable(state.speed_mps), steering_rad: wheel.steering().map_or(0.0, angle) }
        })
    }

    /// Constraints in the independent motions: rolling of the wheels that `rolls` selects, and sliding of the steered
    /// ones, wheel by wheel.
    pub(crate) fn constraints(
        &self,
        rolls: impl Fn(&Wheel) -> bool,
        steering_rad: impl Fn(usize) -> f64,
    ) -> Constraints {
        let of_wheel = |(index, wheel): (usize, &Wheel)| {
            let angle = wheel.steering().map_or(0.0, |_| steering_rad(index));
            let rolling = rolls(wheel).then(|| (true, wheel.rolling(angle)));
            let sliding = wheel.steering().map(|_| (false, wheel.sliding(angle)));
            let both = [rolling, sliding].into_iter().flatten();
            both.map(move |(rolling, row)| Constraint { wheel: index, rolling, row: self.reduced(row) })
        };
        self.wheels.iter().enumerate().flat_map(of_wheel).collect()
    }

    /// Coefficients of the independent motions instead of (vx, vy, ω).
    fn reduced(&self, row: [f64; 3]) -> [f64; 3] {
        core::array::from_fn(|n| self.motions.get(n).map_or(0.0, |motion| motion.dot(row)))
    }

    /// Velocity of the base from the amounts of the independent motions.
    pub(crate) fn combined(&self, amounts: [f64; 3]) -> Twist {
        self.motions.iter().zip(amounts).fold(Twist::ZERO, |sum, (motion, amount)| sum + *motion * amount)
    }

    /// Pseudo-inverse of constraints, and whether they leave no motion open.
    pub(crate) fn inverse_of(&self, constraints: &[Constraint]) -> (Inverse, bool) {
        pseudo_inverse(constraints.iter().map(|constraint| constraint.row), self.motions.len())
    }

    /// Fails if constraints leave a motion open, with the first wheel that adds nothing.
    fn determines(&self, constraints: &[Constraint]) -> Result<(), Option<usize>> {
        let dependent = || dependent(constraints.iter().map(|constraint| constraint.row));
        if self.inverse_of(constraints).1 { Ok(()) } else { Err(dependent().map(|row| constraints[row].wheel)) }
    }

    /// The driven wheels cause every motion that the others permit: straight ahead, and at the ends of the steering, at
    /// most across.
    fn check_drives(&self) -> Result<(), Error> {
        if !self.wheels.iter().any(|wheel| wheel.driven) {
            return Err(Error::NotDriven { wheel: None });
        }
        let right = |range: Steering| range.min_rad.max(-FRAC_PI_2);
        let left = |range: Steering| range.max_rad.min(FRAC_PI_2);
        for angle in [|_| 0.0, right, left] {
            let driven =
                self.constraints(|wheel| wheel.driven, |index| self.wheels[index].steering().map_or(0.0, angle));
            self.determines(&driven).map_err(|wheel| Error::NotDriven { wheel })?;
        }
        Ok(())
    }
}

/// Equation of one wheel in the independent motions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Constraint {
    pub(crate) wheel: usize,
    /// The sum is the speed of the tread; otherwise it is zero, since the wheel does not slide.
    pub(crate) rolling: bool,
    pub(crate) row: [f64; 3],
}

pub(crate) type Constraints = Vec<Constraint, EQUATIONS_MAX>;

/// Independent motions of a base with these wheels.
///
/// Fixed wheels permit rolling along their direction and turning about a point of their common axle (zero motion line,
/// Siegwart et al., 3.3.1). Skidding wheels replace them, if there are no fixed ones, by the line through their middle.
fn motions(wheels: &PerWheel<Wheel>) -> Result<Vec<Twist, 3>, Error> {
    let has_fixed = wheels.iter().any(|wheel| wheel.kind == Kind::Fixed);
    let kind = if has_fixed { Kind::Fixed } else { Kind::Skid };
    let mut axle = wheels.iter().enumerate().filter(|(_, wheel)| wheel.kind == kind);
    let Some((other, first)) = axle.clone().next() else {
        let all = [Twist::new(1.0, 0.0, 0.0), Twist::new(0.0, 1.0, 0.0), Twist::new(0.0, 0.0, 1.0)];
        return Ok(all.into_iter().collect());
    };
    let (sin, cos) = libm::sincos(first.direction_rad);
    let ahead = |wheel: &Wheel| wheel.x_m * cos + wheel.y_m * sin;
    let off_axle = |wheel: &Wheel| {
        let skew = libm::fabs(libm::sin(wheel.direction_rad - first.direction_rad));
        let offset = if has_fixed { libm::fabs(ahead(wheel) - ahead(first)) } else { 0.0 };
        skew > AXLE_TOLERANCE || offset > AXLE_TOLERANCE
    };
    let count = axle.clone().count() as f64;
    let middle = axle.clone().map(|(_, wheel)| ahead(wheel)).sum::<f64>() / count;
    match axle.find(|(_, wheel)| off_axle(wheel)) {
        Some((wheel, _)) => Err(Error::OffAxle { wheel, other }),
        // Turning moves the origin sideways if it is not on the axle.
        None => Ok([Twist::new(cos, sin, 0.0), Twist::new(middle * sin, -middle * cos, 1.0)].into_iter().collect()),
    }
}
