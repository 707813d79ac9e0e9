//! Conversion of the scanner's answers to sightings, each with its own instant, without duplicates.

use base::{Duration, Epoch, Instant};
use messages::lowlevel::{Beacon, DataBeacons};
use rs485::boards::Implausible;
use rs485::boards::sbs1::parse_beacons;
use rs485::frame::OVERHEAD;
use rs485::word_time;
use std::collections::BTreeMap;

/// Maximum plausible age of a sighting, ms; a sweep takes 1 s.
const AGE_MAX_MS: u16 = 2000;
/// Two sightings of a beacon at a smaller interval are the same one, reported twice: a quarter of a sweep.
const SAME_SIGHTING: Duration = Duration::from_millis(250);
/// Time after a change of the selection for which the board may still report sightings of the previous sweep.
const SETTLING_TIME: Duration = Duration::from_millis(1500);

/// State of the scanner's sightings.
#[derive(Debug)]
pub(super) struct Sightings {
    word: Duration,
    /// Selected beacons, and the time of the selection; empty: all.
    active: Vec<u8>,
    since: Instant,
    last: BTreeMap<u8, Instant>,
}

impl Sightings {
    pub fn new(baud: u32) -> Self {
        Self { word: word_time(baud), active: Vec::new(), since: Instant::ZERO, last: BTreeMap::new() }
    }

    /// The board was told to look for these beacons.
    pub fn select(&mut self, now: Instant, ids: &[u8]) {
        self.active = ids.to_vec();
        self.since = now;
    }

    /// Parses an answer whose last word was received at `now`. The flag is true if it contains a beacon that is not
    /// selected: the board has lost its settings.
    ///
    /// # Errors
    /// The answer is implausible.
    pub fn read(&mut self, now: Instant, epoch: Epoch, data: &[u8]) -> Result<(DataBeacons, bool), Implausible> {
        let sightings = parse_beacons(data)?;
        if let Some(index) = sightings.iter().position(|sighting| sighting.age_ms > AGE_MAX_MS) {
            return Err(Implausible::Value { index, value: sightings[index].age_ms.into() });
        }
        // Ages are relative to the answer's first word.
        let said = now - self.word * (data.len() + OVERHEAD) as u32;
        let (mut beacons, mut stranger) = (Vec::new(), false);
        for sighting in &sightings {
            if !self.active.is_empty() && !self.active.contains(&sighting.id) {
                stranger |= now.since(self.since) > SETTLING_TIME;
                continue;
            }
            let at = said - Duration::from_millis(sighting.age_ms.into());
            if self.last.get(&sighting.id).is_some_and(|last| at.since(*last) < SAME_SIGHTING) {
                continue;
            }
            self.last.insert(sighting.id, at);
            beacons.push(Beacon {
                timestamp: epoch.timestamp(at),
                id: sighting.id.into(),
                bearing: (f64::from(sighting.bearing) / 100.0).to_radians(),
                strength: f64::from(sighting.strength) / 255.0,
            });
        }
        Ok((DataBeacons { timestamp: epoch.timestamp(now), beacons }, stranger))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rs485::boards::sbs1::{Sighting, build_beacons};

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn sighting(id: u8, age_ms: u16) -> Sighting {
        Sighting { id, bearing: 9000, strength: 51, age_ms }
    }

    fn read(sightings: &mut Sightings, ms: u64, answer: &[Sighting]) -> (Vec<(i64, i32)>, bool) {
        let (message, stranger) = sightings.read(at(ms), Epoch::default(), &build_beacons(answer)).unwrap();
        (message.beacons.iter().map(|beacon| (beacon.timestamp, beacon.id)).collect(), stranger)
    }

    #[test]
    fn each_sighting_has_its_own_instant_before_the_answer_s_first_word() {
        let mut sightings = Sightings::new(115_200);
        let answer = [sighting(7, 250), sighting(3, 900)];
        let (message, _) = sightings.read(at(5000), Epoch::default(), &build_beacons(&answer)).unwrap();
        // 18 words of 95.487 us.
        let said = 5_000_000 - 1719;
        let times: Vec<i64> = message.beacons.iter().map(|beacon| beacon.timestamp).collect();
        assert_eq!((message.timestamp, times), (5_000_000, vec![said - 250_000, said - 900_000]));
        let first = &message.beacons[0];
        assert!((first.bearing - core::f64::consts::FRAC_PI_2).abs() < 1e-12 && (first.strength - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_repeated_sighting_is_published_once() {
        let mut sightings = Sightings::new(115_200);
        assert_eq!(read(&mut sightings, 5000, &[sighting(1, 3)]).0.len(), 1);
        assert_eq!(read(&mut sightings, 5995, &[sighting(1, 998)]).0.len(), 0);
        assert_eq!(read(&mut sightings, 7000, &[sighting(1, 3)]).0.len(), 1, "the sweep after the next");
    }

    #[test]
    fn an_unselected_beacon_is_dropped_and_reveals_a_reset() {
        let mut sightings = Sightings::new(115_200);
        sightings.select(at(5000), &[2]);
        assert_eq!(read(&mut sightings, 6000, &[sighting(1, 3)]), (vec![], false), "of the sweep before");
        let (seen, stranger) = read(&mut sightings, 7000, &[sighting(1, 3), sighting(2, 3)]);
        assert_eq!((seen.len(), stranger), (1, true));
    }

    #[test]
    fn an_impossible_age_is_implausible() {
        let mut sightings = Sightings::new(115_200);
        let old = build_beacons(&[sighting(1, 3), sighting(2, 2001)]);
        let why = sightings.read(at(9000), Epoch::default(), &old);
        assert_eq!(why, Err(Implausible::Value { index: 1, value: 2001 }));
    }
}
