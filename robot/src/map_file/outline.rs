//! Outline of a map's free space: the walls of a world.
//!
//! Each edge between a free cell and one that is not is part of exactly one wall; edges in a line are one wall. What is
//! behind an edge is left out: no body and no ray reaches it. Occupied, unknown and beyond the map are the same here.

use navitools::Point;
use planner::map::{Cell, Map};
use simulator::world::Segment;

/// Maximum number of walls that a map may become.
pub const WALLS_MAX: usize = 1 << 14;

/// Distance of a wall from its edge, in cells, into the cell that is not free. So a map that is drawn from the walls
/// has its occupied cells where this one has them.
const INSET: f64 = 1e-3;

/// Largest absolute coordinate of a world, m.
const REACH: f64 = 1e4;

/// The walls around a map's free cells.
///
/// Cells that are not free and touch only with a corner are joined there by a short wall, so that nothing passes.
///
/// # Errors
/// The map has no free cell, is beyond ±10 km, or has more than [`WALLS_MAX`] walls.
pub fn walls(map: &Map) -> Result<Vec<Segment>, String> {
    let frame = map.frame();
    if !map.cells().contains(&Cell::Free) {
        return Err("the map has no free cell".into());
    }
    let (right, top) = (frame.width as f64 * frame.resolution, frame.height as f64 * frame.resolution);
    let corners = [frame.x - frame.resolution, frame.y - frame.resolution, frame.x + right, frame.y + top];
    if corners.iter().any(|at| at.abs() > REACH - frame.resolution) {
        return Err(format!("the map is not within ±{REACH} m"));
    }
    let mut outline = Outline { map, walls: Vec::new() };
    outline.along_y()?;
    outline.along_x()?;
    outline.at_corners()?;
    Ok(outline.walls)
}

struct Outline<'a> {
    map: &'a Map,
    walls: Vec<Segment>,
}

impl Outline<'_> {
    /// True for a free cell of the map.
    fn is_free(&self, column: isize, row: isize) -> bool {
        let frame = self.map.frame();
        let within = |at: isize, count: usize| usize::try_from(at).ok().filter(|at| *at < count);
        match (within(column, frame.width), within(row, frame.height)) {
            (Some(column), Some(row)) => self.map.cells()[row * frame.width + column] == Cell::Free,
            _ => false,
        }
    }

    /// Point of the grid, and how far from it along each axis, in insets.
    fn point(&self, column: isize, row: isize, x: f64, y: f64) -> Point {
        let frame = self.map.frame();
        Point {
            x: frame.x + (column as f64 + x * INSET) * frame.resolution,
            y: frame.y + (row as f64 + y * INSET) * frame.resolution,
        }
    }

    fn add(&mut self, a: Point, b: Point) -> Result<(), String> {
        if self.walls.len() == WALLS_MAX {
            return Err(format!(
                "the map's free space has more than {WALLS_MAX} walls: too many to simulate; a coarser or a cleaner \
                 map has fewer"
            ));
        }
        self.walls.push(Segment { a, b });
        Ok(())
    }

    /// Walls along y, from column to column.
    fn along_y(&mut self) -> Result<(), String> {
        let (columns, rows) = (self.map.frame().width as isize, self.map.frame().height as isize);
        for column in 0..=columns {
            // By whether the left one of two cells is the free one.
            for (free, solid, into) in [(column - 1, column, 1.0), (column, column - 1, -1.0)] {
                let edge = |outline: &Self, row| outline.is_free(free, row) && !outline.is_free(solid, row);
                let mut begin = None;
                for row in 0..=rows {
                    match (begin, edge(self, row)) {
                        (None, true) => begin = Some(row),
                        (Some(first), false) => {
                            let low = if self.is_free(solid, first - 1) { 1.0 } else { -1.0 };
                            let high = if self.is_free(solid, row) { -1.0 } else { 1.0 };
                            self.add(self.point(column, first, into, low), self.point(column, row, into, high))?;
                            begin = None;
                        }
                        _ => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// Walls along x, from row to row.
    fn along_x(&mut self) -> Result<(), String> {
        let (columns, rows) = (self.map.frame().width as isize, self.map.frame().height as isize);
        for row in 0..=rows {
            for (free, solid, into) in [(row - 1, row, 1.0), (row, row - 1, -1.0)] {
                let edge = |outline: &Self, column| outline.is_free(column, free) && !outline.is_free(column, solid);
                let mut begin = None;
                for column in 0..=columns {
                    match (begin, edge(self, column)) {
                        (None, true) => begin = Some(column),
                        (Some(first), false) => {
                            let low = if self.is_free(first - 1, solid) { 1.0 } else { -1.0 };
                            let high = if self.is_free(column, solid) { -1.0 } else { 1.0 };
                            self.add(self.point(first, row, low, into), self.point(column, row, high, into))?;
                            begin = None;
                        }
                        _ => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// Walls through the points where two cells that are not free touch with a corner, and the other two are free.
    fn at_corners(&mut self) -> Result<(), String> {
        let (columns, rows) = (self.map.frame().width as isize, self.map.frame().height as isize);
        for row in 1..rows {
            for column in 1..columns {
                let [left, right] = [column - 1, column].map(|column| self.is_free(column, row - 1));
                let above = [column - 1, column].map(|column| self.is_free(column, row));
                if left == right || above != [right, left] {
                    continue;
                }
                // From the lower left cell to the upper right one, or from the upper left one to the lower right one.
                let up = if left { -1.0 } else { 1.0 };
                self.add(self.point(column, row, -1.0, -up), self.point(column, row, 1.0, up))?;
            }
        }
        Ok(())
    }
}
