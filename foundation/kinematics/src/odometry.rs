//! From measured wheels to the velocity of the base, to the wheel that disagrees, and to what the wheels' forces do
//! against each other.

use crate::chassis::{Chassis, Constraint, Constraints};
use crate::least_squares::solve;
use crate::twist::{Twist, is_usable};
use crate::wheel::{PerWheel, Wheel, WheelState};

/// Velocity that fits the measured wheels best.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Velocity of the base.
    pub twist: Twist,
    /// Root mean square of the residuals of the wheels that are measured or steered, m/s.
    pub residual_mps: f64,
    /// Residual of each wheel: speed, m/s, by which the floor under it moves otherwise than the wheel measures, along
    /// and, if it is steered, across; 0 without measurement.
    pub residuals_mps: PerWheel<f64>,
}

/// Judgement about measured wheels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Agreement {
    /// One velocity of the base fits all of them.
    Agree,
    /// The others agree without this one, and no other one explains the residual: dead, reversed, slipping, or at
    /// another steering angle.
    Wheel(usize),
    /// All agree with the speeds of these two exchanged, and nothing less explains the residual.
    Swapped(usize, usize),
    /// They disagree, and the geometry cannot tell which one is wrong.
    Unnamed,
}

impl Chassis {
    /// Velocity of the base by least squares over all measured wheels (pseudo-inverse, *Modern Robotics*, 13.4). The
    /// constraint of the axle holds exactly; steered wheels count twice, along and across.
    ///
    /// `None` if the velocity is not known: another number of states than of wheels, a needed number that is not finite
    /// or beyond 1e6, or steering angles at which the measured wheels do not determine it.
    #[must_use]
    pub fn estimate(&self, wheels: &[WheelState]) -> Option<Estimate> {
        let known = |(wheel, state): (&Wheel, &WheelState)| !wheel.measured || is_usable(state.speed_mps);
        if wheels.len() != self.wheels.len() || !self.wheels.iter().zip(wheels).all(known) {
            return None;
        }
        let (estimate, determined) = self.fit(wheels, None);
        determined.then_some(estimate)
    }

    /// Number of equations of the measured wheels beyond those that determine the velocity.
    ///
    /// With 0 any measurement fits, and the residual is always zero: a differential base, three omni wheels. With 1 a
    /// wheel that lies is noticed but not named: four mecanum wheels. With more the geometry decides: of two wheels on
    /// one side of a skid-steer base it cannot be said which one lies, of three it can.
    #[must_use]
    pub fn redundancy(&self) -> usize {
        self.constraints(|wheel| wheel.measured, |_| 0.0).len() - self.motions.len()
    }

    /// Finds the wheel that disagrees: the only one without which the residual of the others is at most
    /// `tolerance_mps`, m/s. `None` if the velocity is not known.
    ///
    /// One instant can mislead, for instance at standstill, where a dead wheel is right: judge over some motion.
    #[must_use]
    pub fn agreement(&self, wheels: &[WheelState], tolerance_mps: f64) -> Option<Agreement> {
        if self.estimate(wheels)?.residual_mps <= tolerance_mps {
            return Some(Agreement::Agree);
        }
        // Equations that determine less than the velocity can contradict each other, too.
        let fits = |states: &[WheelState], without| self.fit(states, without).0.residual_mps <= tolerance_mps;
        let count = self.wheels.len();
        let mut alone = (0..count).filter(|wheel| self.takes_part(*wheel) && fits(wheels, Some(*wheel)));
        match (alone.next(), alone.next()) {
            (Some(wheel), None) => return Some(Agreement::Wheel(wheel)),
            (Some(_), Some(_)) => return Some(Agreement::Unnamed),
            (None, _) => {}
        }
        let pairs = (0..count).flat_map(|one| (one + 1..count).map(move |other| (one, other)));
        let measured = |wheel: usize| self.wheels[wheel].measured;
        let mut swapped = pairs.filter(|&(one, other)| {
            let mut exchanged: PerWheel<WheelState> = wheels.iter().copied().collect();
            exchanged[one].speed_mps = wheels[other].speed_mps;
            exchanged[other].speed_mps = wheels[one].speed_mps;
            measured(one) && measured(other) && fits(&exchanged, None)
        });
        match (swapped.next(), swapped.next()) {
            (Some((one, other)), None) => Some(Agreement::Swapped(one, other)),
            _ => Some(Agreement::Unnamed),
        }
    }

