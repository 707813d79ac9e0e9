//! The local shared-memory bus: contexts of one host and user exchange messages through memory, beside plain LCM.
//! Every context has a station, a file in the folder of the bus in `/dev/shm`: a ring with its published messages, its
//! subscriptions, and its sleep state. Publishing writes to the own ring and wakes the sleeping contexts that want the
//! channel; receiving reads the rings of all. Datagrams are sent only while a process outside the folder may be
//! listening; a context reads a publisher with a station from its ring and drops its datagrams.
//!
//! | file | knows |
//! |---|---|
//! | `ring` | records, the writer and the reader of a ring |
//! | `bell` | the word that says who sleeps |
//! | `station` | where what lies in shared memory |
//! | `folder` | names, locks, who is dead |
//! | `listeners` | who else listens |
//! | `bus` | all of it together |
//! | `memory` | the mapping |

mod bell;
mod bus;
mod folder;
mod listeners;
pub(crate) mod memory;
mod ring;
mod station;

pub(crate) use bus::Bus;

/// The atomics of shared memory: words of 64 bits, of 32 where the machine has no larger ones. `loom` has its own.
mod sync {
    pub use super::memory::{load_all, store_all};
    #[cfg(not(target_has_atomic = "64"))]
    pub use core::sync::atomic::AtomicU32 as Word;
    #[cfg(target_has_atomic = "64")]
    pub use core::sync::atomic::AtomicU64 as Word;
    pub use core::sync::atomic::{Ordering, fence};
    #[cfg(not(target_has_atomic = "64"))]
    pub type Value = u32;
    #[cfg(target_has_atomic = "64")]
    pub type Value = u64;
}

#[cfg(test)]
mod tests;
