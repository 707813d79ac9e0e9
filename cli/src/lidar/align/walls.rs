//! Straight walls in scans: found while the robot stands, followed while it moves.

use super::odometry::Way;
use std::f64::consts::{FRAC_PI_2, PI};

/// A measurement of a lidar, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Time, s.
    pub at: f64,
    /// Number of the revolution.
    pub revolution: i64,
    /// Direction from the lidar's front, counter-clockwise, rad.
    pub angle: f64,
    /// Distance, m.
    pub range: f64,
}

impl Beam {
    /// The point that was hit.
    pub fn point(&self) -> [f64; 2] {
        let (sin, cos) = self.angle.sin_cos();
        [self.range * cos, self.range * sin]
    }
}

/// A wall as a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Direction of its perpendicular, from the lidar to the wall, rad.
    pub normal: f64,
    /// Distance along it, m.
    pub distance: f64,
}

/// Walls that are used at most.
pub const WALLS_MAX: usize = 4;
/// Points within this distance of a line belong to it, m.
const NEAR_M: f64 = 0.03;
/// Points of a wall that was taken, which no other wall may have, m.
const TAKEN_M: f64 = 0.08;
/// Shortest wall, m, and fewest points of it.
const LENGTH_MIN_M: f64 = 0.8;
const POINTS_MIN: usize = 60;
/// Longest gap in a wall, m.
const GAP_M: f64 = 0.3;
/// A wall that deviates more from a straight line in its middle is not straight, m.
const SAGITTA_MAX_M: f64 = 0.012;
/// Pairs of points that are tried for each wall.
const PAIRS: usize = 400;
/// Walls whose perpendiculars are closer to each other are one, rad.
const APART_RAD: f64 = 0.1;
/// Distance between two parallel walls that are not one, m.
const APART_M: f64 = 0.3;

impl Wall {
    /// Distance of a point behind the wall, m; negative before it.
    pub fn behind(&self, [x, y]: [f64; 2]) -> f64 {
        let (sin, cos) = self.normal.sin_cos();
        x * cos + y * sin - self.distance
    }

    /// Position of a point along the wall, m.
    fn along(&self, [x, y]: [f64; 2]) -> f64 {
        let (sin, cos) = self.normal.sin_cos();
        y * cos - x * sin
    }

    fn through([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> Self {
        let normal = (by - ay).atan2(bx - ax) + FRAC_PI_2;
        let (sin, cos) = normal.sin_cos();
        Self { normal, distance: ax * cos + ay * sin }.outward()
    }

    /// The same line with a positive distance.
    fn outward(self) -> Self {
        let Self { normal, distance } = self;
        if distance < 0.0 { Self { normal: normal + PI, distance: -distance } } else { self }
    }

    /// The line of least squares through points, perpendicular to it.
    pub fn fit(points: &[[f64; 2]]) -> Option<Self> {
        let count = points.len() as f64;
        let [mx, my] = [0, 1].map(|n| points.iter().map(|point| point[n]).sum::<f64>() / count);
        let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
        for [x, y] in points {
            let (dx, dy) = (x - mx, y - my);
            (xx, yy, xy) = (xx + dx * dx, yy + dy * dy, xy + dx * dy);
        }
        if points.len() < 2 || xx + yy < 1e-9 {
            return None;
        }
        let normal = 0.5 * (2.0 * xy).atan2(xx - yy) + FRAC_PI_2;
        let (sin, cos) = normal.sin_cos();
        Some(Self { normal, distance: mx * cos + my * sin }.outward())
    }
}

/// The difference of two directions, in [-π, π).
pub fn apart(one: f64, other: f64) -> f64 {
    navitools::wrap(one - other)
}

/// Straight walls among the points of a robot that stands, the longest first.
pub fn find(points: &[[f64; 2]]) -> Vec<Wall> {
    let (mut left, mut walls) = (points.to_vec(), Vec::<Wall>::new());
    // The same points give the same walls.
    let mut random = 0x2545_F491_4F6C_DD1D_u64;
    // Lines that are no wall are removed, too: some more rounds than walls.
    for _ in 0..3 * WALLS_MAX {
        let Some(best) = best_line(&left, &mut random) else { break };
        let segment = longest_segment(&best, &left);
        let fitted = Wall::fit(&segment);
        if let Some(wall) = fitted.filter(|wall| is_straight(wall, &segment))
            && walls.iter().all(|other| !is_same(other, &wall))
        {
            walls.push(wall);
        }
        let taken = fitted.unwrap_or(best);
        let before = left.len();
        left.retain(|point| taken.behind(*point).abs() > TAKEN_M);
        if walls.len() == WALLS_MAX || left.len() == before {
            break;
        }
    }
    walls
}

/// True for two pieces of a wall.
fn is_same(one: &Wall, other: &Wall) -> bool {
    apart(one.normal, other.normal).abs() < APART_RAD && (one.distance - other.distance).abs() < APART_M
}

/// The line through two of the points that has most of them near.
fn best_line(points: &[[f64; 2]], random: &mut u64) -> Option<Wall> {
    let mut next = |below: usize| {
        *random ^= *random << 13;
        *random ^= *random >> 7;
        *random ^= *random << 17;
        (*random >> 20) as usize % below
    };
    if points.len() < POINTS_MIN {
        return None;
    }
    // A sample tells which line is best.
    let step = (points.len() / 400).max(1);
    let mut best: Option<(usize, Wall)> = None;
    for _ in 0..PAIRS {
        let [a, b] = [points[next(points.len())], points[next(points.len())]];
        if (a[0] - b[0]).hypot(a[1] - b[1]) < LENGTH_MIN_M / 4.0 {
            continue;
        }
        let wall = Wall::through(a, b);
        let count = points.iter().step_by(step).filter(|point| wall.behind(**point).abs() < NEAR_M).count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, wall));
        }
    }
    best.map(|(_, wall)| wall)
}

