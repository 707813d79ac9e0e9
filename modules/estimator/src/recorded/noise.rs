//! Passes over a recording, and the noise of bearings and odometry that it shows: the most probable one.
//!
//! A bearing's error that lasts is a state of its own for each beacon, a first-order process. Unlike the weights of the
//! filter that runs on the robot this tells errors that last from those of the pose, and costs several times as much.

use super::{Recording, Robot, Start};
use crate::filter::{self, Config, DELAY, Noise, PLACE_UNKNOWN, Sight, State, THETA, X, Y};
use base::Duration;
use core::f64::consts::TAU;

/// Number of beacons whose errors are part of the state at a time: those sighted last.
const BEACONS: usize = 16;
const N: usize = PLACE_UNKNOWN + BEACONS;
/// Usual noise, and the standard deviation of its logarithm: the part of a bearing's error that does not last, rad; the
/// part that lasts, rad, and its time, s; of the odometry along the path, m/√s, and of its rotation, rad/√s
/// (docs/facts/robot.md 3.3).
const USUAL: [f64; 5] = [0.01, 0.018, 3.0, 0.015, 0.025];
const SPREAD: [f64; 5] = [0.8, 0.6, 0.8, 0.6, 0.6];
/// Factors by which each is varied, one after the other.
const FACTORS: [f64; 3] = [2.0, 1.4, 1.2];
/// Bounds of the part of outliers.
const WILD: (f64, f64) = (0.01, 0.35);

/// The noise of a configuration, in the order of [`USUAL`].
fn noise_of(Config { bearing, lasting, lasting_s, odometry, .. }: &Config) -> [f64; 5] {
    let (white, lasting) = (bearing * libm::sqrt(1.0 - lasting), bearing * libm::sqrt(*lasting));
    [white, lasting, *lasting_s, odometry.along_per_s, odometry.turn_per_s]
}

fn set_noise(config: &mut Config, [white, lasting, lasting_s, along_per_s, turn_per_s]: [f64; 5]) {
    let variance = white * white + lasting * lasting;
    (config.bearing, config.lasting) = (libm::sqrt(variance), lasting * lasting / variance);
    config.lasting_s = lasting_s;
    config.odometry = Noise { along_per_s, turn_per_s, ..config.odometry };
}

/// A pass over a recording.
pub struct Passed {
    /// Log-likelihood of the bearings, relative to uniformly distributed directions, and of the noise.
    pub evidence: f64,
    /// Part of outliers.
    wild: f64,
    /// State at the end.
    pub state: State<N>,
}

/// Sets the noise to the most probable one; returns the pass with it.
pub fn find(recording: &Recording, robot: &mut Robot, start: Start) -> Passed {
    let mut best = pass(recording, robot, start);
    for factor in FACTORS {
        robot.config.wild = best.wild.clamp(WILD.0, WILD.1);
        best = pass(recording, robot, start);
        for which in 0..USUAL.len() {
            for factor in [factor, 1.0 / factor] {
                let mut other = robot.clone();
                let mut noise = noise_of(&robot.config);
                noise[which] *= factor;
                set_noise(&mut other.config, noise);
                let passed = pass(recording, &other, start);
                if passed.evidence > best.evidence {
                    (*robot, best) = (other, passed);
                    break;
                }
            }
        }
    }
    best
}

