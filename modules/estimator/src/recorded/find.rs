//! Settings of a robot of which nothing is known, found from its recorded data.

use super::{Ended, Hold, Recording, Robot, RunError, Start, noise, run};
use crate::filter::{Beacon, Config, Mount, Noise, Nuisances, Quality};

/// Duration of the data that settings are found from, s.
const ENOUGH: f64 = 600.0;
/// Standard deviation of the sensor's place, m, if it is unknown.
const PLACE: f64 = 0.3;
/// Difference of evidence below which two settings are equally good.
const TIE: f64 = 10.0;
/// Number of times that the noise is found, each with the errors that were found with the one before.
const ROUNDS: usize = 2;
/// Deviation of an error that a trial has found, relative to the trial's own: the final run uses the same data again.
const CALIBRATED: f64 = 1.5;
/// Delay, in standard deviations, that may as well be none.
const NO_DELAY: f64 = 2.0;
/// Factor of the covariance of a start that is found: the bearings that it was found by are used again.
const TWICE: f64 = 2.0;

/// What is known of the robot beforehand.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known {
    /// Meaning of a row's rates.
    pub hold: Option<Hold>,
    /// Place of the sensor.
    pub mount: Option<Mount>,
}

/// A robot of which nothing else is known, before its data are looked at.
fn unknown(beacons: Vec<Beacon>, known: Known) -> Robot {
    let odometry = Noise { along_per_m: 0.0, along_per_s: 0.015, turn_per_m: 0.0, turn_per_s: 0.025 };
    let config = Config {
        beacons,
        mount: known.mount.unwrap_or(Mount { x: 0.0, y: 0.0 }),
        place: if known.mount.is_some() { 0.0 } else { PLACE },
        odometry,
        bearing: 0.02,
        lasting: 0.9,
        lasting_s: 2.0,
        wild: 0.1,
        range: 1000.0,
        // Settings found from the data are uncertain.
        fine_m: 0.15,
        fine_rad: 3.5f64.to_radians(),
        ..Config::default()
    };
    Robot { config, hold: known.hold.unwrap_or(Hold::Before), known: Nuisances::default() }
}

/// What the data say.
#[derive(Clone, Debug)]
pub struct Found {
    /// The robot.
    pub robot: Robot,
    /// Where it started: as given, or as found.
    pub start: Option<Start>,
}

/// A robot that was tried over a recording, and the way back from where it was located last.
struct Trial {
    ended: Ended,
    back: Recording,
    end: Option<Start>,
    /// The robot on its way back, its errors where they were found, and as uncertain as before.
    robot: Robot,
}

impl Trial {
    fn new(recording: &Recording, robot: &Robot, start: Option<Start>) -> Result<Self, RunError> {
        let mut last = None;
        let ended = run(recording, robot, start, |time, estimate| {
            if estimate.quality >= Quality::Coarse {
                last = Some((time, estimate));
            }
        })?;
        let end = last.map(|(_, last)| (last.pose, wide(last.covariance)));
        let back = last.map_or_else(Recording::default, |(time, _)| recording.until(time).backwards());
        let mut found = Robot { known: ended.nuisances, ..robot.clone() };
        found.config.mount = mount(&robot.config, ended.nuisances);
        Ok(Self { ended, back, end, robot: found.backwards() })
    }

    /// Logarithm of its likelihood.
    fn evidence(&self) -> f64 {
        self.end.map_or(f64::NEG_INFINITY, |end| noise::pass(&self.back, &self.robot, end).evidence)
    }

    /// Delay found, in its standard deviations.
    fn late(&self) -> f64 {
        self.ended.nuisances.delay / self.ended.deviations.delay.max(1e-6)
    }
}

/// Covariance of a pose that bearings have found which are used again.
fn wide(covariance: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    covariance.map(|row| row.map(|value| TWICE * value))
}

