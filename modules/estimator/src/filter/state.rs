//! State of the filter: prediction by a motion step, and update by a bearing.
//!
//! Read first: docs/facts/robot.md 3.1. Beside the pose, the state holds calibration parameters of the robot; they are
//! constant over a run and observable while the robot drives with two beacons in sight.

use super::config::Config;
use super::{NuisanceDeviations, Nuisances};
use crate::trail::{pose_along, shifted};
use base::Instant;
use navitools::{Motion, Point, Pose, wrap};

/// Dimension of the state where the sensor's place is known, and where it is part of the state.
pub const PLACE_KNOWN: usize = 8;
pub const PLACE_UNKNOWN: usize = 10;
/// Index of the position in the map, m, and of the heading, rad.
pub const X: usize = 0;
pub const Y: usize = 1;
pub const THETA: usize = 2;
/// Index of the sensor's mounting angle, rad.
pub const TURN: usize = 3;
/// Index of the relative error of measured distance.
pub const SCALE: usize = 4;
/// Index of the rotation per metre that the odometry does not measure, rad/m (wheels of unequal size).
pub const BEND: usize = 5;
/// Index of the relative error of measured rotation (error of the track width).
pub const TRACK: usize = 6;
/// Index of the delay from a bearing's measurement to its time stamp, s.
pub const DELAY: usize = 7;
/// Index of the sensor's place relative to the configured one, in the robot's frame, m; only in a state of at least
/// dimension [`PLACE_UNKNOWN`].
pub const PLACE_X: usize = 8;
pub const PLACE_Y: usize = 9;

/// Mean and covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<const N: usize> {
    pub mean: [f64; N],
    pub cov: [[f64; N]; N],
}

/// A measured motion step and its variances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Step {
    pub seconds: f64,
    pub way: Motion,
    /// Direction of travel in the robot's frame, rad: 0 of a base that does not go sideways.
    pub drift: f64,
    /// Motion that a curvature of 1 rad/m by unequal wheels adds, m and rad.
    pub bend: Motion,
    /// Variance along the direction of travel, m².
    pub along: f64,
    /// Variance of the rotation, rad².
    pub turn: f64,
    /// The rotation was not measured by the wheels: the errors of those are not its own.
    pub gyro: bool,
}

impl Step {
    /// The fraction `part` (0 to 1) of this step.
    pub fn part(&self, part: f64) -> Self {
        let times = |way: Motion| Motion { translation: way.translation * part, rotation: way.rotation * part };
        Self {
            seconds: self.seconds * part,
            way: times(self.way),
            drift: self.drift,
            bend: times(self.bend),
            along: self.along * part,
            turn: self.turn * part,
            gyro: self.gyro,
        }
    }

    /// This step at the same velocities, a second long; of no duration if it has none.
    pub fn rates(&self) -> Self {
        self.part(if self.seconds > 0.0 { 1.0 / self.seconds } else { 0.0 })
    }
}

/// A bearing as applied to the state of an instant.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// Index of the beacon in the map.
    pub number: usize,
    /// Position of the beacon, m.
    pub beacon: Point,
    /// Measured direction in the sensor frame, rad.
    pub bearing: f64,
    /// Variance of the direction, rad².
    pub variance: f64,
    /// Information of this bearing relative to one with independent noise, above 0 to 1.
    pub weight: f64,
    /// The sensor in the robot frame as configured, m.
    pub mount: Point,
    /// Measured motion at that instant, of a second.
    pub rates: Step,
    /// Time from the state's instant to the bearing's time stamp, s.
    pub later: f64,
}

impl Sight {
    /// Time stamp of a bearing applied to the state of `at`.
    pub fn stamp(&self, at: Instant) -> Instant {
        shifted(at, self.later)
    }
}

/// Fit of a bearing to the state.
#[derive(Clone, Copy, Debug)]
pub struct Fit<const N: usize> {
    /// Innovation: measured minus expected direction, rad.
    pub innovation: f64,
    /// Expected variance of the innovation, rad².
    pub variance: f64,
    /// Covariance of the state with the innovation.
    cross: [f64; N],
    /// Variance of the innovation that the update uses, rad²: noise that lasts counts once.
    pub lasting: f64,
}

impl<const N: usize> Fit<N> {
    /// Squared Mahalanobis distance of the innovation.
    pub fn distance(&self) -> f64 {
        self.innovation * self.innovation / self.variance
    }

    /// Probability density of the innovation, 1/rad.
    pub fn density(&self) -> f64 {
        libm::exp(-0.5 * self.distance()) / libm::sqrt(core::f64::consts::TAU * self.variance)
    }
}

