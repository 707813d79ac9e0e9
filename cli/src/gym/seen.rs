//! What an observer of the virtual machine keeps for the answers of `advee gym`.

use super::protocol::{Bounds, Estimate, Hold, Velocity};
use base::{Duration, Instant};
use messages::Message;
use messages::lowlevel::{DataGuard, DataHold, DataMotion, DataRanges, DataScan, DataVelocity, Reading};
use messages::middlelevel::DataEstimate;
use messages::simulation::DataTruth;
use navitools::{Point, Pose};
use robot::config::SIMULATOR;
use sim::host::News;
use simulator::people::{Contact, Mover};
use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

/// Number of sectors around the robot for which the nearest point of a lidar is stated.
pub const SECTORS: usize = 36;
/// Longest age of an estimate, and of the guard's bounds, by which the robot is moved.
const ESTIMATE_AGE_MAX: Duration = Duration::from_millis(200);
const GUARD_AGE_MAX: Duration = Duration::from_millis(150);
/// Age up to which a part of a revolution counts: a revolution takes 100 to 200 ms.
const SCAN_AGE_MAX: Duration = Duration::from_millis(250);
/// Maximum number of kept parts of revolutions.
const SCANS_MAX: usize = 128;

/// Last messages, and what was counted.
#[derive(Debug, Default)]
pub struct Seen {
    /// `SIM_DATA_TRUTH`.
    pub truth: Option<DataTruth>,
    /// `LL_DATA_MOTION`.
    pub motion: DataMotion,
    velocity: Option<DataVelocity>,
    /// `LL_DATA_HOLD` of the motion; absent before the first one.
    pub holds: Option<DataHold>,
    guard: Option<(Instant, DataGuard)>,
    estimate: Option<(Instant, DataEstimate)>,
    /// Number of good estimates in succession.
    pub located: u32,
    ranges: Option<DataRanges>,
    scans: VecDeque<(Instant, DataScan)>,
    /// Number of contacts in which the robot moved.
    pub contacts: u32,
    /// Number of contacts in which a person walked into the robot.
    pub touched: u32,
}

impl Seen {
    /// Takes news of the machine.
    pub fn take(&mut self, now: Instant, news: &News<'_>) {
        match news {
            News::Message { message, .. } => self.on_message(now, message),
            News::Note { module, line } if *module == SIMULATOR => {
                if let Ok(contact) = line.parse::<Contact>() {
                    let count = if contact.mover == Mover::Robot { &mut self.contacts } else { &mut self.touched };
                    *count += 1;
                }
            }
            _ => {}
        }
    }

    fn on_message(&mut self, now: Instant, message: &Message) {
        match message {
            Message::SimDataTruth(truth) => self.truth = Some(truth.clone()),
            Message::LlDataMotion(motion) => self.motion.clone_from(motion),
            Message::LlDataVelocity(velocity) => self.velocity = Some(velocity.clone()),
            Message::LlDataHold(list) if list.is_of_motion() => self.holds = Some(list.clone()),
            Message::LlDataGuard(guard) => self.guard = Some((now, guard.clone())),
            Message::LlDataRanges(ranges) => self.ranges = Some(ranges.clone()),
            Message::MlDataEstimate(estimate) => {
                self.located =
                    if estimate.quality >= DataEstimate::COARSE { self.located.saturating_add(1) } else { 0 };
                self.estimate = Some((now, estimate.clone()));
            }
            Message::LlDataScan(scan) => {
                while self.scans.len() >= SCANS_MAX
                    || self.scans.front().is_some_and(|(at, _)| now.since(*at) > SCAN_AGE_MAX)
                {
                    self.scans.pop_front();
                }
                self.scans.push_back((now, scan.clone()));
            }
            _ => {}
        }
    }

