//! Simulation of a robot that drives about a hall, its measurements, and the theoretical bound of the accuracy.
//!
//! As in docs/facts/robot.md 3.3: 20 × 12 m, 0.6 m/s, odometry at 4 Hz with 0.03 m/s and 0.05 rad/s, each beacon
//! sighted once a second at its own instant. Shares only [`navitools`] with the filter.

use super::matrix::{Matrix, N, add, predict, update};
use navitools::{Angle, Motion, Point, Pose, wrap};

/// Period of the odometry, s.
pub const STEP: f64 = 0.25;
/// Standard deviations of one odometry reading, m/s and rad/s.
pub const ODOMETRY: (f64, f64) = (0.03, 0.05);
const SPEED: f64 = 0.6;

/// Random number generator.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x5DEE_CE66_D1CE_4E5B)
    }

    /// Uniform in [0, 1); splitmix64.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        let (radius, angle) = (1.0 - self.uniform(), self.uniform() * core::f64::consts::TAU);
        libm::sqrt(-2.0 * libm::log(radius)) * libm::cos(angle)
    }
}

/// Parameters of a row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    pub name: &'static str,
    pub beacons: usize,
    /// Standard deviation of a bearing, rad.
    pub sigma: f64,
    /// Share of its variance that is correlated over 2 s.
    pub lasting: f64,
    /// Probability that a sighting fails.
    pub hidden: f64,
    /// Probability of an outlier.
    pub wild: f64,
    /// Delay of the timestamps, s.
    pub late: f64,
    /// Scale error of the odometry: distances are longer by this share than measured.
    pub scale: f64,
    /// Standard deviation of the sensor's mounting angle, rad.
    pub turn: f64,
    /// Time of the kidnapping, s.
    pub kidnapped: Option<f64>,
    /// Time from which the robot stands, s.
    pub stands: f64,
    /// Duration, s.
    pub length: f64,
}

impl Row {
    pub const EASY: Self = Self {
        name: "4 beacons, 0.5°",
        beacons: 4,
        sigma: 0.5 * core::f64::consts::PI / 180.0,
        lasting: 0.0,
        hidden: 0.0,
        wild: 0.0,
        late: 0.0,
        scale: 0.0,
        turn: 0.0,
        kidnapped: None,
        stands: f64::INFINITY,
        length: 300.0,
    };
}

/// Beacons of a hall with this number of them.
pub fn beacons(count: usize) -> Vec<Point> {
    let corners = [(0.1, 0.1), (19.9, 11.9), (19.9, 0.1), (0.1, 11.9), (10.0, 0.1), (8.0, 11.9)];
    corners[..count].iter().map(|(x, y)| Point { x: *x, y: *y }).collect()
}

/// Measurement.
#[derive(Clone, Copy, Debug)]
pub enum Measured {
    /// Rates since the last one.
    Odometry(Motion),
    /// Bearing of this beacon.
    Bearing { beacon: usize, bearing: f64 },
}

/// Events in order of their availability.
pub struct Run {
    /// Measurements with timestamps, s.
    pub measured: Vec<(f64, Measured)>,
    /// At each odometry reading: time, pose, and variance of the position according to the bound, m².
    pub truth: Vec<(f64, Pose, f64)>,
    /// Timestamp of each right bearing, and its beacon.
    pub sighted: Vec<(f64, usize)>,
    pub start: Pose,
    /// Delay of the timestamps as in the row, s.
    pub late: f64,
}

/// Sighting that is due.
struct Due {
    at: f64,
    beacon: usize,
}

pub fn run(row: &Row, seed: u64) -> Run {
    let mut random = Random::new(seed);
    let places = beacons(row.beacons);
    let mut goal = somewhere(&mut random);
    let mut pose = Pose::new(10.0, 6.0, random.uniform() * core::f64::consts::TAU);
    let start = pose;
    let turn = row.turn * random.normal();
    let mut lasting = vec![random.normal(); row.beacons];
    let mut due: Vec<Due> = (0..row.beacons).map(|beacon| Due { at: random.uniform(), beacon }).collect();
    let mut bound = Bound::new(row);
    let (mut measured, mut truth, mut sighted) = (Vec::new(), Vec::new(), Vec::new());
    measured.push((0.0, Measured::Odometry(Motion::default())));
    let steps = (row.length / STEP) as usize;
    for number in 0..steps {
        let (begin, end) = (number as f64 * STEP, (number + 1) as f64 * STEP);
        if row.kidnapped.is_some_and(|at| (begin..end).contains(&at)) {
            let there = somewhere(&mut random);
            pose = Pose::new(there.x, there.y, random.uniform() * core::f64::consts::TAU);
        }
        while pose.point().distance(goal) < 1.0 {
            goal = somewhere(&mut random);
        }
        let off = Angle::new(libm::atan2(goal.y - pose.y, goal.x - pose.x)) - pose.theta;
        let rates = match begin >= row.stands {
            true => Motion::default(),
            false => Motion { translation: SPEED, rotation: (off.radians() * 0.8).clamp(-0.5, 0.5) },
        };
        // The odometry is off by its scale, and by the noise of the motion.
        let said = Motion { translation: rates.translation / (1.0 + row.scale), rotation: rates.rotation };
        let mut at = begin;
        loop {
            let next = due.iter_mut().filter(|due| due.at < end).min_by(|a, b| a.at.total_cmp(&b.at));
            let to = next.as_ref().map_or(end, |due| due.at);
            let dt = to - at;
            // Wheels at standstill have no noise.
            let noise = if begin >= row.stands { 0.0 } else { libm::sqrt(dt * STEP) };
            let way = Motion {
                translation: rates.translation * dt + ODOMETRY.0 * noise * random.normal(),
                rotation: rates.rotation * dt + ODOMETRY.1 * noise * random.normal(),
            };
            bound.go(pose, said, rates, dt);
            pose = pose.along(way);
            at = to;
            let Some(sighting) = next else { break };
            sighting.at += 1.0;
            let beacon = sighting.beacon;
            let place = places[beacon];
            let hold = libm::exp(-1.0 / 2.0);
            lasting[beacon] = hold * lasting[beacon] + libm::sqrt(1.0 - hold * hold) * random.normal();
            let error = libm::sqrt(1.0 - row.lasting) * random.normal() + libm::sqrt(row.lasting) * lasting[beacon];
            let right =
                libm::atan2(place.y - pose.y, place.x - pose.x) - pose.theta.radians() - turn + row.sigma * error;
            let (hidden, wild) = (random.uniform() < row.hidden, random.uniform() < row.wild);
            let elsewhere = random.uniform() * core::f64::consts::TAU;
            if hidden {
                continue;
            }
            let bearing = wrap(if wild { elsewhere } else { right });
            measured.push((at + row.late, Measured::Bearing { beacon, bearing }));
            if !wild {
                sighted.push((at + row.late, beacon));
                bound.see(pose, place, rates, row.sigma);
            }
        }
        measured.push((end, Measured::Odometry(said)));
        truth.push((end, pose, bound.position()));
    }
    // A bearing is available after the odometry that reaches beyond its instant.
    let told = |(at, measured): &(f64, Measured)| match measured {
        Measured::Odometry(_) => *at,
        Measured::Bearing { .. } => libm::ceil(*at / STEP - 1e-9) * STEP + 1e-9,
    };
    measured.sort_by(|a, b| told(a).total_cmp(&told(b)));
    Run { measured, truth, sighted, start, late: row.late }
}

