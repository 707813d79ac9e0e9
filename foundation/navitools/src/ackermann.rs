//! Kinematics of Ackermann steering: fixed rear axle, both front wheels turn about the same centre.

use crate::Motion;

/// Geometry: all wheels roll without slipping about one centre on the rear axle's line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ackermann {
    /// Distance between the axles, m; above zero.
    pub wheelbase_m: f64,
    /// Distance between the hubs of the front wheels, m; above zero.
    pub track_m: f64,
}

impl Ackermann {
    /// Curvature of the rear axle's path, 1/m, at a steering angle of the equivalent single front wheel (below ±π/2).
    #[must_use]
    pub fn curvature(&self, steering: f64) -> f64 {
        libm::tan(steering) / self.wheelbase_m
    }

    /// Steering angle, rad, for a curvature, 1/m.
    #[must_use]
    pub fn steering(&self, curvature: f64) -> f64 {
        libm::atan(self.wheelbase_m * curvature)
    }

    /// Motion at a speed of the rear axle's middle, m/s, and a steering angle, rad.
    #[must_use]
    pub fn motion(&self, speed: f64, steering: f64) -> Motion {
        Motion { translation: speed, rotation: speed * self.curvature(steering) }
    }

    /// Steering angle of a motion; `None` at standstill and for rotation on the spot, which no steering angle produces.
    #[must_use]
    pub fn steering_of(&self, motion: Motion) -> Option<f64> {
        (motion.translation != 0.0).then(|| self.steering(motion.rotation / motion.translation))
    }

    /// Distances of the left and the right front hub per distance of the rear axle's middle, at a curvature.
    ///
    /// Both are positive: a wheel is turned to where its hub moves, so it rolls as the robot drives.
    #[must_use]
    pub fn hub_ratios(&self, curvature: f64) -> (f64, f64) {
        let across = curvature * self.track_m / 2.0;
        let along = curvature * self.wheelbase_m;
        (libm::hypot(1.0 - across, along), libm::hypot(1.0 + across, along))
    }

    /// Speeds of the left and the right front hub along their wheels, m/s, when the robot drives at a speed with a
    /// curvature. Both have the sign of the speed.
    #[must_use]
    pub fn hub_speeds(&self, speed: f64, curvature: f64) -> (f64, f64) {
        let (left, right) = self.hub_ratios(curvature);
        (speed * left, speed * right)
    }

    /// Angles of the left and the right front wheel, rad, at a curvature.
    #[must_use]
    pub fn wheel_angles(&self, curvature: f64) -> (f64, f64) {
        let across = curvature * self.track_m / 2.0;
        let along = curvature * self.wheelbase_m;
        (libm::atan2(along, 1.0 - across), libm::atan2(along, 1.0 + across))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ADVEE: Ackermann = Ackermann { wheelbase_m: 0.60, track_m: 0.50 };

    #[test]
    fn full_lock_turns_on_the_radius_of_the_parameter_table() {
        // docs/facts/robot.md 1.2: R_min at the rear axle 0.857 m at 35 deg.
        let radius = 1.0 / ADVEE.curvature(35f64.to_radians());
        assert!(libm::fabs(radius - 0.857) < 0.0005, "{radius}");
    }

    #[test]
    fn steering_and_motion_are_each_other_s_inverse() {
        for speed in [-1.2, -0.1, 0.3, 1.2] {
            for degrees in -35..=35 {
                let steering = f64::from(degrees).to_radians();
                let back = ADVEE.steering_of(ADVEE.motion(speed, steering)).unwrap();
                assert!(libm::fabs(back - steering) < 1e-15);
            }
        }
        assert_eq!(ADVEE.steering_of(Motion { translation: 0.0, rotation: 1.0 }), None);
    }

    #[test]
    fn in_a_left_turn_the_left_wheel_is_slower_and_turned_further() {
        let curvature = ADVEE.curvature(0.4);
        let (slow, fast) = ADVEE.hub_speeds(1.0, curvature);
        let (inner, outer) = ADVEE.wheel_angles(curvature);
        assert!(slow < fast && inner > outer, "{slow} {fast} {inner} {outer}");
        // The hub's speed projected on the body's y axis is what the turn gives the axle.
        assert!(libm::fabs(slow * libm::sin(inner) - curvature * 0.60) < 1e-15);
    }
}
