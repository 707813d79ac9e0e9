//! Body of the robot: from a command to set-points of the axes, and from what they measure to a velocity.
//!
//! A base that steers has one driven axle and one steering angle; any other one has a drive for each wheel.

use super::{Config, STANDSTILL_MPS};
use base::{Duration, Instant};
use kinematics::{Agreement, Chassis, Driven, End, Error, PerWheel, Refusal, SteeredBase, Steering, Twist, WheelState};
use messages::Hold;
use settings::robot::Traction;

/// Period of the set-points of several wheels, which accelerate together.
const STEP: Duration = Duration::from_millis(20);
/// Deviation of a set-point that is rounding, m/s.
const REACHED_MPS: f64 = 1e-9;

/// What the body is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SetPoints {
    /// Velocity. Of a base that steers only the speed of the fixed axle's middle: it turns by its steering.
    pub velocity: Twist,
    /// Angle of the equivalent single steered wheel, rad; `None`: as it is, or nothing steers.
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

/// Bounds of a source, whatever is sensed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Caps {
    /// m/s.
    pub speed: f64,
    /// Lateral acceleration, m/s².
    pub lateral: f64,
}

/// Kinematics of the robot.
pub(super) struct Body {
    chassis: Chassis,
    steers: bool,
    /// m; without steering that of the equivalent base of `LL_CMD_MOTION`.
    wheelbase: f64,
    traction: Traction,
    /// Greatest angle of the equivalent single steered wheel, rad.
    steering_max: f64,
    /// Greatest speed, m/s, and rotation, rad/s, of a command.
    speed_max: f64,
    rotation_max: f64,
    /// The guard's fields are those of a base that steers.
    guarded: bool,
    /// Part of its rated torque by which a wheel of `[base]` may work against the others.
    strain: Option<f64>,
    /// Last set-points of wheels that accelerate together, and when they were made.
    present: PerWheel<WheelState>,
    at: Instant,
    /// The next ones. Set until the commanded velocity is reached.
    due: Option<Instant>,
}

