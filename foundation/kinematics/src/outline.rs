//! Convex outline of a body, and how far the body may move along a path before the outline touches a point.

use crate::twist::Twist;
use alloc::vec::Vec;
use core::f64::consts::TAU;
use navitools::Point;

/// Convex polygon, corners counter-clockwise, at least three.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    corners: Vec<Point>,
    /// Of the edge from each corner to the next.
    edges: Vec<Edge>,
}

/// Part of the square of a circle's radius, and square in m², by which the end of an edge is surely within it.
const WITHIN: f64 = 1e-6;

/// Sine of the angle between two edges below which they count as in line.
const STRAIGHT: f64 = 1e-3;

/// Line of an edge: the points whose product with `out` is `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    /// Unit vector outwards.
    out: Point,
    offset: f64,
}

impl Polygon {
    /// Convex hull of points; `None` if it has no area, or a coordinate is not a number.
    #[must_use]
    pub fn hull(points: &[Point]) -> Option<Self> {
        let mut points: Vec<Point> = points.to_vec();
        if points.iter().any(|point| !(point.x.is_finite() && point.y.is_finite())) {
            return None;
        }
        points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        points.dedup();
        // Andrew's monotone chain: lower half from left to right, upper half back.
        let mut corners: Vec<Point> = Vec::with_capacity(points.len() + 1);
        let mut first = 0;
        for half in 0..2 {
            let extend = |corners: &mut Vec<Point>, point: Point| {
                while corners.len() >= first + 2
                    && turn(corners[corners.len() - 2], corners[corners.len() - 1], point) <= 0.0
                {
                    corners.pop();
                }
                corners.push(point);
            };
            if half == 0 {
                points.iter().for_each(|point| extend(&mut corners, *point));
            } else {
                points.iter().rev().for_each(|point| extend(&mut corners, *point));
            }
            // The last point of a half is the first one of the other.
            corners.pop();
            first = corners.len();
        }
        (corners.len() >= 3).then(|| Self::new(corners))
    }

    fn new(corners: Vec<Point>) -> Self {
        let next = corners.iter().cycle().skip(1);
        let edge = |(from, to): (&Point, &Point)| {
            let out = normal(*from, *to);
            Edge { out, offset: from.x * out.x + from.y * out.y }
        };
        let edges = corners.iter().zip(next).map(edge).collect();
        Self { corners, edges }
    }

    /// Corners, counter-clockwise.
    #[must_use]
    pub fn corners(&self) -> &[Point] {
        &self.corners
    }

    /// Polygon whose edges are farther out by the margin along their normals, m; its corners move by more than that.
    #[must_use]
    pub fn grown(&self, margin: impl Fn(Point) -> f64) -> Self {
        let count = self.corners.len();
        let corner = |n: usize| {
            let (before, here, after) =
                (self.corners[(n + count - 1) % count], self.corners[n], self.corners[(n + 1) % count]);
            let (one, other) = (normal(before, here), normal(here, after));
            // Both edges move along their normals: the corner is where they meet then.
            let (first, second) = (margin(one), margin(other));
            let turn = one.x * other.y - one.y * other.x;
            if turn < STRAIGHT {
                // The edges are nearly in line: where they meet is lost in rounding.
                let most = first.max(second);
                return Point { x: here.x + most * one.x, y: here.y + most * one.y };
            }
            let x = here.x + (first * other.y - second * one.y) / turn;
            Point { x, y: here.y + (second * one.x - first * other.x) / turn }
        };
        Self::new((0..count).map(corner).collect())
    }

