//! Drawing into a map: each cell that a shape touches becomes occupied.

use super::{Cell, FrameError, Map};

/// Point, m.
type Point = (f64, f64);

impl Map {
    /// Creates a map of walls, round columns and filled areas, large enough for all of them and for the point `within`.
    /// Its cells are at multiples of the resolution: shapes within the cells of such a grid occupy the same cells here.
    ///
    /// # Errors
    /// A coordinate is not a number, or the coordinates are too far apart.
    pub fn drawn(
        walls: &[(Point, Point)],
        columns: &[(Point, f64)],
        areas: &[Vec<Point>],
        within: Point,
        resolution: f64,
    ) -> Result<Self, FrameError> {
        let walls_at = walls.iter().flat_map(|(a, b)| [*a, *b]);
        let columns_at = columns.iter().flat_map(|((x, y), r)| [(x - r, y - r), (x + r, y + r)]);
        let all = walls_at.chain(columns_at).chain(areas.iter().flatten().copied());
        let (low, high) = all.fold((within, within), |(low, high), (x, y)| {
            ((low.0.min(x), low.1.min(y)), (high.0.max(x), high.1.max(y)))
        });
        let low = (multiple(low.0, resolution), multiple(low.1, resolution));
        // One cell of margin, so that shapes that end on a cell's edge are drawn as well.
        let mut map = Self::around(
            (low.0 - resolution, low.1 - resolution),
            (high.0 + resolution, high.1 + resolution),
            resolution,
        )?;
        walls.iter().for_each(|(a, b)| map.wall(*a, *b));
        columns.iter().for_each(|(centre, radius)| map.column(*centre, *radius));
        areas.iter().for_each(|area| map.polygon(area));
        Ok(map)
    }

    /// Draws a wall between two points, m: all cells that the line passes through.
    pub fn wall(&mut self, a: (f64, f64), b: (f64, f64)) {
        let frame = self.frame;
        let grid = |(x, y): (f64, f64)| ((x - frame.x) / frame.resolution, (y - frame.y) / frame.resolution);
        let ((ax, ay), (bx, by)) = (grid(a), grid(b));
        if ![ax, ay, bx, by].iter().all(|value| value.is_finite()) {
            return;
        }
        let ((left, from), (right, to)) = if ax <= bx { ((ax, ay), (bx, by)) } else { ((bx, by), (ax, ay)) };
        let slope = if right > left { (to - from) / (right - left) } else { 0.0 };
        // For each column: the rows between the points where the line enters and leaves.
        let Some((first, last)) = range(left, right, frame.width) else { return };
        for column in first..=last {
            let enters = if right > left { from + slope * ((column as f64).max(left) - left) } else { from };
            let leaves = if right > left { from + slope * ((column as f64 + 1.0).min(right) - left) } else { to };
            let Some((low, high)) = range(enters.min(leaves), enters.max(leaves), frame.height) else { continue };
            (low..=high).for_each(|row| self.set(column, row, Cell::Occupied));
        }
    }

    /// Draws a round column, m: all cells that it touches.
    pub fn column(&mut self, centre: (f64, f64), radius: f64) {
        let frame = self.frame;
        let (x, y, radius) = (
            (centre.0 - frame.x) / frame.resolution,
            (centre.1 - frame.y) / frame.resolution,
            radius / frame.resolution,
        );
        let Some((low, high)) = range(y - radius, y + radius, frame.height) else { return };
        for row in low..=high {
            let off = outside(y, row);
            let half = libm::sqrt((radius * radius - off * off).max(0.0));
            let Some((first, last)) = range(x - half, x + half, frame.width) else { continue };
            (first..=last).for_each(|column| self.set(column, row, Cell::Occupied));
        }
    }

    /// Draws a filled polygon, m: its edges, and all cells whose middle is inside by the even-odd rule.
    pub fn polygon(&mut self, corners: &[(f64, f64)]) {
        let frame = self.frame;
        let edges = || corners.iter().zip(corners.iter().cycle().skip(1));
        edges().for_each(|(&a, &b)| self.wall(a, b));
        let mut crossings = Vec::new();
        for row in 0..frame.height {
            let (_, y) = frame.centre(0, row);
            crossings.clear();
            crossings.extend(
                edges()
                    .filter(|(a, b)| (a.1 > y) != (b.1 > y))
                    .map(|(a, b)| a.0 + (y - a.1) / (b.1 - a.1) * (b.0 - a.0)),
            );
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                // From the first middle right of one edge to the last middle left of the next.
                let low = (pair[0] - frame.x) / frame.resolution - 0.5;
                let high = (pair[1] - frame.x) / frame.resolution - 0.5;
                let first = libm::ceil(low).max(0.0);
                let last = libm::floor(high).min(frame.width as f64 - 1.0);
                if first <= last {
                    (first as usize..=last as usize).for_each(|column| self.set(column, row, Cell::Occupied));
                }
            }
        }
    }
}

/// Greatest multiple of a resolution up to `at`; `at` itself if only rounding separates it from one.
fn multiple(at: f64, resolution: f64) -> f64 {
    let cells = at / resolution;
    if libm::fabs(cells - libm::round(cells)) < 1e-6 { at } else { libm::floor(cells) * resolution }
}

/// Range of cells from `low` to `high`, both in cells; `None` if it is outside `0..count` or not a number.
fn range(low: f64, high: f64, count: usize) -> Option<(usize, usize)> {
    let (low, high) = (libm::floor(low), libm::floor(high));
    let inside = low <= high && high >= 0.0 && low < count as f64;
    inside.then(|| (low.max(0.0) as usize, (high as usize).min(count - 1)))
}

/// Distance of a coordinate from a cell, in cells.
fn outside(at: f64, cell: usize) -> f64 {
    (cell as f64 - at).max(at - (cell as f64 + 1.0)).max(0.0)
}
