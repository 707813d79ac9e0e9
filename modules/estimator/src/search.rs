//! Where the robot may be, when nothing is known: from the bearings of the last seconds.
//!
//! Odometry carries what was seen before to now. Each three bearings of different beacons allow a pose
//! ([`navitools::resection`]); all bearings vote for each, and one is believed when its votes hardly fit together by
//! chance, and all others together are two hundred times less probable (docs/facts/robot.md 3.3).

use crate::filter::Config;
use crate::trail::{Place, Trail};
use base::{Duration, Instant};
use core::f64::consts::{PI, TAU};
use navitools::{Angle, Point, Pose, resection, wrap};

/// What is older does not vote.
pub const WINDOW: Duration = Duration::from_secs(6);
/// Nor more than so many.
pub const KEPT: usize = 40;
/// The newest of them that triples are made of.
const IN_TRIPLES: usize = 14;
/// Poses that are looked at closely.
const CLOSELY: usize = 8;
/// A vote is wild with this probability; more than it is: a wild one must not tip the scales.
const WILD: f64 = 0.1;
/// All others together are no more probable than this part of a believed pose.
const OTHERS: f64 = 5e-3;
/// A vote that is for a pose as probably as this counts among those that carry it.
const SURELY: f64 = 0.98;
/// A wild bearing fits a pose as probably as this.
const ACCIDENT: f64 = 0.02;
/// The votes of a believed pose fit together by chance no more probably than this.
const BY_CHANCE: f64 = 2e-3;
/// Without the votes of one beacon a pose is known well that is known to this, m.
const SHARP_REST: f64 = 1.5;
/// Nobody knows the delay better, s.
const DELAY_MIN: f64 = 1e-3;
/// Delays that are tried differ by this, s.
const DELAYS: f64 = 0.2;
/// Poses nearer than this, m and rad, are the same.
const SAME: (f64, f64) = (0.6, 0.25);
/// What a delay makes of a pose, m/s and rad/s.
const DELAYED: (f64, f64) = (1.0, 0.7);
/// A pose is not believed unless the votes fix it to this, m and rad.
const SHARP: (f64, f64) = (0.85, 0.15);
/// Near the circle through three beacons their pose is no candidate, m².
const D_MIN: f64 = 0.05;

/// A bearing for the search.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Its stamp.
    pub stamp: Instant,
    /// The beacon's place in the map.
    pub beacon: usize,
    /// Where that is, m.
    pub place: Point,
    /// As measured, rad.
    pub bearing: f64,
}

/// What was found.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// The robot at the trail's end.
    pub pose: Pose,
    /// Of x, y, theta, the delay given.
    pub covariance: [[f64; 3]; 3],
    /// From the bearings to their stamps, s, and the deviation of that.
    pub delay: (f64, f64),
    /// By how much x, y, theta are more for each s more of it.
    pub by_delay: [f64; 3],
}

/// A bearing, carried to now as if it was late by the delay that is tried.
#[derive(Clone, Copy)]
struct Vote {
    beacon: usize,
    place: Point,
    /// The sensor then, seen from the robot now.
    sensor: Point,
    /// The direction then, seen from the robot now.
    direction: f64,
    /// How both change with each s more of delay, m/s and rad/s.
    earlier: (Point, f64),
    /// rad², and m² across.
    variance: f64,
    across: f64,
}

/// What is looked for: the pose at the trail's end, and the delay beyond the one that is tried, s.
#[derive(Clone, Copy)]
struct Guess {
    pose: Pose,
    delay: f64,
}

