//! Data of a run in bounded memory for any input: beyond the capacity the resolution decreases.

use navitools::Point;

/// Minimum distance of the points of a track, m; distance beyond which a new line begins, m.
const STEP_M: f64 = 0.02;
const JUMP_M: f64 = 1.0;

/// Value over time.
#[derive(Debug, Default)]
pub struct Series {
    buckets: Vec<Bucket>,
    /// Duration of a bucket from its first value, s.
    width: f64,
}

/// Values combined on the time line; a gap for values that are not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bucket {
    /// Time of the first value, s.
    pub from: f64,
    /// Time of the last value, s.
    pub to: f64,
    /// First value.
    pub first: f64,
    /// Last value.
    pub last: f64,
    /// Minimum.
    pub least: f64,
    /// Maximum.
    pub most: f64,
}

impl Bucket {
    fn join(&mut self, next: &Self) {
        let (from, to) = (self.from, next.to);
        if self.first.is_nan() {
            *self = *next;
        } else if !next.first.is_nan() {
            self.least = self.least.min(next.least);
            self.most = self.most.max(next.most);
            self.last = next.last;
        }
        (self.from, self.to) = (from, to);
    }
}

impl Series {
    /// Maximum number of buckets: about as many as a picture has pixels.
    pub const CAPACITY: usize = 2048;

    /// Adds a value; a value older than the last one is ignored.
    pub fn push(&mut self, at: f64, value: f64) {
        if !at.is_finite() || self.buckets.last().is_some_and(|last| at < last.to) {
            return;
        }
        let value = if value.is_finite() { value } else { f64::NAN };
        self.add(Bucket { from: at, to: at, first: value, last: value, least: value, most: value });
        if self.buckets.len() > Self::CAPACITY {
            let span = at - self.buckets[0].from;
            self.width = (2.0 * self.width).max(2.0 * span / Self::CAPACITY as f64);
            for bucket in std::mem::take(&mut self.buckets) {
                self.add(bucket);
            }
        }
    }

    fn add(&mut self, next: Bucket) {
        match self.buckets.last_mut() {
            Some(last) if next.to - last.from <= self.width => last.join(&next),
            _ => self.buckets.push(next),
        }
    }

    /// First and last value.
    #[must_use]
    pub fn ends(&self) -> Option<(f64, f64)> {
        let mut numbers = self.buckets.iter().filter(|bucket| !bucket.first.is_nan());
        let first = numbers.next()?;
        Some((first.first, numbers.next_back().unwrap_or(first).last))
    }

    /// Minimum and maximum.
    #[must_use]
    pub fn range(&self) -> Option<(f64, f64)> {
        let numbers = self.buckets.iter().filter(|bucket| !bucket.first.is_nan());
        numbers.map(|bucket| (bucket.least, bucket.most)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Lines of (time, value), interrupted by values that are not finite and by gaps longer than `hold` seconds.
    #[must_use]
    pub fn lines(&self, hold: f64) -> Vec<Vec<Point>> {
        let mut lines = Vec::new();
        let mut line: Vec<Point> = Vec::new();
        for bucket in &self.buckets {
            let late = line.last().is_some_and(|last| bucket.from - last.x > hold + self.width);
            if late || bucket.first.is_nan() {
                lines.push(std::mem::take(&mut line));
            }
            if bucket.first.is_nan() {
                continue;
            }
            line.push(Point { x: bucket.from, y: bucket.first });
            if bucket.to > bucket.from {
                let middle = f64::midpoint(bucket.from, bucket.to);
                let corners = [(middle, bucket.least), (middle, bucket.most), (bucket.to, bucket.last)];
                line.extend(corners.map(|(x, y)| Point { x, y }));
            }
        }
        lines.push(line);
        lines.retain(|line| !line.is_empty());
        lines
    }
}

/// Path over the floor.
#[derive(Debug)]
pub struct Track {
    points: Vec<Spot>,
    step: f64,
    before: Option<Point>,
    /// Distance travelled, m, without jumps.
    distance: f64,
}

/// Point of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Time, s.
    pub at: f64,
    /// Position, m.
    pub point: Point,
    /// True if a new line begins here.
    pub begins: bool,
}

impl Default for Track {
    fn default() -> Self {
        Self { points: Vec::new(), step: STEP_M, before: None, distance: 0.0 }
    }
}

impl Track {
    /// Maximum number of points.
    pub const CAPACITY: usize = 20_000;

