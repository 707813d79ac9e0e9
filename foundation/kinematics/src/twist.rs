//! Velocity of the body, and the pose after it.

use core::ops::{Add, Mul, Sub};
use navitools::{Point, Pose};

/// Velocity of the body in its own frame (planar twist), or its path per unit: a path of constant curvature.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Forward, m/s, or m per unit of path.
    pub vx: f64,
    /// To the left, m/s, or m per unit of path.
    pub vy: f64,
    /// Counter-clockwise, rad/s, or rad per unit of path.
    pub omega: f64,
}

/// Rotation below which a path counts as straight, rad/s, or rad per unit of path.
const STRAIGHT: f64 = 1e-6;

/// Maximum magnitude of a velocity, a wheel speed or a steering angle in m/s, rad/s or rad. Larger numbers are treated
/// like those that are not finite: no robot has them, and products of them would overflow.
pub(crate) const MAGNITUDE_MAX: f64 = 1e6;

/// True for a finite number of possible magnitude.
pub(crate) fn is_usable(number: f64) -> bool {
    libm::fabs(number) <= MAGNITUDE_MAX
}

impl Twist {
    /// Standing still.
    pub const ZERO: Self = Self { vx: 0.0, vy: 0.0, omega: 0.0 };

    /// Creates a velocity from m/s forward, m/s to the left, rad/s counter-clockwise.
    #[must_use]
    pub const fn new(vx: f64, vy: f64, omega: f64) -> Self {
        Self { vx, vy, omega }
    }

    /// Velocity of the body's point (x, y), m, in the body's axes, m/s.
    #[must_use]
    pub fn at(self, x_m: f64, y_m: f64) -> (f64, f64) {
        (self.vx - self.omega * y_m, self.vy + self.omega * x_m)
    }

    /// Centre of the rotation in the body's frame; `None` for a straight path.
    #[must_use]
    pub fn center(self) -> Option<Point> {
        let turns = libm::fabs(self.omega) > STRAIGHT;
        turns.then(|| Point { x: -self.vy / self.omega, y: self.vx / self.omega })
    }

    /// Itself; `None` if a component is not finite or beyond 1e6.
    pub(crate) fn usable(self) -> Option<Self> {
        [self.vx, self.vy, self.omega].into_iter().all(is_usable).then_some(self)
    }

    /// Sum of the products with the coefficients of an equation.
    pub(crate) fn dot(self, row: [f64; 3]) -> f64 {
        row[0] * self.vx + row[1] * self.vy + row[2] * self.omega
    }
}

impl Add for Twist {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.vx + other.vx, self.vy + other.vy, self.omega + other.omega)
    }
}

impl Sub for Twist {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + other * -1.0
    }
}

impl Mul<f64> for Twist {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self::new(self.vx * factor, self.vy * factor, self.omega * factor)
    }
}

/// Pose after a constant velocity for `dt_s` seconds: the exact arc (exponential map of SE(2), *Modern Robotics*,
/// 13.4).
///
/// The chord of the arc points halfway between the first and the last heading. With `dt_s` = 1, `twist` is a
/// displacement, for instance from distances of wheels. Returns `pose` if the velocity or the time is not finite.
#[must_use]
pub fn integrate(pose: Pose, twist: Twist, dt_s: f64) -> Pose {
    let Some(way) = twist.usable().map(|twist| twist * dt_s) else { return pose };
    let half = way.omega / 2.0;
    // Chord by arc; below 1e-4 the series is exact to the last bit.
    let ratio = if libm::fabs(half) < 1e-4 { 1.0 - half * half / 6.0 } else { libm::sin(half) / half };
    let (sin, cos) = libm::sincos(pose.theta.radians() + half);
    let x = pose.x + ratio * (cos * way.vx - sin * way.vy);
    let y = pose.y + ratio * (sin * way.vx + cos * way.vy);
    let end = Pose { x, y, theta: pose.theta + way.omega };
    if x.is_finite() && y.is_finite() && end.theta.radians().is_finite() { end } else { pose }
}
