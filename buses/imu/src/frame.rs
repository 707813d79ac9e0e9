//! Rotations in space: unit quaternions x, y, z, w.

use libm::{cos, sin, sqrt};

/// A rotation from one frame to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation([f64; 4]);

impl Rotation {
    /// No rotation.
    pub const IDENTITY: Self = Self([0.0, 0.0, 0.0, 1.0]);

    /// A quaternion x, y, z, w, scaled to the length 1; `None` if it has no length, or a value that is no number.
    #[must_use]
    pub fn new(q: [f64; 4]) -> Option<Self> {
        let length = sqrt(q.iter().map(|part| part * part).sum());
        (length.is_finite() && length > 1e-6).then(|| Self(q.map(|part| part / length)))
    }

    /// Roll about x, then pitch about y, then yaw about z, each about the axes of the frame that it leads to, rad.
    #[must_use]
    pub fn from_angles(roll: f64, pitch: f64, yaw: f64) -> Self {
        let about = |axis: usize, angle: f64| {
            let mut q = [0.0, 0.0, 0.0, cos(angle / 2.0)];
            q[axis] = sin(angle / 2.0);
            Self(q)
        };
        about(2, yaw).after(about(1, pitch)).after(about(0, roll))
    }

    /// The quaternion x, y, z, w.
    #[must_use]
    pub fn quaternion(self) -> [f64; 4] {
        self.0
    }

    /// This rotation after another one: a from b after b from c is a from c.
    #[must_use]
    pub fn after(self, first: Self) -> Self {
        let ([ax, ay, az, aw], [bx, by, bz, bw]) = (self.0, first.0);
        Self([
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ])
    }

    /// The rotation back.
    #[must_use]
    pub fn inverse(self) -> Self {
        let [x, y, z, w] = self.0;
        Self([-x, -y, -z, w])
    }

    /// A vector in the frame that the rotation leads to.
    #[must_use]
    pub fn apply(self, v: [f64; 3]) -> [f64; 3] {
        let [x, y, z, w] = self.0;
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let t = cross([x, y, z], v).map(|part| 2.0 * part);
        let u = cross([x, y, z], t);
        core::array::from_fn(|n| v[n] + w * t[n] + u[n])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{FRAC_PI_2, PI};

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn each_angle_turns_counter_clockwise_about_its_axis() {
        assert!(near(Rotation::from_angles(FRAC_PI_2, 0.0, 0.0).apply([0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]));
        assert!(near(Rotation::from_angles(0.0, FRAC_PI_2, 0.0).apply([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]));
        assert!(near(Rotation::from_angles(0.0, 0.0, FRAC_PI_2).apply([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0]));
        // Roll first: what points up points to the right, which a quarter to the left makes ahead.
        assert!(near(Rotation::from_angles(FRAC_PI_2, 0.0, FRAC_PI_2).apply([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]));
    }

    #[test]
    fn rotations_compose_and_invert() {
        let (a, b) = (Rotation::from_angles(0.3, -0.7, 2.0), Rotation::from_angles(-1.0, 0.2, PI));
        let v = [1.0, -2.0, 0.5];
        assert!(near(a.after(b).apply(v), a.apply(b.apply(v))));
        assert!(near(a.inverse().apply(a.apply(v)), v));
        assert!(near(Rotation::new(a.quaternion().map(|q| 3.0 * q)).unwrap().apply(v), a.apply(v)));
    }

    #[test]
    fn what_has_no_length_is_no_rotation() {
        assert_eq!(Rotation::new([0.0; 4]), None);
        assert_eq!(Rotation::new([f64::NAN, 0.0, 0.0, 1.0]), None);
        assert_eq!(Rotation::new([f64::INFINITY, 0.0, 0.0, 1.0]), None);
    }
}
