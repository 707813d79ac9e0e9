//! Pose from the bearings of three known points (ToTal: Pierlot, Van Droogenbroeck 2014).

use crate::{Angle, Point, Pose};
use core::f64::consts::FRAC_PI_2;

/// Bound of cotangents: beyond it two points are in line with the observer, and the method tolerates the bound.
const COTANGENT_MAX: f64 = 1e8;

/// Pose from three bearings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Pose of the frame in which the bearings were measured.
    pub pose: Pose,
    /// Determinant D, m²: the position error due to errors of the bearings is proportional to 1/|D|. Zero on the circle
    /// through the three points, where there is no solution.
    pub d: f64,
}

/// Pose from which three points have these bearings, in any order and anywhere in the plane.
///
/// `None` without a solution: on the circle (or line) through the three, with two points at one place, with values that
/// are not finite, and with a bearing that points away from its point.
#[must_use]
pub fn three_bearings(points: [Point; 3], bearings: [Angle; 3]) -> Option<Fix> {
    let [one, origin, three] = points;
    let (x1, y1, x3, y3) = (one.x - origin.x, one.y - origin.y, three.x - origin.x, three.y - origin.y);
    let t12 = cotangent(bearings[1] - bearings[0]);
    let t23 = cotangent(bearings[2] - bearings[1]);
    let sum = t12 + t23;
    let t31 = if sum == 0.0 { COTANGENT_MAX } else { ((1.0 - t12 * t23) / sum).clamp(-COTANGENT_MAX, COTANGENT_MAX) };
    // Centres of the three circles (modified by a common factor) relative to the second point.
    let (x12, y12) = (x1 + t12 * y1, y1 - t12 * x1);
    let (x23, y23) = (x3 - t23 * y3, y3 + t23 * x3);
    let (x31, y31) = (x3 + x1 + t31 * (y3 - y1), y3 + y1 - t31 * (x3 - x1));
    let k = x1 * x3 + y1 * y3 + t31 * (x1 * y3 - x3 * y1);
    let d = (x12 - x23) * (y23 - y31) - (y12 - y23) * (x23 - x31);
    let at = Point { x: origin.x + k * (y12 - y23) / d, y: origin.y + k * (x23 - x12) / d };
    if !(at.x.is_finite() && at.y.is_finite()) {
        return None;
    }
    let heading = |n: usize| Angle::new(libm::atan2(points[n].y - at.y, points[n].x - at.x)) - bearings[n];
    let theta = heading(0);
    let agrees = |n: usize| libm::fabs((heading(n) - theta).radians()) < FRAC_PI_2;
    (agrees(1) && agrees(2)).then_some(Fix { pose: Pose { x: at.x, y: at.y, theta }, d })
}

fn cotangent(angle: Angle) -> f64 {
    let (sin, cos) = angle.sin_cos();
    // A sine of exactly zero has the sign of the limit from above.
    (cos / if sin == 0.0 { f64::MIN_POSITIVE } else { sin }).clamp(-COTANGENT_MAX, COTANGENT_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    /// Low-discrepancy sequence that fills [0, 1) evenly.
    struct Even(f64);

    impl Even {
        fn next(&mut self, from: f64, to: f64) -> f64 {
            self.0 = (self.0 * 997.0 + 0.618_033_988_749_894_9) % 1.0;
            from + (to - from) * self.0
        }
    }

    fn seen(pose: Pose, points: [Point; 3]) -> [Angle; 3] {
        points.map(|point| {
            let own = pose.inverse() * point;
            Angle::new(libm::atan2(own.y, own.x))
        })
    }

    #[test]
    fn any_pose_comes_back_from_three_points_in_any_order() {
        let mut even = Even(0.1);
        let (mut tried, mut near_circle) = (0, 0);
        for _ in 0..20_000 {
            let mut point = || Point { x: even.next(-10.0, 10.0), y: even.next(-10.0, 10.0) };
            let points = [point(), point(), point()];
            let pose = Pose::new(even.next(-30.0, 30.0), even.next(-30.0, 30.0), even.next(0.0, TAU));
            let [a, b, c] = points;
            for order in [[a, b, c], [b, c, a], [c, a, b], [a, c, b], [c, b, a], [b, a, c]] {
                let fix = three_bearings(order, seen(pose, order));
                tried += 1;
                if fix.is_none_or(|fix| libm::fabs(fix.d) < 0.1) {
                    near_circle += 1;
                    continue;
                }
                let fix = fix.unwrap();
                let off = fix.pose.point().distance(pose.point());
                assert!(off < 1e-7, "{pose:?} {order:?}: {fix:?}");
                assert!(libm::fabs((fix.pose.theta - pose.theta).radians()) < 1e-7);
            }
        }
        assert!(near_circle * 50 < tried, "{near_circle} of {tried}");
    }

    #[test]
    fn in_line_with_two_points_it_still_works() {
        let points = [Point { x: 0.0, y: 0.0 }, Point { x: 4.0, y: 0.0 }, Point { x: 1.0, y: 5.0 }];
        for x in [-3.0, 2.0, 7.0] {
            let pose = Pose::new(x, 0.0, 0.7);
            let fix = three_bearings(points, seen(pose, points)).unwrap();
            assert!(fix.pose.point().distance(pose.point()) < 1e-6, "{fix:?}");
        }
    }

    #[test]
    fn there_is_no_solution_on_the_circle_through_the_points_and_d_is_small_near_it() {
        let on = |angle: f64, radius: f64| Point { x: radius * libm::cos(angle), y: radius * libm::sin(angle) };
        let points = [on(0.3, 5.0), on(1.9, 5.0), on(4.0, 5.0)];
        let d = |radius: f64| {
            let at = on(2.8, radius);
            three_bearings(points, seen(Pose::new(at.x, at.y, 1.0), points)).map_or(0.0, |fix| libm::fabs(fix.d))
        };
        assert!(d(5.0) < 1e-6 && d(5.0) < d(4.95) && d(4.95) < d(4.0), "{} {} {}", d(5.0), d(4.95), d(4.0));
    }

    #[test]
    fn invalid_input_gives_no_fix() {
        let points = [Point { x: 1.0, y: 0.0 }, Point { x: 0.0, y: 1.0 }, Point { x: -1.0, y: -1.0 }];
        let zero = [Angle::ZERO; 3];
        assert_eq!(three_bearings([points[0]; 3], zero), None);
        assert_eq!(three_bearings(points, [Angle::new(f64::NAN), Angle::ZERO, Angle::new(1.0)]), None);
        let nowhere = Point { x: f64::INFINITY, y: 0.0 };
        assert_eq!(three_bearings([nowhere, points[1], points[2]], seen(Pose::default(), points)), None);
    }
}
