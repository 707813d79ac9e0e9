//! From goals to motion: obstacles, planning, following.
#![forbid(unsafe_code)]

mod config;
pub mod goal;
pub mod guard;
pub mod mission;
pub mod obstacles;
mod planner;
pub mod route;
pub mod senses;
pub mod track;

pub use config::{Body, Config, Limits, Manners};
pub use planner::{NAME, Planner};
