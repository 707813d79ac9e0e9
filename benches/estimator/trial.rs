//! Runs the filter, and a textbook EKF beside it, over runs of the truth.

use super::matrix::{add, normalized, predict, update};
use super::truth::{Measured, ODOMETRY, Row, Run, STEP, beacons, run};
use base::Instant;
use estimator::Filter;
use estimator::filter::{Beacon, Config, Mount, Noise, Quality};
use navitools::{Point, Pose, wrap};

/// Three sweeps, s.
pub const SWEEPS: f64 = 3.0;
/// s that are not judged at the start.
const SETTLES: f64 = 60.0;

pub fn at(seconds: f64) -> Instant {
    // The truth begins at 1 s of the filter's time: a bearing may be of before the first way.
    Instant::from_nanos(((seconds + 1.0) * 1e9 + 0.5) as u64)
}

/// A filter for a row. One that `knows` what the truth has, as the bound does, has priors for that alone; else for all.
pub fn filter(row: &Row, knows: bool) -> Filter {
    let beacons = (1..).zip(beacons(row.beacons)).map(|(id, at)| Beacon { id, at }).collect();
    let half = libm::sqrt(STEP);
    let odometry =
        Noise { along_per_m: 0.0, along_per_s: ODOMETRY.0 * half, turn_per_m: 0.0, turn_per_s: ODOMETRY.1 * half };
    let mount = Mount { x: 0.0, y: 0.0 };
    let usual =
        Config { beacons, odometry, mount, bearing: row.sigma, lasting: row.lasting, range: 25.0, ..Config::default() };
    let prior = |has: bool, deviation: f64| if has || !knows { deviation } else { 0.0 };
    let config = Config {
        turn: prior(row.turn > 0.0, usual.turn),
        scale: prior(row.scale != 0.0, usual.scale),
        bend: prior(false, usual.bend),
        track: prior(false, usual.track),
        delay: prior(row.late != 0.0, usual.delay),
        ..usual
    };
    Filter::new(config).expect("a configuration that can be")
}

/// Feeds what was measured.
pub fn feed(filter: &mut Filter, stamp: f64, measured: &Measured) {
    let _ = match *measured {
        Measured::Odometry(rates) => filter.odometry(at(stamp), rates),
        Measured::Bearing { beacon, bearing } => filter.bearing(at(stamp), beacon as i32 + 1, bearing),
    };
}

/// How a run went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outcome {
    /// Mean squares of the position's error, m²: of the filter that knows as much as the bound, of one that knows nothing
    /// of its robot, of the peer, and the bound.
    pub ours: f64,
    pub knowing_nothing: f64,
    pub peer: f64,
    pub bound: f64,
    /// Mean of the normalized squared error of the pose, by 3.
    pub nees: f64,
    /// The greatest error, m.
    pub worst: f64,
}

/// From a known start.
pub fn known(row: &Row, seed: u64) -> Outcome {
    let run = run(row, seed);
    let (mut filter, mut other) = (filter(row, true), filter(row, false));
    let mut peer = Peer::new(run.start, row);
    let mut told = run.measured.iter().peekable();
    let (mut outcome, mut count) = (Outcome::default(), 0.0);
    if let Some((stamp, measured)) = told.next() {
        feed(&mut filter, *stamp, measured);
        feed(&mut other, *stamp, measured);
    }
    let start = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0025]];
    filter.set(run.start, start).expect("a pose");
    other.set(run.start, start).expect("a pose");
    for (now, truth, bound) in &run.truth {
        let mut news = Vec::new();
        while let Some((stamp, measured)) = told.next_if(|(stamp, _)| *stamp <= now + 1e-6) {
            feed(&mut filter, *stamp, measured);
            feed(&mut other, *stamp, measured);
            news.push((*stamp, *measured));
        }
        peer.step(&mut news);
        if *now < SETTLES {
            continue;
        }
        let estimate = filter.estimate(at(*now));
        let squared = |pose: Pose| (pose.x - truth.x) * (pose.x - truth.x) + (pose.y - truth.y) * (pose.y - truth.y);
        let error =
            [estimate.pose.x - truth.x, estimate.pose.y - truth.y, (estimate.pose.theta - truth.theta).radians()];
        count += 1.0;
        outcome.ours += squared(estimate.pose);
        outcome.knowing_nothing += squared(other.estimate(at(*now)).pose);
        outcome.peer += squared(peer.pose);
        outcome.bound += bound;
        outcome.nees += normalized(&estimate.covariance, error) / 3.0;
        outcome.worst = outcome.worst.max(libm::sqrt(squared(estimate.pose)));
    }
    for sum in
        [&mut outcome.ours, &mut outcome.knowing_nothing, &mut outcome.peer, &mut outcome.bound, &mut outcome.nees]
    {
        *sum /= count;
    }
    outcome
}

