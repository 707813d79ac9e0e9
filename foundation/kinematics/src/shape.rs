//! Convex outline of few corners that is copied as a value: a robot's footprint.

use crate::outline::{Polygon, turn};
use core::fmt;
use navitools::Point;

/// Corners of a [`Shape`] at most.
pub const SHAPE_CORNERS_MAX: usize = 36;

/// Convex outline in the robot's frame, m: at least three corners, counter-clockwise, from the one with the least x on.
/// Unlike a [`Polygon`] it needs no memory of its own.
#[derive(Clone, Copy, PartialEq)]
pub struct Shape {
    corners: [Point; SHAPE_CORNERS_MAX],
    count: usize,
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.corners().iter().map(|corner| (corner.x, corner.y))).finish()
    }
}

impl Shape {
    /// Convex hull of points; `None` if it has no area or more than [`SHAPE_CORNERS_MAX`] corners, or if a coordinate
    /// is not a number.
    #[must_use]
    pub fn hull(points: &[Point]) -> Option<Self> {
        Self::of(Polygon::hull(points)?.corners())
    }

    fn of(corners: &[Point]) -> Option<Self> {
        let mut shape = Self { corners: [Point::default(); SHAPE_CORNERS_MAX], count: corners.len() };
        shape.corners.get_mut(..corners.len())?.copy_from_slice(corners);
        Some(shape)
    }

    /// Corners, counter-clockwise.
    #[must_use]
    pub fn corners(&self) -> &[Point] {
        &self.corners[..self.count]
    }

    /// Edges: from, to.
    pub fn edges(&self) -> impl Iterator<Item = (Point, Point)> + Clone + '_ {
        (0..self.count).map(|n| (self.corners[n], self.corners[(n + 1) % self.count]))
    }

    /// Greatest product of a corner with a vector: how far the shape reaches in its direction, m, if its length is 1.
    #[must_use]
    pub fn reach(&self, direction: Point) -> f64 {
        let product = |corner: &Point| corner.x * direction.x + corner.y * direction.y;
        self.corners().iter().map(product).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Foremost x, m.
    #[must_use]
    pub fn front(&self) -> f64 {
        self.reach(Point { x: 1.0, y: 0.0 })
    }

    /// Rearmost x, m.
    #[must_use]
    pub fn rear(&self) -> f64 {
        -self.reach(Point { x: -1.0, y: 0.0 })
    }

    /// Greatest distance of a corner from the x axis, m.
    #[must_use]
    pub fn half_width(&self) -> f64 {
        self.corners().iter().fold(0.0, |most, corner| f64::max(most, libm::fabs(corner.y)))
    }

    /// Greatest distance of a corner from the origin, m.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.corners().iter().fold(0.0, |most, corner| f64::max(most, libm::hypot(corner.x, corner.y)))
    }

    /// Area, m².
    #[must_use]
    pub fn area(&self) -> f64 {
        self.edges().map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>() / 2.0
    }

    /// Distance by which a point is outside of the farthest edge, m: at most its distance; negative within.
    #[must_use]
    pub fn outside(&self, point: Point) -> f64 {
        let beyond = |(a, b): (Point, Point)| -turn(a, b, point) / a.distance(b);
        self.edges().map(beyond).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The point of the shape that is nearest to a point; the point itself within it.
    #[must_use]
    pub fn nearest(&self, point: Point) -> Point {
        if self.outside(point) <= 0.0 {
            return point;
        }
        let mut found = (f64::INFINITY, point);
        for (a, b) in self.edges() {
            let (dx, dy) = (b.x - a.x, b.y - a.y);
            let part = ((point.x - a.x) * dx + (point.y - a.y) * dy) / (dx * dx + dy * dy);
            let part = part.clamp(0.0, 1.0);
            let near = Point { x: a.x + part * dx, y: a.y + part * dy };
            let distance = near.distance(point);
            if distance < found.0 {
                found = (distance, near);
            }
        }
        found.1
    }

    /// Distance of a point from the shape, m; 0 within.
    #[must_use]
    pub fn distance(&self, point: Point) -> f64 {
        self.nearest(point).distance(point)
    }

    /// The shape with a margin around it, m, at least 0: each edge is that much farther out, and a corner of less than
    /// 90° is cut off at that distance, so that it does not grow longer than needed. Contains all points within the
    /// margin.
    #[must_use]
    pub fn grown(&self, margin: f64) -> Self {
        // Lines: normal outwards, and offset along it.
        let mut lines = [(Point::default(), 0.0); 2 * SHAPE_CORNERS_MAX];
        let mut count = 0;
        let normal = |(a, b): (Point, Point)| {
            let length = a.distance(b);
            Point { x: (b.y - a.y) / length, y: (a.x - b.x) / length }
        };
        let mut add = |out: Point, through: Point| {
            lines[count] = (out, out.x * through.x + out.y * through.y + margin);
            count += 1;
        };
        let next = self.edges().cycle().skip(1);
        for (edge, next) in self.edges().zip(next) {
            let (one, other) = (normal(edge), normal(next));
            add(one, edge.1);
            if one.x * other.x + one.y * other.y < 0.0 {
                let (x, y) = (one.x + other.x, one.y + other.y);
                let length = libm::hypot(x, y);
                // Of a corner of nearly 0° the bisector is along its edge, turned by 90°.
                let out = if length > 1e-9 { Point { x: x / length, y: y / length } } else { turned(one) };
                add(out, edge.1);
            }
        }
        let mut corners = [Point::default(); 2 * SHAPE_CORNERS_MAX];
        for n in 0..count {
            let ((one, first), (other, second)) = (lines[n], lines[(n + 1) % count]);
            let turn = one.x * other.y - one.y * other.x;
            corners[n] = if turn > 1e-9 {
                let x = (first * other.y - second * one.y) / turn;
                Point { x, y: (second * one.x - first * other.x) / turn }
            } else {
                let corner = self.corners[(n + 1) % self.count];
                Point { x: corner.x + margin * one.x, y: corner.y + margin * one.y }
            };
        }
        Self::hull(&corners[..count]).unwrap_or(*self)
    }
}

