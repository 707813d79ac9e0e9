//! Sonar readings of the planner, from `LL_DATA_RANGES`, or as a fallback from `LL_DATA_SRFS`, the view of 2011, which
//! has one timestamp for all and cannot distinguish silence from a dead sensor.

use crate::config::Body;
use base::{Duration, Instant};
use messages::lowlevel::{DataRanges, DataSrfs, Reading};
use navitools::{Point, wrap};

/// Time for which a reading is valid after its sonar fired: people move (docs/facts/robot.md 4.3).
pub const READING_VALID_FOR: Duration = Duration::from_secs(1);
/// Maximum number of sonars in a message.
pub const SONARS_MAX: usize = 32;
/// Distances at which a floor ranger sees the floor, m (docs/facts/boards.md 3).
const FLOOR_M: std::ops::RangeInclusive<f64> = 0.08..=0.20;
/// Upper bound of the beam's opening angle, rad.
const BEAM_MAX_RAD: f64 = 3.0;
/// Distance before an end of the body at which a beam must reach the body's width to cover that direction of travel, m.
const LANE_M: f64 = 0.8;

/// Mounting of a sonar in the robot's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mount {
    /// Position, m.
    pub at: Point,
    /// Direction of the beam's axis, rad.
    pub theta: f64,
    /// Full opening angle of the beam, rad.
    pub beam: f64,
}

impl Mount {
    /// Mounting; `None` if the position or the beam is invalid.
    fn of(x: f64, y: f64, theta: f64, beam: f64) -> Option<Self> {
        let sits = [x, y, theta].iter().all(|value| value.is_finite() && value.abs() <= 10.0);
        (sits && beam >= 0.0).then(|| Self { at: Point { x, y }, theta, beam: beam.min(BEAM_MAX_RAD) })
    }

    /// True if the beam covers the body's width before the robot's front, or its rear.
    #[must_use]
    pub fn covers(&self, forward: bool, body: &Body) -> bool {
        let x = if forward { body.front + LANE_M } else { -body.rear - LANE_M };
        let bearing = |y: f64| libm::atan2(y - self.at.y, x - self.at.x);
        // From the middle of the lane to its corners, and to the beam.
        let middle = bearing(0.0);
        let corners = [body.width / 2.0, -body.width / 2.0].map(|y| wrap(bearing(y) - middle));
        let (axis, half) = (wrap(self.theta - middle), self.beam / 2.0);
        axis - half <= corners[0].max(corners[1]) && axis + half >= corners[0].min(corners[1])
    }
}

/// Result of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measurement {
    /// Unknown; frees no space.
    Unknown,
    /// No echo in the view of 2011: silence or a failed measurement. Frees no space.
    NoEcho,
    /// Measured, without an echo.
    Silent,
    /// Distance of the nearest echo, m; above 0.
    Echo(f64),
}

/// Reading of one sonar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sounding {
    /// Number of the sonar.
    pub id: i32,
    /// Firing instant.
    pub at: Instant,
    /// The sender's name of the measurement, its own time: a message repeats the ones that are not new.
    pub stamp: i64,
    /// Mounting.
    pub mount: Mount,
    /// Result.
    pub measurement: Measurement,
}

impl Sounding {
    /// True if the sonar measured, as far as the message can tell.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.measurement != Measurement::Unknown
    }

    fn of(id: i32, at: Instant, stamp: i64, mount: Mount, measurement: Measurement) -> Self {
        let sane = !matches!(measurement, Measurement::Echo(distance) if !(distance > 0.0 && distance.is_finite()));
        Self { id, at, stamp, mount, measurement: if sane { measurement } else { Measurement::Unknown } }
    }
}

/// Readings of a message received at `received`. Their instants follow from their age in the message, independent of
/// the sender's clock.
#[must_use]
pub fn of_ranges(received: Instant, message: &DataRanges) -> Vec<Sounding> {
    let sonars = message.readings.iter().filter(|reading| reading.kind == Reading::SONAR);
    let sounding = |reading: &Reading| {
        let mount = Mount::of(reading.x, reading.y, reading.theta, reading.beam)?;
        let age = u64::try_from(message.timestamp.saturating_sub(reading.timestamp)).unwrap_or(0);
        let age = Duration::from_micros(age);
        let measurement = match reading.status {
            _ if age > READING_VALID_FOR => Measurement::Unknown,
            Reading::SILENT => Measurement::Silent,
            Reading::MEASURED => Measurement::Echo(reading.distance),
            _ => Measurement::Unknown,
        };
        Some(Sounding::of(reading.id, received - age, reading.timestamp, mount, measurement))
    };
    sonars.take(SONARS_MAX).filter_map(sounding).collect()
}

/// Floor rangers of a message that see no floor: the point at which each looks, robot frame, m, and in which direction,
/// rad. Unknown readings do not count.
pub fn without_floor(message: &DataRanges) -> impl Iterator<Item = (Point, f64)> + '_ {
    let rangers = message.readings.iter().filter(|reading| reading.kind == Reading::INFRARED).take(SONARS_MAX);
    let missing = |reading: &&Reading| match reading.status {
        Reading::SILENT => true,
        Reading::MEASURED => !FLOOR_M.contains(&reading.distance),
        _ => false,
    };
    rangers.filter(missing).filter_map(|reading| {
        let mount = Mount::of(reading.x, reading.y, reading.theta, 0.0)?;
        Some((mount.at, mount.theta))
    })
}

