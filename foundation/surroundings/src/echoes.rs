//! What is in the way according to the sonars: recent readings, each from where the robot was when it was made.
//!
//! **Unknown is not free.** A sensor whose last reading is unknown or too old, and one that has not read often enough
//! within the window, covers its whole cone. One echo is enough to occupy the arc from which it may have come: the
//! robot brakes. It is dropped when the next two readings of the same sensor have found nothing there; once another
//! echo has confirmed it, when the window has passed, or as many newer readings as prove space free have found nothing.

use crate::{Obstacle, Rules, Sonar, Source, Trail, Unseen};
use base::Instant;
use messages::lowlevel::{DataRanges, Reading};
use navitools::{Point, Pose};
use std::collections::VecDeque;

/// Number of windows within which the readings must lie that prove a sensor's space free: some sensors are read at 2
/// Hz.
const PROOF_WINDOWS: u32 = 2;
/// Readings in succession that must find nothing where a single echo came from: a leg returns about three of four.
const MISSES: usize = 2;
/// Readings kept of a sensor.
const READINGS_MAX: usize = 32;
/// Distance of the points on an arc, m; a lane of the robot is several times as wide.
const STEP_M: f64 = 0.12;
/// Maximum number of steps on an arc.
const STEPS_MAX: u32 = 16;
/// Width of the parts into which the cone of an unknown sensor is divided, rad.
const UNSEEN_RAD: f64 = 0.05;
/// Radii by which the cone of an unknown sensor is covered, m; the last one is the reach.
const COVERED_M: [f64; 7] = [0.02, 0.15, 0.4, 0.7, 1.1, 1.6, 2.2];
/// Difference of distances up to which two readings may be the same thing, m, beyond the uncertainty.
const SAME_M: f64 = 0.15;
/// Speed at which the distance must shrink beyond the robot's own motion for something to count as approaching, m/s:
/// lower values are noise of two readings of a sonar, higher ones are echoes of two different things.
const APPROACH_MPS: std::ops::Range<f64> = 0.3..3.2;

#[derive(Debug)]
struct Heard {
    /// Instant of the measurement, and the message's name for it.
    at: Instant,
    stamp: i64,
    /// Distance, m; infinite: nothing returned an echo.
    distance: f64,
    pose: Pose,
    /// Where the echo may have come from, in the frame of the trail; empty if that is beyond the reach.
    arc: Vec<Point>,
    /// It came nearer since the reading before by more than the robot's motion.
    approaches: bool,
}

#[derive(Debug)]
struct Cone {
    sonar: Sonar,
    /// The newest message said that nothing is known.
    lost: bool,
    readings: VecDeque<Heard>,
}

/// Recent readings of all sonars.
#[derive(Debug)]
pub struct Echoes {
    rules: Rules,
    cones: Vec<Cone>,
}

impl Echoes {
    /// Creates a memory of these sonars, of which nothing is known yet.
    #[must_use]
    pub fn new(rules: Rules, sonars: &[Sonar]) -> Self {
        let cone = |sonar: &Sonar| Cone { sonar: *sonar, lost: false, readings: VecDeque::new() };
        Self { rules, cones: sonars.iter().map(cone).collect() }
    }

    /// Processes readings received at `received`; instants follow from their ages in the message. A sensor that the
    /// message leaves out keeps its readings, which grow older.
    pub fn on_ranges(&mut self, received: Instant, message: &DataRanges, trail: &Trail) {
        for reading in message.readings.iter().filter(|reading| reading.kind != Reading::INFRARED) {
            let Some(cone) = self.cones.iter_mut().find(|cone| cone.sonar.id == reading.id) else { continue };
            let age = u64::try_from(message.timestamp.saturating_sub(reading.timestamp)).unwrap_or(0);
            let at = received - base::Duration::from_micros(age);
            let distance = match reading.status {
                Reading::MEASURED if reading.distance > 0.0 && reading.distance.is_finite() => reading.distance,
                Reading::SILENT => f64::INFINITY,
                _ => f64::NAN,
            };
            cone.lost = distance.is_nan();
            let known = cone.readings.iter().any(|heard| heard.stamp == reading.timestamp);
            if cone.lost || known {
                continue;
            }
            if cone.readings.len() == READINGS_MAX {
                cone.readings.pop_front();
            }
            cone.hear(Heard::new(at, reading.timestamp, distance, trail.pose(at)), self.rules.reach);
        }
    }

    /// Forgets all readings: every sensor is unknown until it has proved its space free again.
    pub fn forget(&mut self) {
        self.cones.iter_mut().for_each(|cone| cone.readings.clear());
    }

