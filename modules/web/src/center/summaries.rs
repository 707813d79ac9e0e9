//! Recorded runs in figures, kept so that a run is read once.

use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Maximum number of summaries that are kept.
const SUMMARIES_MAX: usize = 1000;

/// A recorded run in figures. `GET /api/runs/RUN/summary` (viewer).
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunSummary {
    /// Length, s, without steps of the wall clock and long silences.
    pub seconds: f64,
    /// Distance driven forward and backward, m, by the measured speed.
    pub distance: f64,
    /// Contacts of the simulated robot; `None` for a real one.
    pub contacts: Option<u32>,
    /// Stops: PAUSE, and operators.
    pub stops: u32,
    /// Reports of errors, those of a kind within 5 s counted once.
    pub errors: u32,
    /// Reports of warnings, counted likewise.
    pub warnings: u32,
}

/// Summaries of runs that were read, each with the length of its files then: a run that grew is read again.
#[derive(Default)]
pub struct Summaries(Mutex<BTreeMap<String, (u64, RunSummary)>>);

impl Summaries {
    /// The summary of a run of this length, bytes, if it is known.
    #[must_use]
    pub fn get(&self, run: &str, bytes: u64) -> Option<RunSummary> {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.get(run).filter(|(length, _)| *length == bytes).map(|(_, summary)| summary.clone())
    }

    /// Keeps the summary of a run of this length, bytes.
    pub fn keep(&self, run: String, bytes: u64, summary: RunSummary) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if known.len() >= SUMMARIES_MAX {
            known.clear();
        }
        known.insert(run, (bytes, summary));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_grew_is_read_again_and_the_number_of_kept_ones_is_bounded() {
        let summaries = Summaries::default();
        let summary = RunSummary { seconds: 3.0, ..RunSummary::default() };
        summaries.keep("run".into(), 10, summary.clone());
        assert_eq!((summaries.get("run", 10), summaries.get("run", 11)), (Some(summary), None));
        for number in 0..2 * SUMMARIES_MAX {
            summaries.keep(number.to_string(), 1, RunSummary::default());
        }
        assert!(summaries.0.lock().unwrap().len() <= SUMMARIES_MAX);
    }
}
