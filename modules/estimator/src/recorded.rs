//! The filter over recorded data, and what the data say of a robot of which nothing is known.
//!
//! The filter on the robot counts errors of bearings that last by smaller weights. Here, where time is no matter, they
//! are states of their own: a pass over the way back (`noise`) gives the likelihood of noise and conventions, the
//! errors that the robot's measurements always have, and where the robot started.

mod find;
mod noise;

pub use find::{Found, Known, find_hold, find_out};

use crate::filter::{Config, ConfigError, Counts, Estimate, Kalman, Nuisances, Refused};
use crate::filter::{NuisanceDeviations, PLACE_KNOWN, PLACE_UNKNOWN};
use base::{Instant, listed};
use navitools::{Motion, Pose};

/// The filter's time begins this long before the first row: a bearing may be older than the first row, s.
const BEFORE: f64 = 10.0;
/// Recorded measurements.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Time, s, and velocities of each row of odometry; times ascend.
    pub odometry: Vec<(f64, Motion)>,
    /// Time stamp, s, number of the beacon, and bearing, rad, in order of time.
    pub bearings: Vec<(f64, i32, f64)>,
}

impl Recording {
    /// The first seconds.
    fn first(&self, seconds: f64) -> Self {
        self.until(self.odometry.first().map_or(0.0, |(time, _)| time + seconds))
    }

    /// The part up to a time, s.
    fn until(&self, end: f64) -> Self {
        let rows = self.odometry.partition_point(|(time, _)| *time <= end);
        let bearings = self.bearings.partition_point(|(stamp, ..)| *stamp <= end);
        Self { odometry: self.odometry[..rows].to_vec(), bearings: self.bearings[..bearings].to_vec() }
    }

    /// The robot's way back, at negative times.
    fn backwards(&self) -> Self {
        let back = |rates: Motion| Motion { translation: -rates.translation, rotation: -rates.rotation };
        Self {
            odometry: self.odometry.iter().rev().map(|(time, rates)| (-time, back(*rates))).collect(),
            bearings: self.bearings.iter().rev().map(|(stamp, id, bearing)| (-stamp, *id, *bearing)).collect(),
        }
    }
}

listed! {
    /// Interval of validity of an odometry row's rates.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Hold {
        /// From the row before up to its time.
        Before = 0 => "before",
        /// From its time to the next row's.
        After = 1 => "after",
        /// From half a row before its time to half a row after.
        Between = 2 => "between",
    }
}

/// A robot as the filter takes it.
#[derive(Clone, Debug)]
pub struct Robot {
    /// Accuracy of its sensors, and the map.
    pub config: Config,
    /// Meaning of a row's rates.
    pub hold: Hold,
    /// Known errors of its measurements, which are corrected before the filter gets them. The sensor's place is that of
    /// the configuration.
    pub known: Nuisances,
}

impl Robot {
    /// Time stamp of a bearing, s, and the bearing, rad, without the known delay and mounting angle.
    fn bearing(&self, stamp: f64, bearing: f64) -> (f64, f64) {
        (stamp - self.known.delay, bearing + self.known.turn)
    }

    /// Velocities between two rows, without the known errors.
    fn between(&self, before: Motion, after: Motion) -> Motion {
        self.rates(match self.hold {
            Hold::Before => after,
            Hold::After => before,
            Hold::Between => Motion {
                translation: (before.translation + after.translation) / 2.0,
                rotation: (before.rotation + after.rotation) / 2.0,
            },
        })
    }

    /// The robot of [`Recording::backwards`].
    fn backwards(&self) -> Self {
        let hold = match self.hold {
            Hold::Before => Hold::After,
            Hold::After => Hold::Before,
            Hold::Between => Hold::Between,
        };
        let known = Nuisances { delay: -self.known.delay, ..self.known };
        Self { hold, known, config: self.config.clone() }
    }

    /// Velocities without the known errors of the odometry.
    fn rates(&self, Motion { translation, rotation }: Motion) -> Motion {
        let Nuisances { scale, bend, track, .. } = self.known;
        Motion { translation: (1.0 + scale) * translation, rotation: (1.0 + track) * rotation + bend * translation }
    }

    /// Known errors and those that a filter has found beyond them.
    fn nuisances(&self, found: Nuisances) -> Nuisances {
        let known = self.known;
        Nuisances {
            turn: known.turn + found.turn,
            scale: (1.0 + known.scale) * (1.0 + found.scale) - 1.0,
            bend: known.bend + found.bend,
            track: (1.0 + known.track) * (1.0 + found.track) - 1.0,
            delay: known.delay + found.delay,
            place: found.place,
        }
    }
}

/// Initial pose with its covariance of x, y, θ; m², m rad, rad².
pub type Start = (Pose, [[f64; 3]; 3]);

