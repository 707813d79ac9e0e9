//! A picture of a run that one can mail: the way over the map, and below it on one time line what the robot did, why it
//! stood, what was reported and which state each module was in. As SVG or PNG.
//!
//! Fed with messages, from wherever: a recording (`advee plot`) or an observer of a virtual machine. Memory is bounded
//! whatever comes: a long run is shown with less detail. Knows no files. [`data`] is what is kept, [`map`], [`timeline`]
//! and [`page`] are how it looks, [`canvas`] is what it is drawn on.

#![forbid(unsafe_code)]

mod axis;
mod canvas;
mod data;
mod letters;
mod map;
mod page;
mod palette;
mod raster;
mod series;
mod style;
mod svg;
#[cfg(test)]
mod tests;
mod timeline;

pub use data::{Picture, Title};

/// The outline of the robot, a rectangle; all in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Bumper to bumper.
    pub length_m: f64,
    /// Side to side.
    pub width_m: f64,
    /// From the rear axle, which a pose is of, to the rear bumper.
    pub rear_overhang_m: f64,
}
