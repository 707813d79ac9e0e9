//! Collision check of the robot's outline, a rectangle or a convex polygon, against the distance field.

use super::lattice::Sample;
use crate::map::Field;
use crate::path::Move;
use kinematics::{Shape, Twist};
use navitools::{Point, Pose};

/// Largest turn between two checked poses on the spot, rad: a corner leaves the chord by less than a millimetre.
const TURN_MAX_RAD: f64 = 0.08;

/// Rectangle around the rear axle's middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Length, m; above zero.
    pub length_m: f64,
    /// Width, m; above zero.
    pub width_m: f64,
    /// Distance from the rear edge to the rear axle, m; within the length.
    pub rear_m: f64,
}

impl Footprint {
    /// Footprint enlarged by a margin on each side, m.
    #[must_use]
    pub fn grown(self, margin_m: f64) -> Self {
        Self {
            length_m: self.length_m + 2.0 * margin_m,
            width_m: self.width_m + 2.0 * margin_m,
            rear_m: self.rear_m + margin_m,
        }
    }

    /// True if no occupied cell touches the footprint, and all of it is on the map.
    #[must_use]
    pub fn is_free(&self, field: &Field, pose: Pose) -> bool {
        let (sin, cos) = pose.theta.sin_cos();
        Body::new(*self, field).is_free(field, pose.x, pose.y, sin, cos)
    }

    /// Corners, m, counter-clockwise.
    #[must_use]
    pub fn corners(&self) -> [Point; 4] {
        let (front, rear, side) = (self.length_m - self.rear_m, -self.rear_m, self.width_m / 2.0);
        [(rear, -side), (front, -side), (front, side), (rear, side)].map(|(x, y)| Point { x, y })
    }
}

/// Footprint prepared for many checks on one field.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Body {
    /// Distance from the rear axle to the middle.
    pub(crate) ahead: f64,
    half_length: f64,
    half_width: f64,
    /// Distance of the middle from obstacles at and above which the rectangle is free.
    outer: f32,
    /// Distance of the middle from obstacles at and below which the rectangle touches one.
    pub(crate) inner: f32,
    /// Circles that cover the rectangle: their spacing, the number on each side of the middle one, and their `outer`.
    apart: f64,
    beside: u32,
    circle: f32,
    /// Outline within that rectangle; `None`: the rectangle itself.
    shape: Option<Shape>,
    /// Radius of the circle around the middle that the outline holds, m.
    within: f64,
}

/// Points of the axis among which the middle of a polygon is chosen.
const MIDDLES: u32 = 64;

/// What circles show of a pose.
enum Circles {
    /// Free, and each point may move that far, m.
    Free(f32),
    Touch,
    Unclear,
}

impl Body {
    pub(crate) fn new(footprint: Footprint, field: &Field) -> Self {
        let Footprint { length_m, width_m, rear_m } = footprint;
        let (half_length, half_width) = (length_m / 2.0, width_m / 2.0);
        let resolution = field.frame().resolution;
        // A point is at most half a diagonal from its cell's middle, and so is an edge of the obstacle.
        let half_diagonal = resolution * core::f64::consts::FRAC_1_SQRT_2;
        let outer = |radius: f64| (radius + 2.0 * half_diagonal) as f32;
        let short = half_length.min(half_width);
        // Enough circles that they are only a little wider than the rectangle.
        let count = libm::ceil(half_length / half_width * 1.5).clamp(1.0, 15.0) as u32 | 1;
        let each = half_length / f64::from(count);
        Self {
            ahead: half_length - rear_m,
            half_length,
            half_width,
            outer: outer(libm::hypot(half_length, half_width)),
            inner: (short - half_diagonal) as f32,
            apart: 2.0 * each,
            beside: count / 2,
            circle: outer(libm::hypot(each, half_width)),
            shape: None,
            within: short,
        }
    }

    /// A convex polygon with the reference point in it. Its middle is the point of the axis that is farthest from its
    /// edges; the circles cover the rectangle around that point.
    pub(crate) fn shaped(shape: &Shape, field: &Field) -> Self {
        let (rear, front) = (shape.rear(), shape.front());
        let (mut ahead, mut within) = (0.0, -shape.outside(Point::default()));
        for part in 0..=MIDDLES {
            let x = rear + (front - rear) * f64::from(part) / f64::from(MIDDLES);
            let depth = -shape.outside(Point { x, y: 0.0 });
            if depth > within {
                (ahead, within) = (x, depth);
            }
        }
        let half_length = (front - ahead).max(ahead - rear);
        let rectangle =
            Footprint { length_m: 2.0 * half_length, width_m: 2.0 * shape.half_width(), rear_m: half_length - ahead };
        let body = Self::new(rectangle, field);
        let half_diagonal = field.frame().resolution * core::f64::consts::FRAC_1_SQRT_2;
        Self { inner: (within - half_diagonal) as f32, shape: Some(*shape), within, ..body }
    }

