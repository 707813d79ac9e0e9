//! Whether the machine itself stood still: a thread on each processor that wants to run each 5 ms and says when it could
//! not.

use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::unistd::Pid;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(5);
/// Held up for this long, a figure in milliseconds says nothing any more. The bounds have 40 ms of slack.
pub const STALL: Duration = Duration::from_millis(40);

/// Stalls so far: from when to when.
#[derive(Clone, Default)]
pub struct Canary(Arc<Mutex<Vec<(Instant, Instant)>>>);

impl Canary {
    /// On every processor that this process may use; they live as long as it.
    pub fn start() -> Self {
        let canary = Self::default();
        let may = sched_getaffinity(Pid::from_raw(0)).expect("the processors");
        for cpu in (0..CpuSet::count()).filter(|cpu| may.is_set(*cpu).unwrap_or(false)) {
            let canary = canary.clone();
            std::thread::spawn(move || canary.watch(cpu));
        }
        canary
    }

    fn watch(&self, cpu: usize) {
        let mut own = CpuSet::new();
        own.set(cpu).expect("it is there");
        sched_setaffinity(Pid::from_raw(0), &own).expect("it may be used");
        let mut last = Instant::now();
        loop {
            std::thread::sleep(PERIOD);
            let now = Instant::now();
            if now - last >= STALL + PERIOD {
                self.0.lock().unwrap_or_else(PoisonError::into_inner).push((last, now));
            }
            last = now;
        }
    }

    /// Whether it stood between these moments, and how long at most.
    pub fn stalled(&self, from: Instant, to: Instant) -> Option<Duration> {
        let stalls = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let within = stalls.iter().rev().take(1000).filter(|(begin, end)| *begin < to && *end > from);
        within.map(|(begin, end)| *end - *begin).max()
    }
}
