//! Shortest path of a car that drives forwards and in reverse: J. A. Reeds, L. A. Shepp, Optimal paths for a car that
//! goes both forwards and backwards, Pacific Journal of Mathematics 145 (1990), section 8.
//!
//! Nine formulas for words that begin with a left turn forwards (8.1 to 8.11) give all 48 by three symmetries: reversed
//! direction (`timeflip`), left for right (`reflect`), and end for start (`backwards`). All terms follow from the
//! distances and directions between the centres of the first and the last turning circle; there are only four such
//! pairs, so each root and each inverse trigonometric function is evaluated once per pair and not once per word. Unit
//! radius inside.

use crate::curve::Curve;
use crate::{Arc, Pose, wrap};
use core::f64::consts::{FRAC_PI_2, PI};

/// Angles and lengths that rounding has made negative by less than this are zero.
const ROUNDING: f64 = 1e-12;

/// Turning direction of a segment. The discriminant is the sign of its curvature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i8)]
enum Turn {
    Left = 1,
    Straight = 0,
    Right = -1,
}
use Turn::{Left, Right, Straight};

/// Shortest path from one pose to another with turns of `radius` m (above zero) or wider.
#[must_use]
pub fn reeds_shepp(from: Pose, to: Pose, radius: f64) -> Curve {
    let (mut best, mut word) = (f64::INFINITY, Word::NONE);
    each_word(from, to, radius, |candidate| {
        let length = candidate.length();
        // Equally long words differ by rounding only; the first one is chosen on every machine.
        if length < best - 1e-9 {
            (best, word) = (length, candidate);
        }
    });
    word.curve(radius)
}

/// Calls `visit` with every word that leads from one pose to the other, at most 48, for a choice by more than length.
/// The shortest is among them.
pub fn reeds_shepp_words(from: Pose, to: Pose, radius: f64, mut visit: impl FnMut(Curve)) {
    each_word(from, to, radius, |word| visit(word.curve(radius)));
}

/// Length of [`reeds_shepp`], m; infinite if a coordinate is not a finite number.
#[must_use]
pub fn reeds_shepp_length(from: Pose, to: Pose, radius: f64) -> f64 {
    let mut best = f64::INFINITY;
    each_word(from, to, radius, |word| best = best.min(word.length()));
    best * radius
}

/// Signed lengths of up to five segments, in radii.
#[derive(Clone, Copy)]
struct Word {
    turns: [Turn; 5],
    lengths: [f64; 5],
}

impl Word {
    const NONE: Self = Self { turns: [Straight; 5], lengths: [0.0; 5] };

    fn length(&self) -> f64 {
        let [a, b, c, d, e] = self.lengths.map(libm::fabs);
        a + b + c + d + e
    }

    fn curve(&self, radius: f64) -> Curve {
        let pieces = self.turns.into_iter().zip(self.lengths);
        Curve::new(
            pieces.map(|(turn, length)| Arc { curvature: f64::from(turn as i8) / radius, length: length * radius }),
        )
    }
}

/// Centre of the last turning circle relative to the first one's, and terms derived from it.
struct Centres {
    distance: f64,
    direction: f64,
}

impl Centres {
    fn new(x: f64, y: f64) -> Self {
        Self { distance: libm::sqrt(x * x + y * y), direction: libm::atan2(y, x) }
    }
}

/// Terms for circles of the same sense (L…L).
struct Same {
    /// 8.1: straight segment.
    straight: f64,
    /// 8.3, 8.4: middle turn, if three turns reach.
    middle: Option<f64>,
    /// 8.9: straight segment and an angle, if it exists.
    fitted: Option<(f64, f64)>,
}

impl Same {
    fn new(distance: f64) -> Self {
        let root = libm::sqrt((distance * distance - 4.0).max(0.0));
        Self {
            straight: distance,
            middle: (distance <= 4.0).then(|| -2.0 * libm::asin(0.25 * distance)),
            fitted: (root >= 2.0).then(|| (2.0 - root, libm::atan2(root, -2.0))),
        }
    }
}

