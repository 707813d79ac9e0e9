//! Global localization: finds the pose from the bearings of the last seconds, without a prior.
//!
//! Odometry carries older bearings to the present. Each three bearings of different beacons give a candidate pose
//! ([`navitools::resection`]), and all bearings vote on it. A candidate is accepted when its votes are unlikely to
//! agree by chance and all rivals together are two hundred times less likely (docs/facts/robot.md 3.3).

use crate::filter::Config;
use crate::trail::{Trail, TrailPose, shifted};
use base::{Duration, Instant};
use core::f64::consts::{PI, TAU};
use navitools::{Angle, Point, Pose, resection, wrap};

/// Bearings older than this are ignored.
pub const BEARING_WINDOW: Duration = Duration::from_secs(6);
/// Newest bearings that the search uses.
pub const BEARINGS_MAX: usize = 40;
/// Newest bearings that triples are formed from.
const TRIPLE_BEARINGS: usize = 14;
/// Candidate poses that are refined.
const REFINED_CANDIDATES: usize = 8;
/// Prior probability that a bearing is an outlier, relative to the configured one, and its bounds; deliberately too
/// high, so that no single outlier decides.
const OUTLIER_PRIOR_PER_WILD: f64 = 2.0;
const OUTLIER_PRIOR_MIN: f64 = 0.1;
const OUTLIER_PRIOR_MAX: f64 = 0.4;
/// Greatest squared residual, in variances, that noise explains.
const NOISE_SQUARE_MAX: f64 = 9.0;
/// Greatest likelihood of all rivals together, relative to an accepted pose.
const RIVAL_LIKELIHOOD_MAX: f64 = 5e-3;
/// Least inlier probability of a vote that counts as support of a pose.
const INLIER_PROBABILITY_MIN: f64 = 0.98;
/// Least probability that an outlier fits a given pose, and its ratio to the deviation of a bearing, 1/rad.
const OUTLIER_FIT_PROBABILITY_MIN: f64 = 0.02;
const OUTLIER_FIT_PROBABILITY_PER_RAD: f64 = 2.0;
/// Greatest probability that the votes of an accepted pose agree by chance.
const CHANCE_PROBABILITY_MAX: f64 = 2e-3;
/// Greatest position deviation, m, at which a pose counts as known without the votes of one beacon.
const LEAVE_ONE_OUT_DEVIATION_MAX: f64 = 1.5;
/// Lower bound of the delay's standard deviation, s.
const DELAY_SIGMA_MIN: f64 = 1e-3;
/// Distance between the delays that are tried, s.
const DELAY_STEP: f64 = 0.2;
/// Poses closer than this, m and rad, are the same.
const SAME_POSE: (f64, f64) = (0.6, 0.25);
/// Widening of `SAME_POSE` per second of difference in delay, m/s and rad/s.
const SAME_POSE_PER_DELAY: (f64, f64) = (1.0, 0.7);
/// Greatest deviations of an accepted pose, m and rad.
const POSE_DEVIATION_MAX: (f64, f64) = (0.85, 0.15);
/// Least distance measure from the circle through three beacons, where resection is singular, m².
const CIRCLE_DISTANCE_MIN: f64 = 0.05;

/// A bearing of a known beacon.
#[derive(Clone, Copy, Debug)]
pub struct Bearing {
    /// Time stamp as received, later than the measurement by the unknown delay.
    pub stamp: Instant,
    /// Index of the beacon in the map.
    pub beacon: usize,
    /// Position of the beacon, m.
    pub place: Point,
    /// Measured direction in the sensor frame, rad.
    pub bearing: f64,
}

/// What is known of the sensor.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    /// Place in the robot frame, m, and the variance of each coordinate, m².
    pub mount: Point,
    pub spread: f64,
    /// Mounting angle, rad.
    pub turn: f64,
    /// Delay of bearings and its standard deviation, s.
    pub delay: (f64, f64),
    /// Factor of the probabilities below which a pose is accepted.
    pub strictness: f64,
}

/// A pose found by the search.
#[derive(Clone, Copy, Debug)]
pub struct Fix {
    /// Pose of the robot at the trail's end.
    pub pose: Pose,
    /// Covariance of x, y, θ, conditional on the delay; m², m rad, rad².
    pub covariance: [[f64; 3]; 3],
    /// Delay from measurement to time stamp and its standard deviation, s.
    pub delay: (f64, f64),
    /// Derivative of x, y, θ by the delay, m/s and rad/s.
    pub d_pose_d_delay: [f64; 3],
}

