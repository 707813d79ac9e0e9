//! Rates, gaps and sizes of channels, from given arrival times. Memory is bounded.

use std::collections::BTreeMap;

/// Maximum number of channels that are followed; a name costs a hostile publisher one datagram.
pub const CHANNELS_MAX: usize = 4096;

/// Number of parts of the window; it moves by one part.
const PARTS: usize = 16;

/// Statistics of all received channels.
pub struct Stats {
    channels: BTreeMap<String, Channel>,
    /// A part of the window, ns.
    part_ns: u64,
    /// Messages on channels beyond [`CHANNELS_MAX`].
    pub beyond: u64,
}

/// Statistics of a channel.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// Messages so far.
    pub messages: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Of these, messages that contradict their fingerprint, or belong to another channel.
    pub bad: u64,
    /// The newest one's fingerprint, if it has one.
    pub fingerprint: Option<u64>,
    /// The newest one's size, bytes.
    pub size: usize,
    last_ns: u64,
    last_gap_ns: u64,
    parts: [Part; PARTS],
}

#[derive(Clone, Copy, Debug, Default)]
struct Part {
    /// Which part of time it is.
    index: u64,
    sum: Sum,
}

/// Content of a window; the first message of a channel has no gap and is not counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sum {
    count: u64,
    bytes: u64,
    size: (usize, usize),
    gap_ns: (u64, u64),
    gaps: f64,
    squares: f64,
}

/// Rates of a channel over the window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    /// Messages whose gap to the one before ends in the window.
    pub messages: u64,
    /// Messages a second; none before there are two, and after a silence of more than two periods.
    pub hz: Option<f64>,
    /// Bytes a second.
    pub bytes_per_s: Option<f64>,
    /// Least, mean and greatest size, bytes.
    pub size: (usize, f64, usize),
    /// Least, mean and greatest time between messages, s.
    pub gap_s: (f64, f64, f64),
    /// Standard deviation of the time between messages, s.
    pub gap_std_s: f64,
    /// Since the newest, s.
    pub age_s: f64,
}

impl Stats {
    /// Rates are those of the last `window_ns`.
    pub fn new(window_ns: u64) -> Self {
        Self { channels: BTreeMap::new(), part_ns: (window_ns / PARTS as u64).max(1), beyond: 0 }
    }

    /// Takes in a message that came at `at_ns`; none: there are too many channels.
    pub fn hear(&mut self, name: &str, size: usize, at_ns: u64) -> Option<&mut Channel> {
        if !self.channels.contains_key(name) {
            if self.channels.len() == CHANNELS_MAX {
                self.beyond += 1;
                return None;
            }
            self.channels.insert(name.into(), Channel::default());
        }
        let channel = self.channels.get_mut(name)?;
        channel.hear(size, at_ns, self.part_ns);
        Some(channel)
    }

    /// All channels by name, with their rates at `now_ns`.
    pub fn rows(&self, now_ns: u64) -> impl Iterator<Item = (&str, &Channel, Rates)> {
        self.channels.iter().map(move |(name, channel)| (name.as_str(), channel, channel.rates(now_ns, self.part_ns)))
    }

    /// True if nothing was received.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }
}

impl Channel {
    fn hear(&mut self, size: usize, at_ns: u64, part_ns: u64) {
        let (first, gap) = (self.messages == 0, at_ns.saturating_sub(self.last_ns));
        self.messages += 1;
        self.bytes += size as u64;
        self.size = size;
        self.last_ns = at_ns;
        if first {
            return;
        }
        self.last_gap_ns = gap;
        let index = at_ns / part_ns;
        let part = &mut self.parts[(index % PARTS as u64) as usize];
        if part.index != index {
            *part = Part { index, sum: Sum::default() };
        }
        let gap_s = gap as f64 * 1e-9;
        part.sum.add(&Sum {
            count: 1,
            bytes: size as u64,
            size: (size, size),
            gap_ns: (gap, gap),
            gaps: gap_s,
            squares: gap_s * gap_s,
        });
    }

    fn rates(&self, now_ns: u64, part_ns: u64) -> Rates {
        let now = now_ns / part_ns;
        let mut sum = Sum::default();
        for part in self.parts.iter().filter(|part| part.index + PARTS as u64 > now) {
            sum.add(&part.sum);
        }
        let age_s = now_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        if sum.count == 0 {
            // Slower than the window is long, or ended.
            let gap_s = self.last_gap_ns as f64 * 1e-9;
            let hz = (gap_s > 0.0 && age_s <= 2.0 * gap_s).then(|| 1.0 / gap_s);
            let bytes_per_s = hz.map(|hz| hz * self.size as f64);
            return Rates {
                hz,
                bytes_per_s,
                size: (self.size, self.size as f64, self.size),
                gap_s: (gap_s, gap_s, gap_s),
                age_s,
                ..Rates::default()
            };
        }
        // Of a single burst the gaps are no measure: the time since then counts.
        let time = sum.gaps + if age_s > sum.gaps { age_s } else { 0.0 };
        let (count, per_s) = (sum.count as f64, |what: f64| (time > 0.0).then(|| what / time));
        let mean = sum.gaps / count;
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let ended = age_s > 1.0 && age_s > 2.0 * seconds(sum.gap_ns.1);
        Rates {
            messages: sum.count,
            hz: per_s(count).filter(|_| !ended),
            bytes_per_s: per_s(sum.bytes as f64).filter(|_| !ended),
            size: (sum.size.0, sum.bytes as f64 / count, sum.size.1),
            gap_s: (seconds(sum.gap_ns.0), mean, seconds(sum.gap_ns.1)),
            gap_std_s: (sum.squares / count - mean * mean).max(0.0).sqrt(),
            age_s,
        }
    }
}

