//! Settings of a robot of which nothing is known, found from its recorded data.

use super::Ended;
use super::{Hold, Recording, Robot, RunError, Start, judge, noise};
use crate::filter::{Beacon, Config, Mount, Noise, Nuisances};

/// Duration of the data that settings are found from, s.
const ENOUGH: f64 = 600.0;
/// Standard deviation of the sensor's place, m, if it is unknown.
const PLACE: f64 = 0.3;
/// Difference of evidence below which two settings are equally good.
const TIE: f64 = 4.0;
/// Factors by which the noise of the odometry is varied, one after the other.
const STEPS: [f64; 2] = [2.5, 1.5];
/// Standard deviation of the logarithm of the odometry's noise.
const ODOMETRY_SPREAD: f64 = 0.6;
/// Noise of the odometry along the path, m/√s, and of its rotation, rad/√s: docs/facts/robot.md 3.3.
const ODOMETRY: (f64, f64) = (0.015, 0.025);
/// Deviation of an error that a trial has found, relative to the trial's own: the final run uses the same data again.
const CALIBRATED: f64 = 1.5;
/// A delay below zero, which only clocks can make, counts as one so many times as large.
const EARLY: f64 = 3.0;

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
    let odometry = Noise { along_per_m: 0.0, along_per_s: ODOMETRY.0, turn_per_m: 0.0, turn_per_s: ODOMETRY.1 };
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

/// A robot that was tried.
struct Trial {
    robot: Robot,
    ended: Ended,
    /// Logarithm of its likelihood.
    evidence: f64,
}

impl Trial {
    fn new(recording: &Recording, robot: Robot, start: Option<Start>) -> Result<Self, RunError> {
        let ended = judge(recording, &robot, start, ENOUGH)?;
        let Noise { along_per_s, turn_per_s, .. } = robot.config.odometry;
        let odd = |value: f64, usual: f64| {
            let off = libm::log(value.max(1e-6) / usual) / ODOMETRY_SPREAD;
            0.5 * off * off
        };
        let unusual = odd(along_per_s, ODOMETRY.0) + odd(turn_per_s, ODOMETRY.1);
        let evidence = noise::evidence(&robot.config, &ended.judged) - unusual;
        Ok(Self { robot, ended, evidence })
    }

    /// The robot with the noise of bearings that the trial shows.
    fn adapted(&self) -> Robot {
        let mut robot = self.robot.clone();
        noise::adapt(&mut robot.config, &self.ended.judged);
        robot
    }

    /// The robot with the errors known that the trial has found.
    fn calibrated(&self) -> Robot {
        let Ended { nuisances, deviations, .. } = &self.ended;
        let least = |prior: f64, found: f64| prior.min(CALIBRATED * found);
        let config = &self.robot.config;
        let config = Config {
            mount: if config.place > 0.0 { Mount { x: nuisances.place.x, y: nuisances.place.y } } else { config.mount },
            place: least(config.place, deviations.place),
            turn: least(config.turn, deviations.turn),
            scale: least(config.scale, deviations.scale),
            bend: least(config.bend, deviations.bend),
            track: least(config.track, deviations.track),
            delay: least(config.delay, deviations.delay),
            ..config.clone()
        };
        Robot { config, hold: self.robot.hold, known: *nuisances }
    }

    /// Rank of the delay found, smallest first.
    fn late(&self) -> f64 {
        let delay = self.ended.nuisances.delay;
        if delay < 0.0 { -EARLY * delay } else { delay }
    }
}

fn turn_of(noise: &mut Noise) -> &mut f64 {
    &mut noise.turn_per_s
}

fn along_of(noise: &mut Noise) -> &mut f64 {
    &mut noise.along_per_s
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
) -> Result<Robot, RunError> {
    let mut unknown = unknown(beacons, known);
    let mut best = Trial::new(recording, unknown.clone(), start)?;
    if best.ended.judged.is_empty() {
        // Never located: there is nothing to find settings from.
        return Ok(unknown);
    }
    for step in STEPS {
        // The noise of bearings is found where it is judged, and the fit depends on it.
        unknown = Robot { config: Config { odometry: best.robot.config.odometry, ..unknown.config }, ..unknown };
        noise::adapt(&mut unknown.config, &best.ended.judged);
        let wide = Trial::new(recording, unknown.clone(), start)?;
        best = Trial::new(recording, wide.calibrated(), start)?;
        for of in [turn_of as fn(&mut Noise) -> &mut f64, along_of] {
            for factor in [step, 1.0 / step] {
                let mut robot = best.robot.clone();
                *of(&mut robot.config.odometry) *= factor;
                let other = Trial::new(recording, robot, start)?;
                if other.evidence > best.evidence {
                    best = other;
                    break;
                }
            }
        }
    }
    let Robot { config: Config { bearing, lasting, lasting_s, wild, odometry, .. }, .. } = best.adapted();
    unknown.config = Config { bearing, lasting, lasting_s, wild, odometry, ..unknown.config };
    match known.hold {
        Some(_) => Ok(Trial::new(recording, unknown, start)?.calibrated()),
        None => Ok(of_holds(recording, &unknown, start)?.calibrated()),
    }
}

/// Finds what the rates of a row of odometry mean, of a robot that is known otherwise.
///
/// # Errors
/// The robot or the start is refused.
pub fn find_hold(recording: &Recording, robot: Robot, start: Option<Start>) -> Result<Robot, RunError> {
    Ok(of_holds(recording, &robot, start)?.robot)
}

/// The better of both meanings of a row's rates. They, and late stamps, shift the bearings against the way alike, so
/// that the data often cannot tell: of two that are equally good that with the smaller delay is taken.
fn of_holds(recording: &Recording, robot: &Robot, start: Option<Start>) -> Result<Trial, RunError> {
    let [one, other] = Hold::ALL.map(|hold| Trial::new(recording, Robot { hold, ..robot.clone() }, start));
    let (one, other) = (one?, other?);
    let tie = (one.evidence - other.evidence).abs() < TIE;
    let first = if tie { one.late() <= other.late() } else { one.evidence > other.evidence };
    Ok(if first { one } else { other })
}
