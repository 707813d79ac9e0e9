//! A robot's folder: its configuration, and the modules, ports and processes that it describes.
//!
//! [`config`] reads the files strictly, [`topology`] makes modules and ports of them, for the live host and for virtual
//! time; [`recording`] does the same from what a run recorded.
#![forbid(unsafe_code)]

pub mod checks;
pub mod config;
mod launch;
pub mod map_file;
pub mod place;
pub mod recording;
pub mod scene;
mod simulated;
pub mod topology;
