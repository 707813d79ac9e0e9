//! Plausibility of a sonar by the map: a transducer that never returns the echo of a wall that faces it is deaf.
//!
//! The board cannot report a dead transducer: its reading is "no echo", like that of an empty room.

use navitools::{Point, Pose};

/// Number of silent readings before a facing wall after which a sonar counts as deaf. A working one misses such a wall
/// once in ten readings (docs/facts/robot.md 2.1), so it is taken for deaf once in 10⁸.
const DEAF_AFTER: u8 = 8;
/// Range within which a wall must return an echo, m.
const WALL_RANGE_M: f64 = 2.0;
/// Distance at which the search for a wall begins, and its step, m. The angle of a wall that is nearer is not known.
const FROM_M: f64 = 0.2;
const STEP_M: f64 = 0.02;
/// Directions of the rays relative to the axis, the axis first, rad; within the specular limit of 25°.
const RAYS_RAD: [f64; 5] = [0.0, -0.175, 0.175, -0.35, 0.35];
/// Largest deviation of a facing wall from a straight line, m.
const STRAIGHT_M: f64 = 0.15;

/// Hearing of a sonar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Hearing {
    /// Number of silent readings before a facing wall since the last echo.
    missed: u8,
}

impl Hearing {
    /// Processes an echo of any kind.
    pub fn on_echo(&mut self) {
        self.missed = 0;
    }

    /// Processes a reading without an echo of a sonar at this pose; `mapped` is true for points at which the map has an
    /// obstacle.
    pub fn on_silence(&mut self, sonar: Pose, mapped: &impl Fn(Point) -> bool) {
        if faces_wall(sonar, mapped) {
            self.missed = self.missed.saturating_add(1);
        }
    }

    /// True if the sonar does not work: what it measures is unknown until it returns an echo.
    pub fn is_deaf(self) -> bool {
        self.missed >= DEAF_AFTER
    }
}

/// True if a straight wall of the map is perpendicular to a direction within the beam, in range: all rays meet it, at
/// distances that fit one line, and the nearest ray is not at the edge of the beam. A wall so near that a ray begins in
/// it is not judged.
fn faces_wall(sonar: Pose, mapped: &impl Fn(Point) -> bool) -> bool {
    let to_map = sonar.to_outer();
    let mut points = [Point::default(); RAYS_RAD.len()];
    for (ray, point) in RAYS_RAD.into_iter().zip(&mut points) {
        let (sin, cos) = libm::sincos(ray);
        let on_ray = |distance: f64| to_map(Point { x: distance * cos, y: distance * sin });
        let Some(distance) = distance(on_ray, mapped) else { return false };
        *point = Point { x: distance * cos, y: distance * sin };
    }
    let [_, _, _, right, left] = points;
    let (dx, dy) = (left.x - right.x, left.y - right.y);
    let length = libm::hypot(dx, dy);
    if length <= f64::EPSILON {
        return false;
    }
    let off = |at: &Point| ((at.x - right.x) * dy - (at.y - right.y) * dx).abs() / length;
    // Angle between the axis and the normal of the wall.
    let turned = libm::atan2(dx, dy).abs();
    points.iter().all(|at| off(at) < STRAIGHT_M) && turned < RAYS_RAD[2]
}

/// Distance to the first mapped point on a ray, m.
fn distance(on_ray: impl Fn(f64) -> Point, mapped: &impl Fn(Point) -> bool) -> Option<f64> {
    let steps = ((WALL_RANGE_M - FROM_M) / STEP_M) as i32;
    let along = |step: i32| FROM_M + STEP_M * f64::from(step);
    (0..=steps).map(along).find(|distance| mapped(on_ray(*distance))).filter(|distance| *distance > FROM_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of silent readings after which a sonar at the origin that looks along x is deaf.
    fn deaf_after(mapped: impl Fn(Point) -> bool) -> Option<u32> {
        let mut hearing = Hearing::default();
        (1..100).find(|_| {
            hearing.on_silence(Pose::default(), &mapped);
            hearing.is_deaf()
        })
    }

    #[test]
    fn a_sonar_that_never_hears_a_facing_wall_is_deaf_until_it_returns_an_echo() {
        assert_eq!(deaf_after(|point| point.x > 1.0), Some(8));
        let mut hearing = Hearing { missed: 8 };
        hearing.on_silence(Pose::default(), &|_| false);
        assert!(hearing.is_deaf(), "nothing has shown that it works");
        hearing.on_echo();
        assert!(!hearing.is_deaf());
    }

    #[test]
    fn silence_is_plausible_where_no_wall_must_be_heard() {
        assert_eq!(deaf_after(|_| false), None, "an empty room");
        assert_eq!(deaf_after(|point| point.x > 2.2), None, "too far");
        assert_eq!(deaf_after(|point| point.x + point.y > 1.5), None, "at 45 degrees, beyond the specular limit");
        assert_eq!(deaf_after(|point| point.x > 1.0 && point.y > 0.0), None, "the edge of a wall");
        assert_eq!(deaf_after(|point| point.x > 1.0 + 2.0 * point.y.abs()), None, "a corner");
        assert_eq!(deaf_after(|point| point.x + 0.1 * point.y > 1.0), Some(8), "a little oblique");
        // The map is widened by as much as the pose is uncertain.
        let near = |away: f64, widened: f64| {
            let (sin, cos) = libm::sincos(0.44);
            deaf_after(move |point| point.x * cos + point.y * sin > away - widened)
        };
        for away in [0.25, 0.3, 0.4, 0.6, 1.0] {
            assert_eq!(near(away, 0.15), None, "beyond the specular limit, {away} m away");
        }
        assert_eq!(deaf_after(|point| point.x > 0.35), Some(8), "a near wall");
    }
}
