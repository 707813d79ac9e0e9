//! Health of the ranging boards: the robot moves only while each of them measures.
//!
//! A board serves sonars and the floor sensors that detect stairs, so a lost board stops every source, in any
//! direction. The evidence is `LL_DATA_RANGES`: every range finder of a board must have made a measurement, with an
//! echo or without, within the greatest age. That the driver's process runs, or that it publishes, is no proof.

use base::{Duration, Instant};
use messages::lowlevel::{DataRanges, Reading};

/// A ranging board and the numbers of its range finders in `LL_DATA_RANGES`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RangingBoard {
    /// Name in messages.
    pub name: String,
    /// Numbers of its sonars.
    pub sonars: Vec<i32>,
    /// Numbers of its infrared rangers.
    pub infrareds: Vec<i32>,
}

/// Range finder, and the instant of its last measurement.
#[derive(Clone, Copy, Debug)]
struct Finder {
    kind: i8,
    id: i32,
    measured: Option<Instant>,
}

#[derive(Debug)]
struct Board {
    name: String,
    finders: Vec<Finder>,
    /// Instant at which it becomes unknown; `None` while any of its range finders has never measured.
    expires: Option<Instant>,
}

/// All ranging boards of the robot.
#[derive(Debug)]
pub struct Ranging {
    boards: Vec<Board>,
    age_max: Duration,
}

impl Ranging {
    /// Creates the state with nothing received. `age_max`: greatest age of a measurement. A board without range finders
    /// is not judged.
    #[must_use]
    pub fn new(boards: &[RangingBoard], age_max: Duration) -> Self {
        let finder = |kind| move |id: &i32| Finder { kind, id: *id, measured: None };
        let board = |board: &RangingBoard| Board {
            name: board.name.clone(),
            finders: board
                .sonars
                .iter()
                .map(finder(Reading::SONAR))
                .chain(board.infrareds.iter().map(finder(Reading::INFRARED)))
                .collect(),
            expires: None,
        };
        let boards = boards.iter().map(board).filter(|board| !board.finders.is_empty()).collect();
        Self { boards, age_max }
    }

    /// Processes readings received at `at`. Their instants follow from their age in the message, independently of the
    /// sender's clock.
    pub fn on_ranges(&mut self, at: Instant, message: &DataRanges) {
        for reading in &message.readings {
            let known = match reading.status {
                Reading::MEASURED => reading.distance.is_finite() && reading.distance > 0.0,
                Reading::SILENT => true,
                _ => false,
            };
            let finders = self.boards.iter_mut().flat_map(|board| &mut board.finders);
            let found = finders.into_iter().find(|finder| (finder.kind, finder.id) == (reading.kind, reading.id));
            if let Some(finder) = found.filter(|_| known) {
                let age = u64::try_from(message.timestamp.saturating_sub(reading.timestamp)).unwrap_or(0);
                finder.measured = finder.measured.max(Some(at - Duration::from_micros(age)));
            }
        }
        for board in &mut self.boards {
            let oldest = board.finders.iter().map(|finder| finder.measured).min().flatten();
            board.expires = oldest.map(|oldest| oldest + self.age_max);
        }
    }

