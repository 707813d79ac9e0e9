//! Exact check of a whole path: a polygon that drives, turns and slides, against the squares of the occupied cells.
//!
//! The search looks at single poses. Here nothing is left between them: the distance of the polygon from the nearest
//! obstacle is computed exactly, and the next pose is the one up to which no point of the polygon moves farther than
//! that (conservative advancement). It shares no test with the search, so that an error of one is found by the other.

use crate::map::Field;
use crate::path::Move;
use navitools::{Point, Pose};

/// Distance from an obstacle below which the polygon touches it, m.
const TOUCH_M: f64 = 1e-4;
/// Largest distance between two poses, along the motion, m, or rad on the spot: the clearance of a path is the smallest
/// one at these poses.
const STEP_MAX_M: f64 = 0.1;
/// Distances up to this are measured where the clearance found is already smaller, m: they make longer steps.
const MEASURED_M: f64 = 0.15;
/// Step while the polygon leaves an obstacle that it touches at the start, m.
const LEAVING_STEP_M: f64 = 1e-3;
/// Largest clearance that is reported, m.
pub(crate) const CLEARANCE_MAX_M: f64 = 1.0;

/// Outline of a robot: a simple polygon, convex or not, in the robot's frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outline {
    corners: Vec<Point>,
    /// Middle, and the largest distance of a corner from it, m.
    middle: Point,
    reach: f64,
    /// Corners at a pose.
    placed: Vec<Point>,
}

impl Outline {
    /// Creates an outline with these corners, in order; with fewer than three it touches nothing.
    #[must_use]
    pub fn new(corners: &[Point]) -> Self {
        let mut outline = Self::default();
        outline.set(corners);
        outline
    }

    /// Replaces the corners.
    pub fn set(&mut self, corners: &[Point]) {
        self.corners.clear();
        self.corners.extend_from_slice(corners);
        let (low, high) = bounds(corners);
        self.middle = Point { x: (low.x + high.x) / 2.0, y: (low.y + high.y) / 2.0 };
        self.reach = corners.iter().map(|corner| corner.distance(self.middle)).fold(0.0, f64::max);
    }

    /// Drives the parts of a path from a pose. Returns the smallest distance from an obstacle, m, at most 1 m and 0 if
    /// the first pose touches one, and the number of poses that were checked.
    ///
    /// # Errors
    /// The outline touches an obstacle or the edge of the map, at this pose. Contact at the start is no error until the
    /// outline has left it.
    pub fn drive(&mut self, field: &Field, start: Pose, parts: &[Move]) -> Result<(f64, u32), Pose> {
        let (mut least, mut looks) = (CLEARANCE_MAX_M, 1);
        let mut gap = self.gap(field, start, least);
        let mut leaving = gap < TOUCH_M;
        let mut from = start;
        for part in parts {
            let (length, twist) = (part.extent(), part.twist());
            let speed =
                |corner: &Point| libm::hypot(twist.vx - twist.omega * corner.y, twist.vy + twist.omega * corner.x);
            let way = self.corners.iter().map(speed).fold(1e-9, f64::max);
            let mut at = 0.0;
            while at < length {
                least = least.min(if leaving { 0.0 } else { gap });
                let step = if leaving { LEAVING_STEP_M } else { (gap / way).min(STEP_MAX_M) };
                at = (at + step).min(length);
                let pose = part.with(libm::copysign(at, part.size())).from(from);
                gap = self.gap(field, pose, least.max(MEASURED_M));
                looks += 1;
                if gap < TOUCH_M && !leaving {
                    return Err(pose);
                }
                leaving &= gap < TOUCH_M;
            }
            from = part.from(from);
        }
        Ok((least.min(if leaving { 0.0 } else { gap }), looks))
    }

    /// Distance from the nearest occupied cell, or from the edge of the map, m, at most `most`: exact below it; 0 in a
    /// collision.
    pub fn gap(&mut self, field: &Field, pose: Pose, most: f64) -> f64 {
        let frame = field.frame();
        // Half a diagonal is between a point and the middle of its cell, another one between the middle of an
        // obstacle's cell and its corner.
        let diagonal = frame.resolution * core::f64::consts::SQRT_2;
        let middle = pose * self.middle;
        let free = f64::from(field.bound(middle.x, middle.y)) - diagonal - self.reach;
        if free >= most {
            return most;
        }
        self.placed.clear();
        self.placed.extend(self.corners.iter().copied().map(pose.to_outer()));
        if self.placed.len() < 3 {
            return most;
        }
        let (low, high) = bounds(&self.placed);
        let edges = [low.x - frame.x, frame.right() - high.x, low.y - frame.y, frame.top() - high.y];
        let mut least = edges.into_iter().fold(most, f64::min);
        let (x, y) = ((low.x + high.x) / 2.0, (low.y + high.y) / 2.0);
        let (half_x, half_y) = ((high.x - low.x) / 2.0 + least, (high.y - low.y) / 2.0 + least);
        let cells = frame.cells_within(x, y, half_x, half_y);
        let Some([left, right, bottom, top]) = cells.filter(|_| least > 0.0) else { return 0.0 };
        let half = frame.resolution / 2.0;
        for row in bottom..=top {
            for column in field.occupied(row, left, right) {
                let (x, y) = frame.centre(column, row);
                least = distance_of_square(&self.placed, Point { x, y }, half, least);
                if least <= 0.0 {
                    return 0.0;
                }
            }
        }
        least
    }
}