    /// The estimate; one that is old, or was never received, is lost.
    pub fn estimate(&self, now: Instant) -> Estimate {
        let nothing = f64::NAN;
        let Some((at, estimate)) = &self.estimate else {
            let (x, y, theta, sd_x, sd_y, sd_theta) = (nothing, nothing, nothing, nothing, nothing, nothing);
            return Estimate { x, y, theta, sd_x, sd_y, sd_theta, quality: DataEstimate::LOST };
        };
        let &DataEstimate { x, y, theta, covariance, quality, .. } = estimate;
        let sd = |n: usize| covariance[n][n].max(0.0).sqrt();
        let quality = if now.since(*at) < ESTIMATE_AGE_MAX { quality } else { DataEstimate::LOST };
        Estimate { x, y, theta, sd_x: sd(0), sd_y: sd(1), sd_theta: sd(2), quality }
    }

    /// Measured velocity.
    pub fn velocity(&self) -> Velocity {
        let steering = self.motion.steering;
        self.velocity.as_ref().map_or(
            Velocity { vx: f64::NAN, vy: f64::NAN, omega: f64::NAN, steering },
            |&DataVelocity { vx, vy, omega, .. }| Velocity { vx, vy, omega, steering },
        )
    }

    /// Bounds of the guard that are in force.
    pub fn bounds(&self, now: Instant) -> Option<Bounds> {
        let (at, guard) = self.guard.as_ref()?;
        let &DataGuard { forward, backward, left, right, turn_left, turn_right, code, .. } = guard;
        let fresh = now.since(*at) <= GUARD_AGE_MAX;
        fresh.then_some(Bounds { forward, backward, left, right, turn_left, turn_right, code })
    }

    /// Distance and status of each sonar.
    pub fn sonars(&self) -> (Vec<f64>, Vec<i8>) {
        let readings = self.ranges.iter().flat_map(|ranges| &ranges.readings);
        let sonars = readings.filter(|reading| reading.kind == Reading::SONAR);
        sonars
            .map(|reading| {
                let is_measured = reading.status == Reading::MEASURED;
                (if is_measured { reading.distance } else { f64::NAN }, reading.status)
            })
            .unzip()
    }

    /// Distance of the nearest point in each sector around the robot's origin, from the direction -π on; NaN where
    /// nothing was measured, in all of them before the first scan.
    pub fn sectors(&self, now: Instant) -> Vec<f64> {
        let mut nearest = vec![f64::NAN; SECTORS];
        let scans =
            self.scans.iter().filter(|(at, scan)| now.since(*at) <= SCAN_AGE_MAX && scan.status == DataScan::OK);
        for (_, scan) in scans {
            let mount = Pose::new(scan.x, scan.y, scan.theta).to_outer();
            for (n, range) in (0u32..).zip(&scan.ranges) {
                // Up to there nothing was sensed; what is nearer than the device measures is at that distance.
                let distance = match *range {
                    f32::INFINITY => f64::from(scan.range_max),
                    f32::NEG_INFINITY => f64::from(scan.range_min),
                    range => f64::from(range),
                };
                if !distance.is_finite() {
                    continue;
                }
                let angle = scan.angle_min + f64::from(n) * scan.angle_step;
                let at = mount(Point { x: distance * angle.cos(), y: distance * angle.sin() });
                if let Some(sector) = sector(at) {
                    nearest[sector] = nearest[sector].min(at.x.hypot(at.y));
                }
            }
        }
        nearest
    }

    /// Causes that hold the motion, or slow it.
    pub fn holds(&self) -> Vec<Hold> {
        let holds = self.holds.iter().flat_map(|list| &list.holds);
        holds.map(|hold| Hold { code: hold.code, subject: hold.subject.clone(), latched: hold.latched }).collect()
    }

    /// True if a cause holds the motion that ends only by an act of a person.
    pub fn is_latched(&self) -> bool {
        self.holds.iter().flat_map(|list| &list.holds).any(|hold| hold.latched)
    }
}

