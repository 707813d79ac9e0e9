//! Body of the robot: from a commanded velocity to set-points of the axes, and from what they measure to a velocity.
//!
//! Another base is another [`Chassis`], and other axes here.

use super::{Config, STANDSTILL_MPS};
use kinematics::{Chassis, Driven, End, Error, Refusal, SteeredBase, Steering, Twist, WheelState};
use messages::Hold;

/// Set-points of the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SetPoints {
    /// Speed of the rear axle's middle, m/s.
    pub speed: f64,
    /// Angle of the equivalent single front wheel, rad; `None`: as it is.
    pub steering: Option<f64>,
    /// What the base cannot do of the command, and therefore leaves out.
    pub left_out: [Option<Hold>; 2],
}

/// Velocity with the residual of the wheels, m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Measured {
    pub twist: Twist,
    pub residual: f64,
}

/// A driven rear axle and steered front wheels.
pub(super) struct Body {
    chassis: Chassis,
    /// Greatest speed, m/s, and rotation, rad/s, of a command: the tightest turn at that speed.
    speed_max: f64,
    rotation_max: f64,
}

impl Body {
    /// # Errors
    /// No base has these quantities.
    pub(super) fn new(config: &Config) -> Result<Self, Error> {
        let (limits, wheelbase_m) = (&config.limits, config.wheelbase);
        let angle = limits.steering_rad;
        let chassis = Chassis::bicycle(&SteeredBase {
            wheelbase_m,
            end: End::Front,
            driven: Driven::Fixed,
            steering: Steering { min_rad: -angle, max_rad: angle, rate_radps: limits.steering_rate_radps },
            limits: kinematics::Limits {
                speed_mps: limits.speed_mps,
                acceleration_mps2: limits.acceleration_mps2,
                deceleration_mps2: limits.deceleration_mps2,
            },
        })?;
        let rotation_max = limits.speed_mps * libm::tan(angle) / wheelbase_m;
        Ok(Self { chassis, speed_max: limits.speed_mps, rotation_max })
    }

    /// True if no component exceeds what any motion of the robot has; false if one is not a number.
    pub(super) fn is_in_limits(&self, twist: Twist) -> bool {
        let speeds = [twist.vx, twist.vy].into_iter().all(|speed| speed.abs() <= self.speed_max);
        speeds && twist.omega.abs() <= self.rotation_max
    }

    /// Greatest speed, m/s, and rotation, rad/s, of a command.
    pub(super) fn limits(&self) -> (f64, f64) {
        (self.speed_max, self.rotation_max)
    }

    /// Set-points for a commanded velocity that is within limits. Of a turn that is too narrow the narrowest one
    /// remains, so that the robot does not leave the curve straight ahead; a robot that stands keeps its steering. At a
    /// speed that counts as standstill such a turn is one on the spot: the sign of noise must not turn the wheels.
    pub(super) fn set_points(&self, command: Twist) -> SetPoints {
        let mut feasible = self.chassis.feasible(command);
        if command.vx.abs() < STANDSTILL_MPS && feasible.refused.contains(&Refusal::TooNarrow) {
            feasible = self.chassis.feasible(Twist { vx: 0.0, ..command });
        }
        let wheels = self.chassis.wheel_states(feasible.twist, &[]);
        let left_out = |n| feasible.refused.get(n).copied().and_then(hold);
        let [speed, steering] = [wheels.first(), wheels.last()].map(Option::<&WheelState>::copied);
        let moves = feasible.twist != Twist::ZERO;
        SetPoints {
            speed: speed.map_or(0.0, |rear| rear.speed_mps),
            steering: steering.filter(|_| moves).map(|front| front.steering_rad),
            left_out: [left_out(0), left_out(1)],
        }
    }

    /// Velocity at these set-points; a robot that is to stand has none, wherever its wheels point.
    pub(super) fn set_velocity(&self, speed: f64, steering: f64) -> Twist {
        if speed == 0.0 { Twist::ZERO } else { self.velocity(speed, steering).twist }
    }

    /// Velocity at this speed, m/s, and steering angle, rad; NaN where it is unknown. The rotation depends on the
    /// angle; the velocity of the rear axle does not.
    pub(super) fn velocity(&self, speed: f64, steering: f64) -> Measured {
        let turned = steering.is_finite();
        let rear = WheelState { speed_mps: speed, steering_rad: 0.0 };
        let front = WheelState { speed_mps: f64::NAN, steering_rad: if turned { steering } else { 0.0 } };
        let unknown = Twist::new(f64::NAN, f64::NAN, f64::NAN);
        match self.chassis.estimate(&[rear, front]) {
            Some(estimate) if turned => Measured { twist: estimate.twist, residual: estimate.residual_mps },
            Some(estimate) => Measured { twist: Twist { omega: f64::NAN, ..estimate.twist }, residual: f64::NAN },
            None => Measured { twist: unknown, residual: f64::NAN },
        }
    }
}