/// Lower left and upper right corner of the rectangle around points.
fn bounds(points: &[Point]) -> (Point, Point) {
    let (least, most) = (Point { x: f64::MAX, y: f64::MAX }, Point { x: f64::MIN, y: f64::MIN });
    points.iter().fold((least, most), |(low, high), point| {
        let low = Point { x: low.x.min(point.x), y: low.y.min(point.y) };
        (low, Point { x: high.x.max(point.x), y: high.y.max(point.y) })
    })
}

/// Distance between a polygon and an axis-parallel square, at most `most`; 0 if they overlap.
fn distance_of_square(polygon: &[Point], middle: Point, half: f64, most: f64) -> f64 {
    let (from_middle, inside) = distance_of_point(polygon, middle);
    if inside || from_middle <= half {
        return 0.0;
    }
    if from_middle - half * core::f64::consts::SQRT_2 >= most {
        return most;
    }
    let mut least = most;
    for (dx, dy) in [(-half, -half), (half, -half), (half, half), (-half, half)] {
        // A corner inside of the polygon while the middle is outside: an edge crosses the square.
        least = least.min(distance_of_point(polygon, Point { x: middle.x + dx, y: middle.y + dy }).0);
    }
    for (a, b) in edges(polygon) {
        let (dx, dy) = ((a.x - middle.x).abs() - half, (a.y - middle.y).abs() - half);
        least = least.min(libm::hypot(dx.max(0.0), dy.max(0.0)));
        if crosses(a, b, middle, half) {
            return 0.0;
        }
    }
    least
}

fn edges(polygon: &[Point]) -> impl Iterator<Item = (Point, Point)> + '_ {
    let last = polygon.last().into_iter();
    last.chain(polygon).copied().zip(polygon.iter().copied())
}

/// Distance of a point from the edges of a polygon, and true if it is inside.
fn distance_of_point(polygon: &[Point], point: Point) -> (f64, bool) {
    let (mut square, mut inside) = (f64::INFINITY, false);
    for (a, b) in edges(polygon) {
        let (ex, ey) = (b.x - a.x, b.y - a.y);
        let (px, py) = (point.x - a.x, point.y - a.y);
        let part = ((px * ex + py * ey) / (ex * ex + ey * ey).max(1e-18)).clamp(0.0, 1.0);
        let (dx, dy) = (px - part * ex, py - part * ey);
        square = square.min(dx * dx + dy * dy);
        // Crossings of the edges with a ray to the right.
        inside ^= (a.y > point.y) != (b.y > point.y) && px < ex * py / ey;
    }
    (libm::sqrt(square), inside)
}