    /// Adds everything that may be in the way at `now`.
    pub fn obstacles(&mut self, now: Instant, trail: &Trail, found: &mut Vec<Obstacle>) {
        let here = trail.pose(now);
        for cone in &mut self.cones {
            let kept_for = self.rules.window * PROOF_WINDOWS;
            while cone.readings.front().is_some_and(|old| now.since(old.at) > kept_for) {
                cone.readings.pop_front();
            }
            if cone.is_known(now, &self.rules) {
                cone.echoes(now, &self.rules, found);
            } else {
                cone.cover(here, self.rules.reach, found);
            }
        }
    }

    /// Adds the parts of the cones of which nothing is known at `now`: what [`Self::obstacles`], which is called
    /// before, covers with points.
    pub fn unseen(&self, now: Instant, found: &mut Vec<Unseen>) {
        for cone in self.cones.iter().filter(|cone| !cone.is_known(now, &self.rules)) {
            let Sonar { at, theta, beam, .. } = cone.sonar;
            let count = libm::ceil(beam / UNSEEN_RAD).max(1.0) as u32;
            let width = beam / f64::from(count);
            let half = libm::tan(width / 2.0) * self.rules.reach;
            found.extend((0..count).map(|n| {
                let (sin, cos) = libm::sincos(theta - beam / 2.0 + (f64::from(n) + 0.5) * width);
                let to = Point { x: at.x + self.rules.reach * cos, y: at.y + self.rules.reach * sin };
                Unseen { from: at, to, half, source: cone.source() }
            }));
        }
    }
}

impl Heard {
    fn new(at: Instant, stamp: i64, distance: f64, pose: Pose) -> Self {
        Self { at, stamp, distance, pose, arc: Vec::new(), approaches: false }
    }

    /// True if the robot has moved by more than `distance`, at least 0, between two readings, m.
    fn moved_by(&self, other: &Self, distance: f64) -> bool {
        let (x, y) = (other.pose.x - self.pose.x, other.pose.y - self.pose.y);
        x * x + y * y > distance * distance
    }
}

impl Cone {
    fn hear(&mut self, mut heard: Heard, reach: f64) {
        if heard.distance <= reach + SAME_M {
            let closing = self.readings.back().map(|before| self.closing(before, &heard));
            heard.approaches = closing.is_some_and(|speed| APPROACH_MPS.contains(&speed));
            heard.arc.extend(self.arc(heard.pose, heard.distance));
        }
        self.readings.push_back(heard);
    }

    fn is_known(&self, now: Instant, rules: &Rules) -> bool {
        let fresh = self.readings.back().is_some_and(|last| now.since(last.at) <= rules.age_max);
        !self.lost && fresh && self.readings.len() >= rules.readings as usize
    }

    fn source(&self) -> Source {
        Source::Sonar(self.sonar.id)
    }

    /// Echoes that are not refuted.
    fn echoes(&self, now: Instant, rules: &Rules, found: &mut Vec<Obstacle>) {
        for (n, heard) in self.readings.iter().enumerate() {
            if heard.arc.is_empty() || now.since(heard.at) > rules.window {
                continue;
            }
            // A later reading would find it farther away at most by the robot's motion since.
            let farther = |later: &Heard| {
                let beyond = later.distance - heard.distance - SAME_M - rules.uncertainty;
                beyond > 0.0 && !later.moved_by(heard, beyond)
            };
            let near = |other: &&Heard| {
                let apart = (other.distance - heard.distance).abs() - SAME_M;
                apart <= 0.0 || other.moved_by(heard, apart)
            };
            let is_confirmed = || self.readings.iter().filter(near).nth(1).is_some();
            let later = self.readings.iter().skip(n + 1);
            let are_farther = |count: usize| later.len() >= count && later.clone().rev().take(count).all(farther);
            // A single echo may be crosstalk: the robot brakes for it until it has been missed twice. A leg in clothes
            // returns an echo now and then: after two echoes it counts until all of `readings` have missed it.
            let readings = rules.readings as usize;
            if are_farther(readings.min(MISSES)) && (!is_confirmed() || are_farther(readings)) {
                continue;
            }
            let obstacle = |at: &Point| Obstacle {
                at: *at,
                source: self.source(),
                sensed: true,
                approaches: heard.approaches,
                moves: false,
            };
            found.extend(heard.arc.iter().map(obstacle));
        }
    }

    /// Speed at which the distance shrank beyond what the robot's own motion does to anything in the beam, m/s.
    fn closing(&self, before: &Heard, after: &Heard) -> f64 {
        let Sonar { at, theta, beam, .. } = self.sonar;
        let (from, to) = (before.pose * at, after.pose * at);
        let course = libm::atan2(to.y - from.y, to.x - from.x);
        let off = (after.pose.theta + (theta - course)).radians().abs();
        let ours = from.distance(to) * libm::cos((off - beam / 2.0).max(0.0));
        (before.distance - after.distance - ours) / after.at.since(before.at).as_secs_f64()
    }

