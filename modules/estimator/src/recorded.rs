//! The filter over recorded data, and what the data say of a robot of which nothing is known.
//!
//! Noise and conventions are found from bearings that the estimate does not depend on ([`Kalman::judge_by`]): each
//! beacon is withheld for a third of the time, in turn. The fit of bearings that the filter has used would favour one
//! that follows their errors.

mod find;
mod noise;

pub use find::{Known, find_hold, find_out};

use crate::filter::{Config, ConfigError, Counts, Estimate, Kalman, Nuisances, Refused};
use crate::filter::{Judged, NuisanceDeviations, PLACE_KNOWN, PLACE_UNKNOWN};
use base::{Instant, listed};
use navitools::{Motion, Pose};

/// The filter's time begins this long before the first row: a bearing may be older than the first row, s.
const BEFORE: f64 = 10.0;
/// Period in which a beacon is withheld once, s; the part of it; and the shift from one beacon to the next.
const WITHHELD_EVERY: f64 = 36.0;
const WITHHELD_PART: f64 = 1.0 / 3.0;
const WITHHELD_SHIFT: f64 = 0.382;
/// Time at the beginning in which no beacon is withheld, s: the pose must be found.
const BEGIN: f64 = 15.0;
/// Time after which the estimate hardly depends on what a withheld beacon had shown, s.
const FORGOTTEN: f64 = 4.0;

/// Recorded measurements.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Time, s, and velocities of each row of odometry; times ascend.
    pub odometry: Vec<(f64, Motion)>,
    /// Time stamp, s, number of the beacon, and bearing, rad, in order of time.
    pub bearings: Vec<(f64, i32, f64)>,
}

listed! {
    /// Interval of validity of an odometry row's rates.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Hold {
        /// From the row before up to its time.
        Before = 0 => "before",
        /// From its time to the next row's.
        After = 1 => "after",
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
    /// Fits of the bearings that were withheld.
    judged: Vec<Judged>,
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
    let all = |_, _| None;
    match robot.config.place > 0.0 {
        true => replay::<PLACE_UNKNOWN>(recording, robot, start, f64::INFINITY, all, each),
        false => replay::<PLACE_KNOWN>(recording, robot, start, f64::INFINITY, all, each),
    }
}

/// Runs the filter over the first `seconds` with beacons withheld in turn.
fn judge(recording: &Recording, robot: &Robot, start: Option<Start>, seconds: f64) -> Result<Ended, RunError> {
    let turn = |id, time| withheld(&robot.config, id, time);
    match robot.config.place > 0.0 {
        true => replay::<PLACE_UNKNOWN>(recording, robot, start, seconds, turn, |_, _| ()),
        false => replay::<PLACE_KNOWN>(recording, robot, start, seconds, turn, |_, _| ()),
    }
}

/// What to do with a bearing of a beacon at a time, s: `None` to use it, else whether to judge by it.
fn withheld(config: &Config, id: i32, time: f64) -> Option<bool> {
    let place = config.beacons.iter().position(|beacon| beacon.id == id)?;
    let turns = time / WITHHELD_EVERY + place as f64 * WITHHELD_SHIFT;
    let phase = turns - libm::floor(turns);
    (phase < WITHHELD_PART && time >= BEGIN).then_some(phase * WITHHELD_EVERY >= FORGOTTEN)
}

/// Runs the filter; `turn` as [`withheld`].
fn replay<const N: usize>(
    recording: &Recording,
    robot: &Robot,
    start: Option<Start>,
    seconds: f64,
    turn: impl Fn(i32, f64) -> Option<bool>,
    mut each: impl FnMut(f64, Estimate),
) -> Result<Ended, RunError> {
    let mut filter = Kalman::<N>::new(robot.config.clone()).map_err(RunError::Config)?;
    let first = recording.odometry.first().map_or(0.0, |(time, _)| *time);
    let at = |time: f64| Instant::from_nanos(((time - first + BEFORE).max(0.0) * 1e9 + 0.5) as u64);
    let mut bearings = recording.bearings.iter().peekable();
    let mut before = Motion::default();
    for (row, (time, rates)) in recording.odometry.iter().enumerate() {
        if time - first > seconds {
            break;
        }
        let rates = robot.rates(*rates);
        let own = if robot.hold == Hold::Before { rates } else { before };
        before = rates;
        // Refusals are counted.
        let _ = filter.odometry(at(*time), own);
        if let Some((pose, covariance)) = start.filter(|_| row == 0) {
            filter.set(pose, covariance).map_err(RunError::Start)?;
        }
        while let Some((stamp, id, bearing)) = bearings.next_if(|(stamp, ..)| stamp <= time) {
            let (stamp, bearing) = robot.bearing(*stamp, *bearing);
            let _ = match turn(*id, stamp - first) {
                None => filter.bearing(at(stamp), *id, bearing),
                Some(true) => filter.judge_by(at(stamp), *id, bearing),
                Some(false) => Ok(()),
            };
        }
        each(*time, filter.estimate(at(*time)));
    }
    let (counts, deviations, judged) = (filter.counts(), filter.nuisance_deviations(), filter.judged().to_vec());
    Ok(Ended { counts, nuisances: robot.nuisances(filter.nuisances()), deviations, judged })
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
            let robot = find_out(&nonsense(), beacons, Known::default(), None).unwrap();
            let mut rows = 0;
            let each = |_, estimate: Estimate| {
                rows += 1;
                assert!(estimate.quality < Quality::Fine, "{estimate:?}");
            };
            run(&nonsense(), &robot, None, each).unwrap();
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
        assert!((end(Hold::Before) - 0.5).abs() < 1e-9 && (end(Hold::After) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn each_beacon_is_withheld_for_a_third_of_the_time() {
        let at = Point { x: 0.0, y: 0.0 };
        let config = Config { beacons: (1..=3).map(|id| Beacon { id, at }).collect(), ..Config::default() };
        for id in 1..=3 {
            let turns: Vec<_> = (0..3600).map(|n| withheld(&config, id, 36.0 + f64::from(n) * 0.1)).collect();
            let (out, judged) =
                (turns.iter().flatten().count(), turns.iter().filter(|turn| **turn == Some(true)).count());
            assert!((1150..1250).contains(&out) && (750..850).contains(&judged), "{out} {judged}");
        }
        assert!(withheld(&config, 9, 50.0).is_none() && (1..=3).all(|id| withheld(&config, id, 10.0).is_none()));
    }
}