/// A quarter of a turn counter-clockwise.
fn turned(point: Point) -> Point {
    Point { x: -point.y, y: point.x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn shape(corners: &[(f64, f64)]) -> Shape {
        Shape::hull(&corners.iter().map(|&(x, y)| Point { x, y }).collect::<Vec<_>>()).expect("a shape")
    }

    const HEXAGON: [(f64, f64); 6] = [(0.4, 0.0), (0.2, 0.25), (-0.2, 0.25), (-0.4, 0.0), (-0.2, -0.25), (0.2, -0.25)];

    #[test]
    fn a_shape_is_a_hull_and_knows_its_extent() {
        let ell = shape(&[(0.0, 0.0), (0.6, 0.0), (0.6, 0.2), (0.2, 0.2), (0.2, 0.5), (0.0, 0.5)]);
        assert_eq!(ell.corners().len(), 5);
        assert!((ell.area() - (0.3 - 0.5 * 0.4 * 0.3)).abs() < 1e-12, "{}", ell.area());
        let hexagon = shape(&HEXAGON);
        let extent = (hexagon.front(), hexagon.rear(), hexagon.half_width(), hexagon.radius());
        assert_eq!(extent, (0.4, -0.4, 0.25, 0.4));
        assert_eq!(Shape::hull(&[Point::default(); 5]), None);
        let round = |n: usize| {
            let (y, x) = libm::sincos(core::f64::consts::TAU * n as f64 / 40.0);
            Point { x, y }
        };
        assert_eq!(Shape::hull(&(0..40).map(round).collect::<Vec<_>>()), None, "more corners than fit in");
    }

    #[test]
    fn distances_are_those_of_the_polygon() {
        let points: Vec<Point> = HEXAGON.iter().map(|&(x, y)| Point { x, y }).collect();
        let (shape, polygon) = (shape(&HEXAGON), Polygon::hull(&points).expect("a polygon"));
        for n in 0..400 {
            let point = Point { x: f64::from(n % 20) * 0.1 - 1.0, y: f64::from(n / 20) * 0.1 - 1.0 };
            assert!((shape.outside(point) - polygon.outside(point)).abs() < 1e-12, "{point:?}");
            assert!((shape.distance(point) - polygon.distance(point)).abs() < 1e-12, "{point:?}");
        }
    }

    #[test]
    fn a_grown_shape_holds_all_points_within_the_margin_and_no_far_ones() {
        let needle = [(1.0, 0.0), (-0.2, 0.1), (-0.2, -0.1)];
        for corners in [&HEXAGON[..], &needle, &[(0.0, 0.0), (0.5, 0.0), (0.0, 0.5)]] {
            let (small, grown) = (shape(corners), shape(corners).grown(0.1));
            for n in 0..10_000 {
                let point = Point { x: f64::from(n % 100) * 0.02 - 0.6, y: f64::from(n / 100) * 0.02 - 1.0 };
                let (distance, inside) = (small.distance(point), grown.outside(point) <= 1e-9);
                assert!(inside || distance > 0.1, "{point:?} at {distance}");
                assert!(!inside || distance < 0.1 * 1.4143, "{point:?} at {distance}");
            }
        }
    }

    #[test]
    fn a_nearly_straight_corner_grows_as_its_edges_do() {
        let flat = shape(&[(0.0, 0.0), (1.0, -1e-7), (2.0, 0.0), (1.0, 1.0)]);
        let grown = flat.grown(0.1);
        assert!(grown.outside(Point { x: 1.0, y: -0.0999 }) <= 0.0);
        let grown = Polygon::hull(flat.corners()).expect("a polygon").grown(|_| 0.1);
        assert!(grown.outside(Point { x: 1.0, y: -0.0999 }) <= 0.0, "{grown:?}");
        let below = grown.corners().iter().filter(|corner| corner.y < 0.0).map(|corner| corner.y);
        assert!(below.fold(f64::NEG_INFINITY, f64::max) < -0.0999, "{grown:?}");
    }
}
