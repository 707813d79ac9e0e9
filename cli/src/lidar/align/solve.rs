//! Least squares: the lidar's place on the robot, by points on walls that do not move and the robot's way.
//!
//! In the frame of the lidar at the begin, which needs no place on the robot, a point q that the lidar sees at the pose
//! (T, Φ) of the robot lies at R(Φ) q + R(-θ) T + (R(Φ) - 1) m, where θ is the direction of the lidar's front in the
//! robot, and m the vector from the robot's origin to the lidar in the lidar's axes. Its distance from its wall is the
//! residual. θ is only in the term with the way T, m only in the one with the rotation: what was not driven is not
//! determined.

use super::odometry::{Errors, Velocity, Way};
use super::walls::Wall;
use std::f64::consts::{PI, TAU};

/// A point on a wall, in the frame of the lidar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Time, s.
    pub at: f64,
    /// Point, m.
    pub point: [f64; 2],
    /// Which wall.
    pub wall: usize,
}

/// What fits best.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Place in the robot's frame: forward, m; to the left, m; direction of the front, rad.
    pub place: [f64; 3],
    /// Their standard deviations.
    pub deviation: [f64; 3],
    /// Errors of the odometry.
    pub errors: Errors,
    /// Walls in the frame of the lidar at the begin.
    pub walls: Vec<Wall>,
    /// Root mean square of the points' distances from their walls, m.
    pub rms: f64,
    /// A quite different direction of the front that fits as well, rad.
    pub rival: Option<f64>,
    parameters: Vec<f64>,
}

/// Parameters before those of the walls: θ, m, the errors of the odometry.
const FIRST: usize = 7;
/// Standard deviations that are expected of them before anything is measured; large where nothing is known.
const EXPECTED: [f64; FIRST] = [100.0, 100.0, 100.0, 0.03, 0.05, 0.05, 0.05];
/// Steps of the derivatives.
const STEPS: [f64; FIRST] = [1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-3];
const STEP_WALL: f64 = 1e-5;
/// Weight by which a wall without points stays where it is; that of a single point is 1e4 and more.
const STAYS: f64 = 1e-3;
/// Points by which the first guess is made.
const COARSE: usize = 600;
/// Directions that are tried for it.
const DIRECTIONS: usize = 24;
const ITERATIONS: usize = 12;
/// Residuals beyond this many standard deviations count less.
const HUBER: f64 = 2.0;
/// Smallest standard deviation of a point, m.
const NOISE_MIN_M: f64 = 0.003;
/// A direction whose points lie at most this much farther from their walls fits as well, and this far away it is
/// another one, rad.
const RIVAL_RMS: f64 = 1.08;
const RIVAL_RAD: f64 = 0.09;
/// Errors of points are not independent: within this time they may be alike, s.
const ALIKE_S: f64 = 4.0;

type Matrix = Vec<Vec<f64>>;

/// The lidar's place by points on walls. `None`: there are no points, or they determine nothing.
pub fn solve(hits: &[Hit], velocities: &[Velocity], walls: &[Wall]) -> Option<Solution> {
    let step = hits.len().div_ceil(COARSE).max(1);
    let coarse: Vec<Hit> = hits.iter().copied().step_by(step).collect();
    let problem = Problem { hits: &coarse, velocities };
    let starts = (0..DIRECTIONS).map(|n| n as f64 / DIRECTIONS as f64 * TAU - PI);
    let mut tried: Vec<(f64, Vec<f64>)> =
        starts.filter_map(|theta| problem.descend(problem.start(theta, walls))).collect();
    tried.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let (best, start) = tried.first()?.clone();
    let is_rival = |(rms, other): &&(f64, Vec<f64>)| {
        *rms < best * RIVAL_RMS + 1e-4 && navitools::wrap(other[0] - start[0]).abs() > RIVAL_RAD
    };
    let rival = tried.iter().find(is_rival).map(|(_, other)| navitools::wrap(other[0]));
    let mut solution = refine(hits, velocities, start)?;
    solution.rival = rival;
    Some(solution)
}

