//! From a commanded velocity to the next speeds and angles: what the base cannot do, and what it cannot do so soon.

use crate::chassis::Chassis;
use crate::least_squares::solve;
use crate::twist::Twist;
use crate::wheel::{Kind, PerWheel, Wheel, WheelState};
use core::f64::consts::PI;
use heapless::Vec;

/// Part of a command that the base cannot do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// A component is not finite, or beyond 1e6: standing still is permitted.
    NotFinite,
    /// Motion to the side: the other components are permitted.
    Sideways,
    /// Turning without driving, which the range of the steering excludes: standing still is permitted.
    OnTheSpot,
    /// A narrower turn than the range of the steering allows: the narrowest one is permitted, at the commanded speed.
    TooNarrow,
}

/// Velocity that a base can do in place of a commanded one.
#[derive(Clone, Debug, PartialEq)]
pub struct Feasible {
    /// Permitted velocity.
    pub twist: Twist,
    /// What was not possible; empty if the command is permitted as it is.
    pub refused: Vec<Refusal, 2>,
}

/// Sideways velocity that is rounding, m/s.
const SIDEWAYS_MIN_MPS: f64 = 1e-9;

impl Chassis {
    /// Velocity that the geometry permits in place of `command`, whatever the present motion; limits of speed and time
    /// are those of [`Chassis::step`].
    ///
    /// A base with an axle turns about a point of it. If the body's origin is not on the axle, turning moves the origin
    /// sideways: that part of `vy` is determined by `omega`, and refused is only another one that was commanded.
    #[must_use]
    pub fn feasible(&self, command: Twist) -> Feasible {
        let Some(command) = command.usable() else {
            return Feasible { twist: Twist::ZERO, refused: [Refusal::NotFinite].into_iter().collect() };
        };
        let mut refused = Vec::new();
        let (straight, turning) = self.split(command);
        let twist = straight + turning;
        if self.motions.len() == 2 {
            let to_left = Twist::new(-self.motions[0].vy, self.motions[0].vx, 0.0);
            let sideways = |twist: Twist| to_left.vx * twist.vx + to_left.vy * twist.vy;
            let (commanded, permitted) = (sideways(command), sideways(twist));
            if libm::fabs(commanded).min(libm::fabs(commanded - permitted)) > SIDEWAYS_MIN_MPS {
                let _ = refused.push(Refusal::Sideways);
            }
        }
        if self.reach(twist) {
            return Feasible { twist, refused };
        }
        if straight != Twist::ZERO && self.reach(straight) {
            let _ = refused.push(Refusal::TooNarrow);
            return Feasible { twist: straight + turning * self.narrowest(straight, turning), refused };
        }
        let _ = refused.push(if twist.omega == 0.0 { Refusal::Sideways } else { Refusal::OnTheSpot });
        Feasible { twist: Twist::ZERO, refused }
    }

    /// Greatest part of a velocity, up to all of it, at which each driven wheel stays within its speed limit. The
    /// direction of motion and the curvature are unchanged.
    #[must_use]
    pub fn within_speed(&self, twist: Twist) -> Twist {
        let twist = twist.usable().unwrap_or_default();
        let at_limit = |wheel: &Wheel| {
            let speed = match wheel.kind {
                Kind::Steered(_) => {
                    let (vx, vy) = twist.at(wheel.x_m, wheel.y_m);
                    libm::hypot(vx, vy)
                }
                _ => libm::fabs(twist.dot(wheel.rolling(0.0))),
            };
            part(wheel.limits.speed_mps, speed)
        };
        twist * self.wheels.iter().filter(|wheel| wheel.driven).map(at_limit).fold(1.0, f64::min)
    }