/// A bearing, carried to the present under the delay that is tried.
#[derive(Clone, Copy)]
struct Vote {
    beacon: usize,
    place: Point,
    /// Sensor position at the measurement, in the robot frame of the present, m.
    sensor: Point,
    /// Direction of the beacon at the measurement, in the robot frame of the present, rad.
    direction: f64,
    /// Derivatives of both by the delay, m/s and rad/s.
    earlier: (Point, f64),
    /// Time stamp.
    stamp: Instant,
    /// Information relative to a vote with independent noise, above 0 to 1.
    weight: f64,
    /// Variance of the direction, rad², and of the position across it, m².
    variance: f64,
    position_variance: f64,
}

/// Unknowns of the search: the pose at the trail's end, and the delay beyond the one that is tried, s.
#[derive(Clone, Copy)]
struct Hypothesis {
    pose: Pose,
    delay: f64,
}

/// Searches for the pose. `seen` is ordered by time; `trail` is the odometry up to the present. `own`, the present
/// estimate if there is one, competes as a rival. At least the fraction `share` of all bearings must support the
/// result.
pub fn search(
    config: &Config,
    seen: &[Bearing],
    trail: &Trail,
    sensor: Sensor,
    own: Option<Pose>,
    share: f64,
) -> Option<Fix> {
    let delay = sensor.delay;
    let mut best: Vec<Candidate> = Vec::new();
    let mut votes = Vec::with_capacity(seen.len());
    for tried in delays(delay) {
        votes.clear();
        votes.extend(seen.iter().rev().filter_map(|seen| carry(config, seen, trail, &sensor, tried)));
        weigh(config, &mut votes);
        let prior = (delay.0 - tried, delay.1.max(DELAY_SIGMA_MIN));
        let chance = CHANCE_PROBABILITY_MAX * sensor.strictness;
        for mut candidate in candidates(config, &votes, own, (share, chance), prior) {
            candidate.delay += tried;
            match best.iter_mut().find(|other| candidate.is_same(other)) {
                Some(other) if other.score >= candidate.score => {}
                Some(other) => *other = candidate,
                None => best.push(candidate),
            }
        }
    }
    best.sort_by(|a, b| b.score.total_cmp(&a.score));
    let first = *best.first()?;
    let others: f64 = best[1..].iter().map(|other| libm::exp(other.score - first.score)).sum();
    let (variance, covariance) = (first.covariance[3][3], first.covariance);
    let d_pose_d_delay = core::array::from_fn(|row| covariance[row][3] / variance);
    let given =
        |row: usize, column: usize| covariance[row][column] - covariance[row][3] * covariance[column][3] / variance;
    let given = core::array::from_fn(|row| core::array::from_fn(|column| given(row, column)));
    let (position, heading) = crate::filter::deviations(&given);
    let sharp = position <= POSE_DEVIATION_MAX.0 && heading <= POSE_DEVIATION_MAX.1;
    let delay = (first.delay, libm::sqrt(variance));
    (others <= RIVAL_LIKELIHOOD_MAX * sensor.strictness && sharp && first.is_supported).then_some(Fix {
        pose: first.pose,
        covariance: given,
        delay,
        d_pose_d_delay,
    })
}

/// Delays to try: the more, the less well the delay is known.
fn delays((mean, deviation): (f64, f64)) -> impl Iterator<Item = f64> {
    let most = libm::ceil(2.0 * deviation / DELAY_STEP - 0.5).clamp(0.0, 4.0) as i32;
    (0..=most).map(move |number| mean + f64::from(number) * DELAY_STEP)
}

/// A candidate pose.
#[derive(Clone, Copy)]
struct Candidate {
    /// Logarithm of its evidence: the likelihood integrated over the neighbourhood.
    score: f64,
    pose: Pose,
    /// Covariance of x, y, θ and the delay.
    covariance: [[f64; 4]; 4],
    delay: f64,
    is_supported: bool,
}