impl Body {
    /// # Errors
    /// No base has these quantities.
    pub(super) fn new(config: &Config) -> Result<Self, Error> {
        let (limits, wheelbase) = (&config.limits, config.wheelbase);
        let chassis = match &config.base {
            Some(base) => base.chassis(limits)?,
            None => steered(config)?,
        };
        let steers = config.base.is_none();
        // That of the tightest turn at full speed.
        let by_steering = limits.speed_mps * libm::tan(limits.steering_rad) / wheelbase;
        let present = chassis.standing();
        Ok(Self {
            chassis,
            steers,
            wheelbase,
            traction: config.traction,
            steering_max: limits.steering_rad,
            speed_max: limits.speed_mps,
            rotation_max: if steers { by_steering } else { limits.rotation_radps },
            guarded: config.protection.guarded,
            strain: config.base.map(|base| base.strain),
            present,
            at: Instant::ZERO,
            due: None,
        })
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

    /// Set-points for a speed and a steering angle that are within limits. A base without steering follows the curve
    /// on which a base that steers would drive.
    pub(super) fn by_steering(&self, speed: f64, steering: f64) -> SetPoints {
        if !self.steers {
            return self.set_points(Twist::new(speed, 0.0, speed * libm::tan(steering) / self.wheelbase));
        }
        SetPoints { velocity: Twist::new(speed, 0.0, 0.0), steering: Some(steering), left_out: [None; 2] }
    }

    /// Set-points for a commanded velocity that is within limits. Of a turn that is too narrow the narrowest one
    /// remains, so that the robot does not leave the curve straight ahead; a robot that stands keeps its steering. At a
    /// speed that counts as standstill such a turn is one on the spot: the sign of noise must not turn the wheels.
    pub(super) fn set_points(&self, command: Twist) -> SetPoints {
        let mut feasible = self.chassis.feasible(command);
        if command.vx.abs() < STANDSTILL_MPS && feasible.refused.contains(&Refusal::TooNarrow) {
            feasible = self.chassis.feasible(Twist { vx: 0.0, ..command });
        }
        let left_out = |n| feasible.refused.get(n).copied().and_then(hold);
        let left_out = [left_out(0), left_out(1)];
        if !self.steers {
            return self.sensed(SetPoints { velocity: feasible.twist, steering: None, left_out });
        }
        let wheels = self.chassis.wheel_states(feasible.twist, &[]);
        let [speed, steering] = [wheels.first(), wheels.last()].map(Option::<&WheelState>::copied);
        let moves = feasible.twist != Twist::ZERO;
        SetPoints {
            velocity: Twist::new(speed.map_or(0.0, |rear| rear.speed_mps), 0.0, 0.0),
            steering: steering.filter(|_| moves).map(|front| front.steering_rad),
            left_out,
        }
    }

    /// What the fields of the guard cover: driving on the curves of a base that steers, sideways motion and turns on
    /// the spot each by itself. Without a guard all of it.
    fn sensed(&self, points: SetPoints) -> SetPoints {
        let Twist { vx, vy, omega } = points.velocity;
        let one_way = [vx, vy, omega].into_iter().filter(|component| *component != 0.0).count() <= 1;
        if !self.guarded || one_way {
            return points;
        }
        let [first, second] = points.left_out;
        let without = |hold, velocity| SetPoints {
            velocity,
            left_out: [Some(hold), first.or(second)],
            steering: points.steering,
        };
        if vy != 0.0 {
            return self.sensed(without(Hold::NoSideways, Twist::new(vx, 0.0, omega)));
        }
        let narrowest = vx.abs() * libm::tan(self.steering_max) / self.wheelbase;
        if omega.abs() <= narrowest {
            points
        } else if vx.abs() < STANDSTILL_MPS {
            SetPoints { velocity: Twist::new(0.0, 0.0, omega), ..points }
        } else {
            without(Hold::TurnTooNarrow, Twist::new(vx, 0.0, narrowest.copysign(omega)))
        }
    }

    /// Set-points within bounds. A base that steers keeps its angle, any other one its direction and its curve.
    pub(super) fn capped(&self, points: SetPoints, caps: Caps) -> SetPoints {
        let Twist { vx, vy, omega } = points.velocity;
        if self.steers {
            let angle = points.steering.unwrap_or(0.0);
            let curvature = libm::fabs(libm::tan(angle) / self.wheelbase);
            let by_curve = if curvature > 0.0 { libm::sqrt(caps.lateral / curvature) } else { caps.speed };
            // Neither the robot nor the driven tread is faster.
            let bound = (caps.speed / self.traction.tread_ratio(angle).max(1.0)).min(by_curve);
            return SetPoints { velocity: Twist::new(vx.clamp(-bound, bound), vy, omega), ..points };
        }
        let part = |most: f64, wanted: f64| if wanted > most { most / wanted } else { 1.0 };
        let speed = libm::hypot(vx, vy);
        let lateral = libm::sqrt(part(caps.lateral, speed * omega.abs()));
        let kept = part(caps.speed, speed).min(part(self.rotation_max, omega.abs())).min(lateral);
        SetPoints { velocity: self.chassis.within_speed(points.velocity * kept), ..points }
    }

    /// Speeds of the wheels, m/s, on the way to a velocity: several accelerate together, so that the robot keeps its
    /// curve. `steering`: its measured angle, rad, NaN if it is unknown. `enabled`: the drives follow; else they stand,
    /// and begin there.
    pub(super) fn speeds(&mut self, now: Instant, velocity: Twist, steering: f64, enabled: bool) -> PerWheel<f64> {
        if self.steers {
            let tread = self.tread(velocity.vx, steering).clamp(-self.speed_max, self.speed_max);
            return [if tread.is_nan() { 0.0 } else { tread }].into_iter().collect();
        }
        if !enabled {
            (self.present, self.due) = (self.chassis.standing(), None);
        } else if self.due.is_none_or(|due| due <= now) {
            // After a pause a step is one step.
            let dt = now.since(self.at).min(STEP);
            self.present = self.chassis.step(velocity, &self.present, dt.as_secs_f64());
            self.at = now;
        }
        let goal = self.chassis.wheel_states(velocity, &[]);
        let away = self.present.iter().zip(&goal).any(|(is, goal)| (is.speed_mps - goal.speed_mps).abs() > REACHED_MPS);
        self.due = (enabled && away).then(|| self.due.filter(|due| *due > now).unwrap_or(now + STEP));
        self.present.iter().map(|wheel| wheel.speed_mps).collect()
    }

    /// The robot is stopped: the next motion begins at standstill.
    pub(super) fn stand(&mut self) {
        (self.present, self.due) = (self.chassis.standing(), None);
    }

    /// When the next set-points are due.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.due
    }

