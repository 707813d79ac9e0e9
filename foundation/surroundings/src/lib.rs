//! What is around a robot according to its range finders, from the last second of measurements; no map.
//!
//! [`Trail`] is the robot's own motion meanwhile, [`Echoes`] the readings of sonars, [`Scans`] those of lidars.
//! Both say [`Obstacle`]s: points where something was measured, and points where nobody knows. **Unknown is not free**:
//! a direction is free only while its sensor goes on proving it. Users: `guard`.
//!
//! A sonar is unknown until it has been read often enough:
//!
//! ```
//! use base::{Duration, Instant};
//! use messages::lowlevel::{DataRanges, Reading};
//! use navitools::Point;
//! use surroundings::{Echoes, Rules, Sonar, Trail};
//!
//! let second = Duration::from_secs(1);
//! let rules = Rules {
//!     reach: 2.5,
//!     uncertainty: 0.05,
//!     age_max: second,
//!     readings: 3,
//!     window: second,
//!     evaluations: 2,
//!     scan_age_max: second,
//! };
//! let sonar = Sonar { id: 2, at: Point { x: 0.75, y: 0.0 }, theta: 0.0, beam: 0.96 };
//! let (mut echoes, trail) = (Echoes::new(rules, &[sonar]), Trail::default());
//! let mut found = Vec::new();
//! for n in 1..=3 {
//!     found.clear();
//!     echoes.obstacles(Instant::from_millis(100 * n), &trail, &mut found);
//!     assert!(!found.is_empty() && found.iter().all(|obstacle| !obstacle.sensed), "its cone is not known to be free");
//!
//!     let timestamp = 100_000 * n as i64;
//!     let silent = Reading { timestamp, id: 2, kind: Reading::SONAR, status: Reading::SILENT, ..Reading::default() };
//!     echoes.on_ranges(Instant::from_millis(100 * n), &DataRanges { timestamp, readings: vec![silent] }, &trail);
//! }
//! found.clear();
//! echoes.obstacles(Instant::from_millis(310), &trail, &mut found);
//! assert!(found.is_empty());
//! ```
#![forbid(unsafe_code)]

mod echoes;
mod scans;
mod trail;

use base::Duration;
use navitools::{Point, Pose, wrap};

pub use echoes::Echoes;
pub use scans::Scans;
pub use trail::Trail;

/// Mounting of a sonar in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sonar {
    /// Number in `LL_DATA_RANGES`.
    pub id: i32,
    /// Position, m.
    pub at: Point,
    /// Direction of its beam's axis, rad.
    pub theta: f64,
    /// Full opening angle of its beam, rad.
    pub beam: f64,
}

impl Sonar {
    /// True if a point is within its cone.
    #[must_use]
    pub fn covers(&self, point: Point) -> bool {
        let bearing = libm::atan2(point.y - self.at.y, point.x - self.at.x);
        wrap(bearing - self.theta).abs() <= self.beam / 2.0
    }
}

/// A lidar.
#[derive(Clone, Debug, PartialEq)]
pub struct Lidar {
    /// Its name in `LL_DATA_SCAN`.
    pub name: String,
    /// Where it sits on the robot; its front is along x.
    pub mount: Pose,
    /// Full opening angle of its view, around its front, rad.
    pub view: f64,
}

impl Lidar {
    /// True if a point is within its view.
    #[must_use]
    pub fn covers(&self, point: Point) -> bool {
        let Point { x, y } = self.mount.inverse() * point;
        libm::atan2(y, x).abs() <= self.view / 2.0
    }
}

/// What proves space free, and for how long a measurement counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Distance at which a sensor still finds a leg in clothes, m: what is farther away is left out.
    pub reach: f64,
    /// Uncertainty of a measurement, m.
    pub uncertainty: f64,
    /// A sonar whose last reading is older than this is unknown.
    pub age_max: Duration,
    /// Number of readings within twice `window` by which a sonar proves its space free; as many refute an echo.
    pub readings: u32,
    /// Time for which an echo counts.
    pub window: Duration,
    /// Revolutions of a lidar in succession that must find something, or find a direction free.
    pub evaluations: u32,
    /// A direction of a lidar that was measured longer ago than this is unknown.
    pub scan_age_max: Duration,
}

/// What senses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A sonar: its number in `LL_DATA_RANGES`.
    Sonar(i32),
    /// A lidar: its place among those of [`Scans`].
    Lidar(usize),
}

/// Something that may be there: a point in the frame of the trail, and which sensor says so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Position, m.
    pub at: Point,
    /// What says so.
    pub source: Source,
    /// False: nothing was measured there; the sensor does not know.
    pub sensed: bool,
    /// It approaches by itself, or nothing is known of it: a law that allows for people who walk towards the robot
    /// counts it.
    pub approaches: bool,
    /// It is nearer than everything that a lidar found in its direction 0.25 s before: what came there may be the leg of
    /// somebody who walks.
    pub moves: bool,
}

/// Part of a sensor's view of which nothing is known now, as a line along its middle from the robot on, as far as the
/// sensor would find something. Robot's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unseen {
    /// Begin, m.
    pub from: Point,
    /// End, m.
    pub to: Point,
    /// Half of the width of the part at its end, m.
    pub half: f64,
    /// What does not know.
    pub source: Source,
}

#[cfg(test)]
mod tests;