    /// Distance of the field at the middle.
    pub(crate) fn middle(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64) -> f32 {
        field.distance(x + self.ahead * cos, y + self.ahead * sin)
    }

    pub(crate) fn is_free(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64) -> bool {
        match self.circles(field, Sample { x, y, sin, cos }) {
            Circles::Free(_) => true,
            Circles::Touch => false,
            Circles::Unclear => self.is_free_exactly(field, Sample { x, y, sin, cos }),
        }
    }

    /// Check by circles.
    fn circles(&self, field: &Field, Sample { x, y, sin, cos }: Sample) -> Circles {
        let (x, y) = (x + self.ahead * cos, y + self.ahead * sin);
        let distance = field.bound(x, y);
        if distance >= self.outer {
            return Circles::Free(distance - self.outer);
        }
        if distance <= self.inner {
            return Circles::Touch;
        }
        let mut room = distance - self.circle;
        for circle in 1..=self.beside {
            if room < 0.0 {
                return Circles::Unclear;
            }
            let away = f64::from(circle) * self.apart;
            let (dx, dy) = (away * cos, away * sin);
            room = room.min(field.bound(x + dx, y + dy).min(field.bound(x - dx, y - dy)) - self.circle);
        }
        if room < 0.0 { Circles::Unclear } else { Circles::Free(room) }
    }

    /// Distance that each point of the rectangle may move without touching an obstacle, m, as far as circles show it: a
    /// lower bound. `None` if they show that it touches one.
    pub(crate) fn room(&self, field: &Field, at: Sample) -> Option<f32> {
        match self.circles(field, at) {
            Circles::Free(room) => Some(room),
            Circles::Unclear => Some(0.0),
            Circles::Touch => None,
        }
    }

    /// True if the rectangle is free at all samples of a motion, relative to a point, between which no corner moves
    /// farther than `way`, m. Those that are that close to one with room around it need no check.
    pub(crate) fn is_free_along(&self, field: &Field, from: (f64, f64), samples: &[Sample], way: f32) -> bool {
        let mut left = samples.len();
        // The end first: if it is not free, the poses in between do not matter.
        while left > 0 {
            let at = &samples[left - 1];
            let at = Sample { x: from.0 + at.x, y: from.1 + at.y, ..*at };
            let room = match self.circles(field, at) {
                Circles::Free(room) => room,
                Circles::Unclear if self.is_free_exactly(field, at) => 0.0,
                Circles::Unclear | Circles::Touch => return false,
            };
            left = left.saturating_sub(1 + (room / way) as usize);
        }
        true
    }

    /// True if no occupied cell touches the rectangle, and all of it is on the map. Exact: in each row of cells, it
    /// touches those between its leftmost and rightmost point in the row.
    fn is_free_exactly(&self, field: &Field, Sample { x, y, sin, cos }: Sample) -> bool {
        if let Some(shape) = &self.shape {
            return is_free_exactly(shape, field, Sample { x, y, sin, cos });
        }
        let frame = field.frame();
        let per_metre = 1.0 / frame.resolution;
        let (along, across) = (libm::fabs(cos), libm::fabs(sin));
        let (length, width) = (self.half_length * per_metre, self.half_width * per_metre);
        // Half edges, in cells: one goes up and to the right, the other one up and to the left.
        let (right, left) = if sin * cos >= 0.0 {
            ((length * along, length * across), (-width * across, width * along))
        } else {
            ((width * across, width * along), (-length * along, length * across))
        };
        let middle = ((x + self.ahead * cos - frame.x) * per_metre, (y + self.ahead * sin - frame.y) * per_metre);
        let half = (right.0 - left.0, right.1 + left.1);
        let (bottom, top) = (middle.1 - half.1, middle.1 + half.1);
        let (least, most) = (middle.0 - half.0, middle.0 + half.0);
        let inside = least >= 0.0 && bottom >= 0.0 && most <= frame.width as f64 && top <= frame.height as f64;
        if !inside {
            return false;
        }
        // The lowest corner, and the heights of the leftmost and the rightmost one.
        let lowest = middle.0 - right.0 - left.0;
        let (left_at, right_at) = (middle.1 - right.1 + left.1, middle.1 + right.1 - left.1);
        let (rising, falling) = (right.0 / right.1, left.0 / left.1);
        let last = libm::ceil(top) as usize;
        for row in bottom as usize..last {
            let (low, high) = ((row as f64).max(bottom), ((row + 1) as f64).min(top));
            let from = if high < left_at {
                lowest + (high - bottom) * falling
            } else if low > left_at {
                least + (low - left_at) * rising
            } else {
                least
            };
            let to = if high < right_at {
                lowest + (high - bottom) * rising
            } else if low > right_at {
                most + (low - right_at) * falling
            } else {
                most
            };
            let (from, to) = (from.max(0.0) as usize, libm::ceil(to) as usize);
            if to > from && field.is_occupied(row, from, to.min(frame.width) - 1) {
                return false;
            }
        }
        true
    }