impl<const N: usize> State<N> {
    /// State without a pose, with the prior of the calibration parameters.
    pub fn new(config: &Config) -> Self {
        let Config { turn, scale, bend, track, delay, place, .. } = config;
        let mut cov = [[0.0; N]; N];
        for (at, deviation) in (TURN..N).zip([turn, scale, bend, track, delay, place, place]) {
            cov[at][at] = deviation * deviation;
        }
        Self { mean: [0.0; N], cov }
    }

    pub fn pose(&self) -> Pose {
        Pose::new(self.mean[X], self.mean[Y], self.mean[THETA])
    }

    /// Place of the sensor in the robot's frame, m; `configured`: where it is meant to be.
    pub fn place(&self, configured: Point) -> Point {
        match N >= PLACE_UNKNOWN {
            true => Point { x: configured.x + self.mean[PLACE_X], y: configured.y + self.mean[PLACE_Y] },
            false => configured,
        }
    }

    /// Calibration parameters; `configured`: place where the sensor is meant to be, m.
    pub fn nuisances(&self, configured: Point) -> Nuisances {
        let (turn, scale, bend, track) = (self.mean[TURN], self.mean[SCALE], self.mean[BEND], self.mean[TRACK]);
        Nuisances { turn, scale, bend, track, delay: self.mean[DELAY], place: self.place(configured) }
    }

    /// Standard deviations of the calibration parameters; of the place the larger one, m.
    pub fn nuisance_deviations(&self) -> NuisanceDeviations {
        let deviation = |at: usize| libm::sqrt(self.cov[at][at].max(0.0));
        let place = if N >= PLACE_UNKNOWN { deviation(PLACE_X).max(deviation(PLACE_Y)) } else { 0.0 };
        let (turn, scale, bend, track) = (deviation(TURN), deviation(SCALE), deviation(BEND), deviation(TRACK));
        NuisanceDeviations { turn, scale, bend, track, delay: deviation(DELAY), place }
    }

    /// Motion of a step, corrected by the calibration parameters.
    pub fn corrected(&self, step: &Step) -> Motion {
        let Step { way, bend, .. } = step;
        let translation = (1.0 + self.mean[SCALE]) * way.translation + self.mean[BEND] * bend.translation;
        let track = if step.gyro { 0.0 } else { self.mean[TRACK] };
        Motion { translation, rotation: (1.0 + track) * way.rotation + self.mean[BEND] * bend.rotation }
    }

    /// Covariance of the pose; m², m rad, rad².
    pub fn pose_covariance(&self) -> [[f64; 3]; 3] {
        core::array::from_fn(|row| core::array::from_fn(|column| self.cov[row][column]))
    }

    /// Standard deviations: the larger one of the position, m, and that of the heading, rad.
    pub fn deviations(&self) -> (f64, f64) {
        deviations(&self.pose_covariance())
    }

    /// Predicts the state after a motion step. `walk`: variance per second of each parameter's random walk; that of the
    /// pose is zero.
    pub fn predict(&mut self, step: &Step, walk: &[f64; N]) {
        let way = self.corrected(step);
        let middle = self.mean[THETA] + step.drift + way.rotation / 2.0;
        let (sin, cos) = libm::sincos(middle);
        let end = pose_along(self.pose(), way, step.drift);
        (self.mean[X], self.mean[Y], self.mean[THETA]) = (end.x, end.y, end.theta.radians());
        // A rotation moves the position across the chord.
        let (across_x, across_y) = (-way.translation * sin, way.translation * cos);
        let a = if step.gyro { 0.0 } else { step.way.rotation };
        let (d, bend) = (step.way.translation, step.bend);
        // Derivatives of x, y, θ by scale, bend and track; those by mounting angle and delay are zero.
        let rest = [
            [d * cos, bend.translation * cos + across_x * bend.rotation / 2.0, across_x * a / 2.0],
            [d * sin, bend.translation * sin + across_y * bend.rotation / 2.0, across_y * a / 2.0],
            [0.0, bend.rotation, a],
        ];
        let cov = &mut self.cov;
        // Transition times covariance, pose rows first ...
        let mut rows = [[0.0; N]; 3];
        for column in 0..N {
            let theta = cov[THETA][column];
            let (scale, bend, track) = (cov[SCALE][column], cov[BEND][column], cov[TRACK][column]);
            for (row, by) in rest.iter().enumerate() {
                let across = [across_x, across_y, 0.0][row];
                rows[row][column] = cov[row][column] + across * theta + by[0] * scale + by[1] * bend + by[2] * track;
            }
        }
        // ... then columns: only those of the pose change.
        for (row, sums) in rows.iter().enumerate() {
            for (column, by) in rest.iter().enumerate().skip(row) {
                let across = [across_x, across_y, 0.0][column];
                let value = sums[column]
                    + across * sums[THETA]
                    + by[0] * sums[SCALE]
                    + by[1] * sums[BEND]
                    + by[2] * sums[TRACK];
                cov[row][column] = value;
                cov[column][row] = value;
            }
            for column in 3..N {
                cov[row][column] = sums[column];
                cov[column][row] = sums[column];
            }
        }
        let noise = [[cos, across_x / 2.0], [sin, across_y / 2.0], [0.0, 1.0]];
        for row in 0..3 {
            for column in 0..3 {
                cov[row][column] +=
                    noise[row][0] * noise[column][0] * step.along + noise[row][1] * noise[column][1] * step.turn;
            }
        }
        for place in 3..N {
            cov[place][place] += walk[place] * step.seconds;
        }
    }