/// Terms for circles of opposite sense (L…R).
struct Opposite {
    /// 8.2: straight segment and its angle.
    straight: Option<(f64, f64)>,
    /// 8.7: two equal middle turns, and the angle in both formulas.
    unlike: Option<(f64, f64)>,
    /// 8.8: the same for turns of the same direction.
    like: Option<(f64, f64)>,
    /// 8.10: straight segment.
    fitted: Option<f64>,
    /// 8.11: straight segment between two quarter turns, and its angle.
    quarters: Option<(f64, f64)>,
}

impl Opposite {
    fn new(distance: f64) -> Self {
        let square = distance * distance;
        let root = libm::sqrt((square - 4.0).max(0.0));
        let (unlike, like) = (0.25 * (2.0 + distance), (20.0 - square) / 16.0);
        let quarters = 4.0 - root;
        Self {
            straight: (square >= 4.0).then(|| (root, libm::atan2(2.0, root))),
            unlike: (unlike <= 1.0).then(|| {
                // cos u = rho, and the difference of the turns is 2u: A = sin u - sin 2u, B = cos u - cos 2u - 1.
                let (cos, u) = (unlike, libm::acos(unlike));
                let sin = libm::sqrt((1.0 - cos * cos).max(0.0));
                (u, libm::atan2(cos - 2.0 * cos * cos, sin - 2.0 * sin * cos))
            }),
            like: (0.0..=1.0).contains(&like).then(|| {
                // Their difference is 0: A = sin u, B = cos u - 2.
                let u = -libm::acos(like);
                (u, libm::atan2(like - 2.0, -libm::sqrt((1.0 - like * like).max(0.0))))
            }),
            fitted: (distance >= 2.0).then_some(2.0 - distance),
            quarters: (square >= 4.0 && quarters <= 0.0).then(|| (quarters, libm::atan2(root, -2.0))),
        }
    }
}

/// Images of a base word.
#[derive(Clone, Copy)]
struct Image {
    timeflip: bool,
    reflect: bool,
    backwards: bool,
}

impl Image {
    fn word<const N: usize>(self, turns: [Turn; N], lengths: [f64; N]) -> Word {
        let mut word = Word::NONE;
        for i in 0..N {
            let from = if self.backwards { N - 1 - i } else { i };
            word.turns[i] = match turns[from] {
                Left if self.reflect => Right,
                Right if self.reflect => Left,
                turn => turn,
            };
            word.lengths[i] = if self.timeflip { -lengths[from] } else { lengths[from] };
        }
        word
    }
}

fn each_word(from: Pose, to: Pose, radius: f64, mut visit: impl FnMut(Word)) {
    let to = from.inverse() * to;
    let (x, y, phi) = (to.x / radius, to.y / radius, to.theta.radians());
    if !(x.is_finite() && y.is_finite() && phi.is_finite()) {
        return;
    }
    let (sin, cos) = libm::sincos(phi);
    for reflect in [false, true] {
        // The mirror image has -y, -phi. Same sense: L…L, reflected R…R; opposite: L…R, reflected R…L.
        let (y, sin, phi) = if reflect { (-y, -sin, -phi) } else { (y, sin, phi) };
        let same = Centres::new(x - sin, y - 1.0 + cos);
        let opposite = Centres::new(x + sin, y - 1.0 - cos);
        let (of_same, of_opposite) = (Same::new(same.distance), Opposite::new(opposite.distance));
        for timeflip in [false, true] {
            // Driving the other way along has -x, -phi: directions between centres are mirrored.
            let (direction_same, direction_opposite, phi) = match timeflip {
                false => (same.direction, opposite.direction, phi),
                true => (PI - same.direction, PI - opposite.direction, -phi),
            };
            let image = Image { timeflip, reflect, backwards: false };
            same_words(&of_same, direction_same, phi, image, &mut visit);
            opposite_words(&of_opposite, direction_opposite, phi, image, &mut visit);
            // From the end: the centres in the frame of the last circle.
            let image = Image { backwards: true, ..image };
            same_words_both_ways(&of_same, phi - direction_same, phi, image, &mut visit);
            // There R…L reads as L…R mirrored once more.
            let image = Image { reflect: !reflect, ..image };
            opposite_words_both_ways(&of_opposite, direction_opposite - phi, -phi, image, &mut visit);
        }
    }
}