    /// Ends of the edges: from, to.
    fn ends(&self) -> impl Iterator<Item = (Point, Point)> + '_ {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.iter().copied().zip(next.copied())
    }

    /// Distance by which a point is outside of the farthest edge, m: at most its distance; negative within.
    #[must_use]
    pub fn outside(&self, point: Point) -> f64 {
        self.nearest_edge(point).0
    }

    /// The edge beyond which a point is farthest out: distance from the edge, m, and the edge's normal.
    #[must_use]
    pub fn nearest_edge(&self, point: Point) -> (f64, Point) {
        let mut farthest = (f64::NEG_INFINITY, Point::default());
        for Edge { out, offset } in &self.edges {
            let beyond = point.x * out.x + point.y * out.y - offset;
            // What is not a number is nowhere outside.
            if beyond > farthest.0 {
                farthest = (beyond, *out);
            }
        }
        farthest
    }

    /// Greatest distance of a corner from a point, m.
    #[must_use]
    pub fn radius(&self, from: Point) -> f64 {
        self.corners.iter().fold(0.0, |most, corner| f64::max(most, corner.distance(from)))
    }

    /// Least distance of the polygon from a point, m; 0 within.
    #[must_use]
    pub fn distance(&self, from: Point) -> f64 {
        from.distance(self.nearest(from))
    }

    /// Point of the polygon that is nearest to a point: that point itself within.
    #[must_use]
    pub fn nearest(&self, from: Point) -> Point {
        if self.outside(from) <= 0.0 {
            return from;
        }
        let on_edge = |(a, b): (Point, Point)| {
            let (dx, dy) = (b.x - a.x, b.y - a.y);
            let part = ((from.x - a.x) * dx + (from.y - a.y) * dy) / (dx * dx + dy * dy);
            let part = part.clamp(0.0, 1.0);
            Point { x: a.x + part * dx, y: a.y + part * dy }
        };
        let nearer = |one: Point, other: Point| if from.distance(other) < from.distance(one) { other } else { one };
        self.ends().map(on_edge).reduce(nearer).unwrap_or(from)
    }

    /// Length of the path along `twist` after which the polygon first touches a point that is outside of it now;
    /// infinite if it never does.
    #[must_use]
    pub fn contact(&self, twist: Twist, point: Point) -> f64 {
        match twist.center() {
            Some(center) => self.contact_turning(twist.omega, center, point),
            None => self.contact_straight(twist, point),
        }
    }

    fn contact_straight(&self, twist: Twist, point: Point) -> f64 {
        let mut first = f64::INFINITY;
        for (a, b) in self.ends() {
            // point - s (vx, vy) = a + t (b - a)
            let (ex, ey) = (b.x - a.x, b.y - a.y);
            let (px, py) = (point.x - a.x, point.y - a.y);
            let across = twist.vx * ey - twist.vy * ex;
            if across.abs() < 1e-12 {
                continue;
            }
            let length = (px * ey - py * ex) / across;
            let part = (twist.vx * py - twist.vy * px) / across;
            // Slightly beyond the edge: at a corner, rounding could make both edges miss.
            if length >= 0.0 && length < first && (-1e-9..=1.0 + 1e-9).contains(&part) {
                first = length;
            }
        }
        first
    }

    fn contact_turning(&self, omega: f64, center: Point, point: Point) -> f64 {
        let (px, py) = (point.x - center.x, point.y - center.y);
        let square = px * px + py * py;
        // Far more than what is slightly beyond an edge below.
        let inner = square - WITHIN * (1.0 + square);
        let mut first: Option<Turn> = None;
        for (a, b) in self.ends() {
            // The point stays on its circle about the center: |a + t (b - a)| is its radius.
            let (ax, ay) = (a.x - center.x, a.y - center.y);
            let (bx, by) = (b.x - center.x, b.y - center.y);
            let from = ax * ax + ay * ay;
            // An edge with both ends within the circle does not cross it, as about half of them.
            if from < inner && bx * bx + by * by < inner {
                continue;
            }
            let (ex, ey) = (b.x - a.x, b.y - a.y);
            let (ee, ae) = (ex * ex + ey * ey, ax * ex + ay * ey);
            let under = ae * ae - ee * (from - square);
            if under < 0.0 {
                continue;
            }
            let root = libm::sqrt(under);
            for part in [(-ae - root) / ee, (-ae + root) / ee] {
                if !(-1e-9..=1.0 + 1e-9).contains(&part) {
                    continue;
                }
                // In the robot's frame the point turns the other way.
                let (x, y) = (ax + part * ex, ay + part * ey);
                let turn = Turn { cos: x * px + y * py, sin: (x * py - y * px) * omega.signum() };
                // Slightly behind: a point that touches, after rounding.
                if turn.sin <= 0.0 && -turn.sin <= turn.cos * 1e-9 * omega.abs() {
                    return 0.0;
                }
                if first.is_none_or(|first| turn.order() < first.order()) {
                    first = Some(turn);
                }
            }
        }
        first.map_or(f64::INFINITY, |first| first.angle() / omega.abs())
    }
}

