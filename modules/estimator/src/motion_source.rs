//! Selection of the motion source: the wheels' odometry, while it arrives and the drives do not contradict it.

use base::{Duration, Instant};
use messages::lowlevel::{DataMotion, DataOdo};
use navitools::{Ackermann, Motion};

/// Silence after which odometry (20 Hz) counts as lost; the same for the drives.
const SILENCE_MAX: Duration = Duration::from_millis(300);
/// Time that odometry and drives must differ before the odometry counts as stuck, and agree before it no longer does.
const STUCK_AFTER: Duration = Duration::from_secs(1);
/// Tolerated difference of speed: absolute, m/s, and relative; and of rotation, rad/s.
const DIFFERENCE_MAX: (f64, f64, f64) = (0.12, 0.3, 0.35);
/// Greatest difference between a rate and its integral, m/s and rad/s; beyond it the integral was restarted.
const INTEGRAL_DIFFERENCE_MAX: f64 = 0.3;

/// Source of a motion step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The wheels' odometry.
    Wheels,
    /// The drives, because the odometry is silent.
    Drives,
    /// The drives, because they move and the odometry does not.
    DrivesAgainstWheels,
    /// No source.
    None,
}

#[derive(Clone, Copy, Debug)]
struct Odo {
    at: Instant,
    timestamp: i64,
    path: f64,
    heading: f64,
    rates: Motion,
}

/// State of both sources.
#[derive(Debug)]
pub struct MotionSources {
    geometry: Ackermann,
    odo: Option<Odo>,
    drives: Option<(Instant, Motion)>,
    /// Instant since which they contradict `stuck`.
    differs_since: Option<Instant>,
    stuck: bool,
}

impl MotionSources {
    pub fn new(wheelbase_m: f64, track_m: f64) -> Self {
        let geometry = Ackermann { wheelbase_m, track_m };
        Self { geometry, odo: None, drives: None, differs_since: None, stuck: false }
    }

    /// Takes odometry of `at`; returns the velocity since the previous one. The integrals bridge lost messages.
    pub fn on_odo(&mut self, at: Instant, odo: &DataOdo) -> Motion {
        let said = Motion { translation: odo.translation, rotation: odo.rotation };
        let rates = match self.odo {
            Some(last) if odo.timestamp > last.timestamp => {
                let seconds = (odo.timestamp - last.timestamp) as f64 * 1e-6;
                let translation = (odo.path - last.path) / seconds;
                let rotation = (odo.heading - last.heading) / seconds;
                let whole = (translation - said.translation).abs() < INTEGRAL_DIFFERENCE_MAX
                    && (rotation - said.rotation).abs() < INTEGRAL_DIFFERENCE_MAX;
                if whole { Motion { translation, rotation } } else { said }
            }
            _ => said,
        };
        self.odo = Some(Odo { at, timestamp: odo.timestamp, path: odo.path, heading: odo.heading, rates });
        self.compare(at);
        rates
    }

    /// Takes the motion of the drives at `at`.
    pub fn on_motion(&mut self, at: Instant, motion: &DataMotion) {
        let rates = self.geometry.motion(motion.speed, motion.steering.clamp(-1.5, 1.5));
        if rates.translation.is_finite() && rates.rotation.is_finite() {
            self.drives = Some((at, rates));
            self.compare(at);
        }
    }

    /// Takes note of a velocity of all wheels at `at`: they are driven, and the only source.
    pub fn on_velocity(&mut self, at: Instant) {
        self.odo = Some(Odo { at, timestamp: 0, path: 0.0, heading: 0.0, rates: Motion::default() });
    }

    fn compare(&mut self, now: Instant) {
        let (Some(odo), Some((at, drives))) = (self.odo, self.drives) else { return };
        if now.since(at) >= SILENCE_MAX || now.since(odo.at) >= SILENCE_MAX {
            self.differs_since = None;
            return;
        }
        let moves = drives.translation.abs() > DIFFERENCE_MAX.0;
        let slower = drives.translation.abs() - odo.rates.translation.abs();
        let short = slower > DIFFERENCE_MAX.0 + DIFFERENCE_MAX.1 * drives.translation.abs();
        let turned =
            (drives.rotation - odo.rates.rotation).abs() > DIFFERENCE_MAX.2 + DIFFERENCE_MAX.1 * drives.rotation.abs();
        let differ = moves && (short || turned);
        // Standstill is no evidence: a stuck odometry stays so until both move alike.
        if differ == self.stuck || (self.stuck && !moves) {
            self.differs_since = None;
        } else if now.since(*self.differs_since.get_or_insert(now)) >= STUCK_AFTER {
            (self.stuck, self.differs_since) = (differ, None);
        }
    }

    /// Source at `now`, and the velocity of the drives.
    pub fn source(&self, now: Instant) -> (Source, Motion) {
        let drives = self.drives.filter(|(at, _)| now.since(*at) < SILENCE_MAX).map(|(_, rates)| rates);
        let speaks = self.odo.is_some_and(|odo| now.since(odo.at) < SILENCE_MAX);
        match (speaks, drives) {
            (true, Some(rates)) if self.stuck => (Source::DrivesAgainstWheels, rates),
            (true, _) => (Source::Wheels, Motion::default()),
            (false, Some(rates)) => (Source::Drives, rates),
            (false, None) => (Source::None, Motion::default()),
        }
    }

    /// True if odometry was ever received.
    pub fn has_begun(&self) -> bool {
        self.odo.is_some()
    }
}