/// What a run ends with.
#[derive(Clone, Debug)]
pub struct Ended {
    /// Accepted and refused measurements.
    pub counts: Counts,
    /// Estimated calibration parameters.
    pub nuisances: Nuisances,
    /// Their standard deviations.
    pub deviations: NuisanceDeviations,
}

/// Why there is no run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunError {
    /// The configuration is inconsistent.
    Config(ConfigError),
    /// The initial pose is refused.
    Start(Refused),
}

/// Runs the filter over a recording; calls `each` for each row of odometry with its time, s, and the estimate from what
/// was known then.
///
/// # Errors
/// The configuration or the start is refused.
pub fn run(
    recording: &Recording,
    robot: &Robot,
    start: Option<Start>,
    each: impl FnMut(f64, Estimate),
) -> Result<Ended, RunError> {
    match robot.config.place > 0.0 {
        true => replay::<PLACE_UNKNOWN>(recording, robot, start, each),
        false => replay::<PLACE_KNOWN>(recording, robot, start, each),
    }
}

fn replay<const N: usize>(
    recording: &Recording,
    robot: &Robot,
    start: Option<Start>,
    mut each: impl FnMut(f64, Estimate),
) -> Result<Ended, RunError> {
    let mut filter = Kalman::<N>::new(robot.config.clone()).map_err(RunError::Config)?;
    let first = recording.odometry.first().map_or(0.0, |(time, _)| *time);
    let at = |time: f64| Instant::from_nanos(((time - first + BEFORE).max(0.0) * 1e9 + 0.5) as u64);
    let mut bearings = recording.bearings.iter().peekable();
    let mut before = Motion::default();
    for (row, (time, rates)) in recording.odometry.iter().enumerate() {
        let own = robot.between(before, *rates);
        before = *rates;
        // Refusals are counted.
        let _ = filter.odometry(at(*time), own);
        if let Some((pose, covariance)) = start.filter(|_| row == 0) {
            filter.set(pose, covariance).map_err(RunError::Start)?;
        }
        while let Some((stamp, id, bearing)) = bearings.next_if(|(stamp, ..)| stamp <= time) {
            let (stamp, bearing) = robot.bearing(*stamp, *bearing);
            let _ = filter.bearing(at(stamp), *id, bearing);
        }
        each(*time, filter.estimate(at(*time)));
    }
    let (counts, deviations) = (filter.counts(), filter.nuisance_deviations());
    Ok(Ended { counts, nuisances: robot.nuisances(filter.nuisances()), deviations })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::{Beacon, Quality};
    use navitools::Point;

    /// Two minutes of a robot that drives in a circle and sees the beacons in directions that fit no pose.
    fn nonsense() -> Recording {
        let rates = Motion { translation: 0.5, rotation: 0.3 };
        let odometry = (0..2400).map(|row| (f64::from(row) * 0.05, rates)).collect();
        let bearing = |n: i32| (f64::from(n) * 0.1, 1 + n % 6, libm::sin(f64::from(n * n)) * 3.0);
        Recording { odometry, bearings: (0..1200).map(bearing).collect() }
    }

    #[test]
    fn beacons_on_a_line_or_at_one_place_end_without_a_fine_pose() {
        let line = |id: i32| Point { x: 2.0 * f64::from(id), y: 1.0 };
        let point = |_: i32| Point { x: 2.0, y: 1.0 };
        let far = |id: i32| Point { x: 1e7 - f64::from(id * id), y: -1e7 };
        for place in [line as fn(i32) -> Point, point, far] {
            let beacons: Vec<Beacon> = (1..=6).map(|id| Beacon { id, at: place(id) }).collect();
            let Found { robot, start } = find_out(&nonsense(), beacons, Known::default(), None).unwrap();
            let mut rows = 0;
            let each = |_, estimate: Estimate| {
                rows += 1;
                assert!(estimate.quality < Quality::Fine, "{estimate:?}");
            };
            run(&nonsense(), &robot, start, each).unwrap();
            assert_eq!(rows, 2400);
        }
    }

    #[test]
    fn rates_hold_up_to_their_row_or_from_it_on() {
        let rates = |translation| Motion { translation, rotation: 0.0 };
        let recording = Recording { odometry: vec![(0.0, rates(1.0)), (1.0, rates(0.5))], bearings: Vec::new() };
        let start = Some((Pose::default(), [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]]));
        let end = |hold| {
            let robot = Robot { config: Config::default(), hold, known: Nuisances::default() };
            let mut x = 0.0;
            run(&recording, &robot, start, |_, estimate| x = estimate.pose.x).unwrap();
            x
        };
        for (hold, x) in [(Hold::Before, 0.5), (Hold::After, 1.0), (Hold::Between, 0.75)] {
            assert!((end(hold) - x).abs() < 1e-9, "{hold}: {}", end(hold));
        }
    }
}