/// How a search for the pose went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sought {
    /// s from the first instant at which a sighting of the new place could be stamped until the pose was no longer FINE.
    pub uneasy: Option<f64>,
    /// The same until the kidnapping was noticed: the pose was not to be relied on, or was another one; none: not
    /// kidnapped, or never.
    pub noticed: Option<f64>,
    /// Bearings, right and wild, that were stamped in the three sweeps after, and could be told by then.
    pub told: usize,
    /// s from the third beacon's sighting until right bearings were enough for anybody who is told which are right: two
    /// of each of three beacons, or five of four, within six seconds.
    pub enough: Option<f64>,
    /// The first pose ever called COARSE or FINE was wrong.
    pub first_wrong: bool,
    /// s from the third beacon's sighting (since the start, or the kidnapping) until there was a right pose.
    pub found: Option<f64>,
    /// s with a pose more than a metre or 20 degrees off, called COARSE or FINE, other than before it was noticed.
    pub wrong: f64,
    /// s that the error was more than ten of its deviations, in a row at most.
    pub dishonest: f64,
}

/// From no start; and once more where the robot is put elsewhere.
pub fn unknown(row: &Row, seed: u64) -> Sought {
    let run = run(row, seed);
    let mut filter = filter(row, false);
    let mut told = run.measured.iter().peekable();
    let from = row.kidnapped.unwrap_or(0.0);
    let mut doubted = 0;
    let third = third(&run, from);
    let enough = enough(&run, from, row.beacons).map(|at| at - third);
    let (from_stamps, mut claimed) = (from + row.late, false);
    let stamps = run.measured.iter().filter(|(_, measured)| matches!(measured, Measured::Bearing { .. }));
    let told_in_sweeps = stamps.filter(|(stamp, _)| (from_stamps..from_stamps + SWEEPS + STEP).contains(stamp)).count();
    let (mut sought, mut dishonest) = (Sought { told: told_in_sweeps, enough, ..Sought::default() }, 0.0);
    for (now, truth, _) in &run.truth {
        while let Some((stamp, measured)) = told.next_if(|(stamp, _)| *stamp <= now + 1e-6) {
            feed(&mut filter, *stamp, measured);
        }
        let estimate = filter.estimate(at(*now));
        let claims = estimate.quality >= Quality::Coarse;
        let off = estimate.pose.point().distance(truth.point());
        let turned = (estimate.pose.theta - truth.theta).radians().abs();
        let deviation = libm::sqrt(estimate.covariance[0][0] + estimate.covariance[1][1]);
        let right = off < f64::max(1.0, 4.0 * deviation)
            && turned < f64::max(0.35, 4.0 * libm::sqrt(estimate.covariance[2][2]));
        dishonest = if off > 10.0 * deviation { dishonest + STEP } else { 0.0 };
        let unnoticed = row.kidnapped.is_some() && *now > from && sought.noticed.is_none();
        if *now <= from {
            doubted = filter.counts().doubted;
        }
        if *now > from && unnoticed && (!claims || filter.counts().doubted > doubted) {
            sought.noticed = Some(now - from_stamps);
        }
        if unnoticed && sought.uneasy.is_none() && estimate.quality < Quality::Fine {
            sought.uneasy = Some(now - from_stamps);
        }
        sought.uneasy = sought.uneasy.or(sought.noticed);
        if claims && !claimed {
            (claimed, sought.first_wrong) = (true, !right);
        }
        if claims && !right && !unnoticed {
            sought.wrong += STEP;
        }
        sought.dishonest = f64::max(sought.dishonest, if unnoticed { 0.0 } else { dishonest });
        let counts = *now > from && (row.kidnapped.is_none() || sought.noticed.is_some());
        if counts && claims && right && sought.found.is_none() {
            sought.found = Some(f64::max(now - third, 0.0));
        }
    }
    sought
}

