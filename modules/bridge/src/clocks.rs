//! Comparison of two computers' clocks by questions and answers, as NTP does (RFC 5905, section 8): the offset of the
//! monotonic clocks, by which the age of a message is bounded, and of the wall clocks, for people.

use base::{Duration, Instant};
use std::collections::VecDeque;

/// Number of answers of which the one with the shortest round trip counts.
const SAMPLES: usize = 8;
/// Age from which an answer does not count any more.
const SAMPLE_AGE_MAX: Duration = Duration::from_secs(2);
/// Maximum drift between two computers' monotonic clocks: the kernel slews by at most 500 ppm, each of them.
const DRIFT_PPM: u64 = 1000;

/// Times of a question and its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Question sent, ns on this computer's monotonic clock.
    pub sent: u64,
    /// Question received, ns on the other computer's monotonic clock.
    pub received: u64,
    /// Answer sent, likewise.
    pub answered: u64,
    /// The other computer's wall clock at the answer, ns since the UNIX epoch.
    pub wall: u64,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Instant,
    /// Other monotonic clock minus this one, ns; true within half a round trip.
    offset: i128,
    round_trip: u64,
    /// Other wall clock minus this one, ns; likewise.
    wall: i128,
}

/// Result for people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Wall clock of the other computer minus that of this one, s.
    pub offset_s: f64,
    /// Round trip of the answer that counts, s; the offset is true within half of it.
    pub round_trip_s: f64,
}

impl Comparison {
    /// True if the wall clocks differ by more than `max` whatever the round trip hides.
    #[must_use]
    pub fn exceeds(&self, max: Duration) -> bool {
        self.offset_s.abs() - self.round_trip_s / 2.0 > max.as_secs_f64()
    }
}

/// The clocks of this computer and of another one.
#[derive(Debug, Default)]
pub struct Clocks {
    samples: VecDeque<Sample>,
}

impl Clocks {
    /// Takes an answer that was received at `now`, while this computer's wall clock shows `wall` (ns). An impossible
    /// one is left out: false.
    pub fn on_answer(&mut self, now: Instant, wall: u64, answer: Answer) -> bool {
        let Answer { sent, received, answered, wall: far_wall } = answer;
        let (sent, here, received, answered) =
            (i128::from(sent), i128::from(now.as_nanos()), i128::from(received), i128::from(answered));
        let round_trip = (here - sent) - (answered - received);
        let is_possible = sent <= here && received <= answered && round_trip >= 0;
        let Some(round_trip) = u64::try_from(round_trip).ok().filter(|_| is_possible) else { return false };
        let offset = ((received - sent) + (answered - here)) / 2;
        // Time since the answer, on both clocks.
        let since = here - (answered - offset);
        let wall = i128::from(far_wall) + since - i128::from(wall);
        if self.samples.len() >= SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(Sample { at: now, offset, round_trip, wall });
        true
    }

    fn best(&self, now: Instant) -> Option<&Sample> {
        let counts = |sample: &&Sample| now.since(sample.at) <= SAMPLE_AGE_MAX;
        self.samples.iter().filter(counts).min_by_key(|sample| sample.round_trip)
    }

    /// Greatest age at `now` that something may have whose time on the other computer's monotonic clock is `published`,
    /// ns. It holds for any division of the round trip between both ways. `None`: the clocks are not compared yet, or
    /// the time is in the future.
    #[must_use]
    pub fn age_max(&self, now: Instant, published: u64) -> Option<Duration> {
        let Sample { at, offset, round_trip, .. } = *self.best(now)?;
        let drift = now.since(at).as_nanos() * u128::from(DRIFT_PPM) / 1_000_000;
        let error = i128::from(round_trip / 2) + drift as i128;
        let age = i128::from(now.as_nanos()) - (i128::from(published) - offset);
        u64::try_from(age + error).ok().map(Duration::from_nanos)
    }