/// Place of the sensor, if it was looked for.
fn mount(config: &Config, Nuisances { place, .. }: Nuisances) -> Mount {
    if config.place > 0.0 { Mount { x: place.x, y: place.y } } else { config.mount }
}

/// The robot with its errors known, and where it started, from a pass over the way back; `back`: the robot on it.
fn settled(back: &Robot, passed: &noise::Passed) -> Found {
    let (state, config) = (&passed.state, &back.config);
    let (nuisances, found) = (back.nuisances(state.nuisances(config.mount.into())), state.nuisance_deviations());
    let least = |prior: f64, found: f64| prior.min(CALIBRATED * found);
    let config = Config {
        mount: mount(config, nuisances),
        place: least(config.place, found.place),
        turn: least(config.turn, found.turn),
        scale: least(config.scale, found.scale),
        bend: least(config.bend, found.bend),
        track: least(config.track, found.track),
        delay: least(config.delay, found.delay),
        ..config.clone()
    };
    let robot = Robot { config, hold: back.hold, known: nuisances }.backwards();
    Found { robot, start: Some((state.pose(), wide(state.pose_covariance()))) }
}

/// Finds the settings that a recording fits: noise of the bearings, how long their errors last, the part of outliers,
/// noise of the odometry, the meaning of a row's rates, and the errors that the robot's measurements always have.
///
/// # Errors
/// The map or the start is refused.
pub fn find_out(
    recording: &Recording,
    beacons: Vec<Beacon>,
    known: Known,
    start: Option<Start>,
) -> Result<Found, RunError> {
    let recording = &recording.first(ENOUGH);
    let mut unknown = unknown(beacons, known);
    for _ in 0..ROUNDS {
        let Trial { back, end: Some(end), mut robot, .. } = Trial::new(recording, &unknown, start)? else {
            // Never located: there is nothing to find settings from.
            return Ok(Found { robot: unknown, start });
        };
        noise::find(&back, &mut robot, end);
        let Config { bearing, lasting, lasting_s, wild, odometry, .. } = robot.config;
        unknown.config = Config { bearing, lasting, lasting_s, wild, odometry, ..unknown.config };
    }
    if known.hold.is_none() {
        unknown = of_holds(recording, &unknown, start)?;
    }
    let Trial { back, end: Some(end), robot, .. } = Trial::new(recording, &unknown, start)? else {
        return Ok(Found { robot: unknown, start });
    };
    let found = settled(&robot, &noise::pass(&back, &robot, end));
    Ok(Found { start: start.or(found.start), ..found })
}

/// Finds what the rates of a row of odometry mean, of a robot that is known otherwise.
///
/// # Errors
/// The robot or the start is refused.
pub fn find_hold(recording: &Recording, robot: Robot, start: Option<Start>) -> Result<Robot, RunError> {
    of_holds(&recording.first(ENOUGH), &robot, start)
}

/// The robot with the meaning of a row's rates that fits. They, and late stamps, shift the bearings against the way
/// alike, so that the data often cannot tell. Then a meaning with which the bearings come before they are made is
/// wrong, and one with which they are not late is right; else it is in between, where the error is half a row's way at
/// most.
fn of_holds(recording: &Recording, robot: &Robot, start: Option<Start>) -> Result<Robot, RunError> {
    let with = |hold| Robot { hold, ..robot.clone() };
    let before = Trial::new(recording, &with(Hold::Before), start)?;
    let after = Trial::new(recording, &with(Hold::After), start)?;
    let (gain, late) = (after.evidence() - before.evidence(), (before.late(), after.late()));
    Ok(with(match () {
        () if gain.abs() >= TIE => {
            if gain > 0.0 {
                Hold::After
            } else {
                Hold::Before
            }
        }
        // The delay is the smaller one if the rates hold from their row on.
        () if late.1 < -NO_DELAY || late.0.abs() < NO_DELAY && late.1.abs() >= NO_DELAY => Hold::Before,
        () if late.1.abs() < NO_DELAY => Hold::After,
        () => Hold::Between,
    }))
}
