//! The robot's two drives, as thin tables over [`Master`](crate::Master), [`axis`](crate::axis) and [`cia402`]; the
//! table of any other drive out of its data sheet is [`mod@derive`]'s.
//!
//! Both drives also offer the dictionary of their simulated twin. What drives a robot is a file each, `epos.toml` and
//! `icla.toml` of the crate `drivers`, which this crate cannot read; a test there compares them with the tables here. A
//! drive that needs code is another file here: `docs/adding-a-drive.md`.

pub mod cia402;
mod cia402_objects;
pub mod derive;
pub mod epos;
mod epos_objects;
pub mod icla;
mod icla_objects;
pub mod motor;
#[cfg(test)]
mod tests;
