//! Circular arcs: the path of an Ackermann robot with a constant steering angle.

use crate::{Motion, Point, Pose};

/// Arc that begins at the origin along the x axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Arc {
    /// Curvature, 1/m; positive to the left.
    pub curvature: f64,
    /// Length, m; negative in reverse.
    pub length: f64,
}

impl Arc {
    /// Arc through a point ahead or behind; to a point behind it is driven in reverse. `None` for the origin itself.
    ///
    /// Points beside the origin have two arcs; this is the one whose tangent turns by at most half a turn.
    #[must_use]
    pub fn through(point: Point) -> Option<Self> {
        let square = point.x * point.x + point.y * point.y;
        if !(square > 0.0 && square.is_finite()) {
            return None;
        }
        let curvature = 2.0 * point.y / square;
        // Half the turn is the angle between the x axis (or its opposite) and the chord.
        let half = libm::atan2(libm::fabs(point.y), libm::fabs(point.x));
        let chord = libm::sqrt(square);
        let length = if half < 1e-4 { chord * (1.0 + half * half / 6.0) } else { chord * half / libm::sin(half) };
        Some(Self { curvature, length: libm::copysign(length, point.x) })
    }

    /// Motion along the arc.
    #[must_use]
    pub fn motion(self) -> Motion {
        Motion { translation: self.length, rotation: self.curvature * self.length }
    }

    /// Pose at the end.
    #[must_use]
    pub fn end(self) -> Pose {
        Pose::default().along(self.motion())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    #[test]
    fn the_arc_through_a_point_ends_there() {
        for x in -20..=20 {
            for y in -20..=20 {
                let point = Point { x: f64::from(x) * 0.37, y: f64::from(y) * 0.21 };
                match Arc::through(point) {
                    Some(arc) => assert!(arc.end().point().distance(point) < 1e-12, "{point:?}: {arc:?}"),
                    None => assert_eq!((x, y), (0, 0)),
                }
            }
        }
    }

    #[test]
    fn beside_it_is_half_a_circle_and_behind_it_goes_back() {
        let beside = Arc::through(Point { x: 0.0, y: 2.0 }).unwrap();
        assert!(libm::fabs(beside.length - PI) < 1e-12 && libm::fabs(beside.curvature - 1.0) < 1e-12);
        let behind = Arc::through(Point { x: -1.0, y: 0.0 }).unwrap();
        assert_eq!((behind.curvature, behind.length), (0.0, -1.0));
        assert_eq!(Arc::through(Point { x: f64::NAN, y: 0.0 }), None);
    }
}
