//! The machine's clocks and their conversion to the scales that modules use.

use base::{Epoch, Instant};
use nix::time::{ClockId, clock_gettime};

/// Time between two readings from which a thread was held up, and how often both are tried.
const HELD_UP: std::time::Duration = std::time::Duration::from_micros(100);
const TRIES: u32 = 10;

/// Current time on the monotonic scale, which counts from the machine's start.
#[must_use]
pub fn now() -> Instant {
    Instant::from_nanos(read(ClockId::CLOCK_MONOTONIC))
}

/// Wall clock, nanoseconds since the UNIX epoch.
#[must_use]
pub fn wall() -> u64 {
    read(ClockId::CLOCK_REALTIME)
}

/// Both clocks at one instant: a thread that was held up between the two reads them again.
#[must_use]
pub fn both() -> (Instant, u64) {
    for _ in 0..TRIES {
        let (before, wall, after) = (now(), wall(), now());
        if after.since(before) < HELD_UP {
            return (before, wall);
        }
    }
    (now(), wall())
}

/// Current offset between the monotonic scale and the wall clock; a process reads it once.
#[must_use]
pub fn epoch() -> Epoch {
    let (now, wall) = both();
    Epoch { offset_us: (wall / 1000) as i64 - (now.as_nanos() / 1000) as i64 }
}

/// Converts the kernel's receive time, on the wall clock, to the monotonic scale; at most `now`. A step of the wall
/// clock between reception and now is an error of that size: after a forward step a message counts as older than it is,
/// after a backward step an old one counts as new. The kernel stamps datagrams on no other clock.
#[must_use]
pub fn received(now: Instant, kernel_ns: u64) -> Instant {
    now - std::time::Duration::from_nanos(wall().saturating_sub(kernel_ns))
}

fn read(clock: ClockId) -> u64 {
    // Neither clock can fail on Linux.
    let time = clock_gettime(clock).unwrap_or_else(|errno| panic!("{clock:?}: {errno}"));
    time.tv_sec() as u64 * 1_000_000_000 + time.tv_nsec() as u64
}