    /// Adds a point; implausible positions are ignored.
    pub fn push(&mut self, at: f64, point: Point) {
        if !(point.x.abs() < 1e6 && point.y.abs() < 1e6) {
            return;
        }
        let moved = self.before.map(|before| before.distance(point));
        let begins = moved.is_none_or(|moved| moved > JUMP_M);
        self.before = Some(point);
        let near = self.points.last().is_some_and(|last| last.point.distance(point) < self.step);
        if !begins && near {
            return;
        }
        if let Some(last) = self.points.last().filter(|_| !begins) {
            self.distance += last.point.distance(point);
        }
        self.points.push(Spot { at, point, begins });
        if self.points.len() > Self::CAPACITY {
            self.thin();
        }
    }

    /// Removes every other point; if a removed point began a line, the next one does.
    fn thin(&mut self) {
        self.step *= 2.0;
        let pairs = self.points.chunks(2).map(|pair| {
            let last = pair[pair.len() - 1];
            Spot { begins: pair.iter().any(|spot| spot.begins), ..last }
        });
        self.points = pairs.collect();
    }

    /// All points.
    #[must_use]
    pub fn spots(&self) -> &[Spot] {
        &self.points
    }

    /// Distance travelled, m.
    #[must_use]
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Lines of at least two points each.
    pub fn lines(&self) -> impl Iterator<Item = Vec<Point>> + '_ {
        let pieces = self.points.chunk_by(|_, next| !next.begins).filter(|piece| piece.len() > 1);
        pieces.map(|piece| piece.iter().map(|spot| spot.point).collect())
    }
}

/// Value over an interval of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Span<T> {
    /// Beginning, s.
    pub from: f64,
    /// End, s.
    pub to: f64,
    /// Value.
    pub what: T,
}

/// Value that is repeated and changes from time to time.
#[derive(Clone, Debug)]
pub struct Lane<T> {
    spans: Vec<Span<T>>,
    /// Number of changes after the capacity was reached.
    pub lost: u64,
}

impl<T> Default for Lane<T> {
    fn default() -> Self {
        Self { spans: Vec::new(), lost: 0 }
    }
}

impl<T: PartialEq> Lane<T> {
    /// Maximum number of changes.
    pub const CAPACITY: usize = 5000;

    /// Adds the value at a time; it lasts until the next one, if that follows within `hold` seconds.
    pub fn push(&mut self, at: f64, what: T, hold: f64) {
        if self.lost > 0 {
            self.lost += 1;
            return;
        }
        if let Some(last) = self.spans.last_mut() {
            if at < last.to {
                return;
            }
            if at - last.to <= hold {
                last.to = at;
                if last.what == what {
                    return;
                }
            }
        }
        match self.spans.len() < Self::CAPACITY {
            true => self.spans.push(Span { from: at, to: at, what }),
            false => self.lost += 1,
        }
    }

    /// All intervals, in order.
    #[must_use]
    pub fn spans(&self) -> &[Span<T>] {
        &self.spans
    }
}

/// Times of events.
#[derive(Clone, Debug, Default)]
pub struct Ticks {
    moments: Vec<f64>,
    /// Time below which two events are merged, s.
    width: f64,
    /// Number of events.
    pub count: u64,
}

impl Ticks {
    /// Maximum number of times.
    pub const CAPACITY: usize = 2000;

    /// Adds an event.
    pub fn push(&mut self, at: f64) {
        self.count += 1;
        self.moments.push(at);
        if self.moments.len() > 2 * Self::CAPACITY {
            self.moments.sort_by(f64::total_cmp);
            let span = at.max(self.moments[self.moments.len() - 1]) - self.moments[0];
            self.width = (2.0 * self.width).max(span / Self::CAPACITY as f64);
            let width = self.width;
            let mut last = f64::NEG_INFINITY;
            self.moments.retain(|moment| {
                let keeps = moment - last > width;
                last = if keeps { *moment } else { last };
                keeps
            });
        }
    }

