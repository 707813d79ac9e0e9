//! Recordings of robots of all kinds, with the truth: what `advee estimate` is given by others.
//!
//! A seed draws the room, the beacons, the robot, its sensor and its errors: bearings of 0.0255 rad whose errors last 1
//! to 10 s, of a scanner or of a camera with a narrow view; the sensor up to 0.3 m off; stamps of an unknown delay;
//! rates that hold before or after their row; no outliers, or a fifth of all bearings.

use super::matrix::normalized;
use super::truth::Random;
use core::f64::consts::{PI, TAU};
use estimator::filter::{Beacon, Config, Counts, Estimate, Mount, Noise, Nuisances, Quality};
use estimator::recorded::{Found, Hold, Known, Recording, Robot, Start, find_out, run};
use navitools::{Angle, Motion, Point, Pose, wrap};

/// Duration of a recording, s.
pub const LENGTH: f64 = 120.0;
/// Standard deviation of a bearing, rad.
pub const SIGMA: f64 = 0.0255;
/// Period of the odometry, s; and of its integration.
const ROW: f64 = 0.05;
/// Initial time whose errors are not compared, s.
const SETTLES: f64 = 30.0;

/// Parameters of a recording, beside those that are drawn.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    pub name: &'static str,
    /// Width of the view, rad.
    pub view: f64,
    /// Sightings of a beacon per second.
    pub rate: f64,
    /// Probability of an outlier.
    pub wild: f64,
}

pub const KINDS: [Kind; 4] = [
    Kind { name: "scanner", view: TAU, rate: 2.0, wild: 0.0 },
    Kind { name: "camera, narrow view", view: PI / 2.0, rate: 5.0, wild: 0.0 },
    Kind { name: "scanner, 20 % outliers", view: TAU, rate: 2.0, wild: 0.2 },
    Kind { name: "camera, 20 % outliers", view: PI / 2.0, rate: 5.0, wild: 0.2 },
];

/// A recording, its truth, and the robot that made it.
pub struct Made {
    pub recording: Recording,
    pub beacons: Vec<Beacon>,
    /// Pose at each row of the odometry.
    pub truth: Vec<(f64, Pose)>,
    /// The robot as it is, the delay excepted.
    pub robot: Robot,
    /// s
    pub delay: f64,
    /// rad
    pub turn: f64,
    /// Relative errors of measured distance and rotation.
    pub scale: f64,
    pub track: f64,
}

