//! Samples and their quantiles.

use std::time::Duration;

/// Samples of one quantity, ms.
#[derive(Clone, Default)]
pub struct Samples {
    pub ms: Vec<f64>,
    /// Number of commands that were not answered in time.
    pub lost: usize,
}

impl Samples {
    pub fn add(&mut self, took: Duration) {
        self.ms.push(took.as_secs_f64() * 1e3);
    }

    pub fn append(&mut self, other: &Self) {
        self.ms.extend(&other.ms);
        self.lost += other.lost;
    }

    /// Quantile, ms (nearest rank); NaN without samples.
    pub fn at(&self, share: f64) -> f64 {
        let mut sorted = self.ms.clone();
        sorted.sort_by(f64::total_cmp);
        let rank = (sorted.len() as f64 * share).ceil().max(1.0) as usize;
        sorted.get(rank - 1).copied().unwrap_or(f64::NAN)
    }
}

/// Middle value, or the mean of the two in the middle; NaN without values.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => f64::NAN,
        len if len % 2 == 1 => values[middle],
        _ => f64::midpoint(values[middle - 1], values[middle]),
    }
}

/// Word on a figure with its greatest permitted value; one that was not measured is not within it.
pub fn verdict(figure: f64, most: f64) -> &'static str {
    if figure <= most { "held" } else { "NOT held" }
}