/// Cause in `LL_DATA_HOLD`.
fn hold(refusal: Refusal) -> Option<Hold> {
    match refusal {
        Refusal::Sideways => Some(Hold::NoSideways),
        Refusal::OnTheSpot => Some(Hold::NoTurnOnSpot),
        Refusal::TooNarrow => Some(Hold::TurnTooNarrow),
        // Out of limits: the command was refused.
        Refusal::NotFinite => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::config;
    use super::*;

    fn body() -> Body {
        Body::new(&config()).expect("a base")
    }

    fn points(vx: f64, vy: f64, omega: f64) -> (f64, Option<f64>, Vec<Hold>) {
        let SetPoints { speed, steering, left_out } = body().set_points(Twist::new(vx, vy, omega));
        (speed, steering, left_out.into_iter().flatten().collect())
    }

    #[test]
    fn a_velocity_becomes_speed_and_angle_of_the_equivalent_single_wheel_both_ways() {
        // A radius of 2 m at a wheelbase of 0.6 m.
        let angle = libm::atan(0.3);
        for (vx, omega, steering) in [(0.4, 0.2, angle), (0.4, -0.2, -angle), (-0.4, 0.2, -angle), (-0.4, 0.0, 0.0)] {
            let (speed, found, left_out) = points(vx, 0.0, omega);
            assert!((speed - vx).abs() < 1e-12 && (found.unwrap() - steering).abs() < 1e-12, "{vx} {omega}: {found:?}");
            assert_eq!(left_out, []);
            let Measured { twist, residual } = body().velocity(speed, steering);
            assert!((twist - Twist::new(vx, 0.0, omega)).at(1.0, 1.0).0.abs() < 1e-12 && residual < 1e-12, "{twist:?}");
        }
        assert_eq!(points(0.0, 0.0, 0.0), (0.0, None, vec![]), "the steering stays as it is");
    }

    #[test]
    fn what_the_base_cannot_do_is_left_out_and_named() {
        assert_eq!(points(0.4, 0.1, 0.0), (0.4, Some(0.0), vec![Hold::NoSideways]));
        assert_eq!(points(0.0, 0.1, 0.0), (0.0, None, vec![Hold::NoSideways]));
        assert_eq!(points(0.0, 0.0, 0.5), (0.0, None, vec![Hold::NoTurnOnSpot]));
        assert_eq!(points(0.0, -0.1, 0.5), (0.0, None, vec![Hold::NoSideways, Hold::NoTurnOnSpot]));
        for noise in [0.001, -0.001, 0.019] {
            assert_eq!(points(noise, 0.0, 0.5), (0.0, None, vec![Hold::NoTurnOnSpot]));
            assert_eq!(points(noise, 0.0, 0.0), (noise, Some(0.0), vec![]));
        }
        for (vx, omega, end) in [(0.1, 0.5, 0.61), (0.1, -0.5, -0.61), (-0.1, 0.5, -0.61)] {
            let (speed, steering, left_out) = points(vx, 0.0, omega);
            assert!((speed - vx).abs() < 1e-12 && (steering.unwrap() - end).abs() < 1e-9, "{vx} {omega}: {steering:?}");
            assert_eq!(left_out, [Hold::TurnTooNarrow]);
        }
    }

    #[test]
    fn limits_are_those_of_the_configuration_and_nan_exceeds_them() {
        // 1.2 m/s · tan(0.61 rad) / 0.6 m.
        let rotation = 2.0 * libm::tan(0.61);
        for (vx, vy, omega, within) in [
            (1.2, 0.0, rotation, true),
            (-1.2, -1.2, -rotation, true),
            (1.21, 0.0, 0.0, false),
            (0.0, 1.21, 0.0, false),
            (0.0, 0.0, rotation + 0.01, false),
            (f64::NAN, 0.0, 0.0, false),
            (0.0, f64::NAN, 0.0, false),
            (0.0, 0.0, f64::NEG_INFINITY, false),
        ] {
            assert_eq!(body().is_in_limits(Twist::new(vx, vy, omega)), within, "{vx} {vy} {omega}");
        }
    }

    #[test]
    fn what_is_not_measured_is_not_a_number() {
        let Measured { twist, residual } = body().velocity(0.4, f64::NAN);
        assert!(twist.vx == 0.4 && twist.vy == 0.0 && twist.omega.is_nan() && residual.is_nan(), "{twist:?}");
        let Measured { twist, residual } = body().velocity(f64::NAN, 0.1);
        assert!([twist.vx, twist.vy, twist.omega, residual].into_iter().all(f64::is_nan), "{twist:?}");
    }
}
