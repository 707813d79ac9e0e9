//! From goals to motion: obstacles, planning, following.
#![forbid(unsafe_code)]

mod config;
pub mod goal;
pub mod goal_state;
pub mod guard;
pub mod map;
pub mod mission;
pub mod obstacles;
pub mod path;
pub mod people;
mod planner;
pub mod ranges;
pub mod route;
pub mod search;
pub mod senses;
pub mod track;

pub use config::{Body, Config, Limits, Manners, Settings};
pub use planner::{NAME, Planner};