/// Sector of a point in the robot's frame; `None` if it is not a place.
fn sector(at: Point) -> Option<usize> {
    let place = (at.y.atan2(at.x) + PI) / TAU * SECTORS as f64;
    place.is_finite().then(|| (place as usize).min(SECTORS - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(message: impl Into<Message>) -> Message {
        message.into()
    }

    fn at(ms: u64) -> Instant {
        Instant::from_millis(ms)
    }

    #[test]
    fn sectors_begin_behind_the_robot_and_go_around_counter_clockwise() {
        let of = |x, y| sector(Point { x, y });
        assert_eq!([of(-1.0, -0.01), of(0.0, -1.0), of(1.0, 0.01)], [Some(0), Some(9), Some(18)]);
        assert_eq!([of(0.0, 1.0), of(-1.0, 0.0), of(f64::NAN, 0.0)], [Some(27), Some(35), None]);
    }

    #[test]
    fn a_scan_gives_the_nearest_point_of_a_sector_and_what_was_not_measured_stays_unknown() {
        let scan = DataScan {
            x: 0.5,
            range_min: 0.1,
            range_max: 12.0,
            angle_step: 0.01,
            ranges: vec![2.0, f32::NAN, 1.5, f32::INFINITY],
            ..DataScan::default()
        };
        let mut seen = Seen::default();
        seen.on_message(at(1000), &message(scan.clone()));
        let sectors = seen.sectors(at(1100));
        assert!((sectors[18] - 2.0).abs() < 1e-3, "1.5 m before a lidar at 0.5 m: {sectors:?}");
        assert_eq!(sectors.iter().filter(|distance| distance.is_nan()).count(), SECTORS - 1);
        assert!(seen.sectors(at(1300)).iter().all(|distance| distance.is_nan()), "old");
        seen.on_message(at(2000), &message(DataScan { status: DataScan::FAULT, ..scan }));
        assert!(seen.sectors(at(2000)).iter().all(|distance| distance.is_nan()), "it reports a fault");
    }

    #[test]
    fn old_estimates_are_lost_and_old_bounds_are_none() {
        let mut seen = Seen::default();
        assert_eq!((seen.estimate(at(0)).quality, seen.bounds(at(0))), (DataEstimate::LOST, None));
        let estimate = DataEstimate { x: 3.0, quality: DataEstimate::FINE, ..DataEstimate::default() };
        seen.on_message(at(1000), &message(estimate));
        seen.on_message(at(1000), &message(DataGuard { forward: 0.4, ..DataGuard::default() }));
        let estimate = seen.estimate(at(1199));
        assert_eq!((estimate.x, estimate.quality, seen.estimate(at(1200)).quality), (3.0, DataEstimate::FINE, 0));
        assert_eq!(seen.bounds(at(1150)).map(|bounds| bounds.forward), Some(0.4));
        assert_eq!(seen.bounds(at(1151)), None);
    }

    #[test]
    fn a_sonar_without_a_measurement_has_a_status_and_no_distance() {
        let reading =
            |id, status, distance| Reading { id, kind: Reading::SONAR, status, distance, ..Reading::default() };
        let infrared = Reading { kind: Reading::INFRARED, status: Reading::MEASURED, ..Reading::default() };
        let silent = reading(1, Reading::SILENT, f64::NAN);
        let readings = vec![reading(0, Reading::MEASURED, 1.5), silent, reading(2, Reading::UNKNOWN, 0.7), infrared];
        let mut seen = Seen::default();
        seen.on_message(at(0), &message(DataRanges { timestamp: 0, readings }));
        let (distances, status) = seen.sonars();
        assert_eq!(status, [Reading::MEASURED, Reading::SILENT, Reading::UNKNOWN]);
        assert!(distances[0] == 1.5 && distances[1].is_nan() && distances[2].is_nan());
    }

    #[test]
    fn contacts_are_counted_by_who_moved() {
        let mut seen = Seen::default();
        let by = |mover| Contact { mover, person: None, robot_mps: 0.3, at: Point { x: 1.0, y: 2.0 } }.to_string();
        let mut note = |module, line: &str| seen.take(at(0), &News::Note { module, line });
        note(SIMULATOR, &by(Mover::Robot));
        note(SIMULATOR, &by(Mover::Person));
        note(SIMULATOR, "contact: with the world");
        note("guard", &by(Mover::Robot));
        assert_eq!((seen.contacts, seen.touched), (1, 1));
    }
}
