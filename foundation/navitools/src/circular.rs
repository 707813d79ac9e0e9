//! Statistics of directions.

use crate::Angle;

/// Mean direction of weighted angles, and their agreement (mean resultant length): 1 if all are equal, 0 if they cancel
/// out.
///
/// `None` without weight, or if they cancel out so far that no direction remains.
#[must_use]
pub fn mean(angles: impl IntoIterator<Item = (Angle, f64)>) -> Option<(Angle, f64)> {
    let (mut x, mut y, mut weight) = (0.0, 0.0, 0.0);
    for (angle, own) in angles {
        let (sin, cos) = angle.sin_cos();
        (x, y, weight) = (x + own * cos, y + own * sin, weight + own);
    }
    let length = libm::hypot(x, y) / weight;
    (length > 1e-12).then(|| (Angle::new(libm::atan2(y, x)), length))
}

/// Standard deviation, rad, of a wrapped normal distribution with this agreement (0 to 1).
#[must_use]
pub fn deviation(agreement: f64) -> f64 {
    libm::sqrt((-2.0 * libm::log(agreement)).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    #[test]
    fn the_mean_of_directions_goes_over_the_seam() {
        let degrees = |list: &[f64]| mean(list.iter().map(|d| (Angle::from_degrees(*d), 1.0)));
        let (middle, agreement) = degrees(&[170.0, -170.0]).unwrap();
        assert!(libm::fabs(libm::fabs(middle.radians()) - PI) < 1e-12 && agreement > 0.98);
        assert_eq!(degrees(&[]), None);
        assert_eq!(degrees(&[0.0, 180.0]), None);
        let weighted = mean([(Angle::ZERO, 3.0), (Angle::from_degrees(90.0), 1.0)]).unwrap().0;
        assert!(libm::fabs(libm::tan(weighted.radians()) - 1.0 / 3.0) < 1e-12);
    }

    #[test]
    fn small_deviations_are_those_of_the_line() {
        let spread = 0.05;
        let two = [Angle::new(1.0 - spread), Angle::new(1.0 + spread)];
        let (_, agreement) = mean(two.map(|angle| (angle, 1.0))).unwrap();
        assert!(libm::fabs(deviation(agreement) - spread) < 1e-4);
        assert_eq!(deviation(1.0), 0.0);
    }
}