/// The same with other points, from a solution that is nearly right.
pub fn again(hits: &[Hit], velocities: &[Velocity], before: &Solution) -> Option<Solution> {
    let mut solution = refine(hits, velocities, before.parameters.clone())?;
    solution.rival = before.rival;
    Some(solution)
}

fn refine(hits: &[Hit], velocities: &[Velocity], start: Vec<f64>) -> Option<Solution> {
    let problem = Problem { hits, velocities };
    let (rms, parameters) = problem.descend(start)?;
    let covariance = problem.covariance(&parameters)?;
    let [theta, mx, my] = [parameters[0], parameters[1], parameters[2]];
    let (sin, cos) = theta.sin_cos();
    let place = [cos * mx - sin * my, sin * mx + cos * my, navitools::wrap(theta)];
    // By θ and m.
    let rows = [[-place[1], cos, -sin], [place[0], sin, cos], [1.0, 0.0, 0.0]];
    let deviation = rows.map(|row| {
        let mut variance = 0.0;
        for (n, a) in row.iter().enumerate() {
            for (k, b) in row.iter().enumerate() {
                variance += a * b * covariance[n][k];
            }
        }
        variance.max(0.0).sqrt()
    });
    let (errors, walls) = (errors(&parameters), walls_of(&parameters));
    Some(Solution { place, deviation, errors, walls, rms, rival: None, parameters })
}

impl Solution {
    /// A point that the lidar sees, in the frame of the lidar at the begin. `way` is that of these errors of the
    /// odometry.
    pub fn still(&self, way: &Way, at: f64, point: [f64; 2]) -> [f64; 2] {
        still(&self.parameters, way.at(at), point)
    }
}

fn errors(parameters: &[f64]) -> Errors {
    Errors { travel: parameters[3], turn: parameters[4], drift: parameters[5], delay: parameters[6] }
}

fn walls_of(parameters: &[f64]) -> Vec<Wall> {
    parameters[FIRST..].chunks_exact(2).map(|wall| Wall { normal: wall[0], distance: wall[1] }).collect()
}

fn still(parameters: &[f64], [tx, ty, heading]: [f64; 3], [qx, qy]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = heading.sin_cos();
    let (sin_front, cos_front) = parameters[0].sin_cos();
    let (mx, my) = (parameters[1], parameters[2]);
    let (ax, ay) = (qx + mx, qy + my);
    [
        cos * ax - sin * ay - mx + cos_front * tx + sin_front * ty,
        sin * ax + cos * ay - my - sin_front * tx + cos_front * ty,
    ]
}

struct Problem<'a> {
    hits: &'a [Hit],
    velocities: &'a [Velocity],
}