    /// Velocity at these set-points; a robot that is to stand has none, wherever its wheels point.
    pub(super) fn set_velocity(&self, velocity: Twist, steering: f64) -> Twist {
        match velocity.vx {
            _ if !self.steers => velocity,
            0.0 => Twist::ZERO,
            speed => self.by_angle(speed, steering).twist,
        }
    }

    /// Velocity that the wheels measure; of a base that steers with this angle, rad. NaN where it is unknown.
    pub(super) fn velocity(&self, wheels: &[WheelState], steering: f64) -> Measured {
        if self.steers {
            let tread = wheels.first().map_or(f64::NAN, |wheel| wheel.speed_mps);
            return self.by_angle(self.axle(tread, steering), steering);
        }
        let unknown = Measured { twist: Twist::new(f64::NAN, f64::NAN, f64::NAN), residual: f64::NAN };
        let estimate = self.chassis.estimate(wheels);
        estimate.map_or(unknown, |estimate| Measured { twist: estimate.twist, residual: estimate.residual_mps })
    }

    /// True if wheels can contradict each other.
    pub(super) fn is_redundant(&self) -> bool {
        !self.steers && self.chassis.redundancy() > 0
    }

    /// Part of its rated torque by which a wheel may work against the others; `None`: wheels cannot.
    pub(super) fn strain_allowed(&self) -> Option<f64> {
        self.strain.filter(|_| self.is_redundant())
    }

    pub(super) fn chassis(&self) -> &Chassis {
        &self.chassis
    }

    /// Which of these wheels disagree by more than `tolerance`, m/s; `None` if that is not known.
    pub(super) fn agreement(&self, wheels: &[WheelState], tolerance: f64) -> Option<Agreement> {
        self.chassis.agreement(wheels, tolerance)
    }

    /// Angle of the equivalent single steered wheel at a velocity of a base without steering, rad; `otherwise` while it
    /// does not drive forward or backward.
    pub(super) fn equivalent_steering(&self, Twist { vx, omega, .. }: Twist, otherwise: f64) -> f64 {
        if vx.abs() < STANDSTILL_MPS { otherwise } else { libm::atan(omega * self.wheelbase / vx) }
    }

    /// Speed of the driven tread at this speed of the fixed axle's middle, m/s, and steering angle, rad.
    fn tread(&self, axle: f64, steering: f64) -> f64 {
        axle * self.traction.tread_ratio(steering)
    }

    /// The inverse of [`Self::tread`].
    fn axle(&self, tread: f64, steering: f64) -> f64 {
        tread / self.traction.tread_ratio(steering)
    }