    /// The whole cone.
    fn cover(&self, here: Pose, reach: f64, found: &mut Vec<Obstacle>) {
        for radius in COVERED_M.into_iter().filter(|radius| *radius < reach).chain([reach]) {
            let unknown = |at| Obstacle { at, source: self.source(), sensed: false, approaches: true, moves: false };
            found.extend(self.arc(here, radius).map(unknown));
        }
    }

    /// Points on the arc at a distance.
    fn arc(&self, pose: Pose, distance: f64) -> impl Iterator<Item = Point> + use<> {
        let Sonar { at, theta, beam, .. } = self.sonar;
        let steps = libm::ceil(distance * beam / STEP_M).clamp(2.0, f64::from(STEPS_MAX)) as u32;
        let to_trail = pose.to_outer();
        (0..=steps).map(move |n| {
            let (sin, cos) = libm::sincos(theta + beam * (f64::from(n) / f64::from(steps) - 0.5));
            to_trail(Point { x: at.x + distance * cos, y: at.y + distance * sin })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::RULES;

    fn ms(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    const SONAR: Sonar = Sonar { id: 2, at: Point { x: 0.75, y: 0.0 }, theta: 0.0, beam: 0.96 };

    /// A message at `at` with one reading of the sonar, made 100 ms before.
    fn ranges(at: u64, status: i8, distance: f64) -> DataRanges {
        let timestamp = at as i64 * 1000;
        let reading = Reading {
            timestamp: timestamp - 100_000,
            id: 2,
            kind: Reading::SONAR,
            status,
            distance,
            ..Default::default()
        };
        DataRanges { timestamp, readings: vec![reading] }
    }

    struct Bench {
        echoes: Echoes,
        trail: Trail,
    }

    impl Bench {
        fn new() -> Self {
            Self { echoes: Echoes::new(RULES, &[SONAR]), trail: Trail::default() }
        }

        fn hear(&mut self, at: u64, status: i8, distance: f64) {
            self.echoes.on_ranges(ms(at), &ranges(at, status, distance), &self.trail);
        }

        /// Sensed and unknown points at `at`, and the least x of any.
        fn found(&mut self, at: u64) -> (usize, usize, f64) {
            let mut found = Vec::new();
            self.echoes.obstacles(ms(at), &self.trail, &mut found);
            let sensed = found.iter().filter(|obstacle| obstacle.sensed).count();
            let nearest = found.iter().map(|obstacle| obstacle.at.x).fold(f64::INFINITY, f64::min);
            (sensed, found.len() - sensed, nearest)
        }
    }

    #[test]
    fn a_sensor_is_unknown_until_it_has_read_often_enough_and_again_when_it_is_silent() {
        let mut bench = Bench::new();
        assert!(matches!(bench.found(0), (0, 1.., x) if x < 0.8), "nothing was heard yet");
        for at in [100, 350] {
            bench.hear(at, Reading::SILENT, f64::NAN);
            assert!(matches!(bench.found(at), (0, 1.., _)), "{at}");
        }
        bench.hear(600, Reading::SILENT, f64::NAN);
        assert_eq!(bench.found(600), (0, 0, f64::INFINITY));
        assert_eq!(bench.found(1000), (0, 0, f64::INFINITY));
        assert!(matches!(bench.found(1301), (0, 1.., _)), "too old");
    }

    #[test]
    fn what_is_not_known_is_the_whole_cone_up_to_the_reach() {
        let mut bench = Bench::new();
        let unseen = |bench: &Bench, at: u64| {
            let mut unseen = Vec::new();
            bench.echoes.unseen(ms(at), &mut unseen);
            unseen
        };
        let all = unseen(&bench, 0);
        let width: f64 = all.iter().map(|part| 2.0 * part.half).sum();
        assert!((width - RULES.reach * SONAR.beam).abs() < 0.01, "{width} m at the end: without a gap");
        let angle = |part: &Unseen| libm::atan2(part.to.y - part.from.y, part.to.x - part.from.x);
        assert!(all.iter().all(|part| part.from == SONAR.at && angle(part).abs() < SONAR.beam / 2.0), "{all:?}");
        assert!(all.iter().all(|part| (part.to.distance(part.from) - RULES.reach).abs() < 1e-9));
        (0..3).for_each(|n| bench.hear(100 + 250 * n, Reading::SILENT, f64::NAN));
        assert_eq!(unseen(&bench, 600), []);
        assert_eq!(unseen(&bench, 1401).len(), all.len(), "too old");
    }

    #[test]
    fn an_unknown_reading_takes_effect_at_once() {
        let mut bench = Bench::new();
        (0..4).for_each(|n| bench.hear(100 + 250 * n, Reading::SILENT, f64::NAN));
        assert_eq!(bench.found(850), (0, 0, f64::INFINITY));
        bench.hear(900, Reading::UNKNOWN, f64::NAN);
        assert!(matches!(bench.found(900), (0, 1.., _)));
        bench.hear(950, Reading::MEASURED, -1.0);
        assert!(matches!(bench.found(950), (0, 1.., _)), "a distance that cannot be");
        bench.hear(1000, Reading::SILENT, f64::NAN);
        assert_eq!(bench.found(1000), (0, 0, f64::INFINITY));
    }

    #[test]
    fn one_echo_is_enough_until_it_is_missed_twice_and_two_until_they_are_missed_repeatedly() {
        let mut bench = Bench::new();
        (0..4).for_each(|n| bench.hear(100 + 100 * n, Reading::SILENT, f64::NAN));
        bench.hear(500, Reading::MEASURED, 0.5);
        let (sensed, unknown, nearest) = bench.found(500);
        assert!(sensed > 3 && unknown == 0 && (1.15..1.25).contains(&nearest), "{sensed} {unknown} {nearest}");
        bench.hear(600, Reading::SILENT, f64::NAN);
        assert!(bench.found(600).0 > 3, "one silence may be a leg that will be heard again");
        bench.hear(700, Reading::SILENT, f64::NAN);
        assert_eq!(bench.found(700).0, 0, "it was crosstalk");
        bench.hear(800, Reading::MEASURED, 0.5);
        bench.hear(850, Reading::MEASURED, 0.5);
        bench.hear(900, Reading::SILENT, f64::NAN);
        bench.hear(1000, Reading::MEASURED, 3.0);
        assert!(bench.found(1000).0 > 3, "heard twice");
        bench.hear(1100, Reading::SILENT, f64::NAN);
        assert_eq!(bench.found(1100).0, 0, "three found nothing there");
    }

    #[test]
    fn the_same_measurement_read_again_is_one_reading() {
        let mut bench = Bench::new();
        let message = ranges(100, Reading::SILENT, f64::NAN);
        for at in [100, 120, 140, 160] {
            let message = DataRanges { timestamp: at * 1000, ..message.clone() };
            bench.echoes.on_ranges(ms(at as u64), &message, &bench.trail);
        }
        assert!(matches!(bench.found(160), (0, 1.., _)));
    }

    #[test]
    fn who_comes_nearer_approaches_and_a_wall_to_which_the_robot_drives_does_not() {
        let approaches = |speed: f64, distance: f64, closing: f64| {
            let mut bench = Bench::new();
            let forward = kinematics::Twist { vx: speed, ..kinematics::Twist::default() };
            (0..=24).for_each(|n| bench.trail.on_motion(ms(n * 50), forward, base::Duration::from_secs(1)));
            for n in 0..3 {
                bench.hear(600 + 210 * n, Reading::MEASURED, distance - closing * 0.21 * n as f64);
            }
            let mut found = Vec::new();
            bench.echoes.obstacles(ms(1100), &bench.trail, &mut found);
            assert!(!found.is_empty());
            found.iter().any(|obstacle| obstacle.approaches)
        };
        for (speed, closing, expected) in [
            (0.0, 0.0, false),
            (0.6, 0.6, false),
            (0.8, 0.9, false),
            (0.0, 0.5, true),
            (0.6, 1.8, true),
            (0.0, 4.0, false),
        ] {
            assert_eq!(approaches(speed, 2.4, closing), expected, "{speed} {closing}");
        }
        // A wall that is square to the edge of the beam recedes less than the robot drives.
        assert!(!approaches(0.8, 2.4, 0.8 * libm::cos(0.48)));
    }

    #[test]
    fn an_echo_stays_where_it_was_while_the_robot_drives() {
        let mut bench = Bench::new();
        let speed = kinematics::Twist { vx: 0.5, ..kinematics::Twist::default() };
        (0..=20).for_each(|n| bench.trail.on_motion(ms(n * 50), speed, base::Duration::from_secs(1)));
        (0..3).for_each(|n| bench.hear(800 + 100 * n, Reading::MEASURED, 1.0));
        let first = bench.trail.pose(ms(700)).x;
        assert!((first - 0.35).abs() < 1e-9);
        let (_, _, nearest) = bench.found(1000);
        assert!(nearest > first + 1.6 && nearest < first + 1.75, "{nearest}");
    }
}