impl Problem<'_> {
    /// Start of a descent with this direction of the front.
    fn start(&self, theta: f64, walls: &[Wall]) -> Vec<f64> {
        let mut parameters = vec![theta, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        parameters.extend(walls.iter().flat_map(|wall| [wall.normal, wall.distance]));
        parameters
    }

    fn way(&self, parameters: &[f64]) -> Way {
        Way::new(self.velocities, &errors(parameters))
    }

    /// Distance of each point from its wall, m.
    fn residuals(&self, parameters: &[f64], way: &Way) -> Vec<f64> {
        let walls = walls_of(parameters);
        let residual = |hit: &Hit| walls[hit.wall].behind(still(parameters, way.at(hit.at), hit.point));
        self.hits.iter().map(residual).collect()
    }

    /// Columns of derivatives: one for each parameter.
    fn derivatives(&self, parameters: &[f64], way: &Way, residuals: &[f64]) -> Matrix {
        let column = |n: usize| {
            let step = STEPS.get(n).copied().unwrap_or(STEP_WALL);
            let mut moved = parameters.to_vec();
            moved[n] += step;
            let there = if (3..FIRST).contains(&n) {
                self.residuals(&moved, &self.way(&moved))
            } else {
                self.residuals(&moved, way)
            };
            there.iter().zip(residuals).map(|(there, here)| (there - here) / step).collect()
        };
        (0..parameters.len()).map(column).collect()
    }

    /// Minimizes; the root mean square of the residuals, m, and the parameters.
    fn descend(&self, mut parameters: Vec<f64>) -> Option<(f64, Vec<f64>)> {
        if self.hits.len() <= parameters.len() {
            return None;
        }
        let mut way = self.way(&parameters);
        let mut residuals = self.residuals(&parameters, &way);
        let mut damping = 1e-3;
        for _ in 0..ITERATIONS {
            let noise = noise(&residuals);
            let weights = weights(&residuals, noise);
            let cost = cost(&residuals, noise, &parameters);
            let columns = self.derivatives(&parameters, &way, &residuals);
            let (matrix, gradient) = normal(&columns, &residuals, &weights, noise, &parameters);
            let mut improved = false;
            while damping < 1e6 {
                let mut damped = matrix.clone();
                (0..damped.len()).for_each(|n| damped[n][n] *= 1.0 + damping);
                let step = factor(damped).map(|factor| back(&factor, &gradient))?;
                let moved: Vec<f64> = parameters.iter().zip(&step).map(|(value, step)| value - step).collect();
                let there_way = self.way(&moved);
                let there = self.residuals(&moved, &there_way);
                if self::cost(&there, noise, &moved) < cost {
                    let small = step.iter().map(|step| step.abs()).fold(0.0, f64::max) < 1e-7;
                    (parameters, way, residuals) = (moved, there_way, there);
                    damping = (damping / 10.0).max(1e-9);
                    improved = !small;
                    break;
                }
                damping *= 10.0;
            }
            if !improved {
                break;
            }
        }
        let square: f64 = residuals.iter().map(|residual| residual * residual).sum();
        Some(((square / residuals.len() as f64).sqrt(), parameters))
    }

    /// Covariance of the parameters: the larger, for each, of that of independent points and that of points whose
    /// errors within a second are alike (sandwich estimate).
    fn covariance(&self, parameters: &[f64]) -> Option<Matrix> {
        let way = self.way(parameters);
        let residuals = self.residuals(parameters, &way);
        let noise = noise(&residuals);
        let weights = weights(&residuals, noise);
        let columns = self.derivatives(parameters, &way, &residuals);
        let (matrix, _) = normal(&columns, &residuals, &weights, noise, parameters);
        let size = parameters.len();
        let factor = factor(matrix)?;
        let mut inverse: Matrix = Vec::new();
        for n in 0..size {
            let mut unit = vec![0.0; size];
            unit[n] = 1.0;
            inverse.push(back(&factor, &unit));
        }
        // Sums of scores of points that may be alike.
        let mut groups = std::collections::BTreeMap::<(usize, i64), Vec<f64>>::new();
        for (at, hit) in self.hits.iter().enumerate() {
            let scores = groups.entry((hit.wall, (hit.at / ALIKE_S).floor() as i64)).or_insert_with(|| vec![0.0; size]);
            let weight = weights[at] * residuals[at] / (noise * noise);
            scores.iter_mut().zip(&columns).for_each(|(score, column)| *score += weight * column[at]);
        }
        let mut alike: Matrix = vec![vec![0.0; size]; size];
        for scores in groups.values() {
            let moved = product(&inverse, scores);
            for n in 0..size {
                for k in 0..size {
                    alike[n][k] += moved[n] * moved[k];
                }
            }
        }
        // Each group is as good as one observation, and the parameters follow their scatter.
        let count = groups.len() as f64;
        let few = count / (count - size as f64).max(1.0);
        let scale = |n: usize| (few * alike[n][n] / inverse[n][n]).max(1.0).sqrt();
        let scales: Vec<f64> = (0..size).map(scale).collect();
        Some((0..size).map(|n| (0..size).map(|k| inverse[n][k] * scales[n] * scales[k]).collect()).collect())
    }
}

