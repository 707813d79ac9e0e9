//! How far long work is, on stderr where that is a terminal.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Shorter work needs no word.
const QUIET: Duration = Duration::from_millis(500);
const RENEW: Duration = Duration::from_millis(100);

/// A line that is renewed, and gone at the end.
pub struct Progress {
    what: &'static str,
    begin: Instant,
    told: Option<Instant>,
    terminal: bool,
}

impl Progress {
    pub fn new(what: &'static str) -> Self {
        Self { what, begin: Instant::now(), told: None, terminal: std::io::stderr().is_terminal() }
    }

    /// Shows progress: bytes done and in all.
    pub fn tell(&mut self, done: u64, all: u64) {
        if !self.terminal {
            return;
        }
        let now = Instant::now();
        if now - self.begin < QUIET || self.told.is_some_and(|told| now - told < RENEW) {
            return;
        }
        self.told = Some(now);
        let percent = done.saturating_mul(100).checked_div(all).unwrap_or(100).min(100);
        let rate = done as f64 / (now - self.begin).as_secs_f64() / 1e6;
        self.put(&format!("\r\x1b[K{} {percent} %, {rate:.0} MB/s", self.what));
    }

    fn put(&self, text: &str) {
        // A failure cannot be reported.
        let _ = std::io::stderr().write_all(text.as_bytes());
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if self.told.is_some() {
            self.put("\r\x1b[K");
        }
    }
}