impl Candidate {
    /// True if both are one pose under different delays.
    fn is_same(&self, other: &Self) -> bool {
        let apart = (self.delay - other.delay).abs();
        let turned = (self.pose.theta - other.pose.theta).radians().abs();
        self.pose.point().distance(other.pose.point()) < SAME_POSE.0 + apart * SAME_POSE_PER_DELAY.0
            && turned < SAME_POSE.1 + apart * SAME_POSE_PER_DELAY.1
    }
}

/// `support`: least fraction of votes that support a pose, and greatest probability that they do so by chance.
fn candidates(
    config: &Config,
    votes: &[Vote],
    own: Option<Pose>,
    support: (f64, f64),
    prior: (f64, f64),
) -> Vec<Candidate> {
    let mut rough: Vec<(f64, Pose)> = Vec::with_capacity(REFINED_CANDIDATES + 1);
    for (a, one) in votes.iter().enumerate().take(TRIPLE_BEARINGS) {
        for (b, two) in votes.iter().enumerate().take(TRIPLE_BEARINGS).skip(a + 1) {
            for three in votes.iter().take(TRIPLE_BEARINGS).skip(b + 1) {
                if one.beacon != two.beacon && two.beacon != three.beacon && three.beacon != one.beacon {
                    try_triple(config, votes, &[*one, *two, *three], prior.1, &mut rough);
                }
            }
        }
    }
    let closely = |(_, pose): (f64, Pose)| {
        let mut guess = Hypothesis { pose, delay: 0.0 };
        for inflation in [4.0, 2.0] {
            guess = refine(config, votes, guess, inflation, prior).map_or(guess, |(guess, ..)| guess);
        }
        let (guess, covariance, volume) = refine(config, votes, guess, 1.0, prior)?;
        let off = (guess.delay - prior.0) / prior.1;
        let score = score(config, votes, guess, 0.0) - 0.5 * off * off + volume;
        let is_supported = is_supported(config, votes, guess, support, prior);
        let within = guess.delay.abs() < DELAY_STEP || prior.1 < DELAY_STEP;
        within.then_some(Candidate { score, pose: guess.pose, covariance, delay: guess.delay, is_supported })
    };
    rough.extend(own.map(|pose| (0.0, pose)));
    rough.into_iter().filter_map(closely).collect()
}

/// Carries a bearing to the trail's end; `None` when it lies outside the trail.
fn carry(config: &Config, seen: &Bearing, trail: &Trail, known: &Sensor, delay: f64) -> Option<Vote> {
    let now = trail.last();
    let place = |delay: f64| {
        let then = shifted(seen.stamp, -delay);
        trail.at(if delay >= 0.0 { then } else { then.min(now.at) })
    };
    let from = |then: TrailPose| now.pose.inverse() * then.pose;
    let then = place(delay)?;
    let own = from(then);
    let sensor = own * known.mount;
    let earlier = place(delay + DELAY_STEP / 2.0).map_or((Point::default(), 0.0), |then| {
        let (other, per_s) = (from(then), 2.0 / DELAY_STEP);
        let there = other * known.mount;
        let moved = Point { x: (there.x - sensor.x) * per_s, y: (there.y - sensor.y) * per_s };
        (moved, (other.theta - own.theta).radians() * per_s)
    });
    Some(Vote {
        beacon: seen.beacon,
        place: seen.place,
        sensor,
        direction: wrap(own.theta.radians() + known.turn + seen.bearing),
        earlier,
        stamp: seen.stamp,
        weight: 1.0,
        variance: config.bearing * config.bearing + (now.turn - then.turn).max(0.0),
        position_variance: (now.along - then.along).max(0.0) + 0.0025 + known.spread,
    })
}

/// Weighs the votes of each beacon: the part of the bearing noise that lasts does not average out.
fn weigh(config: &Config, votes: &mut [Vote]) {
    for beacon in 0..config.beacons.len() {
        let (mut last, mut sum, mut count) = (None, 0.0, 0.0);
        for vote in votes.iter().filter(|vote| vote.beacon == beacon) {
            let apart = |last: Instant| last.since(vote.stamp).as_secs_f64();
            sum += last.map_or(1.0, |last| config.independence(apart(last)));
            count += 1.0;
            last = Some(vote.stamp);
        }
        votes.iter_mut().filter(|vote| vote.beacon == beacon).for_each(|vote| vote.weight = sum / count);
    }
}

