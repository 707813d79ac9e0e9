//! How far long work is, on stderr where that is a terminal: `exporting [#####     ] 47 %  120 MB/s  ETA 0:42`.

use crate::Failed;
use crate::bus::interrupt;
use nix::sys::signal::SigSet;
use nix::sys::signalfd::SignalFd;
use std::io::{IsTerminal, Write};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Duration of work that needs no line.
const QUIET: Duration = Duration::from_millis(500);
const RENEWED: Duration = Duration::from_millis(100);
/// Period of the line beside a measurement, which it must not disturb.
const BESIDE: Duration = Duration::from_secs(1);
/// Width of the bar, characters.
const BAR: usize = 10;
/// Time before which the remaining time is not estimated.
const ESTIMATED: Duration = Duration::from_secs(1);

/// A line that is renewed, and erased at the end.
pub struct Progress {
    what: &'static str,
    begin: Instant,
    shown: Option<Instant>,
    terminal: bool,
}

impl Progress {
    pub fn new(what: &'static str) -> Self {
        Self { what, begin: Instant::now(), shown: None, terminal: std::io::stderr().is_terminal() }
    }

    /// Shows bytes done of all.
    pub fn tell(&mut self, done: u64, all: u64) {
        let share = if all == 0 { 1.0 } else { done as f64 / all as f64 };
        self.show(share, |took| format!("{:.0} MB/s", done as f64 / took.as_secs_f64().max(1e-3) / 1e6));
    }

    /// Shows the share that is done, 0 to 1, and a text about it, made from the time that the work has taken so far.
    pub fn show(&mut self, share: f64, text: impl FnOnce(Duration) -> String) {
        self.put(|what, took| line(what, share, left(share, took), &text(took)));
    }

    /// The same where the remaining time is known otherwise, s; `None` where it is not known.
    pub fn show_left(&mut self, share: f64, left: Option<f64>, text: impl FnOnce() -> String) {
        self.put(|what, _| line(what, share, left, &text()));
    }

    /// Shows that a time passes: all of it, where that is known.
    pub fn pass(&mut self, all: Option<Duration>) {
        self.put(|what, took| passing(what, took, all));
    }

    /// Shows work of which it is not known how much there is: a text about it, and how long it has taken so far.
    pub fn open(&mut self, text: impl FnOnce(Duration) -> String) {
        self.put(|what, took| endless(what, &text(took), took));
    }

    fn put(&mut self, line: impl FnOnce(&str, Duration) -> String) {
        if !self.terminal {
            return;
        }
        let now = Instant::now();
        let took = now - self.begin;
        if took < QUIET || self.shown.is_some_and(|shown| now - shown < RENEWED) {
            return;
        }
        self.shown = Some(now);
        put(&format!("\r\x1b[K{}", line(self.what, took)));
    }

    /// Erases the line and begins anew: other work of the same kind follows.
    pub fn restart(&mut self) {
        self.clear();
        self.begin = Instant::now();
    }

