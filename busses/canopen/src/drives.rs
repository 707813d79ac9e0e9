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

use crate::master::Farewell;
use base::Duration;

/// The inhibit time of a TPDO in its unit, 100 us.
fn inhibit(time: Duration) -> u16 {
    u16::try_from(time.as_micros() / 100).unwrap_or(u16::MAX)
}

/// A quick stop for a drive that is not heard any more, and the time that its ramp takes from `speed`; in the drive's
/// own units, of which `deceleration` is per second. At most 2 s: a drive that is dead is waited for in vain.
fn quick_stop(number: u8, data: &[u8], speed: u32, deceleration: u32) -> Farewell {
    let ramp = u64::from(speed) * 1000 / u64::from(deceleration.max(1));
    let data = heapless::Vec::from_slice(data).unwrap_or_default();
    Farewell { number, data, pause: Duration::from_millis(ramp.min(2000)) }
}
