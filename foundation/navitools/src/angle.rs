//! Angles that wrap.

use core::f64::consts::PI;
use core::fmt;
use core::ops::{Add, Neg, Sub};

/// Angle in [-π, π) with the direction of `radians`; NaN stays NaN.
#[must_use]
pub fn wrap(radians: f64) -> f64 {
    if (-PI..PI).contains(&radians) {
        return radians;
    }
    let turn = 2.0 * PI;
    let wrapped = radians - turn * libm::floor((radians + PI) / turn);
    // Rounding may leave it just outside.
    match wrapped {
        above if above >= PI => above - turn,
        below if below < -PI => -PI,
        inside => inside,
    }
}

/// Angle in radians within [-π, π); sums and differences wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Angle(f64);

impl Angle {
    /// Direction of the x axis.
    pub const ZERO: Self = Self(0.0);

    /// Creates an angle from any number of radians.
    #[must_use]
    pub fn new(radians: f64) -> Self {
        Self(wrap(radians))
    }

    /// Creates an angle from any number of degrees.
    #[must_use]
    pub fn from_degrees(degrees: f64) -> Self {
        Self::new(degrees.to_radians())
    }

    /// Radians in [-π, π).
    #[must_use]
    pub fn radians(self) -> f64 {
        self.0
    }

    /// Degrees in [-180, 180).
    #[must_use]
    pub fn degrees(self) -> f64 {
        self.0.to_degrees()
    }

    /// Sine and cosine.
    #[must_use]
    pub fn sin_cos(self) -> (f64, f64) {
        libm::sincos(self.0)
    }
}

impl Add for Angle {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.0 + other.0)
    }
}

impl Add<f64> for Angle {
    type Output = Self;
    fn add(self, radians: f64) -> Self {
        Self::new(self.0 + radians)
    }
}

impl Sub for Angle {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.0 - other.0)
    }
}

impl Neg for Angle {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.0)
    }
}

impl fmt::Display for Angle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1}°", self.degrees())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_direction_and_the_range() {
        for turns in -50..=50 {
            for step in 0..100 {
                let inside = -PI + f64::from(step) * (2.0 * PI / 100.0);
                let wrapped = wrap(inside + f64::from(turns) * 2.0 * PI);
                assert!((-PI..PI).contains(&wrapped), "{wrapped}");
                let off = libm::fabs(wrapped - inside);
                assert!(off < 1e-12 || libm::fabs(off - 2.0 * PI) < 1e-12, "{inside} {turns}: {wrapped}");
            }
        }
        assert_eq!(wrap(PI), -PI);
        assert_eq!(wrap(-PI), -PI);
        assert_eq!(wrap(0.25), 0.25);
        assert!(wrap(f64::NAN).is_nan() && wrap(f64::INFINITY).is_nan());
    }

    #[test]
    fn a_difference_goes_the_short_way_round() {
        let difference = Angle::from_degrees(-170.0) - Angle::from_degrees(170.0);
        assert!(libm::fabs(difference.degrees() - 20.0) < 1e-12);
        assert_eq!(-Angle::new(PI), Angle::new(PI));
    }
}