impl Sum {
    fn add(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        if self.count == 0 {
            *self = *other;
            return;
        }
        self.count += other.count;
        self.bytes += other.bytes;
        self.size = (self.size.0.min(other.size.0), self.size.1.max(other.size.1));
        self.gap_ns = (self.gap_ns.0.min(other.gap_ns.0), self.gap_ns.1.max(other.gap_ns.1));
        self.gaps += other.gaps;
        self.squares += other.squares;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    /// Arrival times are of this century.
    const START: u64 = 1_700_000_000_000_000_000;

    fn heard(stats: &mut Stats, name: &str, times_ms: impl IntoIterator<Item = u64>, size: usize) {
        for ms in times_ms {
            stats.hear(name, size, START + ms * MS).unwrap();
        }
    }

    fn rates(stats: &Stats, now_ms: u64) -> Rates {
        stats.rows(START + now_ms * MS).next().unwrap().2
    }

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-6 * b.abs().max(1e-6), "{a} and {b}");
    }

    #[test]
    fn a_steady_channel_has_its_rate_whatever_the_window_cuts() {
        for now in [5000, 5100, 5333] {
            let mut stats = Stats::new(3_000 * MS);
            heard(&mut stats, "A", (0..=now / 20).map(|i| i * 20), 81);
            let rates = rates(&stats, now);
            near(rates.hz.unwrap(), 50.0);
            near(rates.bytes_per_s.unwrap(), 4050.0);
            near(rates.gap_s.0, 0.02);
            near(rates.gap_s.2, 0.02);
            assert!(rates.gap_std_s < 1e-6 && rates.size == (81, 81.0, 81));
            assert!((140..=150).contains(&rates.messages), "{}", rates.messages);
        }
    }

    #[test]
    fn gaps_are_least_mean_greatest_and_their_deviation() {
        let mut stats = Stats::new(10_000 * MS);
        heard(&mut stats, "A", [0, 10, 40], 10);
        heard(&mut stats, "A", [60], 40);
        let rates = rates(&stats, 70);
        near(rates.hz.unwrap(), 50.0);
        near(rates.bytes_per_s.unwrap(), 1000.0);
        assert_eq!((rates.messages, rates.size), (3, (10, 20.0, 40)));
        let (least, mean, greatest) = rates.gap_s;
        near(least, 0.01);
        near(mean, 0.02);
        near(greatest, 0.03);
        near(rates.gap_std_s, (200e-6_f64 / 3.0).sqrt());
        near(rates.age_s, 0.01);
    }

    #[test]
    fn a_single_burst_is_no_high_rate() {
        let mut stats = Stats::new(10_000 * MS);
        heard(&mut stats, "A", [0, 0, 0, 1, 1], 8);
        near(rates(&stats, 500).hz.unwrap(), 8.0);
        near(rates(&stats, 500).bytes_per_s.unwrap(), 64.0);
        heard(&mut stats, "A", [1000, 1000], 8);
        near(rates(&stats, 1500).hz.unwrap(), 6.0);
    }

    #[test]
    fn one_message_makes_no_rate_and_a_slow_channel_keeps_its_own() {
        let mut stats = Stats::new(1_000 * MS);
        heard(&mut stats, "A", [0], 8);
        assert_eq!(rates(&stats, 10).hz, None);
        heard(&mut stats, "A", [10_000], 8);
        near(rates(&stats, 10_000).hz.unwrap(), 0.1);
        near(rates(&stats, 19_000).hz.unwrap(), 0.1);
        assert_eq!(rates(&stats, 30_001).hz, None);
    }

    #[test]
    fn a_channel_that_fell_silent_has_no_rate() {
        let mut stats = Stats::new(5_000 * MS);
        heard(&mut stats, "A", (0..100).map(|i| i * 10), 8);
        assert!(rates(&stats, 1_500).hz.is_some());
        assert_eq!(rates(&stats, 2_000).hz, None);
        let (_, channel, rates) = stats.rows(START + 60_000 * MS).next().unwrap();
        assert_eq!((channel.messages, rates.messages, rates.hz), (100, 0, None));
    }

    #[test]
    fn clocks_that_stand_or_go_back_do_no_harm() {
        let mut stats = Stats::new(1_000 * MS);
        heard(&mut stats, "A", [100, 100, 50, 100], 8);
        let rates = rates(&stats, 0);
        near(rates.hz.unwrap(), 3.0 / 0.05);
        near(rates.gap_s.0, 0.0);
        assert!(rates.age_s.abs() < 1e-9);
        let mut stats = Stats::new(0);
        heard(&mut stats, "A", [0, 0], 8);
        assert_eq!(self::rates(&stats, 0).hz, None);
    }

    #[test]
    fn channels_are_bounded_and_what_is_beyond_is_counted() {
        let mut stats = Stats::new(1_000 * MS);
        (0..CHANNELS_MAX).for_each(|i| heard(&mut stats, &format!("C{i}"), [0], 8));
        assert!(stats.hear("one more", 8, START).is_none() && stats.hear("one more", 8, START).is_none());
        assert!(stats.hear("C7", 8, START).is_some());
        assert_eq!((stats.beyond, stats.rows(START).count()), (2, CHANNELS_MAX));
    }
}
