//! Where the robot may be, when nothing is known: from the bearings of the last seconds.
//!
//! Odometry carries what was seen before to now. Each three bearings of different beacons allow a pose
//! ([`navitools::resection`]); all bearings vote for each, and one is believed when it has enough of them and all others,
//! elsewhere, are ten times less likely (docs/facts/robot.md 3.3).

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
/// A believed pose is this much more likely than any other: 10 to 1, and 100 times that for having been picked among
/// some hundred triples.
const AHEAD: f64 = 3.0 * core::f64::consts::LN_10;
/// Delays that are tried differ by this, s.
const DELAYS: f64 = 0.2;
/// Poses nearer than this, m and rad, are the same.
const SAME: (f64, f64) = (0.6, 0.25);
/// What a delay makes of a pose, m/s and rad/s.
const DELAYED: (f64, f64) = (1.0, 0.7);
/// A pose is not believed unless the votes fix it to this, m and rad.
const SHARP: (f64, f64) = (0.6, 0.15);
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
    /// Of x, y, theta.
    pub covariance: [[f64; 3]; 3],
    /// From the bearings to their stamps, s, and the deviation of that.
    pub delay: (f64, f64),
}

/// A bearing, carried to now.
#[derive(Clone, Copy)]
struct Vote {
    beacon: usize,
    place: Point,
    /// The sensor then, seen from the robot now.
    sensor: Point,
    /// The direction then, seen from the robot now.
    direction: f64,
    /// rad², and m² across.
    variance: f64,
    across: f64,
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
    for delay in delays(delay) {
        votes.clear();
        votes.extend(seen.iter().rev().filter_map(|seen| carry(config, seen, trail, turn, delay.0)));
        for mut candidate in candidates(config, &votes, own, share) {
            candidate.delay = delay.0;
            candidate.score += delay.1;
            best.push(candidate);
        }
    }
    best.sort_by(|a, b| b.score.total_cmp(&a.score));
    let first = *best.first()?;
    let rival = best.iter().find(|other| !first.is_same(other));
    let ahead = rival.is_none_or(|rival| first.score - rival.score >= AHEAD);
    let (position, heading) = crate::filter::deviations(&first.covariance);
    let sharp = position <= SHARP.0 && heading <= SHARP.1;
    (ahead && sharp && first.is_carried).then(|| Found {
        pose: first.pose,
        covariance: first.covariance,
        delay: delay_of(&first, &best, delay.1),
    })
}

/// The delays to try, each with the logarithm of how likely it is: where that is not known well they are many.
fn delays((mean, deviation): (f64, f64)) -> impl Iterator<Item = (f64, f64)> {
    let most = libm::ceil(2.0 * deviation / DELAYS - 0.5).clamp(0.0, 4.0) as i32;
    (0..=most).map(move |number| {
        let off = f64::from(number) * DELAYS;
        let unlikely = if number == 0 { 0.0 } else { 0.5 * off * off / (deviation * deviation) };
        (mean + off, -unlikely)
    })
}

/// The mean of the delays with which a pose was found, by how likely they are, and the deviation.
fn delay_of(first: &Candidate, all: &[Candidate], deviation: f64) -> (f64, f64) {
    let same = || all.iter().filter(|other| first.is_same(other));
    let weight = |other: &Candidate| libm::exp(other.score - first.score);
    let sum: f64 = same().map(weight).sum();
    let spread: f64 = same().map(|o| weight(o) * (o.delay - first.delay) * (o.delay - first.delay)).sum::<f64>() / sum;
    // The first one's pose goes with its own delay; within a step any is as good.
    (first.delay, deviation.min(libm::sqrt(spread + DELAYS * DELAYS)))
}

