//! Which ways to believe: the wheels' odometry, as long as it speaks and the drives do not speak against it.

use base::{Duration, Instant};
use messages::lowlevel::{DataMotion, DataOdo};
use navitools::{Ackermann, Motion};

/// Odometry comes twenty times a second; without it for this long it is lost. The drives count as long.
const SILENT: Duration = Duration::from_millis(300);
/// Odometry and drives must differ for this long before the odometry is stuck, and agree as long before it is not.
const STUCK_AFTER: Duration = Duration::from_secs(1);
/// Differences that are none: of the speed, m/s and a part of it, and of the turning, rad/s.
const SAME: (f64, f64, f64) = (0.12, 0.3, 0.35);
/// A rate and its integral may differ by this, m/s and rad/s; else the integral was begun anew.
const WHOLE: f64 = 0.3;

/// What a way is by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The wheels' odometry.
    Wheels,
    /// The drives: the odometry is silent.
    Drives,
    /// The drives: they move, and the odometry does not.
    DrivesAgainstWheels,
    /// Nobody.
    Nobody,
}

#[derive(Clone, Copy, Debug)]
struct Odo {
    at: Instant,
    timestamp: i64,
    path: f64,
    heading: f64,
    rates: Motion,
}

/// Follows both.
#[derive(Debug)]
pub struct Ways {
    geometry: Ackermann,
    odo: Option<Odo>,
    drives: Option<(Instant, Motion)>,
    /// Since when they say otherwise than `stuck`.
    otherwise: Option<Instant>,
    stuck: bool,
}

impl Ways {
    pub fn new(wheelbase_m: f64, track_m: f64) -> Self {
        let geometry = Ackermann { wheelbase_m, track_m };
        Self { geometry, odo: None, drives: None, otherwise: None, stuck: false }
    }

    /// Odometry of `at`: the rates since the one before. The integrals bridge what was lost on the bus.
    pub fn on_odo(&mut self, at: Instant, odo: &DataOdo) -> Motion {
        let said = Motion { translation: odo.translation, rotation: odo.rotation };
        let rates = match self.odo {
            Some(last) if odo.timestamp > last.timestamp => {
                let seconds = (odo.timestamp - last.timestamp) as f64 * 1e-6;
                let translation = (odo.path - last.path) / seconds;
                let rotation = (odo.heading - last.heading) / seconds;
                let whole = (translation - said.translation).abs() < WHOLE && (rotation - said.rotation).abs() < WHOLE;
                if whole { Motion { translation, rotation } } else { said }
            }
            _ => said,
        };
        self.odo = Some(Odo { at, timestamp: odo.timestamp, path: odo.path, heading: odo.heading, rates });
        self.compare(at);
        rates
    }

    /// How the drives moved at `at`.
    pub fn on_motion(&mut self, at: Instant, motion: &DataMotion) {
        let rates = self.geometry.motion(motion.speed, motion.steering.clamp(-1.5, 1.5));
        if rates.translation.is_finite() && rates.rotation.is_finite() {
            self.drives = Some((at, rates));
            self.compare(at);
        }
    }

    fn compare(&mut self, now: Instant) {
        let (Some(odo), Some((at, drives))) = (self.odo, self.drives) else { return };
        if now.since(at) >= SILENT || now.since(odo.at) >= SILENT {
            self.otherwise = None;
            return;
        }
        let moves = drives.translation.abs() > SAME.0;
        let slower = drives.translation.abs() - odo.rates.translation.abs();
        let short = slower > SAME.0 + SAME.1 * drives.translation.abs();
        let turned = (drives.rotation - odo.rates.rotation).abs() > SAME.2 + SAME.1 * drives.rotation.abs();
        let differ = moves && (short || turned);
        // Who stands tells nothing: what was stuck is so until both move alike.
        if differ == self.stuck || (self.stuck && !moves) {
            self.otherwise = None;
        } else if now.since(*self.otherwise.get_or_insert(now)) >= STUCK_AFTER {
            (self.stuck, self.otherwise) = (differ, None);
        }
    }

    /// What ways are by at `now`, and the drives' rates.
    pub fn source(&self, now: Instant) -> (Source, Motion) {
        let drives = self.drives.filter(|(at, _)| now.since(*at) < SILENT).map(|(_, rates)| rates);
        let speaks = self.odo.is_some_and(|odo| now.since(odo.at) < SILENT);
        match (speaks, drives) {
            (true, Some(rates)) if self.stuck => (Source::DrivesAgainstWheels, rates),
            (true, _) => (Source::Wheels, Motion::default()),
            (false, Some(rates)) => (Source::Drives, rates),
            (false, None) => (Source::Nobody, Motion::default()),
        }
    }

    /// Whether odometry was ever heard.
    pub fn has_begun(&self) -> bool {
        self.odo.is_some()
    }
}
