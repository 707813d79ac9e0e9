//! The map: a grid of cells that are free, occupied or unknown; drawn from walls, or read from a picture.
//!
//! Knows no file: [`pgm`] and [`yaml`] read bytes and text that the host has opened. Distances to what is occupied are
//! [`Field`]'s.

mod draw;
mod field;
pub mod pgm;
pub mod yaml;

pub use field::{Field, Obstacle, Unknown};

use std::fmt;

/// At most so many cells: a picture of 4096 × 4096.
pub const CELLS_MAX: usize = 1 << 24;

/// Resolutions are within this, m.
pub const RESOLUTION: std::ops::RangeInclusive<f64> = 1e-3..=10.0;

/// The origin is within this of zero, m.
pub const ORIGIN_MAX: f64 = 1e6;

/// What is known of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Cell {
    /// Nothing is there.
    #[default]
    Free,
    /// Something is there.
    Occupied,
    /// Nobody has looked.
    Unknown,
}

/// Where a grid lies and how fine it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The outer corner of the first cell, m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// A cell's side, m.
    pub resolution: f64,
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
}

/// Why a grid cannot be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameError {
    /// The resolution is no number within [`RESOLUTION`].
    Resolution(f64),
    /// The origin is no number within ±[`ORIGIN_MAX`].
    Origin(f64, f64),
    /// No cell, or more than [`CELLS_MAX`].
    Size {
        /// Cells along x.
        width: usize,
        /// Cells along y.
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
    /// Checks it.
    ///
    /// # Errors
    /// A number is none or out of range.
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

    /// The cell of a point; `None` outside of the grid, and for what is no number.
    #[must_use]
    pub fn cell(&self, x: f64, y: f64) -> Option<(usize, usize)> {
        let (column, row) = ((x - self.x) / self.resolution, (y - self.y) / self.resolution);
        let inside = column >= 0.0 && row >= 0.0 && column < self.width as f64 && row < self.height as f64;
        inside.then_some((column as usize, row as usize))
    }

    /// The middle of a cell, m.
    #[must_use]
    pub fn centre(&self, column: usize, row: usize) -> (f64, f64) {
        (self.x + (column as f64 + 0.5) * self.resolution, self.y + (row as f64 + 0.5) * self.resolution)
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
    /// A map on which everything is free.
    ///
    /// # Errors
    /// The frame is none.
    pub fn new(frame: Frame) -> Result<Self, FrameError> {
        frame.check()?;
        Ok(Self { frame, cells: vec![Cell::Free; frame.width * frame.height] })
    }

    /// An empty map that holds the rectangle between two corners, m.
    ///
    /// # Errors
    /// The frame is none.
    pub fn around(low: (f64, f64), high: (f64, f64), resolution: f64) -> Result<Self, FrameError> {
        let cells = |span: f64| libm::ceil(span / resolution - 1e-9).clamp(0.0, CELLS_MAX as f64 + 1.0) as usize;
        let (width, height) = (cells(high.0 - low.0), cells(high.1 - low.1));
        Self::new(Frame { x: low.0, y: low.1, resolution, width, height })
    }

    /// Where it lies.
    #[must_use]
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The cells, row by row from the lowest y.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// What is known of a point; outside of the map `None`.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> Option<Cell> {
        self.frame.cell(x, y).map(|(column, row)| self.cells[self.frame.index(column, row)])
    }

    /// Sets a cell; outside of the map nothing happens.
    pub fn set(&mut self, column: usize, row: usize, cell: Cell) {
        if column < self.frame.width && row < self.frame.height {
            let index = self.frame.index(column, row);
            self.cells[index] = cell;
        }
    }
}

#[cfg(test)]
mod tests;
