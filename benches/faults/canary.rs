//! Detector for stalls of the machine: one thread per processor that should run every 5 ms and records when it could
//! not.

use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::unistd::Pid;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(5);
/// Stall from which figures in milliseconds are meaningless. The bounds have 40 ms of slack.
pub const STALL: Duration = Duration::from_millis(40);

/// Stalls so far: beginning and end.
#[derive(Clone, Default)]
pub struct Canary(Arc<Mutex<Vec<(Instant, Instant)>>>);

impl Canary {
    /// Starts a thread on every processor available to this process; they run as long as it.
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

    /// Longest stall between these instants, if any.
    pub fn stalled(&self, from: Instant, to: Instant) -> Option<Duration> {
        let stalls = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let within = stalls.iter().rev().take(1000).filter(|(begin, end)| *begin < to && *end > from);
        within.map(|(begin, end)| *end - *begin).max()
    }
}