/// When right bearings since `from`, those of the last six seconds, were first enough, s; as of [`Sought::enough`].
fn enough(run: &Run, from: f64, beacons: usize) -> Option<f64> {
    let sighted: Vec<(f64, usize)> =
        run.sighted.iter().copied().filter(|(stamp, _)| *stamp > from + run.late).collect();
    let is_enough = |place: usize| {
        let mut each = vec![0; beacons];
        let last = sighted[place].0;
        sighted[..=place].iter().filter(|(stamp, _)| last - stamp <= 6.0).for_each(|(_, beacon)| each[*beacon] += 1);
        let (once, twice) = (|n: &&i32| **n > 0, |n: &&i32| **n > 1);
        let distinct = each.iter().filter(once).count();
        each.iter().filter(twice).count() >= 3 || (distinct >= 4 && each.iter().sum::<i32>() >= 5)
    };
    (0..sighted.len()).find(|place| is_enough(*place)).map(|place| sighted[place].0)
}

/// When the third beacon since `from` was sighted, s.
fn third(run: &Run, from: f64) -> f64 {
    let mut seen = Vec::new();
    for (stamp, beacon) in run.sighted.iter().filter(|(stamp, _)| *stamp > from + run.late) {
        if !seen.contains(beacon) {
            seen.push(*beacon);
        }
        if seen.len() == 3 {
            return *stamp;
        }
    }
    f64::INFINITY
}

/// The EKF of a textbook: x, y, heading; a bearing counts when it comes; a gate of 9 where there are wild ones.
struct Peer {
    pose: Pose,
    cov: [[f64; 3]; 3],
    places: Vec<Point>,
    row: Row,
    at: f64,
    rates: navitools::Motion,
}

impl Peer {
    fn new(pose: Pose, row: &Row) -> Self {
        let cov = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0025]];
        Self { pose, cov, places: beacons(row.beacons), row: *row, at: 0.0, rates: Default::default() }
    }

    /// A way, and the bearings that are stamped in it, each in its place.
    fn step(&mut self, news: &mut [(f64, Measured)]) {
        let rates =
            news.iter().find_map(|(_, news)| if let Measured::Odometry(rates) = news { Some(*rates) } else { None });
        self.rates = rates.unwrap_or_default();
        news.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (stamp, measured) in news {
            self.go(*stamp);
            if let Measured::Bearing { beacon, bearing } = *measured {
                self.see(self.places[beacon], bearing);
            }
        }
    }

    fn go(&mut self, to: f64) {
        let dt = to - self.at;
        self.at = to;
        let way = navitools::Motion { translation: self.rates.translation * dt, rotation: self.rates.rotation * dt };
        let (sin, cos) = libm::sincos(self.pose.theta.radians() + way.rotation / 2.0);
        let f = [[1.0, 0.0, -way.translation * sin], [0.0, 1.0, way.translation * cos], [0.0, 0.0, 1.0]];
        let (along, turn) = (ODOMETRY.0 * ODOMETRY.0 * dt * STEP, ODOMETRY.1 * ODOMETRY.1 * dt * STEP);
        let q = [
            [along * cos * cos, along * sin * cos, 0.0],
            [along * sin * cos, along * sin * sin, 0.0],
            [0.0, 0.0, turn],
        ];
        self.cov = add(&predict(&self.cov, &f), &q);
        self.pose = self.pose.along(way);
    }

    fn see(&mut self, place: Point, bearing: f64) {
        let (dx, dy) = (place.x - self.pose.x, place.y - self.pose.y);
        let square = dx * dx + dy * dy;
        let by = [dy / square, -dx / square, -1.0];
        let innovation = wrap(bearing - libm::atan2(dy, dx) + self.pose.theta.radians());
        let mut cov = self.cov;
        let (gain, expected) = update(&mut cov, &by, self.row.sigma * self.row.sigma);
        if self.row.wild > 0.0 && innovation * innovation > 9.0 * expected {
            return;
        }
        self.cov = cov;
        let theta = self.pose.theta + gain[2] * innovation;
        self.pose = Pose { x: self.pose.x + gain[0] * innovation, y: self.pose.y + gain[1] * innovation, theta };
    }
}