/// Adds the pose of a triple to the candidates, if it is among the best and not a duplicate of a better one. `delay`:
/// the standard deviation of the delay beyond the tried one, s.
fn try_triple(config: &Config, votes: &[Vote], triple: &[Vote; 3], delay: f64, candidates: &mut Vec<(f64, Pose)>) {
    let bearings = triple.map(|vote| Angle::new(vote.direction));
    let Some(fix) = resection::three_bearings(triple.map(|vote| vote.place), bearings) else { return };
    if fix.d.abs() < CIRCLE_DISTANCE_MIN {
        return;
    }
    // Resection assumes one sensor position; the three bearings have three, so the pose is refined.
    let middle = Point {
        x: triple.iter().map(|vote| vote.sensor.x).sum::<f64>() / 3.0,
        y: triple.iter().map(|vote| vote.sensor.y).sum::<f64>() / 3.0,
    };
    let pose = fix.pose * Pose { x: -middle.x, y: -middle.y, theta: Angle::ZERO };
    let mut guess = Hypothesis { pose, delay: 0.0 };
    for _ in 0..3 {
        match refine(config, triple, guess, 1e6, (0.0, DELAY_SIGMA_MIN)) {
            Some((better, ..)) => guess = better,
            None => return,
        }
    }
    let pose = guess.pose;
    let inside = config.range * 2.0 + 100.0;
    if !(pose.x.abs() < 1e6 && pose.y.abs() < 1e6 && triple.iter().all(|v| pose.point().distance(v.place) < inside)) {
        return;
    }
    let own = score(config, votes, guess, delay.min(DELAY_STEP / 3.0));
    if let Some(place) = candidates.iter().position(|(_, other)| is_same(pose, *other)) {
        if candidates[place].0 >= own {
            return;
        }
        candidates.remove(place);
    }
    let place = candidates.partition_point(|(other, _)| *other >= own);
    candidates.insert(place, (own, pose));
    candidates.truncate(REFINED_CANDIDATES);
}

/// True if the search treats two poses as one.
pub fn is_same(one: Pose, other: Pose) -> bool {
    one.point().distance(other.point()) < SAME_POSE.0 && (one.theta - other.theta).radians().abs() < SAME_POSE.1
}

/// Residual of a vote under a hypothesis, rad, its variance, rad², and its derivatives by x, y, θ and delay.
fn residual(vote: &Vote, guess: Hypothesis) -> (f64, f64, [f64; 4]) {
    let ((moved, turned), Hypothesis { pose, delay }) = (vote.earlier, guess);
    let then = Point { x: vote.sensor.x + delay * moved.x, y: vote.sensor.y + delay * moved.y };
    let sensor = pose * then;
    let (dx, dy) = (vote.place.x - sensor.x, vote.place.y - sensor.y);
    let square = (dx * dx + dy * dy).max(0.04);
    let residual = wrap(vote.direction + delay * turned - libm::atan2(dy, dx) + pose.theta.radians());
    let (by_x, by_y) = (dy / square, -dx / square);
    let by_theta = by_x * (pose.y - sensor.y) + by_y * (sensor.x - pose.x) - 1.0;
    let (sin, cos) = pose.theta.sin_cos();
    let d_pose_d_delay = by_x * (cos * moved.x - sin * moved.y) + by_y * (sin * moved.x + cos * moved.y) - turned;
    (residual, vote.variance + vote.position_variance / square, [by_x, by_y, by_theta, d_pose_d_delay])
}

/// Probability that a vote is an inlier of a hypothesis, and the likelihood of the vote, per turn. `delay`: standard
/// deviation of the hypothesis's delay, s.
fn agreement(config: &Config, vote: &Vote, guess: Hypothesis, inflation: f64, delay: f64) -> (f64, f64) {
    let (residual, variance, by) = residual(vote, guess);
    let variance = variance * inflation + by[3] * by[3] * delay * delay;
    let in_range = guess.pose.point().distance(vote.place) <= config.range + 2.0;
    // Noise that lasts counts once, but a vote beyond it is an outlier of its own.
    let square = residual * residual / variance;
    let square = square - (1.0 - vote.weight) * square.min(NOISE_SQUARE_MAX);
    let density = libm::exp(-0.5 * square) / libm::sqrt(TAU * variance);
    let outlier = outlier_prior(config);
    let own = if in_range { (1.0 - outlier) * density * TAU } else { 0.0 };
    (own / (own + outlier), own + outlier)
}

