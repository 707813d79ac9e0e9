//! Folder of a robot: its configuration, and the modules, ports and processes that it describes.
//!
//! [`config`] reads the files strictly, [`topology`] creates modules and ports from them, for the live host and for
//! virtual time; [`recording`] does the same from the recording of a run.
//!
//! ```
//! use robot::config::{Config, ConfigError, parsed_world};
//! use robot::map_file;
//! use settings::Node;
//! use std::path::Path;
//!
//! // A file is refused as a whole, with a line for each key that is wrong.
//! let robot = Node::parse(Path::new("robot.toml"), "[robot]\nname = \"small\"\ncolour = \"red\"\n").unwrap();
//! let modules = Node::parse(Path::new("modules.toml"), "[[modules]]\nname = \"planner\"\n").unwrap();
//! let refused = Config::merge::<&str>(robot, None, modules, &[]);
//! let Err(ConfigError(lines)) = refused else { panic!("colour is not a key") };
//! assert!(lines.iter().any(|line| line.starts_with("robot.toml:3: robot.colour")));
//!
//! // A world, with one key overridden as by `--set world.start=…`; it gives the planner its map.
//! let path = Path::new("room.toml");
//! let text = "start = [1.0, 1.0, 0.0]\nwalls = [[0.0, 0.0, 4.0, 0.0], [4.0, 0.0, 4.0, 3.0]]\n";
//! let room = Node::parse(path, text).unwrap();
//! let world = parsed_world(room, path, &["world.start=[2.0, 1.5, 0.0]".into()])?;
//! assert_eq!((world.walls.len(), world.start.x), (2, 2.0));
//! let map = map_file::of_world(&world)?;
//! assert_eq!(map.at(4.0, 1.0), Some(planner::map::Cell::Occupied));
//! assert_eq!(map.at(2.0, 1.5), Some(planner::map::Cell::Free));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod checks;
pub mod config;
mod launch;
pub mod map_file;
#[cfg(feature = "ros2")]
mod node;
pub mod picture;
pub mod place;
mod ports;
pub mod preflight;
pub mod recording;
pub mod scene;
mod sheets;
mod simulated;
pub mod topology;
