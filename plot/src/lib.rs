//! Picture of a run that can be sent by mail: the path on the map, and below it on one time line the motion, the causes
//! of standstill, the reports and the state of each module. As SVG or PNG.
//!
//! Fed with messages from any source: a recording (`advee plot`) or an observer of a virtual machine. Memory is bounded
//! for any input: a long run is shown with less detail. No file access. [`data`] is the content, [`map`], [`timeline`]
//! and [`page`] are the layout, [`canvas`] is the drawing surface.

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

/// Outline of the robot, a rectangle; all in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Length, bumper to bumper.
    pub length_m: f64,
    /// Width.
    pub width_m: f64,
    /// Distance from the rear axle, the reference point of a pose, to the rear bumper.
    pub rear_overhang_m: f64,
}