/// Passes over a recording from its start.
pub fn pass(recording: &Recording, robot: &Robot, (pose, covariance): Start) -> Passed {
    let config = &robot.config;
    let [white, lasting, lasting_s, ..] = noise_of(config);
    let mut state = State::<N>::new(config);
    (state.mean[X], state.mean[Y], state.mean[THETA]) = (pose.x, pose.y, pose.theta.radians());
    (0..3).for_each(|row| state.cov[row][..3].copy_from_slice(&covariance[row]));
    (PLACE_UNKNOWN..N).for_each(|error| state.cov[error][error] = lasting * lasting);
    // Beacon and time of the last sighting, s.
    let mut last = [(usize::MAX, f64::NEG_INFINITY); BEACONS];
    let mut bearings = recording.bearings.iter().map(|row| (robot.bearing(row.0, row.2), row.1)).peekable();
    let (mut sum, mut outliers, mut count) = (0.0, 0.0, 0.0);
    for rows in recording.odometry.windows(2) {
        let ((begin, before), (end, after)) = (rows[0], rows[1]);
        let time = Duration::from_secs_f64(end - begin);
        let step = filter::step(time, robot.between(before, after), config.odometry, None, 0.0);
        while let Some(((stamp, bearing), id)) = bearings.next_if(|((stamp, _), _)| stamp - state.mean[DELAY] <= end) {
            let at = config.beacons.iter().position(|beacon| beacon.id == id);
            let Some(number) = at.filter(|_| stamp - state.mean[DELAY] >= begin) else { continue };
            let own = last.iter().position(|(beacon, _)| *beacon == number);
            let again = own.map_or(0.0, |own| libm::exp((last[own].1 - stamp).min(0.0) / lasting_s));
            let oldest = || (0..BEACONS).min_by(|a, b| last[*a].1.total_cmp(&last[*b].1)).unwrap_or(0);
            let own = own.unwrap_or_else(oldest);
            last[own] = (number, stamp);
            let error = PLACE_UNKNOWN + own;
            state.mean[error] *= again;
            (0..N).for_each(|other| {
                state.cov[error][other] *= again;
                state.cov[other][error] *= again;
            });
            state.cov[error][error] += lasting * lasting * (1.0 - again * again);
            let sight = Sight {
                number,
                beacon: config.beacons[number].at,
                bearing,
                variance: white * white,
                weight: 1.0,
                mount: config.mount.into(),
                rates: step.rates(),
                later: stamp - begin,
            };
            let Some(fit) = state.fit_beside(&sight, Some(error)) else { continue };
            let (own, other) = ((1.0 - config.wild) * fit.density(), config.wild / TAU);
            sum += libm::log((own + other) * TAU);
            outliers += other / (own + other);
            count += 1.0;
            if fit.distance() <= config.gate {
                state.update(&fit, own / (own + other));
            }
        }
        state.predict(&step, &[0.0; N]);
    }
    let odd = |((noise, usual), spread): ((f64, f64), f64)| {
        let off = libm::log(noise.max(1e-9) / usual) / spread;
        0.5 * off * off
    };
    let unusual: f64 = noise_of(config).into_iter().zip(USUAL).zip(SPREAD).map(odd).sum();
    Passed { evidence: sum - unusual, wild: outliers / f64::max(count, 1.0), state }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::{Beacon, Nuisances};
    use crate::recorded::Hold;
    use navitools::{Angle, Motion, Point, Pose, wrap};

    /// Three minutes in a circle among eight beacons at 4 Hz, whose errors of 0.0255 rad are a first-order process of
    /// this time, s, and a part of outliers; the robot, and its start.
    fn recording(lasting_s: f64, wild: f64) -> (Recording, Robot, Start) {
        let mut state = 1u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let place = |n: i32| {
            let (sin, cos) = libm::sincos(f64::from(n) * 0.8);
            Point { x: 6.0 * cos, y: 5.0 * sin }
        };
        let beacons: Vec<Beacon> = (0..8).map(|id| Beacon { id, at: place(id) }).collect();
        let rates = Motion { translation: 0.5, rotation: 0.25 };
        let begin = Pose { x: 2.0, y: 0.0, theta: Angle::new(1.5) };
        let (mut pose, mut made, mut errors) = (begin, Recording::default(), [0.0; 8]);
        for row in 0..720 {
            let now = f64::from(row) * 0.25;
            made.odometry.push((now, rates));
            for (beacon, error) in beacons.iter().zip(&mut errors) {
                let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
                let again = libm::exp(-0.25 / lasting_s);
                *error = again * *error + libm::sqrt(1.0 - again * again) * 0.0255 * normal;
                let right = libm::atan2(beacon.at.y - pose.y, beacon.at.x - pose.x) - pose.theta.radians() + *error;
                let bearing = if uniform() < wild { uniform() * TAU } else { right };
                made.bearings.push((now, beacon.id, wrap(bearing)));
            }
            let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            let noisy = Motion { rotation: rates.rotation + 0.025 * normal / 0.5, ..rates };
            pose = pose.along(Motion { translation: noisy.translation * 0.25, rotation: noisy.rotation * 0.25 });
        }
        let mut config = Config { beacons, ..Config::default() };
        config.mount.x = 0.0;
        set_noise(&mut config, USUAL);
        let start = (begin, [[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]]);
        (made, Robot { config, hold: Hold::After, known: Nuisances::default() }, start)
    }

    #[test]
    fn noise_that_lasts_outliers_and_the_way_are_told_from_each_other() {
        for (lasting_s, wild) in [(1.5, 0.0), (6.0, 0.0), (3.0, 0.2)] {
            let (made, mut robot, start) = recording(lasting_s, wild);
            find(&made, &mut robot, start);
            let config = &robot.config;
            assert!((config.bearing / 0.0255 - 1.0).abs() < 0.2, "{lasting_s} s, {wild}: {config:?}");
            assert!((config.wild - wild).abs() < 0.03, "{lasting_s} s, {wild}: {config:?}");
            assert!(config.lasting > 0.8, "{lasting_s} s, {wild}: {config:?}");
            assert!((0.6..1.7).contains(&(config.lasting_s / lasting_s)), "{lasting_s} s, {wild}: {config:?}");
            let turn = config.odometry.turn_per_s / 0.025;
            assert!((0.7..1.4).contains(&turn), "{lasting_s} s, {wild}: {config:?}");
        }
    }

    #[test]
    fn the_way_back_ends_where_the_robot_started() {
        let (made, robot, start) = recording(1.5, 0.0);
        let end = pass(&made, &robot, start).state;
        let back = pass(&made.backwards(), &robot.backwards(), (end.pose(), end.pose_covariance())).state;
        assert!(back.pose().point().distance(start.0.point()) < 0.1, "{:?}", back.pose());
    }
}
