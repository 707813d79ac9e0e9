//! Times in whole microseconds, counted: as much memory for an hour as for a second.

/// A count for each microsecond below a limit, as `cyclictest -h` has it; what lies beyond is counted together.
#[derive(Clone, Debug)]
pub struct Histogram {
    buckets: Box<[u32]>,
    beyond: u32,
    count: u64,
    sum: u64,
    min: u64,
    max: u64,
}

impl Histogram {
    /// An empty one for times below `limit` µs: four bytes for each of them.
    pub fn new(limit: usize) -> Self {
        Self { buckets: vec![0; limit].into(), beyond: 0, count: 0, sum: 0, min: u64::MAX, max: 0 }
    }

    /// Counts a time, µs. Allocates nothing.
    pub fn add(&mut self, us: u64) {
        self.add_many(us, 1);
    }

    fn add_many(&mut self, us: u64, times: u32) {
        let bucket = usize::try_from(us).ok().and_then(|us| self.buckets.get_mut(us));
        let bucket = bucket.unwrap_or(&mut self.beyond);
        *bucket = bucket.saturating_add(times);
        self.count += u64::from(times);
        self.sum = self.sum.saturating_add(us.saturating_mul(times.into()));
        self.min = self.min.min(us);
        self.max = self.max.max(us);
    }

    /// Number of times counted.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Smallest time, µs; 0 without samples.
    pub fn min(&self) -> u64 {
        self.min.min(self.max)
    }

    /// The largest, µs, exact also beyond the limit.
    pub fn max(&self) -> u64 {
        self.max
    }

    /// The mean, µs.
    pub fn mean(&self) -> f64 {
        self.sum as f64 / self.count.max(1) as f64
    }

    /// The smallest time, µs, that `of` in `all` do not exceed: 999 in 1000. Where that lies beyond the limit it is the
    /// largest.
    pub fn quantile(&self, of: u64, all: u64) -> u64 {
        let wanted = u128::from(self.count) * u128::from(of);
        let mut sum = 0_u128;
        for (us, count) in self.filled() {
            sum += u128::from(count) * u128::from(all);
            if sum >= wanted {
                return us;
            }
        }
        self.max
    }

    /// Histogram of the distances from `middle`, in either direction.
    pub fn around(&self, middle: u64) -> Self {
        let mut around = Self::new(self.buckets.len());
        for (us, count) in self.filled() {
            around.add_many(us.abs_diff(middle), count);
        }
        if self.beyond > 0 {
            around.add_many(self.max.abs_diff(middle), self.beyond);
        }
        around
    }

    /// Every time that was counted below the limit, µs, and how often.
    pub fn filled(&self) -> impl Iterator<Item = (u64, u32)> {
        (0..).zip(self.buckets.iter().copied()).filter(|(_, count)| *count > 0)
    }
}