/// Searches; `seen` in order of time, `trail` is the way by odometry up to now. The sensor is turned by `turn`, and its
/// bearings are late by `delay`, with its deviation. `own` is what is believed now, if anything: it is a rival.
/// `share` of all bearings must be for what is found.
pub fn search(
    config: &Config,
    seen: &[Seen],
    trail: &Trail,
    turn: f64,
    delay: (f64, f64),
    own: Option<Pose>,
    share: f64,
) -> Option<Found> {
    let mut best: Vec<Candidate> = Vec::new();
    let mut votes = Vec::with_capacity(seen.len());
    for tried in delays(delay) {
        votes.clear();
        votes.extend(seen.iter().rev().filter_map(|seen| carry(config, seen, trail, turn, tried)));
        let prior = (delay.0 - tried, delay.1.max(DELAY_MIN));
        for mut candidate in candidates(config, &votes, own, share, prior) {
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
    let by_delay = core::array::from_fn(|row| covariance[row][3] / variance);
    let given =
        |row: usize, column: usize| covariance[row][column] - covariance[row][3] * covariance[column][3] / variance;
    let given = core::array::from_fn(|row| core::array::from_fn(|column| given(row, column)));
    let (position, heading) = crate::filter::deviations(&given);
    let sharp = position <= SHARP.0 && heading <= SHARP.1;
    let delay = (first.delay, libm::sqrt(variance));
    (others <= OTHERS && sharp && first.is_carried).then_some(Found {
        pose: first.pose,
        covariance: given,
        delay,
        by_delay,
    })
}

/// The delays to try: where that is not known well they are many.
fn delays((mean, deviation): (f64, f64)) -> impl Iterator<Item = f64> {
    let most = libm::ceil(2.0 * deviation / DELAYS - 0.5).clamp(0.0, 4.0) as i32;
    (0..=most).map(move |number| mean + f64::from(number) * DELAYS)
}

/// A pose that votes are for.
#[derive(Clone, Copy)]
struct Candidate {
    /// The logarithm of how probable it is, with all that is as good nearby.
    score: f64,
    pose: Pose,
    /// Of x, y, theta and the delay.
    covariance: [[f64; 4]; 4],
    delay: f64,
    is_carried: bool,
}

impl Candidate {
    /// Whether both are one pose, seen with other delays: the robot was where it was that much earlier.
    fn is_same(&self, other: &Self) -> bool {
        let apart = (self.delay - other.delay).abs();
        let turned = (self.pose.theta - other.pose.theta).radians().abs();
        self.pose.point().distance(other.pose.point()) < SAME.0 + apart * DELAYED.0
            && turned < SAME.1 + apart * DELAYED.1
    }
}

fn candidates(config: &Config, votes: &[Vote], own: Option<Pose>, share: f64, prior: (f64, f64)) -> Vec<Candidate> {
    let mut rough: Vec<(f64, Pose)> = Vec::with_capacity(CLOSELY + 1);
    for (a, one) in votes.iter().enumerate().take(IN_TRIPLES) {
        for (b, two) in votes.iter().enumerate().take(IN_TRIPLES).skip(a + 1) {
            for three in votes.iter().take(IN_TRIPLES).skip(b + 1) {
                if one.beacon != two.beacon && two.beacon != three.beacon && three.beacon != one.beacon {
                    try_triple(config, votes, &[*one, *two, *three], prior.1, &mut rough);
                }
            }
        }
    }
    let closely = |(_, pose): (f64, Pose)| {
        let mut guess = Guess { pose, delay: 0.0 };
        for wider in [4.0, 2.0] {
            guess = refine(config, votes, guess, wider, prior).map_or(guess, |(guess, ..)| guess);
        }
        let (guess, covariance, volume) = refine(config, votes, guess, 1.0, prior)?;
        let off = (guess.delay - prior.0) / prior.1;
        let score = score(config, votes, guess, 0.0) - 0.5 * off * off + volume;
        let is_carried = is_carried(config, votes, guess, share, prior);
        let within = guess.delay.abs() < DELAYS || prior.1 < DELAYS;
        within.then_some(Candidate { score, pose: guess.pose, covariance, delay: guess.delay, is_carried })
    };
    rough.extend(own.map(|pose| (0.0, pose)));
    rough.into_iter().filter_map(closely).collect()
}

/// A bearing as it is seen from the trail's end; `None` when it is beyond the trail.
fn carry(config: &Config, seen: &Seen, trail: &Trail, turn: f64, delay: f64) -> Option<Vote> {
    let now = trail.last();
    let place = |delay: f64| {
        let late = Duration::from_secs_f64(delay.abs());
        trail.at(if delay >= 0.0 { seen.stamp - late } else { (seen.stamp + late).min(now.at) })
    };
    let from = |then: Place| now.pose.inverse() * then.pose;
    let then = place(delay)?;
    let own = from(then);
    let sensor = own * config.mount;
    let earlier = place(delay + DELAYS / 2.0).map_or((Point::default(), 0.0), |then| {
        let (other, per_s) = (from(then), 2.0 / DELAYS);
        let there = other * config.mount;
        let moved = Point { x: (there.x - sensor.x) * per_s, y: (there.y - sensor.y) * per_s };
        (moved, (other.theta - own.theta).radians() * per_s)
    });
    // Deviations of bearings are about what they are said to be; their lasting part does not average out.
    let bearing = libm::sqrt(1.0 + 2.5 * config.lasting) * config.bearing;
    Some(Vote {
        beacon: seen.beacon,
        place: seen.place,
        sensor,
        direction: wrap(own.theta.radians() + turn + seen.bearing),
        earlier,
        variance: bearing * bearing + (now.turn - then.turn).max(0.0),
        across: (now.along - then.along).max(0.0) + 0.0025,
    })
}

/// A triple's pose joins the candidates, if it is among the best and no better one is there already. What the delay is
/// beyond the tried one, with this deviation, is left open.
fn try_triple(config: &Config, votes: &[Vote], triple: &[Vote; 3], delay: f64, candidates: &mut Vec<(f64, Pose)>) {
    let bearings = triple.map(|vote| Angle::new(vote.direction));
    let Some(fix) = resection::three_bearings(triple.map(|vote| vote.place), bearings) else { return };
    if fix.d.abs() < D_MIN {
        return;
    }
    // That was for a sensor in one place; it was in three, so the pose is put right a few times.
    let middle = Point {
        x: triple.iter().map(|vote| vote.sensor.x).sum::<f64>() / 3.0,
        y: triple.iter().map(|vote| vote.sensor.y).sum::<f64>() / 3.0,
    };
    let pose = fix.pose * Pose { x: -middle.x, y: -middle.y, theta: Angle::ZERO };
    let mut guess = Guess { pose, delay: 0.0 };
    for _ in 0..3 {
        match refine(config, triple, guess, 1e6, (0.0, DELAY_MIN)) {
            Some((better, ..)) => guess = better,
            None => return,
        }
    }
    let pose = guess.pose;
    let inside = config.range * 2.0 + 100.0;
    if !(pose.x.abs() < 1e6 && pose.y.abs() < 1e6 && triple.iter().all(|v| pose.point().distance(v.place) < inside)) {
        return;
    }
    let own = score(config, votes, guess, delay.min(DELAYS / 3.0));
    if let Some(place) = candidates.iter().position(|(_, other)| is_same(pose, *other)) {
        if candidates[place].0 >= own {
            return;
        }
        candidates.remove(place);
    }
    let place = candidates.partition_point(|(other, _)| *other >= own);
    candidates.insert(place, (own, pose));
    candidates.truncate(CLOSELY);
}

/// Whether two poses are one for the search.
pub fn is_same(one: Pose, other: Pose) -> bool {
    one.point().distance(other.point()) < SAME.0 && (one.theta - other.theta).radians().abs() < SAME.1
}

/// What a vote says of a guess: its residual, rad, the variance of that, and its derivatives by x, y, theta, delay.
fn residual(vote: &Vote, guess: Guess) -> (f64, f64, [f64; 4]) {
    let ((moved, turned), Guess { pose, delay }) = (vote.earlier, guess);
    let then = Point { x: vote.sensor.x + delay * moved.x, y: vote.sensor.y + delay * moved.y };
    let sensor = pose * then;
    let (dx, dy) = (vote.place.x - sensor.x, vote.place.y - sensor.y);
    let square = (dx * dx + dy * dy).max(0.04);
    let residual = wrap(vote.direction + delay * turned - libm::atan2(dy, dx) + pose.theta.radians());
    let (by_x, by_y) = (dy / square, -dx / square);
    let by_theta = by_x * (pose.y - sensor.y) + by_y * (sensor.x - pose.x) - 1.0;
    let (sin, cos) = pose.theta.sin_cos();
    let by_delay = by_x * (cos * moved.x - sin * moved.y) + by_y * (sin * moved.x + cos * moved.y) - turned;
    (residual, vote.variance + vote.across / square, [by_x, by_y, by_theta, by_delay])
}

/// How probably a vote is for a guess, and the density of that, by 1/turn. `delay` is the deviation of the guess's.
fn agreement(config: &Config, vote: &Vote, guess: Guess, wider: f64, delay: f64) -> (f64, f64) {
    let (residual, variance, by) = residual(vote, guess);
    let variance = variance * wider + by[3] * by[3] * delay * delay;
    let in_range = guess.pose.point().distance(vote.place) <= config.range + 2.0;
    let density = libm::exp(-0.5 * residual * residual / variance) / libm::sqrt(TAU * variance);
    let own = if in_range { (1.0 - WILD) * density * TAU } else { 0.0 };
    (own / (own + WILD), own + WILD)
}

/// The logarithm of how likely the votes are.
fn score(config: &Config, votes: &[Vote], guess: Guess, delay: f64) -> f64 {
    votes.iter().map(|vote| libm::log(agreement(config, vote, guess, 1.0, delay).1)).sum()
}

/// One step of Gauss and Newton with all votes weighed by how they agree, and the delay by what is known of it (mean and
/// deviation); the covariance, and the logarithm of its volume.
fn refine(
    config: &Config,
    votes: &[Vote],
    guess: Guess,
    wider: f64,
    prior: (f64, f64),
) -> Option<(Guess, [[f64; 4]; 4], f64)> {
    let (mut information, mut sum) = ([[0.0; 4]; 4], [0.0; 4]);
    let known = 1.0 / (prior.1 * prior.1);
    (information[3][3], sum[3]) = (known, known * (prior.0 - guess.delay));
    for vote in votes {
        // Whoever is so generous weighs nothing.
        let right = if wider > 100.0 { 1.0 } else { agreement(config, vote, guess, wider, 0.0).0 };
        let (residual, variance, by) = residual(vote, guess);
        for row in 0..4 {
            sum[row] += right * by[row] * residual / variance;
            for column in 0..4 {
                information[row][column] += right * by[row] * by[column] / variance;
            }
        }
    }
    let (covariance, volume) = inverse(&information)?;
    let by = |row: usize| (0..4).map(|column| covariance[row][column] * sum[column]).sum::<f64>();
    let (dx, dy, turn) = (by(0), by(1), by(2));
    let pose = Pose { x: guess.pose.x + dx, y: guess.pose.y + dy, theta: guess.pose.theta + turn };
    // Steps beyond this are nonsense of nearly singular votes.
    (libm::hypot(dx, dy) < 50.0 && turn.abs() < PI)
        .then(|| (Guess { pose, delay: guess.delay + by(3) }, covariance, volume))
}

/// Whether enough votes, and this share of them, carry a pose: three bearings fit somewhere always.
fn is_carried(config: &Config, votes: &[Vote], guess: Guess, share: f64, prior: (f64, f64)) -> bool {
    let mut each = vec![0i32; config.beacons.len()];
    let mut half = 0;
    for vote in votes {
        let right = agreement(config, vote, guess, 1.0, 0.0).0;
        each[vote.beacon] += i32::from(right > SURELY);
        half += u32::from(right > 0.5);
    }
    f64::from(half) >= share * votes.len() as f64
        && by_chance(&each) + by_one(config, votes, guess, prior, &each) <= BY_CHANCE
}

/// How probably votes for a pose, so many of each beacon, are there by chance: those of two beacons are right, which
/// leaves a circle, and a wild one fits somewhere on it; any other wild one fits only by accident.
fn by_chance(each: &[i32]) -> f64 {
    let all: i32 = each.iter().sum();
    let pairs = each.iter().enumerate().flat_map(|(place, one)| each[..place].iter().map(move |other| one + other));
    if each.iter().filter(|count| **count > 0).count() < 3 { 1.0 } else { pairs.map(|pair| wild(all - pair)).sum() }
}

/// So many wild bearings fit, the first of them anyhow.
fn wild(count: i32) -> f64 {
    libm::pow(WILD / (1.0 - WILD) * ACCIDENT, f64::from(count)) / ACCIDENT
}

/// How probably a pose is there by the wild votes of one beacon, where it is not known well without them.
fn by_one(config: &Config, votes: &[Vote], guess: Guess, prior: (f64, f64), each: &[i32]) -> f64 {
    let mut sum = 0.0;
    for beacon in (0..each.len()).filter(|beacon| each[*beacon] > 0) {
        let mut information = [[0.0; 4]; 4];
        information[3][3] = 1.0 / (prior.1 * prior.1);
        let mut own = None;
        for vote in votes {
            let right = agreement(config, vote, guess, 1.0, 0.0).0;
            let (_, variance, by) = residual(vote, guess);
            if vote.beacon == beacon {
                own = own.or((right > SURELY).then_some((by, variance)));
                continue;
            }
            for row in 0..4 {
                for column in 0..4 {
                    information[row][column] += right * by[row] * by[column] / variance;
                }
            }
        }
        let (Some((rest, _)), Some((by, variance))) = (inverse(&information), own) else {
            sum += wild(each[beacon]);
            continue;
        };
        let (position, _) =
            crate::filter::deviations(&core::array::from_fn(|row| core::array::from_fn(|c| rest[row][c])));
        if position > SHARP_REST {
            let spread: f64 =
                (0..4).map(|row| (0..4).map(|column| by[row] * rest[row][column] * by[column]).sum::<f64>()).sum();
            sum += wild(each[beacon]) * (5.0 * libm::sqrt(spread + variance) / TAU).min(1.0);
        }
    }
    sum
}

/// The inverse of a symmetric matrix, and half the logarithm of its determinant; `None` if it has (nearly) none.
fn inverse<const N: usize>(m: &[[f64; N]; N]) -> Option<([[f64; N]; N], f64)> {
    // Of the matrix with ones on its diagonal, by Gauss and Jordan.
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