    /// Way of the fastest point of the rectangle for each metre of a motion, or rad on the spot, m.
    pub(crate) fn way(&self, part: Move) -> f64 {
        let Twist { vx, vy, omega } = part.twist();
        if let Some(shape) = &self.shape {
            let speed = |corner: &Point| libm::hypot(vx - omega * corner.y, vy + omega * corner.x);
            return shape.corners().iter().map(speed).fold(0.0, f64::max);
        }
        let farthest = self.half_length + libm::fabs(self.ahead);
        libm::hypot(libm::fabs(vx) + libm::fabs(omega) * self.half_width, libm::fabs(vy) + libm::fabs(omega) * farthest)
    }

    /// Largest distance between two poses of a motion, along the rear axle's way, m, or rad on the spot, such that
    /// nothing between them is farther than `deviation` outside of both rectangles, m.
    ///
    /// A corner that moves by d, at the angle a to an edge, leaves a triangle between the rectangles, of the height
    /// d sin a cos a.
    pub(crate) fn spacing(&self, part: Move, deviation: f64) -> f64 {
        let Twist { vx, vy, omega } = part.twist();
        if let Some(shape) = &self.shape {
            let most = if matches!(part, Move::Turn(_)) { TURN_MAX_RAD } else { self.within };
            return (deviation / height(shape, part.twist())).min(most);
        }
        let ends = [self.ahead + self.half_length, self.ahead - self.half_length];
        let sides = [self.half_width, -self.half_width];
        let corners = ends.into_iter().flat_map(|x| sides.map(|y| (x, y)));
        let height = corners.map(|(x, y)| {
            let (along, across) = (libm::fabs(vx - omega * y), libm::fabs(vy + omega * x));
            along * across / libm::hypot(along, across)
        });
        // No obstacle passes between two rectangles that overlap.
        let most = match part {
            Move::Arc(_) => self.half_length,
            Move::Aside(_) => self.half_width,
            Move::Turn(_) => TURN_MAX_RAD,
        };
        (deviation / height.fold(0.0, f64::max)).min(most)
    }

    /// Penetration from which the robot cannot drive out, m.
    pub(crate) fn depth_max(&self) -> f64 {
        self.within
    }

    /// Largest penetration of an occupied cell, m; 0 if free; infinite if part of it is off the map. Exact: squares
    /// against a rectangle by the separating axis test.
    pub(crate) fn depth(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64) -> f64 {
        if let Some(shape) = &self.shape {
            return depth(shape, field, Sample { x, y, sin, cos });
        }
        let frame = field.frame();
        let (x, y) = (x + self.ahead * cos, y + self.ahead * sin);
        let (along, across) = (libm::fabs(cos), libm::fabs(sin));
        let half_x = self.half_length * along + self.half_width * across;
        let half_y = self.half_length * across + self.half_width * along;
        let low = frame.cell(x - half_x, y - half_y);
        let high = frame.cell(x + half_x, y + half_y);
        let (Some((left, bottom)), Some((right, top))) = (low, high) else { return f64::INFINITY };
        let half_cell = frame.resolution / 2.0 * (along + across);
        let (length, width) = (self.half_length + half_cell, self.half_width + half_cell);
        let mut deepest = 0f64;
        for row in bottom..=top {
            for column in field.occupied(row, left, right) {
                let (cx, cy) = frame.centre(column, row);
                let (dx, dy) = (cx - x, cy - y);
                let along = length - libm::fabs(dx * cos + dy * sin);
                let across = width - libm::fabs(dy * cos - dx * sin);
                deepest = deepest.max(along.min(across));
            }
        }
        deepest
    }
}

/// A shape's edges at a pose.
fn edges(shape: &Shape, at: Sample) -> impl Iterator<Item = (Point, Point)> + Clone + '_ {
    let place = move |Point { x, y }: Point| {
        let Point { x, y } = Point { x: at.cos * x - at.sin * y, y: at.sin * x + at.cos * y };
        Point { x: at.x + x, y: at.y + y }
    };
    shape.edges().map(move |(a, b)| (place(a), place(b)))
}