/// Log-likelihood of all votes.
fn score(config: &Config, votes: &[Vote], guess: Hypothesis, delay: f64) -> f64 {
    votes.iter().map(|vote| libm::log(agreement(config, vote, guess, 1.0, delay).1)).sum()
}

/// One Gauss-Newton step over all votes, weighted by their inlier probability, with a prior on the delay (mean and
/// standard deviation, s); returns the new hypothesis, its covariance, and the logarithm of the covariance's volume.
fn refine(
    config: &Config,
    votes: &[Vote],
    guess: Hypothesis,
    inflation: f64,
    prior: (f64, f64),
) -> Option<(Hypothesis, [[f64; 4]; 4], f64)> {
    let (mut information, mut sum) = ([[0.0; 4]; 4], [0.0; 4]);
    let known = 1.0 / (prior.1 * prior.1);
    (information[3][3], sum[3]) = (known, known * (prior.0 - guess.delay));
    for vote in votes {
        // An inflation beyond 100 means: no weighting.
        let inlier = if inflation > 100.0 { 1.0 } else { agreement(config, vote, guess, inflation, 0.0).0 };
        let (residual, variance, by) = residual(vote, guess);
        let inlier = inlier * vote.weight;
        for row in 0..4 {
            sum[row] += inlier * by[row] * residual / variance;
            for column in 0..4 {
                information[row][column] += inlier * by[row] * by[column] / variance;
            }
        }
    }
    let (covariance, volume) = inverse(&information)?;
    let by = |row: usize| (0..4).map(|column| covariance[row][column] * sum[column]).sum::<f64>();
    let (dx, dy, turn) = (by(0), by(1), by(2));
    let pose = Pose { x: guess.pose.x + dx, y: guess.pose.y + dy, theta: guess.pose.theta + turn };
    // Larger steps come from nearly singular votes.
    (libm::hypot(dx, dy) < 50.0 && turn.abs() < PI)
        .then(|| (Hypothesis { pose, delay: guess.delay + by(3) }, covariance, volume))
}

/// True if enough votes, and this fraction of them, support a pose: any three bearings fit some pose.
fn is_supported(
    config: &Config,
    votes: &[Vote],
    guess: Hypothesis,
    (share, chance): (f64, f64),
    prior: (f64, f64),
) -> bool {
    let mut each = vec![0i32; config.beacons.len()];
    let mut half = 0;
    for vote in votes {
        let inlier = agreement(config, vote, guess, 1.0, 0.0).0;
        each[vote.beacon] += i32::from(inlier > INLIER_PROBABILITY_MIN);
        half += u32::from(inlier > 0.5);
    }
    f64::from(half) >= share * votes.len() as f64
        && chance_probability(config, &each) + single_beacon_probability(config, votes, guess, prior, &each) <= chance
}

/// Probability that the supporting votes, counted for each beacon, agree by chance: with the votes of two beacons
/// correct the pose lies on a circle, the first outlier fits somewhere on it, and each further one fits only by
/// accident.
fn chance_probability(config: &Config, each: &[i32]) -> f64 {
    let all: i32 = each.iter().sum();
    let pairs = each.iter().enumerate().flat_map(|(place, one)| each[..place].iter().map(move |other| one + other));
    if each.iter().filter(|count| **count > 0).count() < 3 {
        1.0
    } else {
        pairs.map(|pair| outliers(config, all - pair)).sum()
    }
}

/// Probability that this number of outliers fit, the first of them always.
fn outliers(config: &Config, count: i32) -> f64 {
    let prior = outlier_prior(config);
    let fit = (OUTLIER_FIT_PROBABILITY_PER_RAD * config.bearing).clamp(OUTLIER_FIT_PROBABILITY_MIN, 1.0);
    libm::pow(prior / (1.0 - prior) * fit, f64::from(count)) / fit
}

fn outlier_prior(config: &Config) -> f64 {
    (OUTLIER_PRIOR_PER_WILD * config.wild).clamp(OUTLIER_PRIOR_MIN, OUTLIER_PRIOR_MAX)
}