    /// Velocity at this speed, m/s, and steering angle, rad. The rotation depends on the angle; the velocity of the
    /// rear axle does not.
    fn by_angle(&self, speed: f64, steering: f64) -> Measured {
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

/// A driven rear axle and steered front wheels.
fn steered(config: &Config) -> Result<Chassis, Error> {
    let limits = &config.limits;
    let angle = limits.steering_rad;
    Chassis::bicycle(&SteeredBase {
        wheelbase_m: config.wheelbase,
        end: End::Front,
        driven: Driven::Fixed,
        steering: Steering { min_rad: -angle, max_rad: angle, rate_radps: limits.steering_rate_radps },
        limits: kinematics::Limits {
            speed_mps: limits.speed_mps,
            acceleration_mps2: limits.acceleration_mps2,
            deceleration_mps2: limits.deceleration_mps2,
        },
    })
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

    fn at(speed_mps: f64) -> WheelState {
        WheelState { speed_mps, steering_rad: 0.0 }
    }

    fn points(vx: f64, vy: f64, omega: f64) -> (f64, Option<f64>, Vec<Hold>) {
        let SetPoints { velocity, steering, left_out } = body().set_points(Twist::new(vx, vy, omega));
        (velocity.vx, steering, left_out.into_iter().flatten().collect())
    }

    #[test]
    fn a_velocity_becomes_speed_and_angle_of_the_equivalent_single_wheel_both_ways() {
        // A radius of 2 m at a wheelbase of 0.6 m.
        let angle = libm::atan(0.3);
        for (vx, omega, steering) in [(0.4, 0.2, angle), (0.4, -0.2, -angle), (-0.4, 0.2, -angle), (-0.4, 0.0, 0.0)] {
            let (speed, found, left_out) = points(vx, 0.0, omega);
            assert!((speed - vx).abs() < 1e-12 && (found.unwrap() - steering).abs() < 1e-12, "{vx} {omega}: {found:?}");
            assert_eq!(left_out, []);
            let Measured { twist, residual } = body().velocity(&[at(speed)], steering);
            assert!((twist - Twist::new(vx, 0.0, omega)).at(1.0, 1.0).0.abs() < 1e-12 && residual < 1e-12, "{twist:?}");
        }
        assert_eq!(points(0.0, 0.0, 0.0), (0.0, None, vec![]), "the steering stays as it is");
    }

    #[test]
    fn the_driven_wheel_has_the_speed_of_its_place_whichever_end_steers() {
        const LEFT: f64 = 0.25;
        let config = config();
        let base = |end| SteeredBase {
            wheelbase_m: config.wheelbase,
            end,
            driven: Driven::All,
            steering: Steering { min_rad: -1.0, max_rad: 1.0, rate_radps: 1.0 },
            limits: kinematics::Limits { speed_mps: 9.0, acceleration_mps2: 1.0, deceleration_mps2: 1.0 },
        };
        for (speed, angle) in [(0.4, 0.5), (0.4, -0.5), (-0.3, 0.5), (0.2, 0.0)] {
            let twist = Twist::new(speed, 0.0, speed * libm::tan(angle) / config.wheelbase);
            for (end, sign) in [(End::Front, 1.0), (End::Rear, -1.0)] {
                let wheels = Chassis::tricycle(&base(end), 2.0 * LEFT).expect("a base").wheel_states(twist, &[]);
                // A wheel behind the fixed axle is turned to the right for a curve to the left.
                assert!((wheels[2].steering_rad - sign * angle).abs() < 1e-12, "{end:?} {angle}: {wheels:?}");
                let places = [
                    (0, Traction::Fixed { left: LEFT / config.wheelbase }),
                    (1, Traction::Fixed { left: -LEFT / config.wheelbase }),
                    (2, Traction::Steered),
                ];
                for (wheel, traction) in places {
                    let mut body = Body::new(&Config { traction, ..config.clone() }).expect("a base");
                    let set = body.speeds(Instant::ZERO, Twist::new(speed, 0.0, 0.0), angle, true);
                    assert!((set[0] - wheels[wheel].speed_mps).abs() < 1e-12, "{wheel}: {set:?} {wheels:?}");
                    let Measured { twist: measured, .. } = body.velocity(&[at(set[0])], angle);
                    let off = measured - twist;
                    assert!(off.vx.abs() < 1e-12 && off.omega.abs() < 1e-12, "{wheel}: {measured:?}, not {twist:?}");
                }
            }
        }
        // Beside the middle nothing is known without the angle.
        let beside = Config { traction: Traction::Fixed { left: 0.4 }, ..config };
        let mut body = Body::new(&beside).expect("a base");
        assert!(body.velocity(&[at(0.3)], f64::NAN).twist.vx.is_nan());
        assert_eq!(body.speeds(Instant::ZERO, Twist::new(0.3, 0.0, 0.0), f64::NAN, true), [0.0]);
        // On the outside of a curve its tread keeps the bound, on the inside the robot.
        for (angle, most) in [(-0.5, 0.4 / (1.0 + 0.4 * libm::tan(0.5))), (0.5, 0.4)] {
            let steering = Some(angle);
            let points = SetPoints { velocity: Twist::new(1.0, 0.0, 0.0), steering, left_out: [None; 2] };
            let capped = body.capped(points, Caps { speed: 0.4, lateral: 9.0 });
            assert!((capped.velocity.vx - most).abs() < 1e-12, "{angle}: {capped:?}");
        }
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
        let Measured { twist, residual } = body().velocity(&[at(0.4)], f64::NAN);
        assert!(twist.vx == 0.4 && twist.vy == 0.0 && twist.omega.is_nan() && residual.is_nan(), "{twist:?}");
        let Measured { twist, residual } = body().velocity(&[at(f64::NAN)], 0.1);
        assert!([twist.vx, twist.vy, twist.omega, residual].into_iter().all(f64::is_nan), "{twist:?}");
    }
}
