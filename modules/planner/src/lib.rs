//! From goals to motion: obstacles, path planning, path following.
//!
//! A drivable path in a small map:
//!
//! ```
//! use navitools::{Point, Pose};
//! use planner::map::{Field, Map, Unknown};
//! use planner::search::{Budget, Footprint, Goal, Limits, Search};
//!
//! // A room of 8 m by 6 m with cells of 10 cm, and a wall in it that leaves a passage of 2.5 m.
//! let mut map = Map::around((0.0, 0.0), (8.0, 6.0), 0.1)?;
//! map.wall((4.0, 0.0), (4.0, 3.5));
//! let field = Field::new(&map, Unknown::Blocked);
//!
//! let footprint = Footprint { length_m: 0.9, width_m: 0.6, rear_m: 0.15 };
//! let mut search = Search::new(Limits::new(footprint, 0.86));
//! let start = Pose::new(1.0, 1.0, 0.0);
//! let goal = Goal { x: 7.0, y: 1.0, heading: None, tolerance_m: 0.0 };
//! let path = search.plan(&field, start, goal, Budget::default())?;
//!
//! // Arcs that the robot can drive one after the other, round the end of the wall to the goal.
//! assert!(path.length() > 8.0 && path.length() < 12.0);
//! let end = path.moves().iter().fold(start, |pose, part| part.from(pose));
//! assert!(end.point().distance(Point { x: 7.0, y: 1.0 }) < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod ahead;
pub mod attention;
mod config;
pub mod goal;
pub mod goal_state;
pub mod map;
pub mod mission;
pub mod mode;
pub mod obstacles;
pub mod parameters;
pub mod path;
pub mod people;
mod planner;
pub mod ranges;
pub mod route;
pub mod search;
pub mod senses;
pub mod track;

pub use config::{Behaviour, Body, Config, Limits, Settings};
pub use kinematics::Direction;
pub use planner::{NAME, Planner};