/// Probability that a pose rests on outliers of a single beacon, summed over the beacons without whose votes the pose
/// is not well known.
fn single_beacon_probability(
    config: &Config,
    votes: &[Vote],
    guess: Hypothesis,
    prior: (f64, f64),
    each: &[i32],
) -> f64 {
    let mut sum = 0.0;
    for beacon in (0..each.len()).filter(|beacon| each[*beacon] > 0) {
        let mut information = [[0.0; 4]; 4];
        information[3][3] = 1.0 / (prior.1 * prior.1);
        let mut own = None;
        for vote in votes {
            let inlier = agreement(config, vote, guess, 1.0, 0.0).0;
            let (_, variance, by) = residual(vote, guess);
            if vote.beacon == beacon {
                own = own.or((inlier > INLIER_PROBABILITY_MIN).then_some((by, variance)));
                continue;
            }
            let inlier = inlier * vote.weight;
            for row in 0..4 {
                for column in 0..4 {
                    information[row][column] += inlier * by[row] * by[column] / variance;
                }
            }
        }
        let (Some((rest, _)), Some((by, variance))) = (inverse(&information), own) else {
            sum += outliers(config, each[beacon]);
            continue;
        };
        let (position, _) =
            crate::filter::deviations(&core::array::from_fn(|row| core::array::from_fn(|c| rest[row][c])));
        if position > LEAVE_ONE_OUT_DEVIATION_MAX {
            let spread: f64 =
                (0..4).map(|row| (0..4).map(|column| by[row] * rest[row][column] * by[column]).sum::<f64>()).sum();
            sum += outliers(config, each[beacon]) * (5.0 * libm::sqrt(spread + variance) / TAU).min(1.0);
        }
    }
    sum
}

/// Inverse of a symmetric matrix, and minus half the logarithm of its determinant; `None` if it is (nearly) singular.
pub fn inverse<const N: usize>(m: &[[f64; N]; N]) -> Option<([[f64; N]; N], f64)> {
    // Gauss-Jordan elimination, scaled to a unit diagonal.
    let scale: [f64; N] = core::array::from_fn(|row| 1.0 / libm::sqrt(m[row][row]));
    let mut left: [[f64; N]; N] =
        core::array::from_fn(|row| core::array::from_fn(|column| m[row][column] * scale[row] * scale[column]));
    let mut right = [[0.0; N]; N];
    (0..N).for_each(|row| right[row][row] = 1.0);
    let mut volume = 0.0;
    for pivot in 0..N {
        let value = left[pivot][pivot];
        if value.is_nan() || value <= 1e-10 {
            return None;
        }
        volume -= 0.5 * libm::log(value);
        for column in 0..N {
            left[pivot][column] /= value;
            right[pivot][column] /= value;
        }
        for row in (0..N).filter(|row| *row != pivot) {
            let factor = left[row][pivot];
            for column in 0..N {
                left[row][column] -= factor * left[pivot][column];
                right[row][column] -= factor * right[pivot][column];
            }
        }
    }
    volume += scale.iter().map(|scale| libm::log(*scale)).sum::<f64>();
    let inverse =
        core::array::from_fn(|row| core::array::from_fn(|column| right[row][column] * scale[row] * scale[column]));
    volume.is_finite().then_some((inverse, volume))
}

#[cfg(test)]
mod tests {
    use super::*;
    use navitools::Motion;

    #[test]
    fn a_delay_of_any_size_carries_no_bearing_and_ends_no_module() {
        let mut trail = Trail::default();
        for ms in (1000..=3000).step_by(50) {
            trail.push(Instant::from_millis(ms), Motion::default(), 0.0, (0.0, 0.0));
        }
        let place = Point { x: 3.0, y: 1.0 };
        let seen = Bearing { stamp: Instant::from_millis(2500), beacon: 0, place, bearing: 0.3 };
        let config = Config::default();
        let vote = |delay: f64| {
            let sensor = Sensor { mount: place, spread: 0.0, turn: 0.0, delay: (delay, 0.1), strictness: 1.0 };
            assert!(search(&config, &[seen; 3], &trail, sensor, None, 0.5).is_none(), "one beacon in sight");
            carry(&config, &seen, &trail, &sensor, delay)
        };
        assert!(vote(0.25).is_some() && vote(-0.25).is_some());
        for huge in [60.0, 1e19, 1e300, f64::INFINITY] {
            assert!(vote(huge).is_none(), "{huge}");
            // As one that is stamped too late: it is of the present.
            assert_eq!(vote(-huge).map(|vote| vote.stamp), Some(seen.stamp), "{huge}");
        }
        vote(f64::NAN);
    }
}