/// Lower left and upper right corner of the rectangle around a shape's edges.
fn extent(edges: impl Iterator<Item = (Point, Point)>) -> (Point, Point) {
    let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
    edges.fold((Point { x: low, y: low }, Point { x: high, y: high }), |(low, high), (a, _)| {
        let low = Point { x: low.x.min(a.x), y: low.y.min(a.y) };
        (low, Point { x: high.x.max(a.x), y: high.y.max(a.y) })
    })
}

/// True if no occupied cell touches the shape, and all of it is on the map: in each row of cells, it touches those
/// between its leftmost and rightmost point in the row.
fn is_free_exactly(shape: &Shape, field: &Field, at: Sample) -> bool {
    let frame = field.frame();
    let per_metre = 1.0 / frame.resolution;
    let cell = |point: Point| Point { x: (point.x - frame.x) * per_metre, y: (point.y - frame.y) * per_metre };
    let edges = edges(shape, at).map(|(a, b)| (cell(a), cell(b)));
    let (low, high) = extent(edges.clone());
    let inside = low.x >= 0.0 && low.y >= 0.0 && high.x <= frame.width as f64 && high.y <= frame.height as f64;
    if !inside {
        return false;
    }
    for row in low.y as usize..libm::ceil(high.y) as usize {
        let (bottom, top) = (row as f64, (row + 1) as f64);
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        for (a, b) in edges.clone() {
            let (under, over) = if a.y <= b.y { (a, b) } else { (b, a) };
            if over.y < bottom || under.y > top {
                continue;
            }
            let slope = (over.x - under.x) / (over.y - under.y);
            // Of an edge along the row both ends count.
            let cut = |y: f64, end: Point| if y == end.y { end.x } else { under.x + (y - under.y) * slope };
            for x in [cut(under.y.max(bottom), under), cut(over.y.min(top), over)] {
                (from, to) = (from.min(x), to.max(x));
            }
        }
        let (from, to) = (from.max(0.0) as usize, libm::ceil(to) as usize);
        if to > from && field.is_occupied(row, from, to.min(frame.width) - 1) {
            return false;
        }
    }
    true
}

/// Largest penetration of an occupied cell into the shape, m, by the separating axis test; 0 if free; infinite if
/// part of it is off the map.
fn depth(shape: &Shape, field: &Field, at: Sample) -> f64 {
    let frame = field.frame();
    let edges = edges(shape, at);
    let (low, high) = extent(edges.clone());
    let (low, high) = (frame.cell(low.x, low.y), frame.cell(high.x, high.y));
    let (Some((left, bottom)), Some((right, top))) = (low, high) else { return f64::INFINITY };
    let half = frame.resolution / 2.0;
    let mut deepest = 0f64;
    for row in bottom..=top {
        for column in field.occupied(row, left, right) {
            let (x, y) = frame.centre(column, row);
            let beyond = |(a, b): (Point, Point)| {
                let (dx, dy) = (b.x - a.x, b.y - a.y);
                let reach = half * (libm::fabs(dx) + libm::fabs(dy));
                (reach + dx * (y - a.y) - dy * (x - a.x)) / libm::hypot(dx, dy)
            };
            deepest = deepest.max(edges.clone().map(beyond).fold(f64::INFINITY, f64::min));
        }
    }
    deepest
}

/// Largest distance of a point between two poses of a shape from both, by the distance of the poses, for small ones.
///
/// A corner that is the outermost one across its motion, with the angles a and b between that and its edges, leaves a
/// triangle between the poses. The point of its base that is as far from both edges is at sin a sin b / (sin a + sin b)
/// of the corner's way. What any other corner passes is within one of the poses.
fn height(shape: &Shape, twist: Twist) -> f64 {
    let next = shape.edges().cycle().skip(1);
    let height = |((before, corner), (_, after)): ((Point, Point), (Point, Point))| {
        let (vx, vy) = (twist.vx - twist.omega * corner.y, twist.vy + twist.omega * corner.x);
        let speed = libm::hypot(vx, vy);
        let sine = |end: Point| {
            let (dx, dy) = (end.x - corner.x, end.y - corner.y);
            (vx * dy - vy * dx) / (speed * libm::hypot(dx, dy))
        };
        let (one, other) = (sine(before), sine(after));
        // Both edges on the same side of the motion.
        if speed > 0.0 && one * other > 0.0 { speed * libm::fabs(one * other / (one + other)) } else { 0.0 }
    };
    shape.edges().zip(next).map(height).fold(0.0, f64::max)
}
