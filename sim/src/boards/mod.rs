//! The robot's boards as they are on the wire (`docs/boards.md`), each with the scene behind it.

pub(crate) mod line;
pub mod motion;
pub mod sd1;
pub mod so1;