/// The longest piece of a line that has points without a gap.
fn longest_segment(wall: &Wall, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut near: Vec<[f64; 2]> = points.iter().copied().filter(|point| wall.behind(*point).abs() < NEAR_M).collect();
    near.sort_by(|a, b| wall.along(*a).total_cmp(&wall.along(*b)));
    let pieces = near.chunk_by(|a, b| wall.along(*b) - wall.along(*a) < GAP_M);
    pieces.max_by_key(|piece| piece.len()).unwrap_or_default().to_vec()
}

/// True for a wall that is long enough, and not bent.
fn is_straight(wall: &Wall, points: &[[f64; 2]]) -> bool {
    let places = || points.iter().map(|point| wall.along(*point));
    let (from, to) = (places().fold(f64::MAX, f64::min), places().fold(f64::MIN, f64::max));
    if points.len() < POINTS_MIN || to - from < LENGTH_MIN_M {
        return false;
    }
    // Deviation as a parabola: the second Legendre polynomial is orthogonal to the line that was fitted, nearly.
    let (middle, half) = ((from + to) / 2.0, (to - from) / 2.0);
    let (mut product, mut square) = (0.0, 0.0);
    for point in points {
        let u = (wall.along(*point) - middle) / half;
        let p2 = 1.5 * u * u - 0.5;
        product += p2 * wall.behind(*point);
        square += p2 * p2;
    }
    // From the middle to the ends it changes by 3/2.
    (1.5 * product / square.max(1e-9)).abs() < SAGITTA_MAX_M
}

/// A wall that is followed, in the frame of the moving lidar.
struct Followed {
    wall: Wall,
    /// Change of its distance, m/s.
    rate: f64,
    /// When it was seen last, s.
    seen: f64,
}

/// Distance of points of a wall from where it is expected, m; and after the first fit.
const GATES_M: [f64; 3] = [0.15, 0.08, 0.05];
/// Fewest beams of a revolution on a wall, and their extent, m.
const BEAMS_MIN: usize = 12;
const EXTENT_MIN_M: f64 = 0.4;
/// A wall that was not seen for this time is lost, s.
const LOST_S: f64 = 1.5;

/// Beams on each wall, followed from a revolution to the next by the rotation that the odometry says. The lidar's place
/// need not be known for that: it turns as the robot does.
pub fn follow(walls: &[Wall], beams: &[Beam], way: &Way) -> Vec<(usize, Beam)> {
    let Some(mut before) = beams.first().map(|beam| beam.at) else { return Vec::new() };
    let new = |wall: &Wall| Some(Followed { wall: *wall, rate: 0.0, seen: before });
    let mut followed: Vec<Option<Followed>> = walls.iter().map(new).collect();
    let mut hits = Vec::new();
    for turn in beams.chunk_by(|a, b| a.revolution == b.revolution) {
        let middle = (turn[0].at + turn[turn.len() - 1].at) / 2.0;
        let turned = way.at(middle)[2] - way.at(before)[2];
        let step = middle - before;
        before = middle;
        // As if all were measured in the middle, as far as the rotation goes.
        let heading = way.at(middle)[2];
        let points: Vec<[f64; 2]> = turn
            .iter()
            .map(|beam| Beam { angle: beam.angle + way.at(beam.at)[2] - heading, ..*beam }.point())
            .collect();
        for (n, place) in followed.iter_mut().enumerate() {
            let Some(wall) = place else { continue };
            wall.wall.normal -= turned;
            wall.wall.distance += wall.rate * step;
            match wall.renew(turn, &points, middle, step) {
                Some(on) => hits.extend(on.into_iter().map(|at| (n, turn[at]))),
                None if middle - wall.seen > LOST_S => *place = None,
                None => {}
            }
        }
    }
    hits
}