pub fn make(kind: &Kind, seed: u64) -> Made {
    let mut random = Random::new(seed);
    let between = |random: &mut Random, least: f64, most: f64| least + (most - least) * random.uniform();
    let (length, width) = (between(&mut random, 6.0, 15.0), between(&mut random, 5.0, 10.0));
    let count = 5 + (random.uniform() * 8.0) as i32;
    let beacons: Vec<Beacon> = (1..=count)
        .map(|id| {
            let (along, side) = (random.uniform(), random.uniform() * 4.0);
            let at = match side as i32 {
                0 => Point { x: along * length, y: 0.0 },
                1 => Point { x: along * length, y: width },
                2 => Point { x: 0.0, y: along * width },
                _ => Point { x: length, y: along * width },
            };
            Beacon { id, at }
        })
        .collect();
    let hold = if random.uniform() < 0.5 { Hold::Before } else { Hold::After };
    let (far, round) = (0.3 * libm::sqrt(random.uniform()), TAU * random.uniform());
    let (sin, cos) = libm::sincos(round);
    let mount = Mount { x: far * cos, y: far * sin };
    let delay = between(&mut random, 0.0, 0.3);
    let (turn, scale, track) = (0.02 * random.normal(), 0.01 * random.normal(), 0.01 * random.normal());
    let lasting = between(&mut random, 0.5, 0.95);
    let lasting_s = libm::pow(10.0, random.uniform());
    let speed = between(&mut random, 0.2, 0.7);
    let noisy = libm::exp(between(&mut random, -1.0, 0.7));
    let odometry = Noise { along_per_m: 0.0, along_per_s: 0.015 * noisy, turn_per_m: 0.0, turn_per_s: 0.025 * noisy };
    let config = Config {
        beacons: beacons.clone(),
        mount,
        odometry,
        bearing: SIGMA,
        lasting,
        lasting_s,
        wild: kind.wild.max(0.005),
        range: 1000.0,
        turn: 0.0,
        scale: 0.0,
        bend: 0.0,
        track: 0.0,
        delay: 0.0,
        fine_m: 0.15,
        fine_rad: 3.5f64.to_radians(),
        ..Config::default()
    };
    let somewhere = |random: &mut Random| Point {
        x: 1.0 + (length - 2.0) * random.uniform(),
        y: 1.0 + (width - 2.0) * random.uniform(),
    };
    let at = somewhere(&mut random);
    let mut pose = Pose::new(at.x, at.y, random.uniform() * TAU);
    let mut goal = somewhere(&mut random);
    let mut errors: Vec<f64> = beacons.iter().map(|_| random.normal()).collect();
    let (mut measured, mut truth) = (Recording::default(), Vec::new());
    // The camera looks at all beacons at once, a scanner at one after another.
    let phases: Vec<f64> = beacons.iter().map(|_| if kind.view < TAU { 0.0 } else { random.uniform() }).collect();
    let mut due: Vec<f64> = phases.iter().map(|phase| phase / kind.rate).collect();
    let mut before = Motion::default();
    for row in 0..(LENGTH / ROW) as usize {
        let begin = row as f64 * ROW;
        while pose.point().distance(goal) < 0.7 {
            goal = somewhere(&mut random);
        }
        let off = (Angle::new(libm::atan2(goal.y - pose.y, goal.x - pose.x)) - pose.theta).radians();
        let rotation = (off * 1.2).clamp(-0.8, 0.8);
        let rates = Motion { translation: if off.abs() > 1.0 { 0.3 * speed } else { speed }, rotation };
        let noise = |deviation: f64, random: &mut Random| deviation * libm::sqrt(ROW) * random.normal() / ROW;
        let true_rates = Motion {
            translation: rates.translation + noise(odometry.along_per_s, &mut random),
            rotation: rates.rotation + noise(odometry.turn_per_s, &mut random),
        };
        let said = Motion { translation: rates.translation / (1.0 + scale), rotation: rates.rotation / (1.0 + track) };
        truth.push((begin, pose));
        measured.odometry.push((begin, if hold == Hold::Before { before } else { said }));
        before = said;
        for (place, beacon) in beacons.iter().enumerate() {
            while due[place] < begin + ROW {
                let when = due[place];
                due[place] += 1.0 / kind.rate;
                let again = libm::exp(-1.0 / kind.rate / lasting_s);
                errors[place] = again * errors[place] + libm::sqrt(1.0 - again * again) * random.normal();
                let late = when - begin;
                let there = pose
                    .along(Motion { translation: true_rates.translation * late, rotation: true_rates.rotation * late });
                let sensor = there * Point { x: mount.x, y: mount.y };
                let right =
                    wrap(libm::atan2(beacon.at.y - sensor.y, beacon.at.x - sensor.x) - there.theta.radians() - turn);
                let error = libm::sqrt(lasting) * errors[place] + libm::sqrt(1.0 - lasting) * random.normal();
                let (wild, elsewhere) = (random.uniform() < kind.wild, (random.uniform() - 0.5) * kind.view);
                let seen = random.uniform() < 0.8 && right.abs() < kind.view / 2.0;
                if seen {
                    let bearing = if wild { elsewhere } else { right + SIGMA * error };
                    measured.bearings.push((when + delay, beacon.id, wrap(bearing)));
                }
            }
        }
        pose = pose.along(Motion { translation: true_rates.translation * ROW, rotation: true_rates.rotation * ROW });
    }
    measured.bearings.sort_by(|a, b| a.0.total_cmp(&b.0));
    let robot = Robot { config, hold, known: Nuisances::default() };
    Made { recording: measured, beacons, truth, robot, delay, turn, scale, track }
}

impl Made {
    /// The recording as it is for one who knows the delay, the mounting angle and the errors of the odometry.
    fn known(&self) -> Recording {
        let mut known = self.recording.clone();
        for (time, _, bearing) in &mut known.bearings {
            *time -= self.delay;
            *bearing = wrap(*bearing + self.turn);
        }
        for (_, rates) in &mut known.odometry {
            rates.translation *= 1.0 + self.scale;
            rates.rotation *= 1.0 + self.track;
        }
        known
    }
}

/// Covariance of a given start; m², m rad, rad².
const START: [[f64; 3]; 3] = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0025]];

/// Errors of a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    /// Mean squared error of the position, m², after [`SETTLES`].
    pub square: f64,
    /// Mean of the normalized squared error of the pose, divided by 3, while it is at least COARSE.
    pub nees: f64,
    /// Time with more than a metre or 20 degrees of error, s: called FINE, and called COARSE.
    pub wrong_fine: f64,
    pub wrong_coarse: f64,
    /// True if the first pose is more than a metre or 20 degrees off.
    pub first_wrong: bool,
    /// Part of the time after [`SETTLES`] at least COARSE, and FINE.
    pub located: f64,
    pub fine: f64,
    pub counts: Counts,
}

/// Result of a recording.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The filter without any settings, and the one with the true settings.
    pub nothing: Errors,
    pub everything: Errors,
    /// Mean squared error of a gated filter that knows everything, its start too, m².
    pub gated: f64,
    /// The settings found.
    pub found: Robot,
    /// Delay found, s.
    pub delay: f64,
}

