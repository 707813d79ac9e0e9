//! Configuration of the filter: the robot and its surroundings.

use navitools::Point;
use navitools::odometry::SteeredWheels;
use settings::{Section, settings};
use std::fmt;

/// A beacon of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beacon {
    /// Its number.
    pub id: i32,
    /// Position in the map, m.
    pub at: Point,
}

settings! {
    /// Noise of measured motion; variances add up over distance and time.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Noise {
        /// Deviation along the path, m/√m.
        odometry_along_per_m as along_per_m: f64 = 0.01, 0.0..=1.0;
        /// Deviation along the path while driving, m/√s.
        odometry_along_per_s as along_per_s: f64 = 0.002, 0.0..=1.0;
        /// Deviation of the heading, rad/√m.
        odometry_turn_per_m as turn_per_m: f64 = 0.5f64.to_radians(), 0.0..=1.0;
        /// Deviation of the heading while driving, rad/√s.
        odometry_turn_per_s as turn_per_s: f64 = 0.002, 0.0..=1.0;
    }
}

settings! {
    /// Place of the beacon scanner in the robot's frame.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Mount {
        /// Ahead of the rear axle.
        sensor_x_m as x: f64 = 0.25, -10.0..=10.0;
        /// Left of the middle.
        sensor_y_m as y: f64 = 0.0, -10.0..=10.0;
    }
}

settings! {
    /// `[estimator]`: accuracy of the sensors of the pose; standard deviations. The defaults are those of
    /// docs/facts/robot.md 1.2.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Config {
        /// The beacons; each number once.
        beacons: Vec<Beacon> = unset [];
        /// The steered wheels whose encoders are the odometry: the turn that unequal ones make depends on the
        /// curvature. Without them it is the same in every turn.
        wheels: Option<SteeredWheels> = unset None;
        /// Way of the wheels of a base that does not steer, m for each rad that it turns on the spot.
        spin: f64 = unset 0.0;
        mount: Mount = flat;
        odometry: Noise = flat;
        /// Deviation of a bearing.
        bearing_rad as bearing: f64 = 0.5f64.to_radians(), 1e-5..=0.5;
        /// Part of a bearing's variance that lasts.
        bearing_lasting as lasting: f64 = 0.5, 0.0..=0.99;
        /// Time for which that part lasts.
        bearing_lasting_s as lasting_s: f64 = 2.0, 0.01..=100.0;
        /// Part of bearings that are of something else.
        bearing_wild as wild: f64 = 0.05, 1e-4..=0.5;
        /// A bearing whose squared innovation exceeds this many variances is not used.
        gate: f64 = 16.0, 4.0..=100.0;
        /// Range of the scanner: beacons further away are not seen.
        range_m as range: f64 = 15.0, 0.5..=1000.0;
        /// Deviation of the sensor's turn at the start.
        sensor_turn_rad as turn: f64 = 2f64.to_radians(), 0.0..=1.0;
        /// Deviation of the sensor's place at the start, along x and y, m; above 0 only for a `PlacingFilter`.
        place: f64 = unset 0.0;
        /// Deviation of the odometry's scale at the start.
        scale: f64 = 0.02, 0.0..=0.5;
        /// Deviation of the turning that wheels of unequal size make.
        bend_radpm as bend: f64 = 0.01, 0.0..=1.0;
        /// Deviation of the scale of turns at the start.
        track: f64 = 0.02, 0.0..=0.5;
        /// Deviation of the bearings' delay at the start, beyond the ages that the scanner reports.
        delay_s as delay: f64 = 0.3, 0.0..=1.0;
        /// Deviation of the position below which the quality is FINE.
        fine_m: f64 = 0.25, 0.001..=10.0;
        /// Deviation of the heading below which the quality is FINE.
        fine_rad: f64 = 6f64.to_radians(), 0.001..=3.0;
        /// Deviation of the position below which it is COARSE, else LOST.
        coarse_m: f64 = 1.0, 0.001..=100.0;
        /// Deviation of the heading below which it is COARSE, else LOST.
        coarse_rad: f64 = 20f64.to_radians(), 0.001..=3.0;
    }
}

impl Default for Config {
    fn default() -> Self {
        Self::usual()
    }
}

impl From<Mount> for Point {
    fn from(Mount { x, y }: Mount) -> Self {
        Self { x, y }
    }
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigError {
    /// Two beacons have this number.
    Twice(i32),
    /// A beacon or the sensor is nowhere.
    Place,
    /// This is not a number, or below zero.
    Negative(&'static str),
    /// This must be above zero.
    Zero(&'static str),
    /// This must be above 0 and below 1.
    Part(&'static str),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Twice(id) => write!(f, "beacon {id} is there twice"),
            Self::Place => f.write_str("the place of a beacon or of the sensor is no number"),
            Self::Negative(what) => write!(f, "{what} must be a number, not below 0"),
            Self::Zero(what) => write!(f, "{what} must be above 0"),
            Self::Part(what) => write!(f, "{what} must be above 0 and below 1"),
        }
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    /// Information of a bearing relative to one with independent noise, if the last bearing of its beacon is `apart`
    /// seconds away: above 0 to 1. The part of the noise that lasts is a first-order process.
    pub(crate) fn independence(&self, apart: f64) -> f64 {
        let again = libm::exp(-apart / self.lasting_s).min(1.0 - 1e-6);
        1.0 / (1.0 - self.lasting + self.lasting * (1.0 + again) / (1.0 - again))
    }

    /// Whether a filter can be made of it.
    ///
    /// # Errors
    /// When it cannot: what is wrong with it.
    pub fn check(&self) -> Result<(), ConfigError> {
        let places = self.beacons.iter().map(|beacon| beacon.at).chain([self.mount.into()]);
        if !{ places }.all(|at| at.x.is_finite() && at.y.is_finite()) {
            return Err(ConfigError::Place);
        }
        for (place, beacon) in self.beacons.iter().enumerate() {
            if self.beacons[..place].iter().any(|other| other.id == beacon.id) {
                return Err(ConfigError::Twice(beacon.id));
            }
        }
        let Noise { along_per_m, along_per_s, turn_per_m, turn_per_s } = self.odometry;
        let deviations = [
            ("odometry_along_per_m", along_per_m),
            ("odometry_along_per_s", along_per_s),
            ("odometry_turn_per_m", turn_per_m),
            ("odometry_turn_per_s", turn_per_s),
            ("turn", self.turn),
            ("place", self.place),
            ("scale", self.scale),
            ("bend", self.bend),
            ("track", self.track),
            ("delay", self.delay),
        ];
        if let Some((what, _)) = deviations.iter().find(|(_, value)| !(value.is_finite() && *value >= 0.0)) {
            return Err(ConfigError::Negative(what));
        }
        let above = [("bearing", self.bearing), ("lasting_s", self.lasting_s), ("range", self.range)];
        let limits = [
            ("gate", self.gate),
            ("fine", self.fine_m.min(self.fine_rad)),
            ("coarse", self.coarse_m.min(self.coarse_rad)),
        ];
        if let Some((what, _)) = { above.iter().chain(&limits) }.find(|(_, value)| !(value.is_finite() && *value > 0.0))
        {
            return Err(ConfigError::Zero(what));
        }
        if !(self.wild > 0.0 && self.wild < 1.0) {
            return Err(ConfigError::Part("wild"));
        }
        if !(0.0..1.0).contains(&self.lasting) {
            return Err(ConfigError::Part("lasting"));
        }
        Ok(())
    }
}
