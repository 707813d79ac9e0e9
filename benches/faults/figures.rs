//! Table and histograms.

use std::time::Duration;

/// Times of one kind of fault, or of all.
#[derive(Clone, Default)]
pub struct Times(Vec<Duration>);

impl Times {
    pub fn add(&mut self, took: Duration) {
        self.0.push(took);
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    pub fn append(&mut self, other: &Self) {
        self.0.extend(&other.0);
    }

    /// Quantile, ms (nearest rank).
    fn at(&self, share: f64) -> Option<f64> {
        let mut sorted = self.0.clone();
        sorted.sort();
        let rank = (sorted.len() as f64 * share).ceil().max(1.0) as usize;
        sorted.get(rank - 1).map(|took| took.as_secs_f64() * 1e3)
    }

    pub fn p99(&self) -> Option<f64> {
        self.at(0.99)
    }

    pub fn worst(&self) -> Option<f64> {
        self.at(1.0)
    }

    /// Three columns: p50, p99, p100.
    pub fn columns(&self) -> String {
        let column = |share| self.at(share).map_or_else(|| format!("{:>6}", "-"), |ms| format!("{ms:6.0}"));
        format!("{} {} {}", column(0.5), column(0.99), column(1.0))
    }

    /// One line for each non-empty bin of `width`.
    pub fn histogram(&self, width: Duration) -> String {
        let mut bins = std::collections::BTreeMap::<u128, usize>::new();
        for took in &self.0 {
            *bins.entry(took.as_millis() / width.as_millis()).or_default() += 1;
        }
        let most = bins.values().copied().max().unwrap_or(1);
        let line = |(bin, count): (u128, usize)| {
            let from = bin * width.as_millis();
            format!(
                "  {from:5}..{:<5} {count:6} {}\n",
                from + width.as_millis(),
                "#".repeat((count * 60).div_ceil(most))
            )
        };
        bins.into_iter().map(line).collect()
    }
}