fn somewhere(random: &mut Random) -> Point {
    Point { x: 2.0 + 16.0 * random.uniform(), y: 2.0 + 8.0 * random.uniform() }
}

/// Posterior Cramér-Rao bound (Tichavsky's recursion, additive noise, Jacobians at the truth) of pose, sensor angle,
/// scale and delay, of which a row's truth has those with a prior. The bounded estimator knows which bearings are
/// right, and gets each at its timestamp: the last `late` seconds are odometry alone.
struct Bound {
    row: Row,
    cov: Matrix,
    /// Derivatives, noise and pending sightings of the last `late` seconds.
    waiting: std::collections::VecDeque<(f64, Matrix, Matrix)>,
    seen: std::collections::VecDeque<(f64, [f64; N])>,
    now: f64,
}

impl Bound {
    fn new(row: &Row) -> Self {
        let mut cov = [[0.0; N]; N];
        let own = |has: bool, deviation: f64| if has { deviation * deviation } else { 0.0 };
        let prior = [
            0.1 * 0.1,
            0.1 * 0.1,
            0.05 * 0.05,
            own(row.turn > 0.0, row.turn),
            own(row.scale != 0.0, 0.02),
            own(row.late != 0.0, 0.3),
        ];
        for (place, variance) in prior.iter().enumerate() {
            cov[place][place] = *variance;
        }
        Self { row: *row, cov, waiting: Default::default(), seen: Default::default(), now: 0.0 }
    }

    fn go(&mut self, pose: Pose, said: Motion, rates: Motion, dt: f64) {
        let middle = pose.theta.radians() + rates.rotation * dt / 2.0;
        let (sin, cos) = libm::sincos(middle);
        let mut f = [[0.0; N]; N];
        (0..N).for_each(|place| f[place][place] = 1.0);
        f[0][2] = -rates.translation * dt * sin;
        f[1][2] = rates.translation * dt * cos;
        (f[0][4], f[1][4]) = (said.translation * dt * cos, said.translation * dt * sin);
        let (along, turn) = (ODOMETRY.0 * ODOMETRY.0 * dt * STEP, ODOMETRY.1 * ODOMETRY.1 * dt * STEP);
        let g = [[cos, f[0][2] / 2.0], [sin, f[1][2] / 2.0], [0.0, 1.0]];
        let mut q = [[0.0; N]; N];
        for row in 0..3 {
            for column in 0..3 {
                q[row][column] = g[row][0] * g[column][0] * along + g[row][1] * g[column][1] * turn;
            }
        }
        self.now += dt;
        self.waiting.push_back((self.now, f, q));
        while self.waiting.front().is_some_and(|(at, ..)| *at <= self.now - self.row.late + 1e-9) {
            let (at, f, q) = self.waiting.pop_front().expect("there is a first");
            self.cov = add(&predict(&self.cov, &f), &q);
            while self.seen.front().is_some_and(|(seen, _)| *seen <= at + 1e-9) {
                let (_, by) = self.seen.pop_front().expect("there is a first");
                update(&mut self.cov, &by, self.row.sigma * self.row.sigma);
            }
        }
    }

    fn see(&mut self, pose: Pose, place: Point, rates: Motion, sigma: f64) {
        let (dx, dy) = (place.x - pose.x, place.y - pose.y);
        let square = dx * dx + dy * dy;
        let (sin, cos) = pose.theta.sin_cos();
        let (by_x, by_y) = (dy / square, -dx / square);
        let by_delay = rates.rotation - rates.translation * (by_x * cos + by_y * sin);
        let by = [by_x, by_y, -1.0, -1.0, 0.0, by_delay];
        if self.row.late == 0.0 {
            update(&mut self.cov, &by, sigma * sigma);
        } else {
            self.seen.push_back((self.now, by));
        }
    }

    /// Variance of the position, m².
    fn position(&self) -> f64 {
        let mut cov = self.cov;
        for (_, f, q) in &self.waiting {
            cov = add(&predict(&cov, f), q);
        }
        cov[0][0] + cov[1][1]
    }
}
