//! Outputs that show situations: of the entries of an output, the first that applies.

use super::config::{ConfigError, ShowKeys};
use super::pattern::Pattern;
use super::signal::{Signal, place};
use super::situation::{Situation, Situations};
use base::Instant;

/// An output and its entries, in the order of the configuration.
#[derive(Debug)]
pub(super) struct Indicator {
    signal: usize,
    entries: Vec<Entry>,
    /// The entry that applies, and since when.
    current: Option<(usize, Instant)>,
    /// When its pattern changes next.
    next: Option<Instant>,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    when: Situation,
    pattern: Pattern,
    /// Values that are on and off.
    on: f64,
    off: f64,
}

/// Indicators of all outputs that entries name.
///
/// # Errors
/// An entry names no output, or a value that it does not take.
pub(super) fn all(keys: &[ShowKeys], signals: &[Signal]) -> Result<Vec<Indicator>, ConfigError> {
    let mut all: Vec<Indicator> = Vec::new();
    for keys in keys {
        let signal = place(signals, &keys.output).ok_or(ConfigError::Show)?;
        let output = signals[signal].output.as_ref().ok_or(ConfigError::Show)?;
        if !(output.accepts(keys.value) && output.accepts(keys.value_off)) {
            return Err(ConfigError::Show);
        }
        let entry = Entry { when: keys.when, pattern: keys.pattern, on: keys.value, off: keys.value_off };
        match all.iter_mut().find(|indicator| indicator.signal == signal) {
            Some(indicator) => indicator.entries.push(entry),
            None => all.push(Indicator { signal, entries: vec![entry], current: None, next: None }),
        }
    }
    Ok(all)
}

impl Indicator {
    /// Shows what applies; `None`: nothing is shown, such as in STOP.
    pub fn show(&mut self, now: Instant, applies: Option<Situations>, signals: &mut [Signal]) {
        let applies = applies.and_then(|applies| self.entries.iter().position(|entry| applies.has(entry.when)));
        if self.current.map(|(entry, _)| entry) != applies {
            self.current = applies.map(|entry| (entry, now));
        }
        self.next = None;
        let shown = self.current.map(|(place, since)| {
            let entry = self.entries[place];
            let (on, next) = entry.pattern.at(now.since(since));
            self.next = next.map(|next| since + next);
            if on { entry.on } else { entry.off }
        });
        signals[self.signal].show(shown);
    }

    /// When the output changes by its pattern.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.next
    }
}