    /// Speeds and steering angles after `dt_s` seconds on the way to a [feasible](Chassis::feasible) velocity, within
    /// all limits of drives and steering.
    ///
    /// `present` is what was commanded last; measured states would add their noise to every step.
    ///
    /// - All wheels make the same part of their change of speed. A base that accelerates from standstill, or brakes,
    ///   keeps its curvature; a steered one once its wheels point there.
    /// - All steering angles make the same part of theirs. Meanwhile each steered wheel drives with the component of
    ///   the velocity along it: slower, and not at all from 90° on, nor before a turn on the spot.
    /// - Neither waits for the other: a base that is to drive slower brakes while it steers.
    ///
    /// A target that is not finite or beyond 1e6 is standing still; a time that is not a number above zero changes
    /// nothing.
    #[must_use]
    pub fn step(&self, target: Twist, present: &[WheelState], dt_s: f64) -> PerWheel<WheelState> {
        let dt = if dt_s > 0.0 && dt_s.is_finite() { dt_s } else { 0.0 };
        let target = self.within_speed(target);
        let mut next: PerWheel<WheelState> = self.present(present).collect();
        let goal = self.wheel_states(target, &next);

        let turnable = |(wheel, (now, goal)): (&Wheel, (&WheelState, &WheelState))| {
            let rate = wheel.steering().map_or(f64::INFINITY, |steering| steering.rate_radps);
            part(rate * dt, libm::fabs(goal.steering_rad - now.steering_rad))
        };
        let turned = self.wheels.iter().zip(next.iter().zip(&goal)).map(turnable).fold(1.0, f64::min);
        next.iter_mut().zip(&goal).for_each(|(next, goal)| {
            next.steering_rad += turned * (goal.steering_rad - next.steering_rad);
        });

        let twist = if turned < 1.0 { self.within_speed(self.along(target, &next, &goal)) } else { target };
        let speed = |wheel: &Wheel, state: &WheelState| twist.dot(wheel.rolling(state.steering_rad));
        let reachable = |(wheel, state): (&Wheel, &WheelState)| {
            let change = speed(wheel, state) - state.speed_mps;
            part(wheel.limits.change(state.speed_mps, change, dt), libm::fabs(change))
        };
        let driven = self.wheels.iter().zip(&next).filter(|(wheel, _)| wheel.driven);
        let changed = driven.map(reachable).fold(1.0, f64::min);
        self.wheels.iter().zip(&mut next).for_each(|(wheel, next)| {
            next.speed_mps += changed * (speed(wheel, next) - next.speed_mps);
        });
        next
    }

    /// Velocity nearest to `target` while the steering is still on its way: each steered wheel has the component along
    /// itself, but never in the direction opposite to its goal. The origin is not faster than at the target; before a
    /// turn on the spot it rests.
    fn along(&self, target: Twist, now: &[WheelState], goal: &[WheelState]) -> Twist {
        let takes_part = |wheel: &Wheel| matches!(wheel.kind, Kind::Steered(_) | Kind::Rollers { .. });
        let constraints = self.constraints(takes_part, |index| now[index].steering_rad);
        let (inverse, determined) = self.inverse_of(&constraints);
        if !determined {
            return Twist::ZERO;
        }
        let speeds = constraints.iter().map(|constraint| {
            let speed = target.dot(self.wheels[constraint.wheel].rolling(now[constraint.wheel].steering_rad));
            if constraint.rolling && speed * goal[constraint.wheel].speed_mps > 0.0 { speed } else { 0.0 }
        });
        let twist = self.combined(solve(&inverse, speeds));
        let translation = |twist: Twist| libm::hypot(twist.vx, twist.vy);
        twist * part(translation(target), translation(twist))
    }

    /// Part of a velocity along the axle (or along x), and the rest that the axle permits.
    fn split(&self, command: Twist) -> (Twist, Twist) {
        let ahead = self.motions[0];
        let straight = ahead * (ahead.vx * command.vx + ahead.vy * command.vy);
        match self.motions.len() {
            2 => (straight, self.motions[1] * command.omega),
            _ => (straight, command - straight),
        }
    }

    /// True if the range of each steered wheel has an angle at which it rolls.
    fn reach(&self, twist: Twist) -> bool {
        self.wheels.iter().all(|wheel| wheel.reaches(twist))
    }

    /// Greatest part of `turning` with which the first steered wheel comes to an end of its range.
    fn narrowest(&self, straight: Twist, turning: Twist) -> f64 {
        let ends = |wheel: &Wheel| {
            // With half a turn or more each direction is in the range.
            let range = wheel.steering().filter(|range| range.max_rad - range.min_rad < PI)?;
            Some([range.min_rad, range.max_rad].map(|end| wheel.sliding(end)))
        };
        // At such an end the wheel does not slide.
        let sliding = self.wheels.iter().filter_map(ends).flatten();
        let parts = sliding.map(|sliding| -straight.dot(sliding) / turning.dot(sliding));
        parts.filter(|part| *part >= 0.0).fold(1.0, f64::min)
    }
}

/// Part of a quantity of size `whole`, up to all of it, that is within `limit`.
fn part(limit: f64, whole: f64) -> f64 {
    if whole > limit { limit / whole } else { 1.0 }
}