/// Angle of a turn, by multiples of its cosine and sine; ordered without computing it, since few of many are first.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    /// Its cosine, times any positive number.
    pub cos: f64,
    /// Its sine, times the same.
    pub sin: f64,
}

impl Turn {
    /// By an angle, rad, at least 0; `None` for a whole turn or more.
    #[must_use]
    pub fn by(angle: f64) -> Option<Self> {
        let (sin, cos) = libm::sincos(angle);
        (angle < TAU).then_some(Self { cos, sin })
    }

    /// Grows with the angle, from 0 to 4 for a whole turn.
    #[must_use]
    pub fn order(self) -> f64 {
        let part = self.cos / (self.cos.abs() + self.sin.abs());
        if self.sin >= 0.0 { 1.0 - part } else { 3.0 + part }
    }

    /// The angle, 0 to 2 pi, rad.
    fn angle(self) -> f64 {
        let angle = libm::atan2(self.sin, self.cos);
        if angle < 0.0 { angle + TAU } else { angle }
    }
}

/// Twice the area of the triangle; above 0 if it is counter-clockwise.
pub(crate) fn turn(a: Point, b: Point, c: Point) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// Unit vector outwards from an edge of a counter-clockwise polygon.
fn normal(from: Point, to: Point) -> Point {
    let length = from.distance(to).max(1e-12);
    Point { x: (to.y - from.y) / length, y: (from.x - to.x) / length }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64) -> Point {
        Point { x, y }
    }

    fn body() -> Polygon {
        Polygon::hull(&[point(-0.15, -0.3), point(0.75, -0.3), point(0.75, 0.3), point(-0.15, 0.3), point(0.2, 0.1)])
            .expect("a rectangle")
    }

    #[test]
    fn a_hull_has_its_corners_counter_clockwise_and_nothing_else() {
        assert_eq!(body().corners(), [point(-0.15, -0.3), point(0.75, -0.3), point(0.75, 0.3), point(-0.15, 0.3)]);
        assert_eq!(Polygon::hull(&[point(0.0, 0.0), point(1.0, 1.0), point(2.0, 2.0)]), None);
        assert_eq!(Polygon::hull(&[point(0.0, f64::NAN), point(1.0, 1.0), point(2.0, 0.0)]), None);
    }

    #[test]
    fn a_grown_polygon_keeps_its_distance() {
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let grown = body().grown(|_| 0.1);
        assert!(near(grown.outside(point(0.85, 0.0)), 0.0) && near(grown.outside(point(0.3, 0.5)), 0.1));
        assert!(
            near(body().distance(point(0.85, 0.4)), libm::hypot(0.1, 0.1))
                && near(body().radius(point(0.0, 0.0)), libm::hypot(0.75, 0.3))
        );
    }

    #[test]
    fn a_straight_path_ends_at_the_point_in_the_way() {
        let forward = Twist { vx: 1.0, vy: 0.0, omega: 0.0 };
        assert!((body().contact(forward, point(1.75, 0.2)) - 1.0).abs() < 1e-12);
        assert_eq!(body().contact(forward, point(1.75, 0.31)), f64::INFINITY);
        assert_eq!(body().contact(forward, point(-0.5, 0.0)), f64::INFINITY);
        let left = Twist { vx: 0.0, vy: 1.0, omega: 0.0 };
        assert!((body().contact(left, point(0.5, 0.7)) - 0.4).abs() < 1e-12);
    }

    #[test]
    fn a_turn_reaches_what_is_beside_the_straight_path() {
        // Radius 1 m to the left: after a quarter of a turn the front looks along y.
        let left = Twist { vx: 1.0, vy: 0.0, omega: 1.0 };
        let length = body().contact(left, point(1.0, 1.75));
        assert!((length - core::f64::consts::FRAC_PI_2).abs() < 1e-9, "{length}");
        // On the spot: the front right corner comes round to the left.
        let spot = Twist { vx: 0.0, vy: 0.0, omega: 1.0 };
        let length = body().contact(spot, point(0.0, 0.5));
        assert!(length > 0.1 && length < 1.5, "{length}");
    }
}