/// Forward turn by this angle, in [0, π], if there is one.
fn onward(angle: f64) -> Option<f64> {
    match wrap(angle) {
        // Half a turn is the same in both directions; rounding decides which one `wrap` has chosen.
        half if half < -PI + ROUNDING => Some(PI),
        turn if turn >= -ROUNDING => Some(turn),
        _ => None,
    }
}

/// Reverse turn by this angle, in [-π, 0], if there is one.
fn back(angle: f64) -> Option<f64> {
    onward(-angle).map(|turn| -turn)
}

/// 8.1, and the formulas with an image from their end.
fn same_words(of: &Same, direction: f64, phi: f64, image: Image, visit: &mut impl FnMut(Word)) {
    if let (Some(t), Some(v)) = (onward(direction), onward(phi - direction)) {
        visit(image.word([Left, Straight, Left], [t, of.straight, v]));
    }
    same_words_both_ways(of, direction, phi, image, visit);
}

/// 8.3 with 8.4, and 8.9.
fn same_words_both_ways(of: &Same, direction: f64, phi: f64, image: Image, visit: &mut impl FnMut(Word)) {
    if let Some(u) = of.middle
        && let Some(t) = onward(direction + 0.5 * u + PI)
    {
        visit(image.word([Left, Right, Left], [t, u, wrap(phi - t + u)]));
    }
    if let Some((u, angle)) = of.fitted
        && let Some(t) = onward(direction + angle)
        && let Some(v) = back(phi - FRAC_PI_2 - t)
    {
        visit(image.word([Left, Right, Straight, Left], [t, -FRAC_PI_2, u, v]));
    }
}

/// 8.2, 8.7, 8.8, 8.11, and the formula with an image from its end.
fn opposite_words(of: &Opposite, direction: f64, phi: f64, image: Image, visit: &mut impl FnMut(Word)) {
    if let Some((u, angle)) = of.straight
        && let Some(t) = onward(direction + angle)
        && let Some(v) = onward(t - phi)
    {
        visit(image.word([Left, Straight, Right], [t, u, v]));
    }
    if let Some((u, angle)) = of.unlike
        && let Some(t) = onward(direction - angle)
        && let Some(v) = back(t - 2.0 * u - phi)
    {
        visit(image.word([Left, Right, Left, Right], [t, u, -u, v]));
    }
    if let Some((u, angle)) = of.like
        && let Some(t) = onward(direction - angle)
        && let Some(v) = onward(t - phi)
    {
        visit(image.word([Left, Right, Left, Right], [t, u, u, v]));
    }
    if let Some((u, angle)) = of.quarters
        && let Some(t) = onward(direction + angle)
        && let Some(v) = onward(t - phi)
    {
        visit(image.word([Left, Right, Straight, Left, Right], [t, -FRAC_PI_2, u, -FRAC_PI_2, v]));
    }
    opposite_words_both_ways(of, direction, phi, image, visit);
}

/// 8.10.
fn opposite_words_both_ways(of: &Opposite, direction: f64, phi: f64, image: Image, visit: &mut impl FnMut(Word)) {
    if let Some(u) = of.fitted
        && let Some(t) = onward(direction + FRAC_PI_2)
        && let Some(v) = back(t + FRAC_PI_2 - phi)
    {
        visit(image.word([Left, Right, Straight, Right], [t, -FRAC_PI_2, u, v]));
    }
}

#[cfg(test)]
mod tests;
