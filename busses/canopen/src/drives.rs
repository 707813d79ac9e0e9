//! The robot's two drives, as thin tables over [`Master`](crate::Master) and [`axis`](crate::axis).
//!
//! Both also offer the dictionary of their simulated twin: driver and twin read one table. Another drive is another file
//! here: `docs/adding-a-drive.md`.

pub mod epos;
mod epos_objects;
pub mod icla;
mod icla_objects;
#[cfg(test)]
mod tests;

use base::Duration;

/// The inhibit time of a TPDO in its unit, 100 us.
fn inhibit(time: Duration) -> u16 {
    u16::try_from(time.as_micros() / 100).unwrap_or(u16::MAX)
}
