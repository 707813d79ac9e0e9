//! Picture of a run that can be sent by mail: the path on the map, and below it on one time line the motion, the causes
//! of standstill, the reports and the state of each module. As SVG or PNG.
//!
//! Fed with messages from any source: a recording (`advee plot`) or an observer of a virtual machine. Memory is bounded
//! for any input: a long run is shown with less detail. No file access. `data` is the content, `map`, `timeline`
//! and `page` are the layout, `canvas` is the drawing surface.
//!
//! ```
//! use messages::simulation::DataTruth;
//! use plot::{Footprint, Picture, Title};
//! use simulator::world::World;
//!
//! // Ten seconds along the middle of a hall of 20 m by 12 m.
//! let outline = Footprint { length_m: 0.9, width_m: 0.6, rear_overhang_m: 0.15, corners: Vec::new() };
//! let mut picture = Picture::new(World::hall(20.0, 12.0), Some(outline));
//! assert!(picture.is_empty());
//! let begin = 1_767_225_600_000_000; // µs since the UNIX epoch
//! for second in 0..=10 {
//!     let x = 4.0 + f64::from(second);
//!     let truth = DataTruth { x, y: 6.0, ..DataTruth::default() };
//!     picture.take(begin + 1_000_000 * i64::from(second), &truth.into());
//! }
//! picture.mark(begin + 5_000_000, "the middle");
//! picture.entitle(Title { run: "2026_01_01_00_00_00".into(), ..Title::default() });
//!
//! let svg = picture.svg();
//! assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
//! let png = picture.png()?;
//! assert_eq!(png[..4], *b"\x89PNG");
//! # Ok::<(), String>(())
//! ```

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

/// Outline of the robot, a rectangle or a polygon; all in m.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    /// Length, bumper to bumper.
    pub length_m: f64,
    /// Width.
    pub width_m: f64,
    /// Distance from the rear axle, the reference point of a pose, to the rear bumper.
    pub rear_overhang_m: f64,
    /// Corners of the polygon in the robot's frame, in order; empty: the rectangle.
    pub corners: Vec<navitools::Point>,
}
