//! Map: a grid of cells that are free, occupied or unknown, drawn from walls or read from a picture.
//!
//! No file access: [`pgm`] and [`yaml`] parse bytes and text that the host has read. [`Field`] has the distances to
//! occupied cells.

mod draw;
mod field;
pub mod pgm;
pub mod yaml;

pub use field::{Field, Obstacle, Unknown};

use std::fmt;

/// Maximum number of cells: a picture of 4096 × 4096.
pub const CELLS_MAX: usize = 1 << 24;

/// Range of the resolution, m.
pub const RESOLUTION: std::ops::RangeInclusive<f64> = 1e-3..=10.0;

/// Largest absolute coordinate of the origin, m.
pub const ORIGIN_MAX: f64 = 1e6;

/// State of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Cell {
    /// Known to be free.
    #[default]
    Free,
    /// Known to be occupied.
    Occupied,
    /// Not observed.
    Unknown,
}

/// Position, resolution and size of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Outer corner of the first cell, x, m.
    pub x: f64,
    /// Outer corner of the first cell, y, m.
    pub y: f64,
    /// Side of a cell, m.
    pub resolution: f64,
    /// Number of cells along x.
    pub width: usize,
    /// Number of cells along y.
    pub height: usize,
}

/// Reason why a grid is invalid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameError {
    /// Resolution not a number within [`RESOLUTION`].
    Resolution(f64),
    /// Origin not a number within ±[`ORIGIN_MAX`].
    Origin(f64, f64),
    /// No cell, or more than [`CELLS_MAX`].
    Size {
        /// Number of cells along x.
        width: usize,
        /// Number of cells along y.
        height: usize,
    },
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Resolution(value) => write!(f, "a resolution of {value} m: expected 0.001 to 10 m"),
            Self::Origin(x, y) => write!(f, "an origin at {x}, {y}: expected numbers within ±{ORIGIN_MAX} m"),
            Self::Size { width, height } => write!(f, "{width} × {height} cells: expected 1 to {CELLS_MAX}"),
        }
    }
}

impl std::error::Error for FrameError {}

impl Frame {
    /// Validates the frame.
    ///
    /// # Errors
    /// The size, resolution or origin is not a number or is out of range.
    pub fn check(&self) -> Result<(), FrameError> {
        let Self { x, y, resolution, width, height } = *self;
        if !RESOLUTION.contains(&resolution) {
            return Err(FrameError::Resolution(resolution));
        }
        if ![x, y].iter().all(|value| (-ORIGIN_MAX..=ORIGIN_MAX).contains(value)) {
            return Err(FrameError::Origin(x, y));
        }
        match width.checked_mul(height) {
            Some(1..=CELLS_MAX) => Ok(()),
            _ => Err(FrameError::Size { width, height }),
        }
    }

    /// Cell that contains a point; `None` outside the grid and for NaN.
    #[must_use]
    pub fn cell(&self, x: f64, y: f64) -> Option<(usize, usize)> {
        let (column, row) = ((x - self.x) / self.resolution, (y - self.y) / self.resolution);
        let inside = column >= 0.0 && row >= 0.0 && column < self.width as f64 && row < self.height as f64;
        inside.then_some((column as usize, row as usize))
    }

    /// Middle of a cell, m.
    #[must_use]
    pub fn centre(&self, column: usize, row: usize) -> (f64, f64) {
        (self.x + (column as f64 + 0.5) * self.resolution, self.y + (row as f64 + 0.5) * self.resolution)
    }

    /// Right edge, m.
    pub(crate) fn right(&self) -> f64 {
        self.x + self.width as f64 * self.resolution
    }

    /// Upper edge, m.
    pub(crate) fn top(&self) -> f64 {
        self.y + self.height as f64 * self.resolution
    }

    /// Columns and rows, first and last, of the rectangle of this half width and half height around a point of the
    /// grid, as far as it is on the grid; `None` if the point is not.
    pub(crate) fn cells_within(&self, x: f64, y: f64, half_x: f64, half_y: f64) -> Option<[usize; 4]> {
        self.cell(x, y)?;
        let column = |x: f64| (((x - self.x) / self.resolution).max(0.0) as usize).min(self.width - 1);
        let row = |y: f64| (((y - self.y) / self.resolution).max(0.0) as usize).min(self.height - 1);
        Some([column(x - half_x), column(x + half_x), row(y - half_y), row(y + half_y)])
    }

    /// True if a point is beyond the edges.
    #[must_use]
    pub fn is_outside(&self, x: f64, y: f64) -> bool {
        !((self.x..=self.right()).contains(&x) && (self.y..=self.top()).contains(&y))
    }

    /// Distance of a point from the grid, m; 0 within its edges.
    #[must_use]
    pub fn distance(&self, x: f64, y: f64) -> f64 {
        let beyond = |value: f64, low: f64, high: f64| (low - value).max(value - high).max(0.0);
        libm::hypot(beyond(x, self.x, self.right()), beyond(y, self.y, self.top()))
    }

    /// Extent of the grid as in texts: "0…20 by 0…12 m".
    #[must_use]
    pub fn extent(&self) -> impl fmt::Display {
        // Rounded to a centimetre; adding zero turns -0 into 0.
        let [x, y, right, top] =
            [self.x, self.y, self.right(), self.top()].map(|at| libm::round(at * 100.0) / 100.0 + 0.0);
        format!("{x}…{right} by {y}…{top} m")
    }

    pub(crate) fn index(&self, column: usize, row: usize) -> usize {
        row * self.width + column
    }
}

/// Cells in a frame, row by row from the lowest y.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    frame: Frame,
    cells: Vec<Cell>,
}

impl Map {
    /// Creates a map with all cells free.
    ///
    /// # Errors
    /// The frame is invalid (size, resolution or origin out of range).
    pub fn new(frame: Frame) -> Result<Self, FrameError> {
        frame.check()?;
        Ok(Self { frame, cells: vec![Cell::Free; frame.width * frame.height] })
    }

    /// Creates an empty map that contains the rectangle between two corners, m.
    ///
    /// # Errors
    /// The frame is invalid (size, resolution or origin out of range).
    pub fn around(low: (f64, f64), high: (f64, f64), resolution: f64) -> Result<Self, FrameError> {
        let cells = |span: f64| libm::ceil(span / resolution - 1e-9).clamp(0.0, CELLS_MAX as f64 + 1.0) as usize;
        let (width, height) = (cells(high.0 - low.0), cells(high.1 - low.1));
        Self::new(Frame { x: low.0, y: low.1, resolution, width, height })
    }

    /// Position, resolution and size.
    #[must_use]
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Cells, row by row from the lowest y.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// State of the cell at a point; `None` outside the map.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> Option<Cell> {
        self.frame.cell(x, y).map(|(column, row)| self.cells[self.frame.index(column, row)])
    }

    /// Sets a cell; no effect outside the map.
    pub fn set(&mut self, column: usize, row: usize, cell: Cell) {
        if column < self.frame.width && row < self.frame.height {
            let index = self.frame.index(column, row);
            self.cells[index] = cell;
        }
    }
}

#[cfg(test)]
mod tests;