/// Readings of an `LL_DATA_SRFS` message received at `received`, which is taken as their instant, with this opening
/// angle, rad. Whether they are new, it does not say.
#[must_use]
pub fn of_srfs(received: Instant, message: &DataSrfs, beam: f64) -> Vec<Sounding> {
    let stamp = received.as_nanos() as i64;
    let sounding = |range: &messages::lowlevel::Range| {
        let mount = Mount::of(range.x, range.y, range.theta, beam)?;
        let measurement = if range.valid { Measurement::Echo(range.distance) } else { Measurement::NoEcho };
        Some(Sounding::of(range.id, received, stamp, mount, measurement))
    };
    message.srfs.iter().take(SONARS_MAX).filter_map(sounding).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODY: Body = Body { wheelbase: 0.60, front: 0.75, rear: 0.15, width: 0.60, shape: None };

    fn mount(x: f64, y: f64, degrees: f64, beam: f64) -> Mount {
        Mount::of(x, y, degrees.to_radians(), beam).expect("a mount")
    }

    #[test]
    fn the_direction_that_a_sonar_covers_follows_from_its_mounting_and_beam() {
        let covers =
            |x, y, degrees, beam| [true, false].map(|forward| mount(x, y, degrees, beam).covers(forward, &BODY));
        // The reference robot's: three of five at the front, three of five at the rear.
        for (y, degrees) in [(0.15, 25.0), (0.0, 0.0), (-0.15, -25.0)] {
            assert_eq!(covers(0.75, y, degrees, 0.96), [true, false], "{degrees}");
            assert_eq!(covers(-0.15, y, 180.0 - degrees, 0.96), [false, true], "{degrees}");
        }
        for side in [1.0, -1.0] {
            assert_eq!(covers(0.73, side * 0.28, side * 60.0, 0.96), [false, false]);
            assert_eq!(covers(0.60, side * 0.30, side * 90.0, 0.96), [false, false]);
            assert_eq!(covers(-0.13, side * 0.28, side * 120.0, 0.96), [false, false]);
        }
        // A narrow beam turned outwards misses the path before the robot. And a beam turned inwards from a corner.
        assert_eq!(covers(0.75, 0.15, 40.0, 0.3), [false, false]);
        assert_eq!(covers(0.75, 0.30, -20.0, 0.3), [true, false]);
    }

    #[test]
    fn readings_have_their_own_instants_by_their_age() {
        let reading = |id, age_us: i64, status, distance| Reading {
            timestamp: 5_000_000 - age_us,
            id,
            kind: Reading::SONAR,
            status,
            distance,
            beam: 0.96,
            ..Default::default()
        };
        let readings = vec![
            reading(0, 175_000, Reading::MEASURED, 1.5),
            reading(1, 105_000, Reading::SILENT, f64::NAN),
            reading(2, 105_000, Reading::UNKNOWN, f64::NAN),
            reading(3, 1_200_000, Reading::SILENT, f64::NAN),
            reading(4, -70_000, Reading::MEASURED, f64::NAN),
            Reading { kind: Reading::INFRARED, ..reading(5, 0, Reading::MEASURED, 0.1) },
            Reading { beam: f64::NAN, ..reading(6, 0, Reading::MEASURED, 0.1) },
            Reading { status: 77, ..reading(7, 0, Reading::MEASURED, 0.1) },
        ];
        let message = DataRanges { timestamp: 5_000_000, readings };
        let received = Instant::from_millis(9000);
        let found: Vec<_> = of_ranges(received, &message).iter().map(|s| (s.id, s.at, s.measurement)).collect();
        let at = Instant::from_millis;
        assert_eq!(
            found,
            [
                (0, at(8825), Measurement::Echo(1.5)),
                (1, at(8895), Measurement::Silent),
                (2, at(8895), Measurement::Unknown),
                (3, at(7800), Measurement::Unknown),
                (4, at(9000), Measurement::Unknown),
                (7, at(9000), Measurement::Unknown),
            ]
        );
    }

    #[test]
    fn floor_rangers_see_an_edge_where_they_measure_no_floor() {
        let reading = |kind, status, distance| Reading { kind, status, distance, x: 0.75, ..Default::default() };
        let edges = |kind, status, distance| {
            let message = DataRanges { timestamp: 0, readings: vec![reading(kind, status, distance)] };
            without_floor(&message).count()
        };
        assert_eq!(edges(Reading::INFRARED, Reading::SILENT, f64::NAN), 1);
        assert_eq!([0.07, 0.12, 0.25].map(|m| edges(Reading::INFRARED, Reading::MEASURED, m)), [1, 0, 1]);
        assert_eq!(edges(Reading::INFRARED, Reading::MEASURED, f64::NAN), 1);
        assert_eq!(edges(Reading::INFRARED, Reading::UNKNOWN, f64::NAN), 0);
        assert_eq!(edges(Reading::SONAR, Reading::SILENT, f64::NAN), 0);
    }

    #[test]
    fn the_view_of_2011_frees_nothing() {
        let range = |id, distance: f64| messages::lowlevel::Range {
            id,
            distance,
            valid: distance.is_finite(),
            ..Default::default()
        };
        let message = DataSrfs { timestamp: 0, srfs: vec![range(0, 1.5), range(1, f64::NAN)] };
        let found = of_srfs(Instant::from_millis(9000), &message, 0.96);
        assert_eq!([found[0].measurement, found[1].measurement], [Measurement::Echo(1.5), Measurement::NoEcho]);
        assert!(found.iter().all(|sounding| sounding.at == Instant::from_millis(9000) && sounding.is_known()));
        assert_eq!(found[0].mount.beam, 0.96);
    }
}