    /// Fit of a bearing; `None` for a beacon too close to have a direction.
    pub fn fit(&self, sight: &Sight) -> Option<Fit<N>> {
        self.fit_beside(sight, None)
    }

    /// Fit of a bearing; `error`: index of an error of the bearing that is part of the state, rad.
    #[inline]
    pub fn fit_beside(&self, sight: &Sight, error: Option<usize>) -> Option<Fit<N>> {
        let rates = self.corrected(&sight.rates);
        let after = sight.later - self.mean[DELAY];
        let moved = Motion { translation: rates.translation * after, rotation: rates.rotation * after };
        let own = pose_along(self.pose(), moved, sight.rates.drift);
        let sensor = own * self.place(sight.mount);
        let (dx, dy) = (sight.beacon.x - sensor.x, sight.beacon.y - sensor.y);
        let square = dx * dx + dy * dy;
        if square < 0.04 {
            return None;
        }
        let own_error = error.map_or(0.0, |error| self.mean[error]);
        let expected = libm::atan2(dy, dx) - own.theta.radians() - self.mean[TURN] + own_error;
        let (by_x, by_y) = (dy / square, -dx / square);
        let mut by = [0.0; N];
        (by[X], by[Y]) = (by_x, by_y);
        by[THETA] = by_x * (self.mean[Y] - sensor.y) + by_y * (sensor.x - self.mean[X]) - 1.0;
        by[TURN] = -1.0;
        // A longer delay refers to an earlier pose.
        let (sin, cos) = own.theta.sin_cos();
        let (ahead_y, ahead_x) = (own.theta + sight.rates.drift).sin_cos();
        let velocity_x = rates.translation * ahead_x - rates.rotation * (sensor.y - own.y);
        let velocity_y = rates.translation * ahead_y + rates.rotation * (sensor.x - own.x);
        by[DELAY] = rates.rotation - by_x * velocity_x - by_y * velocity_y;
        if N >= PLACE_UNKNOWN {
            (by[PLACE_X], by[PLACE_Y]) = (by_x * cos + by_y * sin, by_y * cos - by_x * sin);
        }
        if let Some(error) = error {
            by[error] = 1.0;
        }
        let mut cross = [0.0; N];
        for (sum, row) in cross.iter_mut().zip(&self.cov) {
            *sum = row.iter().zip(&by).map(|(cov, by)| cov * by).sum();
        }
        let spread: f64 = cross.iter().zip(&by).map(|(cross, by)| cross * by).sum();
        // Second-order term: curvature of the direction over an uncertain position.
        let near = (self.cov[X][X] + self.cov[Y][Y]) / square;
        let spread = spread + 0.5 * near * near;
        let (variance, lasting) = (spread + sight.variance, spread + sight.variance / sight.weight);
        Some(Fit { innovation: wrap(sight.bearing - expected), variance, cross, lasting })
    }

    /// Updates the state by a bearing that is an inlier with probability `right`: the gain is weighted by it, and the
    /// uncertainty of the association stays in the covariance (probabilistic data association with one measurement).
    pub fn update(&mut self, fit: &Fit<N>, right: f64) {
        let gain = fit.cross.map(|cross| cross / fit.lasting);
        for (mean, gain) in self.mean.iter_mut().zip(&gain) {
            *mean += right * fit.innovation * gain;
        }
        self.mean[THETA] = wrap(self.mean[THETA]);
        let less = right * (1.0 - (1.0 - right) * fit.distance());
        for row in 0..N {
            for column in row..N {
                let value = self.cov[row][column] - less * gain[row] * fit.cross[column];
                self.cov[row][column] = value;
                self.cov[column][row] = value;
            }
        }
    }
}