/// True if a segment passes through the inside of an axis-parallel square.
fn crosses(a: Point, b: Point, middle: Point, half: f64) -> bool {
    let (mut from, mut to) = (0f64, 1f64);
    for (at, way) in [(a.x - middle.x, b.x - a.x), (a.y - middle.y, b.y - a.y)] {
        if way == 0.0 {
            if at.abs() >= half {
                return false;
            }
            continue;
        }
        let (one, other) = ((-half - at) / way, (half - at) / way);
        from = from.max(one.min(other));
        to = to.min(one.max(other));
    }
    from < to
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{Cell, Frame, Map, Obstacle, Unknown};
    use navitools::Arc;
    use testing::Random;

    /// An L with its corner at the origin, 1 m long and 0.6 m high, 0.2 m thick.
    const ELL: [(f64, f64); 6] = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.2), (0.2, 0.2), (0.2, 0.6), (0.0, 0.6)];

    fn outline(corners: &[(f64, f64)]) -> Outline {
        Outline::new(&corners.iter().map(|&(x, y)| Point { x, y }).collect::<Vec<_>>())
    }

    fn field(occupied: &[(usize, usize)]) -> Field {
        let mut map = Map::new(Frame { x: -5.0, y: -5.0, resolution: 0.1, width: 100, height: 100 }).unwrap();
        occupied.iter().for_each(|&(column, row)| map.set(column, row, Cell::Occupied));
        Field::new(&map, Unknown::Blocked)
    }

    #[test]
    fn the_distance_is_exact_also_in_the_notch_of_a_polygon() {
        // The cell from 0.5, 0.3 to 0.6, 0.4.
        let field = field(&[(55, 53)]);
        let mut ell = outline(&ELL);
        let mut gap = |x: f64, y: f64, theta: f64| ell.gap(&field, Pose::new(x, y, theta), 1.0);
        for (x, y, theta, expected) in [
            (0.0, 0.0, 0.0, 0.1),
            (0.0, 0.05, 0.0, 0.05),
            (0.25, 0.0, 0.0, 0.05),
            (0.0, 0.11, 0.0, 0.0),
            (-0.6, 0.0, 0.0, libm::hypot(0.1, 0.1)),
            (0.55, 0.35, 0.0, 0.0),
            (0.0, -0.3, 0.0, 0.3),
            (0.0, -3.0, 0.0, 1.0),
        ] {
            assert!((gap(x, y, theta) - expected).abs() < 1e-12, "{x} {y} {theta}: {}", gap(x, y, theta));
        }
        // Turned by half a right angle about its corner, the cell's corner is opposite to an edge.
        let diagonal = libm::hypot(0.5, 0.3) * libm::sin(libm::atan2(0.3, 0.5) - 0.3) - 0.2;
        assert!(diagonal < 0.0 && gap(0.0, 0.0, 0.3) == 0.0);
    }

    #[test]
    fn the_edge_of_the_map_is_an_obstacle() {
        let mut ell = outline(&ELL);
        assert!((ell.gap(&field(&[]), Pose::new(3.97, 0.0, 0.0), 1.0) - 0.03).abs() < 1e-9);
        assert_eq!(ell.gap(&field(&[]), Pose::new(4.01, 0.0, 0.0), 1.0), 0.0);
        assert_eq!(ell.gap(&field(&[]), Pose::new(40.0, 0.0, 0.0), 1.0), 0.0);
    }

    #[test]
    fn the_distance_from_temporary_obstacles_beyond_their_stamp_is_exact() {
        let mut field = field(&[]);
        field.overlay(&[Obstacle { x: 2.05, y: 0.05, radius: 0.0 }]);
        let mut long = outline(&[(-2.0, -0.5), (1.9, -0.5), (1.9, 0.5), (-2.0, 0.5)]);
        assert!((long.gap(&field, Pose::default(), 1.0) - 0.1).abs() < 1e-9);
    }

    #[test]
    fn a_drive_is_free_exactly_if_all_its_poses_are() {
        let mut random = Random::new(3);
        let mut number =
            move |low: f64, high: f64| low + (high - low) * random.below(1 << 20) as f64 / (1 << 20) as f64;
        let (mut free, mut touching) = (0, 0);
        for _ in 0..400 {
            let cells: Vec<_> = (0..6).map(|_| (number(30.0, 80.0) as usize, number(30.0, 80.0) as usize)).collect();
            let field = field(&cells);
            let mut ell = outline(&ELL);
            let start = Pose::new(number(-1.0, 1.0), number(-1.0, 1.0), number(-3.0, 3.0));
            if ell.gap(&field, start, 1.0) < TOUCH_M {
                continue;
            }
            let part = match number(0.0, 5.0) as u32 {
                0 => Move::Turn(number(-3.0, 3.0)),
                1 => Move::Aside(number(-2.0, 2.0)),
                _ => Move::Arc(Arc { curvature: number(-1.5, 1.5), length: number(-2.0, 2.0) }),
            };
            let poses = 4000;
            let pose = |share: i32| part.with(part.size() * f64::from(share) / 4000.0).from(start);
            let least = (0..=poses).map(|share| ell.gap(&field, pose(share), 1.0)).fold(1.0, f64::min);
            match ell.drive(&field, start, &[part]) {
                Ok((clearance, _)) => {
                    assert!(least > 0.0 && clearance >= least - 1e-5, "{least} {clearance}");
                    assert!(clearance < least + 0.1, "{least} {clearance}");
                    free += 1;
                }
                Err(_) => {
                    assert!(least < 2e-3, "{least}");
                    touching += 1;
                }
            }
        }
        assert!(free > 50 && touching > 50, "{free} {touching}");
    }

    #[test]
    fn contact_at_the_start_may_be_left_but_not_found_again() {
        let ahead = |length: f64| [Move::Arc(Arc { curvature: 0.0, length })];
        let mut bar = outline(&[(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)]);
        // A cell at 0.1 to 0.2 m ahead, and another one 1 m behind it.
        let field = field(&[(51, 50), (41, 50)]);
        assert_eq!(bar.drive(&field, Pose::default(), &ahead(-0.2)).map(|(clearance, _)| clearance), Ok(0.0));
        let touches = bar.drive(&field, Pose::default(), &ahead(-0.7)).unwrap_err();
        assert!((touches.x + 0.6).abs() < 1e-3, "{touches:?}");
    }
}