fn errors(made: &Made, recording: &Recording, robot: &Robot, start: Option<Start>) -> (Errors, f64) {
    let (mut errors, mut row, mut claimed) = (Errors::default(), 0, false);
    let (mut count, mut located) = (0.0, 0.0);
    let each = |time: f64, estimate: Estimate| {
        let truth = made.truth[row].1;
        row += 1;
        let off = estimate.pose.point().distance(truth.point());
        let turned = (estimate.pose.theta - truth.theta).radians();
        let claims = estimate.quality >= Quality::Coarse;
        let wrong = off > 1.0 || turned.abs() > 20f64.to_radians();
        if claims && !claimed {
            (claimed, errors.first_wrong) = (true, wrong);
        }
        errors.wrong_fine += if wrong && estimate.quality == Quality::Fine { ROW } else { 0.0 };
        errors.wrong_coarse += if wrong && estimate.quality == Quality::Coarse { ROW } else { 0.0 };
        if time < SETTLES {
            return;
        }
        count += 1.0;
        errors.fine += f64::from(u8::from(estimate.quality == Quality::Fine));
        if claims {
            located += 1.0;
            errors.square += off * off;
            let error = [estimate.pose.x - truth.x, estimate.pose.y - truth.y, turned];
            errors.nees += normalized(&estimate.covariance, error) / 3.0;
        }
    };
    let ended = run(recording, robot, start, each).expect("a configuration that can be");
    errors.square /= f64::max(located, 1.0);
    errors.nees /= f64::max(located, 1.0);
    (errors.located, errors.fine) = (located / count, errors.fine / count);
    errors.counts = ended.counts;
    (errors, ended.nuisances.delay)
}

pub fn outcome(kind: &Kind, seed: u64) -> Outcome {
    let made = make(kind, seed);
    let Found { robot: found, start } =
        find_out(&made.recording, made.beacons.clone(), Known::default(), None).expect("a map that can be");
    let (nothing, delay) = errors(&made, &made.recording, &found, start);
    let known = made.known();
    let (everything, _) = errors(&made, &known, &made.robot, Some((made.truth[0].1, START)));
    Outcome { nothing, everything, gated: gated(&made, &known), found, delay }
}

/// Mean squared error, m², of a plain extended Kalman filter with a gate, which knows all but which bearings are right.
fn gated(made: &Made, known: &Recording) -> f64 {
    let Robot { config, hold, .. } = &made.robot;
    let mut pose = made.truth[0].1;
    let mut cov = START;
    let (mut sum, mut count, mut at) = (0.0, 0.0, 0.0);
    let mut last = vec![f64::NEG_INFINITY; made.beacons.len()];
    let mut bearings = known.bearings.iter().peekable();
    for row in 0..known.odometry.len() - 1 {
        let rates = known.odometry[if *hold == Hold::Before { row + 1 } else { row }].1;
        let end = known.odometry[row + 1].0;
        loop {
            let next = bearings.next_if(|(time, ..)| *time <= end);
            let to = next.map_or(end, |(time, ..)| time.max(at));
            let dt = to - at;
            at = to;
            let way = Motion { translation: rates.translation * dt, rotation: rates.rotation * dt };
            let (sin, cos) = libm::sincos(pose.theta.radians() + way.rotation / 2.0);
            let f = [[1.0, 0.0, -way.translation * sin], [0.0, 1.0, way.translation * cos], [0.0, 0.0, 1.0]];
            let along = config.odometry.along_per_s * config.odometry.along_per_s * dt;
            let turn = config.odometry.turn_per_s * config.odometry.turn_per_s * dt;
            let q = [
                [along * cos * cos, along * sin * cos, 0.0],
                [along * sin * cos, along * sin * sin, 0.0],
                [0.0, 0.0, turn],
            ];
            cov = super::matrix::add(&super::matrix::predict(&cov, &f), &q);
            pose = pose.along(way);
            let Some((time, id, bearing)) = next else { break };
            let place = (*id - 1) as usize;
            let (beacon, sensor) = (made.beacons[place].at, pose * Point { x: config.mount.x, y: config.mount.y });
            let (dx, dy) = (beacon.x - sensor.x, beacon.y - sensor.y);
            let square = (dx * dx + dy * dy).max(0.04);
            let innovation = wrap(bearing - libm::atan2(dy, dx) + pose.theta.radians());
            let (by_x, by_y) = (dy / square, -dx / square);
            let by = [by_x, by_y, by_x * (pose.y - sensor.y) + by_y * (sensor.x - pose.x) - 1.0];
            // An error that lasts counts once.
            let again = libm::exp(-(time - last[place]) / config.lasting_s);
            let lasts = 1.0 - config.lasting + config.lasting * (1.0 + again) / (1.0 - again).max(1e-9);
            let variance = config.bearing * config.bearing;
            let spread: f64 = (0..3).map(|row| (0..3).map(|c| by[row] * cov[row][c] * by[c]).sum::<f64>()).sum();
            if innovation * innovation > 9.0 * (spread + variance) {
                continue;
            }
            last[place] = *time;
            let (gain, _) = super::matrix::update(&mut cov, &by, variance * lasts);
            pose.x += gain[0] * innovation;
            pose.y += gain[1] * innovation;
            pose.theta = Angle::new(pose.theta.radians() + gain[2] * innovation);
        }
        if end >= SETTLES {
            let truth = made.truth[row + 1].1;
            let off = pose.point().distance(truth.point());
            sum += off * off;
            count += 1.0;
        }
    }
    sum / count
}
