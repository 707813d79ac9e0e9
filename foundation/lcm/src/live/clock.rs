//! The two clocks, and a timer that an event loop can watch.

use super::{RealtimeNanos, context};
use nix::sys::time::{TimeSpec, TimeValLike};
use nix::sys::timerfd::{ClockId, Expiration, TimerFd, TimerFlags, TimerSetTimeFlags};
use nix::time::{ClockId as Clock, clock_gettime};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

/// Wall-clock time.
pub fn realtime() -> RealtimeNanos {
    RealtimeNanos(now(Clock::CLOCK_REALTIME))
}

/// Nanoseconds of the monotonic clock.
pub fn monotonic() -> i64 {
    now(Clock::CLOCK_MONOTONIC)
}

fn now(clock: Clock) -> i64 {
    // Both clocks are always there (clock_gettime(2)).
    clock_gettime(clock).map_or(0, |time| time.num_nanoseconds())
}

/// A descriptor that is readable from a moment of the monotonic clock on.
#[derive(Debug)]
pub struct Timer(TimerFd);

impl Timer {
    /// A timer that is not set.
    pub fn new() -> io::Result<Self> {
        let flags = TimerFlags::TFD_NONBLOCK | TimerFlags::TFD_CLOEXEC;
        TimerFd::new(ClockId::CLOCK_MONOTONIC, flags).map(Self).map_err(context("cannot make a timer"))
    }

    /// Readable from `at` on, in nanoseconds of [`monotonic`], and not before.
    pub fn set_at(&self, at: i64) -> io::Result<()> {
        // 0 would be "never".
        self.set(TimeSpec::nanoseconds(at.max(1)), TimerSetTimeFlags::TFD_TIMER_ABSTIME)
    }

    /// Readable after `after`, and not before.
    pub fn set_after(&self, after: Duration) -> io::Result<()> {
        self.set(TimeSpec::from_duration(after.max(Duration::from_nanos(1))), TimerSetTimeFlags::empty())
    }

    fn set(&self, time: TimeSpec, flags: TimerSetTimeFlags) -> io::Result<()> {
        self.0.set(Expiration::OneShot(time), flags).map_err(context("cannot set a timer"))
    }

    /// Never readable.
    pub fn clear(&self) -> io::Result<()> {
        self.0.unset().map_err(context("cannot clear a timer"))
    }

    /// True if its moment has come; true only once.
    pub fn expired(&self) -> bool {
        self.0.wait().is_ok()
    }
}

impl AsFd for Timer {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