/// Standard deviation of residuals, by their median.
fn noise(residuals: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|residual| residual.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    (1.4826 * sizes.get(sizes.len() / 2).copied().unwrap_or(0.0)).max(NOISE_MIN_M)
}

/// Weights of Huber: 1 for usual residuals, less for larger ones.
fn weights(residuals: &[f64], noise: f64) -> Vec<f64> {
    residuals.iter().map(|residual| (HUBER * noise / residual.abs().max(1e-12)).min(1.0)).collect()
}

/// What is minimized: residuals in standard deviations, and how far the parameters are from what is expected.
fn cost(residuals: &[f64], noise: f64, parameters: &[f64]) -> f64 {
    let one = |residual: &f64| {
        let size = residual.abs() / noise;
        if size <= HUBER { size * size } else { HUBER * (2.0 * size - HUBER) }
    };
    let prior = |(value, expected): (&f64, f64)| (value / expected) * (value / expected);
    residuals.iter().map(one).sum::<f64>() + parameters.iter().zip(EXPECTED).map(prior).sum::<f64>()
}

/// Matrix and right side of the normal equations.
fn normal(columns: &Matrix, residuals: &[f64], weights: &[f64], noise: f64, parameters: &[f64]) -> (Matrix, Vec<f64>) {
    let size = columns.len();
    let mut matrix = vec![vec![0.0; size]; size];
    let mut gradient = vec![0.0; size];
    let scale = 1.0 / (noise * noise);
    for n in 0..size {
        let weighted: Vec<f64> = columns[n].iter().zip(weights).map(|(value, weight)| value * weight * scale).collect();
        gradient[n] = weighted.iter().zip(residuals).map(|(value, residual)| value * residual).sum();
        for k in 0..=n {
            let sum: f64 = weighted.iter().zip(&columns[k]).map(|(a, b)| a * b).sum();
            (matrix[n][k], matrix[k][n]) = (sum, sum);
        }
    }
    // A wall that is out of sight stays where it is.
    (FIRST..size).for_each(|n| matrix[n][n] += STAYS);
    for (n, expected) in EXPECTED.into_iter().enumerate() {
        matrix[n][n] += 1.0 / (expected * expected);
        gradient[n] += parameters[n] / (expected * expected);
    }
    (matrix, gradient)
}

/// Lower factor of a symmetric matrix (Cholesky). `None`: it is singular.
fn factor(mut matrix: Matrix) -> Option<Matrix> {
    let size = matrix.len();
    for n in 0..size {
        for k in 0..=n {
            let sum: f64 = (0..k).map(|j| matrix[n][j] * matrix[k][j]).sum();
            let value = matrix[n][k] - sum;
            if n == k {
                // Not greater than zero: singular, or no number.
                if value.is_nan() || value <= 1e-12 {
                    return None;
                }
                matrix[n][n] = value.sqrt();
            } else {
                matrix[n][k] = value / matrix[k][k];
            }
        }
    }
    Some(matrix)
}

/// Solves by the factor.
fn back(factor: &Matrix, right: &[f64]) -> Vec<f64> {
    let size = right.len();
    let mut x = right.to_vec();
    for n in 0..size {
        let sum: f64 = (0..n).map(|k| factor[n][k] * x[k]).sum();
        x[n] = (x[n] - sum) / factor[n][n];
    }
    for n in (0..size).rev() {
        let sum: f64 = (n + 1..size).map(|k| factor[k][n] * x[k]).sum();
        x[n] = (x[n] - sum) / factor[n][n];
    }
    x
}

fn product(matrix: &Matrix, vector: &[f64]) -> Vec<f64> {
    matrix.iter().map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum()).collect()
}
