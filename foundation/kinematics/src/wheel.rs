//! One wheel: what describes it, and its two constraints.

use crate::error::{Error, in_range};
use crate::twist::Twist;
use core::f64::consts::PI;

/// Maximum number of wheels of a base.
pub const WHEELS_MAX: usize = 8;

/// One value for each wheel, in the order of the description.
pub type PerWheel<T> = heapless::Vec<T, WHEELS_MAX>;

/// A wheel in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wheel {
    /// Contact point, forward, m; -100 to 100.
    pub x_m: f64,
    /// Contact point, to the left, m; -100 to 100. Of a skidding wheel: half the effective track, which is greater than
    /// the real one.
    pub y_m: f64,
    /// Direction of rolling at positive speed, rad from the x axis; of a steered wheel: at steering angle 0.
    pub direction_rad: f64,
    /// How it meets the floor across its direction of rolling.
    pub kind: Kind,
    /// Has a motor. Only driven wheels have limits.
    pub driven: bool,
    /// Its speed is measured. The angle of a steered wheel always is.
    pub measured: bool,
    /// Limits of its drive.
    pub limits: Limits,
}

/// Kind of a wheel (Siegwart et al., 3.2.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Fixed standard wheel: does not slide. All such wheels share one axle line.
    Fixed,
    /// Fixed standard wheel that is dragged sideways in turns: skid-steer, tracks. Without fixed wheels, skidding ones
    /// are taken as equally loaded: together they slide by nothing, so the base turns about their middle.
    Skid,
    /// Steered standard wheel: does not slide.
    Steered(Steering),
    /// Swedish wheel, with rollers on its rim.
    Rollers {
        /// Free direction of the rollers, rad from the wheel's left: 0 for an omni wheel, ±π/4 for mecanum; -1.4 to
        /// 1.4, since rollers that turn in the direction of rolling transmit nothing (γ in *Modern Robotics*, 13.2.1).
        angle_rad: f64,
    },
}

/// Range and rate of a steering angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steering {
    /// Least angle (furthest to the right), rad; -100 to -0.001.
    pub min_rad: f64,
    /// Greatest angle (furthest to the left), rad; 0.001 to 100.
    pub max_rad: f64,
    /// Greatest rate, rad/s; 0.001 to 1000.
    pub rate_radps: f64,
}

/// Limits of the drive of one wheel, measured at its tread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest speed, m/s; 0.001 to 1000.
    pub speed_mps: f64,
    /// Greatest acceleration, m/s²; 0.001 to 1000.
    pub acceleration_mps2: f64,
    /// Greatest deceleration, m/s²; 0.001 to 1000.
    pub deceleration_mps2: f64,
}

/// Commanded or measured motion of one wheel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelState {
    /// Speed of the tread in the direction of rolling, m/s.
    pub speed_mps: f64,
    /// Steering angle from [`Wheel::direction_rad`], counter-clockwise, rad, not wrapped; 0 for wheels that do not
    /// steer.
    pub steering_rad: f64,
}

/// Tolerance at the ends of a steering range, rad: rounding of limits that were computed.
const ANGLE_TOLERANCE_RAD: f64 = 1e-9;
/// Speed of a contact point, relative to the velocity of the body, below which it is rounding: the body turns about the
/// wheel.
const REST: f64 = 1e-12;

impl Wheel {
    /// Range and rate of the steering angle, if the wheel is steered.
    #[must_use]
    pub fn steering(&self) -> Option<Steering> {
        match self.kind {
            Kind::Steered(steering) => Some(steering),
            _ => None,
        }
    }

    /// Rolling constraint: coefficients of (vx, vy, ω) whose sum is the speed of the tread.
    pub(crate) fn rolling(&self, steering_rad: f64) -> [f64; 3] {
        let (sin, cos) = libm::sincos(self.direction_rad + steering_rad);
        let slope = if let Kind::Rollers { angle_rad } = self.kind { libm::tan(angle_rad) } else { 0.0 };
        let (x, y) = (cos - slope * sin, sin + slope * cos);
        [x, y, self.x_m * y - self.y_m * x]
    }

