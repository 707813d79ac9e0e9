//! The robot's boards and drives as they are on the wire (`docs/facts/boards.md`), each with the scene behind it.

pub mod battery;
pub(crate) mod can_line;
mod canopen_drive;
pub mod cia402;
pub(crate) mod climate;
mod controller;
pub mod drive;
pub mod drive_line;
pub(crate) mod encoder;
pub mod epos;
pub(crate) mod fan1;
pub(crate) mod feed_line;
pub mod icla;
pub(crate) mod line;
mod mirror;
mod motor;
pub mod output;
pub mod psc1;
pub mod sbs1;
pub mod sd1;
pub mod so1;