    /// The wall clocks compared; `None`: not yet.
    #[must_use]
    pub fn compare(&self, now: Instant) -> Option<Comparison> {
        let seconds = |ns: i128| ns as f64 / 1e9;
        let of = |sample: &Sample| Comparison {
            offset_s: seconds(sample.wall),
            round_trip_s: seconds(i128::from(sample.round_trip)),
        };
        self.best(now).map(of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const WALL: u64 = 1_700_000_000_000 * MS;

    /// The other computer's monotonic clock is `ahead` ms ahead, its wall clock `wall` ms; the question takes `there`
    /// ms, the answer `back`. Returns the clocks at 1000 + there + back ms.
    fn compared(clocks: &mut Clocks, (ahead, wall): (u64, u64), there: u64, back: u64) -> Instant {
        let (sent, far) = (1000 * MS, (1000 + ahead + there) * MS);
        let now = Instant::from_millis(1000 + there + back);
        let answer = Answer { sent, received: far, answered: far, wall: WALL + (1000 + there + wall) * MS };
        assert!(clocks.on_answer(now, WALL + now.as_nanos(), answer));
        now
    }

    #[test]
    fn equal_ways_give_the_offset_and_other_ways_err_by_half_a_round_trip() {
        let mut clocks = Clocks::default();
        let now = compared(&mut clocks, (5000, 30), 2, 2);
        let Comparison { offset_s, round_trip_s } = clocks.compare(now).unwrap();
        assert!((offset_s - 0.03).abs() < 1e-9 && (round_trip_s - 0.004).abs() < 1e-9, "{offset_s} {round_trip_s}");

        let mut clocks = Clocks::default();
        let now = compared(&mut clocks, (5000, 30), 10, 0);
        let comparison = clocks.compare(now).unwrap();
        assert!((comparison.offset_s - 0.035).abs() < 1e-9, "{comparison:?}");
        assert!(!comparison.exceeds(Duration::from_millis(31)));
        assert!(comparison.exceeds(Duration::from_millis(29)));
    }

    #[test]
    fn the_age_of_a_message_is_never_taken_for_less_than_it_is() {
        for (there, back) in [(0, 0), (3, 3), (0, 40), (40, 0), (200, 1)] {
            let mut clocks = Clocks::default();
            let now = compared(&mut clocks, (5000, 0), there, back);
            // Published 100 ms ago.
            let published = now.as_nanos() + 4900 * MS;
            let age = clocks.age_max(now, published).unwrap();
            let least = Duration::from_millis(100);
            assert!(age >= least && age <= least + Duration::from_millis(there + back), "{there} {back} {age:?}");
        }
    }

    #[test]
    fn without_a_fresh_answer_no_age_is_known() {
        let mut clocks = Clocks::default();
        assert_eq!(clocks.age_max(Instant::from_millis(1), 0), None);
        let now = compared(&mut clocks, (0, 0), 1, 1);
        assert!(clocks.age_max(now + Duration::from_secs(2), 0).is_some());
        assert_eq!(clocks.age_max(now + Duration::from_millis(2001), 0), None);
        assert_eq!(clocks.age_max(now, now.as_nanos() + 50 * MS), None, "in the future");
    }

    #[test]
    fn the_shortest_round_trip_counts_and_impossible_answers_do_not() {
        let mut clocks = Clocks::default();
        compared(&mut clocks, (0, 7), 1, 1);
        let now = compared(&mut clocks, (0, 7), 90, 0);
        assert!((clocks.compare(now).unwrap().offset_s - 0.007).abs() < 1e-9);
        for (sent, received, answered) in [(9000 * MS, 0, 0), (0, 2, 1), (1000 * MS, 0, 500 * MS)] {
            let answer = Answer { sent, received, answered, wall: WALL };
            assert!(!Clocks::default().on_answer(now, WALL, answer), "{answer:?}");
        }
    }
}