    /// Times of events, s, up to the maximum number.
    #[must_use]
    pub fn moments(&self) -> &[f64] {
        &self.moments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_million_values_keep_their_extremes_in_bounded_room() {
        let mut series = Series::default();
        for n in 0..1_000_000 {
            let value = match n {
                500_001 => 7.0,
                700_001 => f64::INFINITY,
                _ => f64::from(n % 2),
            };
            series.push(f64::from(n) * 1e-3, value);
        }
        assert!(series.buckets.len() <= Series::CAPACITY && series.buckets.len() > Series::CAPACITY / 4);
        assert_eq!((series.range(), series.ends()), (Some((0.0, 7.0)), Some((0.0, 1.0))));
        let lines = series.lines(1.0);
        assert_eq!((lines.len(), lines[0].last().unwrap().x.round()), (1, 1000.0));
    }

    #[test]
    fn a_line_is_interrupted_by_nan_and_by_gaps_and_time_never_goes_back() {
        let mut series = Series::default();
        for (at, value) in
            [(0.0, 1.0), (1.0, 2.0), (0.5, 9.0), (2.0, f64::NAN), (3.0, 3.0), (30.0, 4.0), (f64::NAN, 5.0)]
        {
            series.push(at, value);
        }
        let lines: Vec<Vec<f64>> =
            series.lines(2.0).iter().map(|line| line.iter().map(|point| point.y).collect()).collect();
        assert_eq!(lines, [vec![1.0, 2.0], vec![3.0], vec![4.0]]);
    }

    #[test]
    fn a_track_of_a_million_points_is_thinned_and_keeps_its_jumps() {
        let mut track = Track::default();
        for n in 0..1_000_000 {
            let x = f64::from(n) * 0.03 + if n >= 400_000 { 100.0 } else { 0.0 };
            track.push(f64::from(n), Point { x, y: if n == 7 { f64::NAN } else { 0.0 } });
        }
        assert!(track.spots().len() <= Track::CAPACITY);
        assert_eq!(track.lines().count(), 2);
        assert!((track.distance() - 30_000.0).abs() < 5.0, "{}", track.distance());
    }

    #[test]
    fn a_jump_at_each_point_leaves_no_line_and_takes_no_more_memory() {
        let mut track = Track::default();
        for n in 0..100_000 {
            track.push(f64::from(n), Point { x: f64::from(n % 2) * 50.0, y: 0.0 });
        }
        assert!(track.spots().len() <= Track::CAPACITY && track.lines().next().is_none());
    }

    #[test]
    fn a_lane_ends_when_its_value_is_no_longer_repeated() {
        let mut lane = Lane::default();
        for (at, what) in [(0.0, 1), (1.0, 1), (1.5, 3), (2.5, 3), (2.0, 9), (9.0, 3)] {
            lane.push(at, what, 2.0);
        }
        let spans: Vec<_> = lane.spans().iter().map(|span| (span.from, span.to, span.what)).collect();
        assert_eq!(spans, [(0.0, 1.5, 1), (1.5, 2.5, 3), (9.0, 9.0, 3)]);
        (0..100_000).for_each(|n| lane.push(10.0 + f64::from(n), n % 2, 2.0));
        assert!(lane.spans().len() == Lane::<i32>::CAPACITY && lane.lost > 90_000);
    }

    #[test]
    fn many_moments_are_counted_and_thinned() {
        let mut ticks = Ticks::default();
        (0..1_000_000).for_each(|n| ticks.push(f64::from(n)));
        assert_eq!(ticks.count, 1_000_000);
        assert!((1000..=2 * Ticks::CAPACITY).contains(&ticks.moments().len()), "{}", ticks.moments().len());
        let last = ticks.moments().iter().copied().fold(0.0, f64::max);
        assert_eq!(last, 999_999.0);
    }
}
