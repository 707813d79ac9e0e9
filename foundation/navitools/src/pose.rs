//! Points and poses in the plane.

use crate::{Angle, Motion};
use core::ops::Mul;

/// Point in the plane, m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Coordinate x, m.
    pub x: f64,
    /// Coordinate y, m.
    pub y: f64,
}

impl Point {
    /// Distance to another point, m.
    #[must_use]
    pub fn distance(self, other: Self) -> f64 {
        libm::hypot(other.x - self.x, other.y - self.y)
    }
}

/// Origin and x axis of a frame in another frame: `world_from_robot`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Coordinate x of the origin, m.
    pub x: f64,
    /// Coordinate y of the origin, m.
    pub y: f64,
    /// Direction of the x axis.
    pub theta: Angle,
}

impl Pose {
    /// Creates a pose; `theta` is any number of radians.
    #[must_use]
    pub fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta: Angle::new(theta) }
    }

    /// Origin of the frame.
    #[must_use]
    pub fn point(self) -> Point {
        Point { x: self.x, y: self.y }
    }

    /// Pose after `way.translation` m along a circle with a rotation of `way.rotation` rad; exact.
    #[must_use]
    pub fn along(self, way: Motion) -> Self {
        let half = way.rotation / 2.0;
        // Chord of the arc; below 1e-4 the series is exact to the last bit.
        let sinc = if libm::fabs(half) < 1e-4 { 1.0 - half * half / 6.0 } else { libm::sin(half) / half };
        let (sin, cos) = libm::sincos(self.theta.radians() + half);
        let chord = way.translation * sinc;
        Self { x: self.x + chord * cos, y: self.y + chord * sin, theta: self.theta + way.rotation }
    }

    /// Converts points from this frame to the outer one: as `pose * point`, for many points.
    pub fn to_outer(self) -> impl Fn(Point) -> Point + Copy {
        let (sin, cos) = self.theta.sin_cos();
        move |point| Point { x: self.x + cos * point.x - sin * point.y, y: self.y + sin * point.x + cos * point.y }
    }

    /// Pose of the outer frame in the inner one.
    #[must_use]
    pub fn inverse(self) -> Self {
        let (sin, cos) = self.theta.sin_cos();
        Self { x: -cos * self.x - sin * self.y, y: sin * self.x - cos * self.y, theta: -self.theta }
    }
}

/// `a_from_b * b_from_c` is `a_from_c`.
impl Mul for Pose {
    type Output = Self;
    fn mul(self, inner: Self) -> Self {
        let Point { x, y } = self * inner.point();
        Self { x, y, theta: self.theta + inner.theta }
    }
}

/// `a_from_b * point_in_b` is `point_in_a`.
impl Mul<Point> for Pose {
    type Output = Point;
    fn mul(self, point: Point) -> Point {
        self.to_outer()(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    fn near(a: Pose, b: Pose) -> bool {
        a.point().distance(b.point()) < 1e-12 && libm::fabs((a.theta - b.theta).radians()) < 1e-12
    }

    #[test]
    fn a_pose_times_its_inverse_is_the_identity() {
        let pose = Pose::new(3.0, -2.0, 2.5);
        assert!(near(pose * pose.inverse(), Pose::default()));
        assert!(near(pose.inverse() * pose, Pose::default()));
        let point = pose * Point { x: 1.0, y: 0.0 };
        assert!(point.distance(Point { x: 3.0 + libm::cos(2.5), y: -2.0 + libm::sin(2.5) }) < 1e-12);
    }

    #[test]
    fn arcs_end_where_geometry_says() {
        let quarter = Pose::default().along(Motion { translation: PI, rotation: PI / 2.0 });
        assert!(near(quarter, Pose::new(2.0, 2.0, PI / 2.0)), "radius 2: {quarter:?}");
        let back = quarter.along(Motion { translation: -PI, rotation: -PI / 2.0 });
        assert!(near(back, Pose::default()), "{back:?}");
        let straight = Pose::new(0.0, 0.0, PI).along(Motion { translation: 1.5, rotation: 0.0 });
        assert!(near(straight, Pose::new(-1.5, 0.0, PI)));
    }

    #[test]
    fn the_series_of_a_slight_turn_meets_the_exact_form() {
        for turn in [1.9e-4, 2.1e-4] {
            let end = Pose::default().along(Motion { translation: 1.0, rotation: turn });
            assert!(libm::fabs(end.y - (1.0 - libm::cos(turn)) / turn) < 1e-11, "{turn}");
            assert!(libm::fabs(end.x - libm::sin(turn) / turn) < 1e-15, "{turn}");
        }
    }
}