    /// Sliding constraint: coefficients of (vx, vy, ω) whose sum is the speed of the contact point to the wheel's left.
    pub(crate) fn sliding(&self, steering_rad: f64) -> [f64; 3] {
        let (sin, cos) = libm::sincos(self.direction_rad + steering_rad);
        [-sin, cos, self.x_m * cos + self.y_m * sin]
    }

    /// Steering angle at which the wheel rolls with the body: the one nearest to `present_rad`, forwards or in reverse.
    /// At standstill the present one, which is in the range; the nearer end of the range if no angle within it fits.
    pub(crate) fn steer(&self, twist: Twist, present_rad: f64) -> f64 {
        let Some(range) = self.steering() else { return 0.0 };
        let wanted = self.heading(twist).map_or(present_rad, |heading| match range.nearest(heading, present_rad) {
            Ok(angle) | Err(angle) => angle,
        });
        wanted.clamp(range.min_rad, range.max_rad)
    }

    /// True if some steering angle lets the wheel roll with the body.
    pub(crate) fn reaches(&self, twist: Twist) -> bool {
        let (Some(range), Some(heading)) = (self.steering(), self.heading(twist)) else { return true };
        range.nearest(heading, 0.0).is_ok()
    }

    /// Direction in which the contact point moves, as an angle of the steering; `None` if it rests.
    fn heading(&self, twist: Twist) -> Option<f64> {
        let (vx, vy) = twist.at(self.x_m, self.y_m);
        let rounding = REST * (libm::fabs(twist.vx) + libm::fabs(twist.vy) + libm::fabs(twist.omega));
        (libm::hypot(vx, vy) > rounding).then(|| libm::atan2(vy, vx) - self.direction_rad)
    }

    /// Checks all quantities against their ranges.
    pub(crate) fn check(&self, index: usize) -> Result<(), Error> {
        let check = |quantity, value, range| in_range(Some(index), quantity, value, range);
        check("x_m", self.x_m, (-100.0, 100.0))?;
        check("y_m", self.y_m, (-100.0, 100.0))?;
        check("direction_rad", self.direction_rad, (-2.0 * PI, 2.0 * PI))?;
        check("speed_mps", self.limits.speed_mps, (1e-3, 1e3))?;
        check("acceleration_mps2", self.limits.acceleration_mps2, (1e-3, 1e3))?;
        check("deceleration_mps2", self.limits.deceleration_mps2, (1e-3, 1e3))?;
        match self.kind {
            Kind::Fixed | Kind::Skid => Ok(()),
            Kind::Rollers { angle_rad } => check("angle_rad", angle_rad, (-1.4, 1.4)),
            Kind::Steered(steering) => {
                check("min_rad", steering.min_rad, (-100.0, -1e-3))?;
                check("max_rad", steering.max_rad, (1e-3, 100.0))?;
                check("rate_radps", steering.rate_radps, (1e-3, 1e3))
            }
        }
    }
}

impl Limits {
    /// Greatest change, m/s, within `dt_s` of a speed, in the direction of `change`: first to standstill, if it goes
    /// there, then away from it.
    pub(crate) fn change(&self, speed_mps: f64, change: f64, dt_s: f64) -> f64 {
        let braking_s = if speed_mps * change < 0.0 { libm::fabs(speed_mps) / self.deceleration_mps2 } else { 0.0 };
        let braking_s = braking_s.min(dt_s);
        self.deceleration_mps2 * braking_s + self.acceleration_mps2 * (dt_s - braking_s)
    }
}

impl Steering {
    /// Angle nearest to `present_rad` that is parallel to `angle_rad`; `Err` with that angle if none is in the range.
    fn nearest(&self, angle_rad: f64, present_rad: f64) -> Result<f64, f64> {
        let nearest = angle_rad + PI * libm::rint((present_rad - angle_rad) / PI);
        let side = libm::copysign(PI, present_rad - nearest);
        let inside = (self.min_rad - ANGLE_TOLERANCE_RAD)..=(self.max_rad + ANGLE_TOLERANCE_RAD);
        // By distance from the present angle, which is in the range: the one after these two is farther out.
        [nearest, nearest + side, nearest - side].into_iter().find(|angle| inside.contains(angle)).ok_or(nearest)
    }
}