    /// Indices of the boards that do not measure at `now`.
    pub fn lost(&self, now: Instant) -> impl Iterator<Item = usize> + Clone + '_ {
        let is_lost = move |board: &Board| board.expires.is_none_or(|until| now >= until);
        (0..self.boards.len()).filter(move |place| is_lost(&self.boards[*place]))
    }

    /// Name of a board; empty if there is none at this index.
    #[must_use]
    pub fn name(&self, place: usize) -> &str {
        self.boards.get(place).map_or("", |board| board.name.as_str())
    }

    /// Next instant after `now` at which a board becomes unknown.
    #[must_use]
    pub fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        self.boards.iter().filter_map(|board| board.expires).filter(|until| *until > now).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AGE_MAX: Duration = Duration::from_millis(600);

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    fn ranging() -> Ranging {
        let board = |name: &str, first: i32| RangingBoard {
            name: name.into(),
            sonars: vec![first, first + 1],
            infrareds: vec![first],
        };
        Ranging::new(&[board("front", 0), board("rear", 2), RangingBoard::default()], AGE_MAX)
    }

    /// Readings of this kind: number, status, age in ms.
    fn ranges(kind: i8, readings: &[(i32, i8, i64)]) -> DataRanges {
        let timestamp = 9_000_000;
        let reading = |&(id, status, age): &(i32, i8, i64)| Reading {
            timestamp: timestamp - 1000 * age,
            id,
            kind,
            status,
            distance: if status == Reading::MEASURED { 1.0 } else { f64::NAN },
            ..Default::default()
        };
        DataRanges { timestamp, readings: readings.iter().map(reading).collect() }
    }

    fn lost(ranging: &Ranging, ms: u64) -> Vec<&str> {
        ranging.lost(at(ms)).map(|place| ranging.name(place)).collect()
    }

    /// All range finders have measured at this time, but for the sonars.
    fn floor(ranging: &mut Ranging, ms: u64) {
        ranging.on_ranges(at(ms), &ranges(Reading::INFRARED, &[(0, Reading::MEASURED, 0), (2, Reading::SILENT, 0)]));
    }

    fn sonars(ranging: &mut Ranging, ms: u64, statuses: [i8; 4], age: i64) {
        let readings: Vec<_> = (0..).zip(statuses).map(|(id, status)| (id, status, age)).collect();
        ranging.on_ranges(at(ms), &ranges(Reading::SONAR, &readings));
    }

    #[test]
    fn a_board_is_lost_until_each_of_its_range_finders_has_measured() {
        let mut ranging = ranging();
        assert_eq!((lost(&ranging, 1000), ranging.poll_timeout(at(1000))), (vec!["front", "rear"], None));
        floor(&mut ranging, 1000);
        sonars(&mut ranging, 1000, [Reading::MEASURED, Reading::UNKNOWN, Reading::SILENT, Reading::SILENT], 0);
        assert_eq!(lost(&ranging, 1000), ["front"]);
        sonars(&mut ranging, 1010, [Reading::UNKNOWN, Reading::MEASURED, Reading::SILENT, Reading::SILENT], 0);
        assert_eq!((lost(&ranging, 1010).len(), ranging.poll_timeout(at(1010))), (0, Some(at(1600))));
    }

    #[test]
    fn messages_without_measurements_keep_no_board_alive() {
        let mut ranging = ranging();
        floor(&mut ranging, 1000);
        sonars(&mut ranging, 1000, [Reading::SILENT; 4], 0);
        for ms in (1010..1600).step_by(10) {
            floor(&mut ranging, ms);
            sonars(&mut ranging, ms, [Reading::SILENT, Reading::SILENT, Reading::UNKNOWN, Reading::SILENT], 0);
            assert!(lost(&ranging, ms).is_empty(), "{ms}");
        }
        assert_eq!(lost(&ranging, 1600), ["rear"]);
        sonars(&mut ranging, 1700, [Reading::SILENT; 4], 650);
        assert_eq!(lost(&ranging, 1700), ["rear"], "a measurement that is read again keeps its instant");
        sonars(&mut ranging, 1750, [Reading::MEASURED; 4], 100);
        assert!(lost(&ranging, 1750).is_empty());
    }

    #[test]
    fn invalid_readings_are_no_measurements() {
        let mut ranging = ranging();
        floor(&mut ranging, 1000);
        let mut message = ranges(Reading::SONAR, &[(0, Reading::MEASURED, 0), (1, 77, 0), (99, Reading::SILENT, 0)]);
        message.readings[0].distance = f64::NAN;
        ranging.on_ranges(at(1000), &message);
        assert_eq!(lost(&ranging, 1000), ["front", "rear"]);
        // An instant in the future is now.
        sonars(&mut ranging, 1000, [Reading::SILENT; 4], -5000);
        assert_eq!(ranging.poll_timeout(at(1000)), Some(at(1600)));
    }
}
