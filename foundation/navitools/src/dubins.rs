//! Shortest path of a car that drives forwards only: L. E. Dubins, On curves of minimal length with a constraint on
//! average curvature, American Journal of Mathematics 79 (1957).
//!
//! Six words: two turns with a straight line (LSL, LSR, RSL, RSR) or a turn of more than π (LRL, RLR) between them.
//! Words that begin with a right turn are the mirror images of the others. Unit radius inside.

use crate::curve::Curve;
use crate::{Arc, Pose};
use core::f64::consts::PI;

/// Shortest path from one pose to another without reversing, with turns of `radius` m (above zero) or wider.
#[must_use]
pub fn dubins(from: Pose, to: Pose, radius: f64) -> Curve {
    let (_, turns, lengths) = shortest(from, to, radius);
    Curve::new(
        turns.into_iter().zip(lengths).map(|(turn, length)| Arc { curvature: turn / radius, length: length * radius }),
    )
}

/// Length of [`dubins`], m; infinite if a coordinate is not a finite number.
#[must_use]
pub fn dubins_length(from: Pose, to: Pose, radius: f64) -> f64 {
    shortest(from, to, radius).0 * radius
}

/// Tolerance at the discontinuities, where circles touch or a turn vanishes and the length jumps by a whole turn.
const ROUNDING: f64 = 1e-7;

/// Length, senses of the turns, and lengths of the segments.
type Word = (f64, [f64; 3], [f64; 3]);

fn shortest(from: Pose, to: Pose, radius: f64) -> Word {
    let to = from.inverse() * to;
    let (x, y, phi) = (to.x / radius, to.y / radius, to.theta.radians());
    let mut best: Word = (f64::INFINITY, [0.0; 3], [0.0; 3]);
    if !(x.is_finite() && y.is_finite() && phi.is_finite()) {
        return best;
    }
    let mut take = |turns, lengths: [f64; 3]| {
        let length = lengths[0] + lengths[1] + lengths[2];
        if length < best.0 - 1e-9 {
            best = (length, turns, lengths);
        }
    };
    let (sin, cos) = libm::sincos(phi);
    for left in [1.0, -1.0] {
        // Mirror image of a word that begins to the left.
        let (y, sin, phi) = (y * left, sin * left, phi * left);
        // From the centre of the first turn to that of a last turn to the left: LSL and LRL.
        let (along, across) = (x - sin, y - 1.0 + cos);
        let (distance, direction) = (libm::hypot(along, across), libm::atan2(across, along));
        take([left, 0.0, left], [turn(direction), distance, turn(phi - direction)]);
        if distance <= 4.0 {
            let half = libm::asin(distance / 4.0);
            let (first, middle) = (turn(direction + PI / 2.0 + (PI / 2.0 - half)), 2.0 * PI - 2.0 * half);
            take([left, -left, left], [first, middle, turn(phi - first + middle)]);
        }
        // To that of a last turn to the right: LSR.
        let (along, across) = (x + sin, y - 1.0 - cos);
        let square = along * along + across * across;
        if square >= 4.0 - ROUNDING {
            let straight = libm::sqrt((square - 4.0).max(0.0));
            let first = turn(libm::atan2(across, along) + libm::atan2(2.0, straight));
            take([left, 0.0, -left], [first, straight, turn(first - phi)]);
        }
    }
    best
}

/// Angle in [0, 2π); a full turn due to rounding is zero.
fn turn(angle: f64) -> f64 {
    let turn = angle - 2.0 * PI * libm::floor(angle / (2.0 * PI));
    if turn > 2.0 * PI - ROUNDING { 0.0 } else { turn }
}

#[cfg(test)]
mod tests;
