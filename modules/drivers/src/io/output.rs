//! Limits of an output by its keys, whatever device has it.

use base::Duration;
use settings::{Off, Table, ZeroOr, settings};

settings! {
    /// What a signal that is an output has.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct OutputKeys {
        /// Outputs: value that is written while nobody commands another.
        safe: Option<f64> = optional, -1e9..=1e9;
        /// Outputs: least value that is accepted.
        min: f64 = -1e9, -1e9..=1e9;
        /// Outputs: greatest value that is accepted.
        max: f64 = 1e9, -1e9..=1e9;
        /// Outputs: time for which a command holds, after which the value is the safe one. 0: until the next command.
        hold_s as hold: Option<Duration> = Some(Duration::from_secs(1)), Off(ZeroOr(0.05..=3600.0));
    }
}

impl OutputKeys {
    pub(super) fn check(&self, table: &Table<'_>, output: bool, exists: impl Fn(f64) -> bool) {
        if !output {
            return;
        }
        let expected = "a value that the output has, from min to max";
        match self.safe {
            None => table.refuse_missing("safe", expected),
            Some(safe) if !(self.accepts(safe) && exists(safe)) => table.refuse("safe", expected),
            Some(_) => {}
        }
    }

    /// True for values within the limits.
    #[must_use]
    pub fn accepts(&self, value: f64) -> bool {
        (self.min..=self.max).contains(&value)
    }
}
