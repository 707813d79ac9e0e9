//! How far long work is, on stderr where that is a terminal: `exporting [#####     ] 47 %  120 MB/s  ETA 0:42`.

use crate::Failed;
use crate::bus::interrupt;
use nix::sys::signalfd::SignalFd;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Duration of work that needs no line.
const QUIET: Duration = Duration::from_millis(500);
const RENEWED: Duration = Duration::from_millis(100);
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
        if !self.terminal {
            return;
        }
        let now = Instant::now();
        let took = now - self.begin;
        if took < QUIET || self.shown.is_some_and(|shown| now - shown < RENEWED) {
            return;
        }
        self.shown = Some(now);
        put(&format!("\r\x1b[K{}", line(self.what, share, &text(took), took)));
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

fn line(what: &str, share: f64, text: &str, took: Duration) -> String {
    let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    let head = if what.is_empty() { String::new() } else { format!("{what} ") };
    let bar = "#".repeat((share * BAR as f64) as usize);
    let left = took.as_secs_f64() * (1.0 - share) / share;
    let eta = match left.is_finite() && took >= ESTIMATED {
        true => clock(left),
        false => "-".into(),
    };
    // Rounded down: 100 % is all of it.
    format!("{head}[{bar:BAR$}] {:.0} %  {text}  ETA {eta}", (100.0 * share).floor())
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
}
