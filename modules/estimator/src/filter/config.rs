//! Configuration of the filter: the robot and its surroundings.

use navitools::Point;
use std::fmt;

/// A beacon of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beacon {
    /// Its number.
    pub id: i32,
    /// Position in the map, m.
    pub at: Point,
}

/// Noise of measured motion; variances add up over distance and time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Along the path, m/√m.
    pub along_per_m: f64,
    /// Along the path, m/√s while driving.
    pub along_per_s: f64,
    /// Heading, rad/√m.
    pub turn_per_m: f64,
    /// Heading, rad/√s while driving.
    pub turn_per_s: f64,
}

/// Configuration of the filter; SI units. The defaults are those of docs/facts/robot.md 1.2.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The beacons; each number once.
    pub beacons: Vec<Beacon>,
    /// The sensor in the robot frame, m: 0.25 m ahead of the rear axle.
    pub mount: Point,
    /// Of the odometry: 1 cm and 0.5 degrees for each √m.
    pub odometry: Noise,
    /// Deviation of a bearing, rad: 0.5 degrees.
    pub bearing: f64,
    /// The part of a bearing's variance that lasts (0 to 1): 0.5.
    pub lasting: f64,
    /// For how long that lasts, s: 2.
    pub lasting_s: f64,
    /// The part of bearings that are of something else (above 0, below 1): 0.05.
    pub wild: f64,
    /// A bearing whose squared innovation is more than so many variances is not used: 16.
    pub gate: f64,
    /// Beacons further away than this are not seen, m: 15.
    pub range: f64,
    /// Deviation of the sensor's turn at the start, rad: 2 degrees.
    pub turn: f64,
    /// Deviation of the odometry's scale at the start: 0.02.
    pub scale: f64,
    /// Deviation of the turning that wheels of unequal size make, rad/m: 0.01.
    pub bend: f64,
    /// Deviation of the scale of turns at the start: 0.02.
    pub track: f64,
    /// Deviation of the bearings' delay at the start, s: 0.3.
    pub delay: f64,
    /// Below these deviations of the position, m, and the heading, rad, the quality is FINE: 0.25 m and 6 degrees.
    pub fine: (f64, f64),
    /// Below these it is COARSE, else LOST: 1 m and 20 degrees.
    pub coarse: (f64, f64),
}

impl Default for Config {
    fn default() -> Self {
        let turn_per_m = 0.5f64.to_radians();
        Self {
            beacons: Vec::new(),
            mount: Point { x: 0.25, y: 0.0 },
            odometry: Noise { along_per_m: 0.01, along_per_s: 0.002, turn_per_m, turn_per_s: 0.002 },
            bearing: 0.5f64.to_radians(),
            lasting: 0.5,
            lasting_s: 2.0,
            wild: 0.05,
            gate: 16.0,
            range: 15.0,
            turn: 2f64.to_radians(),
            scale: 0.02,
            bend: 0.01,
            track: 0.02,
            delay: 0.3,
            fine: (0.25, 6f64.to_radians()),
            coarse: (1.0, 20f64.to_radians()),
        }
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
    /// Whether a filter can be made of it.
    ///
    /// # Errors
    /// When it cannot: what is wrong with it.
    pub fn check(&self) -> Result<(), ConfigError> {
        let places = self.beacons.iter().map(|beacon| beacon.at).chain([self.mount]);
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
            ("scale", self.scale),
            ("bend", self.bend),
            ("track", self.track),
            ("delay", self.delay),
        ];
        if let Some((what, _)) = deviations.iter().find(|(_, value)| !(value.is_finite() && *value >= 0.0)) {
            return Err(ConfigError::Negative(what));
        }
        let above = [("bearing", self.bearing), ("lasting_s", self.lasting_s), ("range", self.range)];
        let limits =
            [("gate", self.gate), ("fine", self.fine.0.min(self.fine.1)), ("coarse", self.coarse.0.min(self.coarse.1))];
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