/// Standard deviations: the larger one of the position, m, and that of the heading, rad.
pub fn deviations(cov: &[[f64; 3]; 3]) -> (f64, f64) {
    let (half, difference) = ((cov[0][0] + cov[1][1]) / 2.0, (cov[0][0] - cov[1][1]) / 2.0);
    let largest = half + libm::hypot(difference, cov[0][1]);
    (libm::sqrt(largest.max(0.0)), libm::sqrt(cov[2][2].max(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = PLACE_UNKNOWN;
    type State = super::State<N>;

    fn state() -> State {
        let mut cov = [[0.0; N]; N];
        for (place, row) in cov.iter_mut().enumerate() {
            row[place] = 1e-4 * (1.0 + place as f64);
        }
        State { mean: [3.0, 2.0, 0.4, 0.02, 0.01, -0.02, 0.03, 0.2, 0.05, -0.1], cov }
    }

    fn sight() -> Sight {
        Sight {
            number: 0,
            beacon: Point { x: 9.0, y: 7.0 },
            bearing: 0.3,
            variance: 1e-4,
            weight: 1.0,
            mount: Point { x: 0.25, y: 0.1 },
            rates: Step {
                seconds: 1.0,
                way: Motion { translation: 0.7, rotation: 0.4 },
                bend: Motion { translation: -0.1, rotation: 0.9 },
                ..Step::default()
            },
            later: 0.23,
        }
    }

    #[test]
    fn a_time_stamp_of_any_distance_is_an_instant() {
        let at = Instant::from_millis(100_000);
        assert_eq!(sight().stamp(at), Instant::from_millis(100_230));
        assert_eq!(Sight { later: -0.23, ..sight() }.stamp(at), Instant::from_millis(99_770));
        for later in [1e300, f64::INFINITY, f64::NAN] {
            assert!(Sight { later, ..sight() }.stamp(at) >= at && Sight { later: -later, ..sight() }.stamp(at) <= at);
        }
    }

    /// Transition and derivative of the bearing, by differences.
    fn numerically(f: impl Fn(&State) -> f64) -> [f64; N] {
        core::array::from_fn(|place| {
            let (mut more, mut less) = (state(), state());
            more.mean[place] += 1e-6;
            less.mean[place] -= 1e-6;
            (f(&more) - f(&less)) / 2e-6
        })
    }

    #[test]
    fn the_covariance_goes_along_with_the_derivatives_of_the_step() {
        for drift in [0.0, 0.7, -1.5] {
            covariance_goes_along(drift);
        }
    }

    fn covariance_goes_along(drift: f64) {
        let way = Motion { translation: 0.15, rotation: 0.02 };
        let bend = Motion { translation: -0.03, rotation: 0.2 };
        let step = Step { seconds: 0.25, way, drift, bend, along: 0.0, turn: 0.0, gyro: false };
        let after = |state: &State| {
            let mut state = *state;
            state.predict(&step, &[0.0; N]);
            state
        };
        let rows: [[f64; N]; N] = core::array::from_fn(|row| numerically(|state| after(state).mean[row]));
        let got = after(&state()).cov;
        for row in 0..N {
            for column in 0..N {
                let sum: f64 = (0..N).map(|k| rows[row][k] * state().cov[k][k] * rows[column][k]).sum();
                // The middle of the arc stands for its chord: second order in the turn.
                assert!((got[row][column] - sum).abs() < 5e-8, "{row} {column}: {} {sum}", got[row][column]);
            }
        }
    }

    #[test]
    fn the_bearing_s_derivatives_are_those_of_the_geometry() {
        for drift in [0.0, 0.7, -1.5] {
            let sight = Sight { rates: Step { drift, ..sight().rates }, ..sight() };
            let by = numerically(|state| -state.fit(&sight).unwrap().innovation);
            let fit = state().fit(&sight).unwrap();
            for place in 0..N {
                let expected = state().cov[place][place] * by[place];
                // Those by scale, bend and track act on the short way since the state alone, and are left out.
                let tolerance = if [SCALE, BEND, TRACK].contains(&place) { 2e-5 } else { 1e-9 };
                assert!((fit.cross[place] - expected).abs() < tolerance, "{place}: {} {expected}", fit.cross[place]);
            }
        }
    }

    #[test]
    fn a_doubtful_bearing_gains_less_and_an_open_question_widens() {
        let expected = sight().bearing - state().fit(&sight()).unwrap().innovation;
        let fit = state().fit(&Sight { bearing: expected, ..sight() }).unwrap();
        let trace = |right: f64| {
            let mut state = state();
            state.update(&fit, right);
            (0..N).map(|place| state.cov[place][place]).sum::<f64>()
        };
        assert!(trace(1.0) < trace(0.0));
        let far = Fit { innovation: 5.0 * fit.variance.sqrt(), ..fit };
        let mut open = state();
        open.update(&far, 0.5);
        assert!(open.cov[X][X] > state().cov[X][X]);
    }

    #[test]
    fn a_beacon_on_the_sensor_has_no_direction() {
        let there = state().pose() * Point { x: 0.3, y: 0.0 };
        assert!(state().fit(&Sight { beacon: there, later: 0.2, ..sight() }).is_none());
    }
}
