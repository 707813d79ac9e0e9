//! Folder of a robot: its configuration, and the modules, ports and processes that it describes.
//!
//! [`config`] reads the files strictly, [`topology`] creates modules and ports from them, for the live host and for
//! virtual time; [`recording`] does the same from the recording of a run.
#![forbid(unsafe_code)]

pub mod checks;
pub mod config;
pub mod map_file;
pub mod place;
pub mod recording;
pub mod scene;
pub mod topology;
