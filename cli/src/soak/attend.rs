//! What a person sees of a soak while it runs, and Ctrl-C, which ends it and keeps what was judged.

use crate::Failed;
use crate::bus::{interrupt, wait};
use crate::progress;
use base::Duration;
use nix::sys::signalfd::SignalFd;
use sim::soak::Violation;
use std::io::Write;
use std::os::fd::AsFd;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

/// Interval at which signals and the ends of threads are looked for.
const LOOK: Duration = Duration::from_millis(20);

/// Shows on standard error what was found, and on a terminal how far it is; ends the work at SIGINT and SIGTERM.
pub struct Progress {
    shown: Option<Shown>,
    stop: AtomicBool,
    /// Number of the signal; 0 without one.
    signal: AtomicU32,
    done: AtomicU32,
    violations: AtomicU32,
}

struct Shown {
    episodes: u64,
    each: Duration,
    line: Mutex<progress::Progress>,
    signals: SignalFd,
}

impl Progress {
    /// Progress of that many episodes of a length.
    ///
    /// # Errors
    /// Signals cannot be received.
    pub(super) fn new(episodes: u64, each: Duration) -> Result<Self, Failed> {
        let line = Mutex::new(progress::Progress::new(""));
        let shown = Shown { episodes, each, line, signals: interrupt()? };
        Ok(Self { shown: Some(shown), ..Self::none() })
    }

    /// Shows nothing, and receives no signal.
    #[must_use]
    pub fn none() -> Self {
        Self {
            shown: None,
            stop: AtomicBool::new(false),
            signal: AtomicU32::new(0),
            done: AtomicU32::new(0),
            violations: AtomicU32::new(0),
        }
    }

    /// Set once the work is to end.
    pub(super) fn stop(&self) -> &AtomicBool {
        &self.stop
    }

    /// Signal that ended the work.
    pub(super) fn signal(&self) -> Option<u8> {
        u8::try_from(self.signal.load(Ordering::Relaxed)).ok().filter(|signal| *signal > 0)
    }

    /// Number of episodes that were judged.
    #[cfg(test)]
    pub(super) fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed).into()
    }

    /// An episode was judged.
    pub(super) fn judged(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// A rule was violated: what follows until the report, other episodes and the search for fewer faults, takes long.
    pub(super) fn found(&self, number: u64, violation: &Violation) {
        self.violations.fetch_add(1, Ordering::Relaxed);
        self.tell(&format!("episode {number}: {violation}"));
    }

    /// A line on standard error, beside the report on standard output.
    pub(super) fn tell(&self, line: &str) {
        if let Some(shown) = &self.shown {
            shown.line().clear();
            // A failure cannot be reported.
            let _ = std::io::stderr().write_all(format!("{line}\n").as_bytes());
        }
    }

    /// Runs `work` in so many threads, and attends to signals meanwhile.
    pub(super) fn run<T: Send>(&self, threads: usize, work: impl Fn() -> T + Sync) -> Vec<T> {
        thread::scope(|scope| {
            let threads: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(&work)).collect();
            if let Some(shown) = &self.shown {
                while !threads.iter().all(thread::ScopedJoinHandle::is_finished) {
                    self.attend(shown);
                }
                shown.line().clear();
            }
            threads.into_iter().map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
        })
    }

    fn attend(&self, shown: &Shown) {
        if let Ok(Some(signal)) = shown.signals.read_signal() {
            self.signal.store(signal.ssi_signo, Ordering::Relaxed);
            self.stop.store(true, Ordering::Relaxed);
        }
        shown.show(self.done.load(Ordering::Relaxed).into(), self.violations.load(Ordering::Relaxed));
        if wait(&[shown.signals.as_fd()], LOOK).is_err() {
            thread::sleep(LOOK);
        }
    }
}

impl Shown {
    fn line(&self) -> MutexGuard<'_, progress::Progress> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn show(&self, done: u64, violations: u32) {
        let share = done as f64 / self.episodes.max(1) as f64;
        self.line().show(share, |took| text([done, self.episodes], self.each, violations, took));
    }
}

/// Hours done of all, of episodes of a length; how much faster than time; violations.
fn text(episodes: [u64; 2], each: Duration, violations: u32, took: Duration) -> String {
    let [done, all] = episodes.map(|episodes| episodes as f64 * each.as_secs_f64() / 3600.0);
    let factor = done * 3600.0 / took.as_secs_f64().max(1e-3);
    let violations = match violations {
        0 => "no violation".into(),
        1 => "1 violation".into(),
        several => format!("{several} violations"),
    };
    format!("{done:.1} of {all:.1} h  {factor:.0}x  {violations}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_tells_hours_speed_and_violations() {
        let (each, took) = (Duration::from_secs(360), Duration::from_secs(36));
        let said = [0, 1, 2].map(|violations| text([94, 200], each, violations, took));
        let hours = "9.4 of 20.0 h  940x  ";
        assert_eq!(said, ["no violation", "1 violation", "2 violations"].map(|end| format!("{hours}{end}")));
    }
}
