//! End of a search: a curve straight to the goal, if it is free.

use super::ruler::Ruler;
use super::{append, request::Abilities};
use crate::path::Move;
use navitools::{Arc, Point, Pose, reeds_shepp_words, wrap};

/// Evaluates curves; keeps the buffer of the best one.
#[derive(Debug, Default)]
pub(crate) struct Shot {
    parts: Vec<Move>,
}

impl Shot {
    /// Cheapest free curve from a pose to a target pose, or to a point with any heading, that costs less than `most`.
    pub(crate) fn best(
        &mut self,
        ruler: &Ruler<'_>,
        from: Pose,
        before: Option<Move>,
        target: Result<Pose, (f64, f64)>,
        most: f32,
    ) -> Option<(f32, &[Move])> {
        let radius = ruler.limits.radius_m;
        let Self { parts } = self;
        let mut best = match target {
            Ok(to) => curve(ruler, from, before, to, radius, most, parts),
            Err((x, y)) => {
                let mut best = None;
                for arcs in to_point(from.inverse() * Point { x, y }, radius).into_iter().flatten() {
                    let arcs = arcs.map(Move::Arc);
                    if let Some(cost) = ruler.cost(from, before, arcs, best.unwrap_or(most)) {
                        parts.clear();
                        parts.extend(arcs.into_iter().filter(|arc| arc.size() != 0.0));
                        best = Some(cost);
                    }
                }
                best
            }
        };
        let (to, heading) = match target {
            Ok(to) => (to.point(), Some(to.theta.radians())),
            Err((x, y)) => (Point { x, y }, None),
        };
        best = straight(ruler, from, before, (to, heading), best.unwrap_or(most), parts).or(best);
        best.map(|cost| (cost, &self.parts[..]))
    }
}

/// Reeds-Shepp word that would be cheapest without obstacles, if it is free and costs less than `most`.
pub(crate) fn curve(
    ruler: &Ruler<'_>,
    from: Pose,
    before: Option<Move>,
    to: Pose,
    radius: f64,
    most: f32,
    parts: &mut Vec<Move>,
) -> Option<f32> {
    let mut least = most;
    let mut best = None;
    reeds_shepp_words(from, to, radius, |word| {
        let cost = ruler.cost_in_the_open(before, word.arcs().iter().map(|arc| Move::Arc(*arc)));
        if cost < least {
            (least, best) = (cost, Some(word));
        }
    });
    let best = best?;
    let arcs = best.arcs().iter().map(|arc| Move::Arc(*arc));
    let cost = ruler.cost(from, before, arcs.clone(), most)?;
    parts.clear();
    parts.extend(arcs);
    Some(cost)
}

/// Cheapest free way without curves of a base that turns on the spot or goes sideways, to a point, with this heading or
/// any, if it costs less than `most`.
pub(crate) fn straight(
    ruler: &Ruler<'_>,
    from: Pose,
    before: Option<Move>,
    (to, heading): (Point, Option<f64>),
    most: f32,
    parts: &mut Vec<Move>,
) -> Option<f32> {
    let Abilities { turns, sideways } = ruler.limits.abilities;
    let along = |length: f64| Move::Arc(Arc { curvature: 0.0, length });
    let Point { x, y } = from.inverse() * to;
    let turn = heading.map_or(0.0, |heading| wrap(heading - from.theta.radians()));
    let mut best = None;
    let mut attempt = |ways: &[[Move; 3]]| {
        for way in ways {
            let way = || way.iter().copied().filter(|part| part.extent() > 1e-9);
            let least = best.unwrap_or(most);
            if ruler.cost_in_the_open(before, way()) < least
                && let Some(cost) = ruler.cost(from, before, way(), least)
            {
                parts.clear();
                way().for_each(|part| append(parts, part));
                best = Some(cost);
            }
        }
    };
    if turns {
        let (distance, bearing) = (libm::hypot(x, y), libm::atan2(y, x));
        let bearing = if distance < 1e-9 { 0.0 } else { bearing };
        let ways = [(bearing, distance), (wrap(bearing + core::f64::consts::PI), -distance)];
        attempt(&ways.map(|(bearing, length)| {
            let rest = if heading.is_some() { wrap(turn - bearing) } else { 0.0 };
            [Move::Turn(bearing), along(length), Move::Turn(rest)]
        }));
    }
    if sideways {
        // Beside both ways in the present heading, those in the heading at the end.
        let (sin, cos) = libm::sincos(turn);
        let (ahead, left) = (x * cos + y * sin, y * cos - x * sin);
        attempt(&[[along(x), Move::Aside(y), Move::Turn(turn)], [Move::Aside(y), along(x), Move::Turn(turn)]]);
        if turn != 0.0 {
            let turn = Move::Turn(turn);
            attempt(&[[turn, along(ahead), Move::Aside(left)], [turn, Move::Aside(left), along(ahead)]]);
        }
    }
    best
}

/// Turn and straight line to a point: forwards and in reverse, to the left and to the right.
fn to_point(to: Point, radius: f64) -> [Option<[Arc; 2]>; 4] {
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(ahead, left)| {
        // Mirrored so that it is forwards and to the left.
        let (x, y) = (to.x * ahead, to.y * left - radius);
        let square = x * x + y * y - radius * radius;
        (square >= 0.0).then(|| {
            let straight = libm::sqrt(square);
            let turn = libm::atan2(y, x) - libm::atan2(straight, radius) + core::f64::consts::FRAC_PI_2;
            let turn = if turn < -1e-9 { turn + 2.0 * core::f64::consts::PI } else { turn.max(0.0) };
            [
                Arc { curvature: left / radius, length: ahead * turn * radius },
                Arc { curvature: 0.0, length: ahead * straight },
            ]
        })
    })
}