    /// Erases the line; the next [`Progress::show`] renews it.
    pub fn clear(&mut self) {
        if self.shown.take().is_some() {
            put("\r\x1b[K");
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}

/// A line beside a measurement that takes a known time: a thread of its own renews it each second, so that the one that
/// measures does not wait for a terminal. It is erased when this is dropped.
pub struct Beside(Option<(Sender<()>, JoinHandle<()>)>);

impl Beside {
    /// Begins to show it. To be called before this process gets a priority: the thread gets none.
    pub fn new(what: &'static str, all: Option<Duration>) -> Self {
        let mut progress = Progress::new(what);
        let Some(all) = all.filter(|_| progress.terminal) else { return Self(None) };
        let (alive, ended) = channel();
        let thread = thread::spawn(move || {
            // Signals are for the measuring thread.
            let _ = SigSet::all().thread_block();
            while ended.recv_timeout(BESIDE) == Err(RecvTimeoutError::Timeout) {
                progress.pass(Some(all));
            }
        });
        Self(Some((alive, thread)))
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        if let Some((alive, thread)) = self.0.take() {
            drop(alive);
            // Its panic would be shown already.
            let _ = thread.join();
        }
    }
}

/// Progress of work that SIGINT and SIGTERM end in good order.
pub struct Interruptible {
    progress: Progress,
    signals: SignalFd,
    /// What becomes of the result.
    left: &'static str,
}

impl Interruptible {
    /// Signals are held back from now on.
    pub fn new(what: &'static str, left: &'static str) -> Result<Self, Failed> {
        Ok(Self { progress: Progress::new(what), signals: interrupt()?, left })
    }

    /// Shows bytes done of all; an error after a signal.
    pub fn tell(&mut self, done: u64, all: u64) -> Result<(), Failed> {
        if let Ok(Some(signal)) = self.signals.read_signal() {
            let percent = done.saturating_mul(100).checked_div(all).unwrap_or(100).min(100);
            let code = u8::try_from(signal.ssi_signo).map_or(1, |signal| 128 + signal);
            return Err(Failed { code, why: format!("interrupted at {percent} %: {}", self.left) });
        }
        self.progress.tell(done, all);
        Ok(())
    }
}

fn put(text: &str) {
    // A failure cannot be reported.
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// A share from 0 to 1; 0 where it is not known.
fn sane(share: f64) -> f64 {
    if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
}

/// Remaining time, s, of work that goes on as before; `None` before that can be told.
fn left(share: f64, took: Duration) -> Option<f64> {
    let share = sane(share);
    let left = took.as_secs_f64() * (1.0 - share) / share;
    Some(left).filter(|left| left.is_finite() && took >= ESTIMATED)
}

fn line(what: &str, share: f64, left: Option<f64>, text: &str) -> String {
    let share = sane(share);
    let head = if what.is_empty() { String::new() } else { format!("{what} ") };
    let bar = "#".repeat((share * BAR as f64) as usize);
    let eta = left.map_or("-".into(), clock);
    // Rounded down: 100 % is all of it.
    format!("{head}[{bar:BAR$}] {:.0} %  {text}  ETA {eta}", (100.0 * share).floor())
}

/// The line of a time that passes.
fn passing(what: &str, took: Duration, all: Option<Duration>) -> String {
    let Some(all) = all else { return endless(what, "", took) };
    let (took, all) = (took.as_secs_f64(), all.as_secs_f64());
    let text = format!("{:.0} of {all:.0} s", took.min(all));
    line(what, took / all, Some((all - took).max(0.0)), &text)
}

/// The line of work without a known end.
fn endless(what: &str, text: &str, took: Duration) -> String {
    let space = if text.is_empty() { "" } else { "  " };
    format!("{what}{space}{text}  {}", clock(took.as_secs_f64()))
}

/// `0:42`, `1:02:03`.
fn clock(seconds: f64) -> String {
    let seconds = seconds.ceil() as u64;
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    if hours > 0 { format!("{hours}:{minutes:02}:{seconds:02}") } else { format!("{minutes}:{seconds:02}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_has_a_bar_a_share_and_the_time_that_is_left() {
        let took = Duration::from_secs(37);
        let line = |what, share, text, took| line(what, share, left(share, took), text);
        assert_eq!(
            line("", 0.47, "9.4 of 20 h  980x  no violation", took),
            "[####      ] 47 %  9.4 of 20 h  980x  no violation  ETA 0:42"
        );
        assert_eq!(line("exporting", 1.0, "120 MB/s", took), "exporting [##########] 100 %  120 MB/s  ETA 0:00");
        assert_eq!(line("", 0.999_999, "", took), "[######### ] 99 %    ETA 0:01");
        // Nothing is done, or nothing is known yet.
        assert_eq!(line("", 0.0, "", took), "[          ] 0 %    ETA -");
        assert_eq!(line("", f64::NAN, "", took), "[          ] 0 %    ETA -");
        assert!(line("", 0.5, "", Duration::from_millis(600)).ends_with("ETA -"));
        assert_eq!([clock(0.2), clock(61.0), clock(3723.0)], ["0:01", "1:01", "1:02:03"]);
    }

    #[test]
    fn a_time_that_passes_is_a_share_and_work_without_end_tells_how_long_it_has_taken() {
        let (took, all) = (Duration::from_millis(12_500), Duration::from_secs(50));
        assert_eq!(passing("measuring", took, Some(all)), "measuring [##        ] 25 %  12 of 50 s  ETA 0:38");
        // What ends the work looks at the clock later.
        let over = passing("measuring", Duration::from_secs(51), Some(all));
        assert_eq!(over, "measuring [##########] 100 %  50 of 50 s  ETA 0:00");
        assert_eq!(passing("measuring", took, None), "measuring  0:13");
        assert_eq!(endless("polling", "250 polls", took), "polling  250 polls  0:13");
        // In pause nobody knows when it ends.
        assert_eq!(line("", 0.5, None, "in pause"), "[#####     ] 50 %  in pause  ETA -");
    }
}
