//! Collision check of the robot's rectangle against the distance field.

use crate::map::Field;
use navitools::Pose;

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

    /// Distance from the edges to the nearest occupied cell, m, to half a cell, and at most `most`; 0 in a collision.
    #[must_use]
    pub fn clearance(&self, field: &Field, pose: Pose, most: f64) -> f64 {
        let (sin, cos) = pose.theta.sin_cos();
        let body = Body::new(*self, field);
        if body.is_free(field, pose.x, pose.y, sin, cos) {
            body.clearance(field, pose.x, pose.y, sin, cos, most)
        } else {
            0.0
        }
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
    /// Inscribed circles at both ends: their distance from the middle.
    inscribed_at: f64,
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
            inscribed_at: half_length - short,
        }
    }

    /// Distance of the field at the middle.
    pub(crate) fn middle(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64) -> f32 {
        field.distance(x + self.ahead * cos, y + self.ahead * sin)
    }

    pub(crate) fn is_free(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64) -> bool {
        let (x, y) = (x + self.ahead * cos, y + self.ahead * sin);
        let distance = field.distance(x, y);
        if distance >= self.outer {
            return true;
        }
        if distance <= self.inner {
            return false;
        }
        let mut open = distance >= self.circle;
        for circle in 1..=self.beside {
            let away = f64::from(circle) * self.apart;
            let (dx, dy) = (away * cos, away * sin);
            open &= field.distance(x + dx, y + dy).min(field.distance(x - dx, y - dy)) >= self.circle;
        }
        if open {
            return true;
        }
        let (dx, dy) = (self.inscribed_at * cos, self.inscribed_at * sin);
        if field.distance(x + dx, y + dy).min(field.distance(x - dx, y - dy)) <= self.inner {
            return false;
        }
        !self.touches(field, x, y, sin, cos, |_| true)
    }

    /// Largest penetration of an occupied cell, m; 0 if free; infinite if part of it is off the map.
    pub(crate) fn depth(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64) -> f64 {
        let mut deepest = 0f64;
        let off = self.touches(field, x + self.ahead * cos, y + self.ahead * sin, sin, cos, |depth| {
            deepest = deepest.max(depth);
            false
        });
        if off { f64::INFINITY } else { deepest }
    }

    /// Penetration from which the robot cannot drive out, m.
    pub(crate) fn half_width(&self) -> f64 {
        self.half_width.min(self.half_length)
    }

    /// Calls `enough` with the penetration of each occupied cell that touches the rectangle, until it returns true;
    /// returns true then, and off the map. Exact: squares against a rectangle by the separating axis test.
    fn touches(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64, mut enough: impl FnMut(f64) -> bool) -> bool {
        let frame = field.frame();
        let (along, across) = (libm::fabs(cos), libm::fabs(sin));
        let half_x = self.half_length * along + self.half_width * across;
        let half_y = self.half_length * across + self.half_width * along;
        let low = frame.cell(x - half_x, y - half_y);
        let high = frame.cell(x + half_x, y + half_y);
        let (Some((left, bottom)), Some((right, top))) = (low, high) else { return true };
        let half_cell = frame.resolution / 2.0 * (along + across);
        let (length, width) = (self.half_length + half_cell, self.half_width + half_cell);
        let per_metre = (1.0 / frame.resolution) as f32;
        for row in bottom..=top {
            let mut column = left;
            while column <= right {
                let distance = field.cell(column, row);
                if distance > 0.0 {
                    // No cell is nearer than that.
                    column += ((distance * per_metre) as usize).max(1);
                    continue;
                }
                let (cx, cy) = frame.centre(column, row);
                let (dx, dy) = (cx - x, cy - y);
                let along = length - libm::fabs(dx * cos + dy * sin);
                let across = width - libm::fabs(dy * cos - dx * sin);
                if along > 0.0 && across > 0.0 && enough(along.min(across)) {
                    return true;
                }
                column += 1;
            }
        }
        false
    }

    /// Distance from the edges of a free rectangle to the nearest occupied cell.
    fn clearance(&self, field: &Field, x: f64, y: f64, sin: f64, cos: f64, most: f64) -> f64 {
        let (x, y) = (x + self.ahead * cos, y + self.ahead * sin);
        let frame = field.frame();
        let half = frame.resolution / 2.0;
        let reach = libm::hypot(self.half_length, self.half_width) + most + frame.resolution;
        // The edge of the map counts as an obstacle.
        let (right, top) =
            (frame.x + frame.width as f64 * frame.resolution, frame.y + frame.height as f64 * frame.resolution);
        let half_x = self.half_length * libm::fabs(cos) + self.half_width * libm::fabs(sin);
        let half_y = self.half_length * libm::fabs(sin) + self.half_width * libm::fabs(cos);
        let edges = [x - half_x - frame.x, right - x - half_x, y - half_y - frame.y, top - y - half_y];
        let mut least = edges.into_iter().fold(most, f64::min);
        let cell = |x: f64, y: f64| {
            let column = ((x - frame.x) / frame.resolution).clamp(0.0, frame.width as f64 - 1.0);
            (column as usize, ((y - frame.y) / frame.resolution).clamp(0.0, frame.height as f64 - 1.0) as usize)
        };
        let ((left, bottom), (right, top)) = (cell(x - reach, y - reach), cell(x + reach, y + reach));
        for row in bottom..=top {
            let mut column = left;
            while column <= right {
                let distance = field.cell(column, row);
                if distance > 0.0 {
                    column += ((distance / frame.resolution as f32) as usize).max(1);
                    continue;
                }
                let (cx, cy) = frame.centre(column, row);
                let (dx, dy) = (cx - x, cy - y);
                let along = (libm::fabs(dx * cos + dy * sin) - self.half_length).max(0.0);
                let across = (libm::fabs(dy * cos - dx * sin) - self.half_width).max(0.0);
                least = least.min((libm::hypot(along, across) - half).max(0.0));
                column += 1;
            }
        }
        least
    }
}