/// A pose that votes are for.
#[derive(Clone, Copy)]
struct Candidate {
    score: f64,
    pose: Pose,
    covariance: [[f64; 3]; 3],
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

fn candidates(config: &Config, votes: &[Vote], own: Option<Pose>, share: f64) -> Vec<Candidate> {
    let mut rough: Vec<(f64, Pose)> = Vec::with_capacity(CLOSELY + 1);
    for (a, one) in votes.iter().enumerate().take(IN_TRIPLES) {
        for (b, two) in votes.iter().enumerate().take(IN_TRIPLES).skip(a + 1) {
            for three in votes.iter().take(IN_TRIPLES).skip(b + 1) {
                if one.beacon != two.beacon && two.beacon != three.beacon && three.beacon != one.beacon {
                    try_triple(config, votes, &[*one, *two, *three], &mut rough);
                }
            }
        }
    }
    let closely = |(_, pose): (f64, Pose)| {
        let near = refine(config, votes, pose, 4.0).map_or(pose, |(pose, _)| pose);
        let (pose, covariance) = refine(config, votes, near, 1.0)?;
        let (score, is_carried) = (score(config, votes, pose), is_carried(config, votes, pose, share));
        Some(Candidate { score, pose, covariance, delay: 0.0, is_carried })
    };
    rough.extend(own.map(|pose| (0.0, pose)));
    rough.into_iter().filter_map(closely).collect()
}

/// A bearing as it is seen from the trail's end; `None` when it is beyond the trail.
fn carry(config: &Config, seen: &Seen, trail: &Trail, turn: f64, delay: f64) -> Option<Vote> {
    let late = Duration::from_secs_f64(delay.abs());
    let at = if delay >= 0.0 { seen.stamp - late } else { (seen.stamp + late).min(trail.last().at) };
    let (now, then): (Place, Place) = (trail.last(), trail.at(at)?);
    let now_from_then = now.pose.inverse() * then.pose;
    // Deviations of bearings are about what they are said to be; their lasting part does not average out.
    let bearing = 1.5 * config.bearing;
    Some(Vote {
        beacon: seen.beacon,
        place: seen.place,
        sensor: now_from_then * config.mount,
        direction: wrap(now_from_then.theta.radians() + turn + seen.bearing),
        variance: bearing * bearing + (now.turn - then.turn).max(0.0),
        across: (now.along - then.along).max(0.0) + 0.0025,
    })
}

/// A triple's pose joins the candidates, if it is among the best and no better one is there already.
fn try_triple(config: &Config, votes: &[Vote], triple: &[Vote; 3], candidates: &mut Vec<(f64, Pose)>) {
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
    let mut pose = fix.pose * Pose { x: -middle.x, y: -middle.y, theta: Angle::ZERO };
    for _ in 0..3 {
        match refine(config, triple, pose, 1e6) {
            Some((better, _)) => pose = better,
            None => return,
        }
    }
    let inside = config.range * 2.0 + 100.0;
    if !(pose.x.abs() < 1e6 && pose.y.abs() < 1e6 && triple.iter().all(|v| pose.point().distance(v.place) < inside)) {
        return;
    }
    let own = score(config, votes, pose);
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

/// What a vote says of a pose: its residual, rad, the variance of that, and its derivatives by x, y, theta.
fn residual(vote: &Vote, pose: Pose) -> (f64, f64, [f64; 3]) {
    let sensor = pose * vote.sensor;
    let (dx, dy) = (vote.place.x - sensor.x, vote.place.y - sensor.y);
    let square = (dx * dx + dy * dy).max(0.04);
    let residual = wrap(vote.direction - libm::atan2(dy, dx) + pose.theta.radians());
    let (by_x, by_y) = (dy / square, -dx / square);
    let by_theta = by_x * (pose.y - sensor.y) + by_y * (sensor.x - pose.x) - 1.0;
    (residual, vote.variance + vote.across / square, [by_x, by_y, by_theta])
}

/// How probably a vote is for a pose, and the density of that, by 1/turn.
fn agreement(config: &Config, vote: &Vote, pose: Pose, wider: f64) -> (f64, f64) {
    let (residual, variance, _) = residual(vote, pose);
    let variance = variance * wider;
    let in_range = pose.point().distance(vote.place) <= config.range + 2.0;
    let density = libm::exp(-0.5 * residual * residual / variance) / libm::sqrt(TAU * variance);
    let own = if in_range { (1.0 - WILD) * density * TAU } else { 0.0 };
    (own / (own + WILD), own + WILD)
}

/// The logarithm of how likely the votes are.
fn score(config: &Config, votes: &[Vote], pose: Pose) -> f64 {
    votes.iter().map(|vote| libm::log(agreement(config, vote, pose, 1.0).1)).sum()
}

/// One step of Gauss and Newton with all votes weighed by how they agree; and the covariance.
fn refine(config: &Config, votes: &[Vote], pose: Pose, wider: f64) -> Option<(Pose, [[f64; 3]; 3])> {
    let (mut information, mut sum) = ([[0.0; 3]; 3], [0.0; 3]);
    for vote in votes {
        // Whoever is so generous weighs nothing.
        let right = if wider > 100.0 { 1.0 } else { agreement(config, vote, pose, wider).0 };
        let (residual, variance, by) = residual(vote, pose);
        for row in 0..3 {
            sum[row] += right * by[row] * residual / variance;
            for column in 0..3 {
                information[row][column] += right * by[row] * by[column] / variance;
            }
        }
    }
    let covariance = inverse(&information)?;
    let by = |row: usize| (0..3).map(|column| covariance[row][column] * sum[column]).sum::<f64>();
    let (dx, dy, turn) = (by(0), by(1), by(2));
    // Steps beyond this are nonsense of nearly singular votes.
    (libm::hypot(dx, dy) < 50.0 && turn.abs() < PI)
        .then(|| (Pose { x: pose.x + dx, y: pose.y + dy, theta: pose.theta + turn }, covariance))
}

/// Whether enough votes, and this share of them, carry a pose: three bearings fit somewhere always.
fn is_carried(config: &Config, votes: &[Vote], pose: Pose, share: f64) -> bool {
    let mut each = vec![0u32; config.beacons.len()];
    for vote in votes.iter().filter(|vote| agreement(config, vote, pose, 1.0).0 > 0.5) {
        each[vote.beacon] += 1;
    }
    let for_it: u32 = each.iter().sum();
    let beacons = each.iter().filter(|count| **count > 0).count();
    let twice = each.iter().filter(|count| **count > 1).count();
    let enough = match (beacons, for_it) {
        (5.., 5..) => true,
        (4, 7..) => true,
        (3, 7..) => twice == 3,
        _ => false,
    };
    enough && f64::from(for_it) >= share * votes.len() as f64
}

/// The inverse of a symmetric matrix; `None` if it has (nearly) none.
fn inverse(m: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let minor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
    let scale = m[0][0] * m[1][1] * m[2][2];
    (determinant > 1e-12 * scale && determinant.is_finite())
        .then(|| core::array::from_fn(|row| core::array::from_fn(|column| minor(column, row) / determinant)))
}
