//! What a soak says in the end: the sum of its episodes, in their order.

use super::figures::Figures;
use super::{Outcome, Violation};
use base::Duration;
use std::collections::BTreeMap;
use xxhash_rust::xxh64::Xxh64;

/// The sum of episodes.
pub struct Report {
    /// Number of them.
    pub episodes: u64,
    /// How long they were together.
    pub time: Duration,
    /// How often each kind of fault befell somebody.
    pub faults: BTreeMap<String, u64>,
    /// What was measured.
    pub figures: Figures,
    /// Episodes in which a rule broke, with how.
    pub violations: Vec<(u64, Violation)>,
    digest: Xxh64,
}

impl Report {
    /// Of a soak with this seed, in which nothing has happened yet.
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

    /// Adds an episode; to be called in the order of their numbers, whoever ran them when.
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

    /// Of everything that was sent in all episodes.
    #[must_use]
    pub fn digest(&self) -> u64 {
        self.digest.digest()
    }
}