impl Followed {
    /// Takes the wall's points of a revolution; their places. `None`: too few of them.
    fn renew(&mut self, turn: &[Beam], points: &[[f64; 2]], middle: f64, step: f64) -> Option<Vec<usize>> {
        let mut wall = self.wall;
        let mut on = Vec::new();
        for gate in GATES_M {
            // While the lidar comes nearer, the wall does so from beam to beam.
            let moved = |at: usize| self.rate * (turn[at].at - middle);
            on = (0..points.len()).filter(|at| (wall.behind(points[*at]) - moved(*at)).abs() < gate).collect();
            let places = || on.iter().map(|at: &usize| wall.along(points[*at]));
            let extent = places().fold(f64::MIN, f64::max) - places().fold(f64::MAX, f64::min);
            if on.len() < BEAMS_MIN || extent < EXTENT_MIN_M {
                return None;
            }
            let (sin, cos) = wall.normal.sin_cos();
            let still: Vec<[f64; 2]> =
                on.iter().map(|at| [points[*at][0] - moved(*at) * cos, points[*at][1] - moved(*at) * sin]).collect();
            let fitted = Wall::fit(&still)?;
            if apart(fitted.normal, self.wall.normal).abs() > APART_RAD * 1.5 {
                return None;
            }
            wall = fitted;
        }
        let since = middle - self.seen;
        if step > 0.0 && since > 0.0 {
            let before = self.wall.distance - self.rate * step;
            let rate = if since < 1.5 * step { (wall.distance - before) / step } else { self.rate };
            self.rate = (0.5 * self.rate + 0.5 * rate).clamp(-3.0, 3.0);
        }
        (self.wall, self.seen) = (wall, middle);
        Some(on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(from: [f64; 2], to: [f64; 2], count: usize, bend: f64) -> Vec<[f64; 2]> {
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let normal = [(to[1] - from[1]) / length, (from[0] - to[0]) / length];
        let point = |n: usize| {
            let u = n as f64 / (count - 1) as f64;
            // Noise of 1 cm that repeats itself.
            let off = 0.01 * (n as f64 * 12.9898).sin() + bend * (1.0 - (2.0 * u - 1.0) * (2.0 * u - 1.0));
            [0, 1].map(|axis| from[axis] + u * (to[axis] - from[axis]) + off * normal[axis])
        };
        (0..count).map(point).collect()
    }

    #[test]
    fn walls_of_a_corner_are_found_with_their_distances() {
        let points = [line([2.0, -2.0], [2.0, 1.5], 300, 0.0), line([2.0, 1.5], [-1.0, 1.5], 200, 0.0)].concat();
        let walls = find(&points);
        assert_eq!(walls.len(), 2, "{walls:?}");
        for (normal, distance) in [(0.0, 2.0), (FRAC_PI_2, 1.5)] {
            let is = |wall: &&Wall| apart(wall.normal, normal).abs() < 0.01 && (wall.distance - distance).abs() < 0.01;
            assert!(walls.iter().any(|wall| is(&wall)), "{normal}: {walls:?}");
        }
    }

    #[test]
    fn what_is_bent_short_or_scattered_is_no_wall() {
        assert_eq!(find(&line([2.0, -1.5], [2.0, 1.5], 300, 0.06)), [], "bent by 6 cm");
        assert_eq!(find(&line([2.0, -0.3], [2.0, 0.3], 300, 0.0)), [], "60 cm long");
        let round: Vec<[f64; 2]> =
            (0..600).map(|n| f64::from(n) / 600.0 * 2.0 * PI).map(|a| [3.0 * a.cos(), 3.0 * a.sin()]).collect();
        assert_eq!(find(&round), [], "a round room");
        let columns: Vec<[f64; 2]> = (0..400).map(|n| [2.0, f64::from(n % 8) * 0.5]).collect();
        assert_eq!(find(&columns), [], "columns in a row");
        assert_eq!(find(&[]), []);
    }
}