    /// Parts of the forces of the driven wheels at the floor, N, forward positive, that cancel each other: the wheels
    /// work against each other by them, and nothing moves. What is left of the forces accelerates or holds the base.
    ///
    /// The force on a motion of the base is the sum of the wheels' forces, each times the wheel's speed in that motion
    /// (transposed Jacobian; *Modern Robotics*, 5.2). The parts are the projection on the null space of that sum: the
    /// residuals of the least squares of [`Chassis::estimate`] with forces in place of speeds. Of four mecanum wheels
    /// there is one combination, both front wheels against both rear ones. A wheel without a drive has no part.
    ///
    /// `None`: another number of forces than of wheels, one that is not finite or beyond 1e6 N, wheels that are
    /// steered, or no more driven wheels than independent motions.
    #[must_use]
    pub fn strain(&self, forces_n: &[f64]) -> Option<PerWheel<f64>> {
        let known = |(wheel, force): (&Wheel, &f64)| !wheel.driven || is_usable(*force);
        let fits = forces_n.len() == self.wheels.len() && self.wheels.iter().zip(forces_n).all(known);
        if !fits || self.is_steered() {
            return None;
        }
        let driven = self.constraints(|wheel| wheel.driven, |_| 0.0);
        let (inverse, determined) = self.inverse_of(&driven);
        if !determined || driven.len() <= self.motions.len() {
            return None;
        }
        let amounts = solve(&inverse, driven.iter().map(|constraint| forces_n[constraint.wheel]));
        let mut parts: PerWheel<f64> = self.wheels.iter().map(|_| 0.0).collect();
        for constraint in &driven {
            let moves: f64 = constraint.row.iter().zip(amounts).map(|(part, amount)| part * amount).sum();
            parts[constraint.wheel] = forces_n[constraint.wheel] - moves;
        }
        Some(parts)
    }

    /// True if the wheel contributes equations.
    fn takes_part(&self, wheel: usize) -> bool {
        self.wheels[wheel].measured || self.wheels[wheel].steering().is_some()
    }

    /// Best velocity without the equations of one wheel, and whether the others determine it.
    fn fit(&self, states: &[WheelState], without: Option<usize>) -> (Estimate, bool) {
        let all = self.constraints(|wheel| wheel.measured, |index| states[index].steering_rad);
        let used: Constraints = all.into_iter().filter(|constraint| Some(constraint.wheel) != without).collect();
        let value = |constraint: &Constraint| if constraint.rolling { states[constraint.wheel].speed_mps } else { 0.0 };
        let (inverse, determined) = match &self.inverse {
            Some(inverse) if without.is_none() => (inverse.clone(), true),
            _ => self.inverse_of(&used),
        };
        let amounts = solve(&inverse, used.iter().map(value));

        let mut residuals_mps: PerWheel<f64> = self.wheels.iter().map(|_| 0.0).collect();
        for constraint in &used {
            let fitted: f64 =
                constraint.row.iter().zip(amounts).map(|(coefficient, amount)| coefficient * amount).sum();
            let residual = &mut residuals_mps[constraint.wheel];
            *residual = libm::hypot(*residual, value(constraint) - fitted);
        }
        let wheels = (0..self.wheels.len()).filter(|wheel| Some(*wheel) != without && self.takes_part(*wheel)).count();
        let squares: f64 = residuals_mps.iter().map(|residual| residual * residual).sum();
        let residual_mps = libm::sqrt(squares / wheels.max(1) as f64);
        (Estimate { twist: self.combined(amounts), residual_mps, residuals_mps }, determined)
    }
}
