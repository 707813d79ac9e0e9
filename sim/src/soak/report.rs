//! Report of a soak: the sum of its episodes in their order.

use super::figures::Figures;
use super::{Outcome, Violation};
use base::Duration;
use std::collections::BTreeMap;
use xxhash_rust::xxh64::Xxh64;

/// The sum of episodes.
pub struct Report {
    /// Number of episodes.
    pub episodes: u64,
    /// Total duration.
    pub time: Duration,
    /// Number of injected faults of each kind.
    pub faults: BTreeMap<String, u64>,
    /// Measured figures.
    pub figures: Figures,
    /// Episodes with a violation of a rule.
    pub violations: Vec<(u64, Violation)>,
    digest: Xxh64,
}

impl Report {
    /// Creates the report of a soak with this seed, still empty.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            episodes: 0,
            time: Duration::ZERO,
            faults: BTreeMap::new(),
            figures: Figures::default(),
            violations: Vec::new(),
            digest: Xxh64::new(seed),
        }
    }

    /// Adds an episode; to be called in the order of their numbers, whatever the order of execution.
    pub fn add(&mut self, number: u64, outcome: &Outcome) {
        self.episodes += 1;
        self.time += outcome.time;
        for (kind, count) in &outcome.faults {
            *self.faults.entry(kind.clone()).or_default() += count;
        }
        self.figures.add(&outcome.figures);
        self.violations.extend(outcome.violation.clone().map(|violation| (number, violation)));
        self.digest.update(&number.to_le_bytes());
        self.digest.update(&outcome.digest.to_le_bytes());
    }

    /// Digest of everything sent in all episodes.
    #[must_use]
    pub fn digest(&self) -> u64 {
        self.digest.digest()
    }
}
