//! The module on the bench: what it is told, what it says.

use super::*;
use crate::filter::Beacon;
use kinematics::{Twist, integrate};
use messages::lowlevel;
use module::bench::Bench;
use module::{Action, Shell, ShellConfig};
use navitools::{Point, wrap};

const BEACONS: [(i32, f64, f64); 4] = [(1, 0.1, 0.1), (2, 19.9, 0.1), (3, 19.9, 11.9), (4, 0.1, 11.9)];
const SPEED: f64 = 0.4;
const STEERED: Wheels = Wheels::Steered { wheelbase_m: 0.6, track_m: 0.5 };

/// A robot that moves on from (4, 6), and the module.
struct Rig {
    bench: Bench,
    twist: Twist,
    /// Its wheels do not steer, and measure all of its motion.
    is_base: bool,
    odometry: bool,
    stuck: bool,
    drives: bool,
    beacons: bool,
    /// What the wheels turn the robot by, beside the truth, rad/s.
    slip: f64,
    /// State of its inertial measurement unit, if it has one that measures.
    imu: Option<i8>,
}

impl Rig {
    fn new() -> Self {
        Self::of(STEERED, Twist::new(SPEED, 0.0, 0.0))
    }

    fn of(wheels: Wheels, twist: Twist) -> Self {
        Self::with(wheels, twist, None)
    }

    fn with(wheels: Wheels, twist: Twist, imu: Option<&str>) -> Self {
        let beacons = BEACONS.iter().map(|(id, x, y)| Beacon { id: *id, at: Point { x: *x, y: *y } }).collect();
        // The heading of a base that keeps turning on the spot is known as well as the delay of the bearings.
        let filter = filter::Config { beacons, range: 30.0, delay: 0.1, ..filter::Config::default() };
        let module = Estimator::new(Config { filter, wheels, active_max: 8, imu: imu.map(Into::into) }).unwrap();
        let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(module)));
        bench.start();
        let is_base = matches!(wheels, Wheels::Driven { .. });
        let (odometry, stuck, drives, beacons) = (true, false, true, true);
        let imu = imu.map(|_| lowlevel::DataImu::OK);
        Self { bench, twist, is_base, odometry, stuck, drives, beacons, slip: 0.0, imu }
    }

    fn at(&self) -> f64 {
        self.bench.now().as_nanos() as f64 * 1e-9
    }

    fn pose(&self, at: f64) -> Pose {
        integrate(Pose::new(4.0, 6.0, 0.0), self.twist, at)
    }

    /// Drives for so many seconds.
    fn drive(&mut self, seconds: u32) {
        for _ in 0..seconds * 20 {
            self.bench.pass(PERIOD);
            let (at, timestamp) = (self.at(), (self.at() * 1e6).round() as i64);
            let (translation, path) = if self.stuck { (0.0, 1.0) } else { (SPEED, SPEED * at) };
            let Twist { vx, vy, omega } = self.twist;
            // The last five measurements of a unit of 100 Hz.
            for age in self.imu.iter().flat_map(|_| [40, 30, 20, 10, 0]) {
                let (name, status) = ("base".into(), self.imu.unwrap());
                let (timestamp, rotation) = (timestamp - 1000 * age, [0.0, 0.0, omega]);
                self.bench.message(lowlevel::DataImu { timestamp, name, status, rotation, ..Default::default() });
            }
            let omega = omega + self.slip;
            if self.odometry && self.is_base {
                self.bench.message(lowlevel::DataVelocity { timestamp, vx, vy, omega, ..Default::default() });
            } else if self.odometry {
                self.bench.message(lowlevel::DataOdo { timestamp, translation, path, ..Default::default() });
            }
            if self.drives {
                self.bench.message(lowlevel::DataMotion { timestamp, speed: SPEED, ..Default::default() });
            }
            if self.beacons && timestamp % 1_000_000 == 0 {
                let beacons = BEACONS.iter().enumerate().map(|(n, (id, x, y))| {
                    let then = timestamp - 1000 - 200_000 * n as i64;
                    let place = self.pose(then as f64 * 1e-6);
                    let sensor = place * Point { x: 0.25, y: 0.0 };
                    let bearing = wrap(libm::atan2(y - sensor.y, x - sensor.x) - place.theta.radians());
                    lowlevel::Beacon { timestamp: then, id: *id, bearing, strength: 0.5 }
                });
                let beacons = lowlevel::DataBeacons { timestamp, beacons: beacons.collect() };
                self.bench.message(beacons);
            }
        }
    }

    fn estimates(&mut self) -> Vec<DataEstimate> {
        let estimate = |message| if let Message::MlDataEstimate(estimate) = message { Some(estimate) } else { None };
        self.bench.published().into_iter().filter_map(estimate).collect()
    }

    fn uses(&mut self) -> Vec<DataBeaconUse> {
        let uses = |message| if let Message::MlDataBeaconUse(uses) = message { Some(uses) } else { None };
        self.bench.published().into_iter().filter_map(uses).collect()
    }

    fn faults(&mut self) -> Vec<(Fault, Severity)> {
        let report = |(_, action)| if let Action::Report(report) = action { Some(report) } else { None };
        self.bench.done().into_iter().filter_map(report).map(|report| (report.fault, report.severity)).collect()
    }
}

#[test]
fn twenty_times_a_second_it_says_where_the_robot_is() {
    let mut rig = Rig::new();
    rig.drive(10);
    let estimates = rig.estimates();
    assert_eq!(estimates.len(), 201);
    assert_eq!(estimates[0].quality, DataEstimate::LOST);
    for estimate in &estimates[100..] {
        let truth = rig.pose(estimate.timestamp as f64 * 1e-6);
        let off = libm::hypot(estimate.x - truth.x, estimate.y - truth.y);
        assert!(off < 0.06 && estimate.quality >= DataEstimate::COARSE, "{estimate:?} {truth:?}");
    }
}

#[test]
fn a_base_that_does_not_steer_is_followed_sideways_and_on_the_spot() {
    for twist in [(0.3, 0.0, 0.1), (0.0, 0.0, 0.5), (0.1, -0.3, 0.1), (-0.2, 0.2, -0.1), (0.0, 0.2, 0.0)] {
        let twist = Twist::new(twist.0, twist.1, twist.2);
        let mut rig = Rig::of(Wheels::Driven { radius_m: 0.21 }, twist);
        rig.drive(15);
        let estimates = rig.estimates();
        for estimate in &estimates[160..] {
            let truth = rig.pose(estimate.timestamp as f64 * 1e-6);
            let off = libm::hypot(estimate.x - truth.x, estimate.y - truth.y);
            let turned = wrap(estimate.theta - truth.theta.radians()).abs();
            assert!(off < 0.05 && turned < 0.03 && estimate.quality == DataEstimate::FINE, "{twist:?}: {estimate:?}");
            assert!((estimate.speed - twist.vx).abs() < 0.02 && (estimate.rotation - twist.omega).abs() < 0.02);
        }
        rig.odometry = false;
        rig.drive(1);
        assert_eq!(rig.faults().first(), Some(&(Fault::OdometrySilent, Severity::Error)));
    }
}

#[test]
fn the_active_beacons_are_told_and_repeated() {
    let mut rig = Rig::new();
    rig.drive(11);
    let ids = |message| if let Message::LlDataActiveBeacons(active) = message { Some(active.ids) } else { None };
    let told: Vec<Vec<i32>> = rig.bench.published().into_iter().filter_map(ids).collect();
    assert_eq!(told, vec![vec![1, 2, 3, 4]; 3]);
}

#[test]
fn once_a_second_it_says_what_it_makes_of_each_beacon() {
    let mut rig = Rig::new();
    rig.drive(10);
    let uses = rig.uses();
    assert_eq!(uses.len(), 11);
    let of_map = uses.iter().flat_map(|uses| &uses.beacons).map(|beacon| (beacon.id, beacon.x, beacon.y));
    assert!(of_map.eq(BEACONS.iter().cycle().take(44).copied()));
    let unseen = &uses[0].beacons[0];
    assert!(unseen.active && unseen.permitted && !unseen.fits && unseen.last == 0, "{unseen:?}");
    assert!(unseen.residual.is_nan() && unseen.deviation.is_nan() && unseen.accepted + unseen.refused == 0);
    let last = uses.last().unwrap();
    for beacon in &last.beacons {
        assert!(beacon.fits && beacon.accepted >= 6 && beacon.refused == 0, "{beacon:?}");
        assert!(beacon.residual.abs() < 0.03 && beacon.deviation > 0.0, "{beacon:?}");
        // Sighted with this sweep or the one before.
        assert!((0..2_500_000).contains(&(last.timestamp - beacon.last)), "{} {beacon:?}", last.timestamp);
    }
    rig.faults();
    // Beacon 3 appears in a wrong direction.
    let timestamp = (rig.at() * 1e6).round() as i64;
    let (_, x, y) = BEACONS[2];
    let place = rig.pose(timestamp as f64 * 1e-6);
    let sensor = place * Point { x: 0.25, y: 0.0 };
    let bearing = wrap(libm::atan2(y - sensor.y, x - sensor.x) - place.theta.radians() + 0.4);
    let beacons = vec![lowlevel::Beacon { timestamp, id: 3, bearing, strength: 0.5 }];
    rig.bench.message(lowlevel::DataBeacons { timestamp, beacons });
    rig.beacons = false;
    rig.drive(1);
    let refused = rig.uses().pop().unwrap().beacons.remove(2);
    assert!(!refused.fits && refused.refused == 1 && (refused.residual - 0.4).abs() < 0.05, "{refused:?}");
}

#[test]
fn an_excluded_beacon_is_neither_looked_for_nor_used_until_it_is_permitted_again() {
    let mut rig = Rig::new();
    rig.drive(10);
    let exclude = |id, permitted| CmdBeaconUse { timestamp: 0, id, permitted };
    drop(rig.bench.published());
    rig.bench.message(exclude(2, false));
    rig.bench.pass(PERIOD);
    let published = rig.bench.published();
    let ids = |message: &Message| {
        if let Message::LlDataActiveBeacons(active) = message { Some(active.ids.clone()) } else { None }
    };
    assert_eq!(published.iter().filter_map(ids).collect::<Vec<_>>(), [[1, 3, 4]], "at once");
    rig.drive(2);
    let before = rig.uses().pop().unwrap();
    rig.drive(3);
    let uses = rig.uses().pop().unwrap();
    let state: Vec<_> = uses.beacons.iter().map(|beacon| (beacon.active, beacon.permitted)).collect();
    assert_eq!(state, [(true, true), (false, false), (true, true), (true, true)]);
    for (place, (then, now)) in before.beacons.iter().zip(&uses.beacons).enumerate() {
        assert_eq!(now.accepted > then.accepted, place != 1, "{then:?} {now:?}");
    }
    rig.bench.message(exclude(CmdBeaconUse::ALL, false));
    rig.bench.pass(PERIOD);
    assert_eq!(rig.bench.published().iter().filter_map(ids).collect::<Vec<_>>(), [[0; 0]]);
    rig.bench.message(exclude(CmdBeaconUse::ALL, true));
    rig.bench.pass(PERIOD);
    assert_eq!(rig.bench.published().iter().filter_map(ids).collect::<Vec<_>>(), [[1, 2, 3, 4]]);
    rig.bench.message(exclude(77, false));
    assert_eq!(rig.faults(), [(Fault::CommandForbidden, Severity::Warning)]);
}

#[test]
fn without_odometry_the_drives_carry_it_no_better_than_coarse() {
    let mut rig = Rig::new();
    rig.drive(10);
    rig.faults();
    rig.odometry = false;
    rig.drive(5);
    assert_eq!(rig.faults(), [(Fault::OdometrySilent, Severity::Error)]);
    rig.drive(1);
    let last = rig.estimates().pop().unwrap();
    let truth = rig.pose(last.timestamp as f64 * 1e-6);
    assert_eq!(last.quality, DataEstimate::COARSE);
    assert!(libm::hypot(last.x - truth.x, last.y - truth.y) < 0.1, "{last:?} {truth:?}");
    rig.odometry = true;
    rig.drive(2);
    assert_eq!(rig.faults(), [(Fault::OdometrySilent, Severity::Notice)]);
}

#[test]
fn without_odometry_and_drives_it_is_lost_soon() {
    let mut rig = Rig::new();
    rig.drive(10);
    (rig.odometry, rig.drives) = (false, false);
    rig.faults();
    for _ in 0..400 {
        rig.bench.pass(PERIOD);
    }
    let estimates = rig.estimates();
    assert_eq!(estimates.last().unwrap().quality, DataEstimate::LOST);
}

#[test]
fn odometry_that_stands_while_the_drives_move_is_not_believed() {
    let mut rig = Rig::new();
    rig.drive(10);
    rig.faults();
    rig.stuck = true;
    rig.drive(6);
    let faults = rig.faults();
    assert!(faults.contains(&(Fault::OdometryStuck, Severity::Error)), "{faults:?}");
    rig.drive(1);
    let last = rig.estimates().pop().unwrap();
    let truth = rig.pose(last.timestamp as f64 * 1e-6);
    assert!(libm::hypot(last.x - truth.x, last.y - truth.y) < 0.3, "{last:?} {truth:?}");
    rig.stuck = false;
    rig.drive(3);
    assert!(rig.faults().contains(&(Fault::OdometryStuck, Severity::Notice)));
}

#[test]
fn the_pose_can_be_set_by_hand_and_nonsense_cannot() {
    let mut rig = Rig::new();
    rig.drive(1);
    let covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]];
    let truth = rig.pose(rig.at());
    rig.bench.message(CmdEstimate { timestamp: 0, x: truth.x, y: truth.y, theta: 0.0, covariance });
    rig.bench.pass(PERIOD);
    assert_eq!(rig.estimates().pop().unwrap().quality, DataEstimate::FINE);
    rig.bench.message(CmdEstimate { timestamp: 0, x: f64::NAN, y: 6.0, theta: 0.0, covariance });
    assert_eq!(rig.faults(), [(Fault::MeasurementBad, Severity::Warning)]);
}

#[test]
fn a_beacon_that_is_not_on_the_map_is_told_once() {
    let mut rig = Rig::new();
    rig.drive(1);
    rig.faults();
    for _ in 0..3 {
        let timestamp = (rig.at() * 1e6) as i64;
        let beacon = lowlevel::Beacon { timestamp, id: 77, bearing: 0.3, strength: 0.5 };
        rig.bench.message(lowlevel::DataBeacons { timestamp, beacons: vec![beacon] });
        rig.bench.pass(PERIOD);
    }
    assert_eq!(rig.faults(), [(Fault::BeaconUnknown, Severity::Warning)]);
}

#[test]
fn in_stop_it_is_silent_and_knows_where_it_is_afterwards() {
    let mut rig = Rig::new();
    rig.drive(10);
    let command = |state: State| messages::common::CmdState {
        module: NAME.into(),
        state: state as i8,
        manual: true,
        ..Default::default()
    };
    rig.bench.message(command(State::Stop));
    rig.estimates();
    rig.drive(3);
    assert_eq!(rig.estimates().len(), 0);
    rig.bench.message(command(State::Run));
    rig.drive(1);
    assert_eq!(rig.estimates().pop().unwrap().quality, DataEstimate::FINE);
}

#[test]
fn a_clock_that_is_another_s_does_no_harm() {
    let epoch = Epoch { offset_us: 1_000_000 };
    let came = Instant::from_millis(5000);
    assert_eq!(moment(epoch, 5_990_000, came), Instant::from_millis(4990));
    for timestamp in [0, -5, 5_000_000, 7_000_000, i64::MAX, i64::MIN] {
        assert_eq!(moment(epoch, timestamp, came), came);
    }
}

const DRIVEN: Wheels = Wheels::Driven { radius_m: 0.21 };

#[test]
fn while_wheels_slip_the_rotation_is_that_of_the_inertial_unit_and_the_way_is_uncertain() {
    let off = |imu: Option<&str>| {
        let mut rig = Rig::with(DRIVEN, Twist::new(0.3, 0.0, 0.1), imu);
        rig.drive(15);
        (rig.beacons, rig.slip) = (false, 0.5);
        let before = rig.estimates().pop().unwrap();
        let begun = rig.bench.now();
        rig.drive(4);
        let reports: Vec<_> = rig.bench.done();
        let slip = |(at, action): &(Instant, Action)| match action {
            Action::Report(report) if report.fault == Fault::RotationDisagrees => Some((*at, report.severity)),
            _ => None,
        };
        let slips: Vec<_> = reports.iter().filter_map(slip).collect();
        let estimate = |(_, action)| match action {
            Action::Publish(Message::MlDataEstimate(estimate)) => Some(estimate),
            _ => None,
        };
        let after = reports.into_iter().filter_map(estimate).last().unwrap();
        let truth = rig.pose(after.timestamp as f64 * 1e-6);
        let heading = wrap(after.theta - truth.theta.radians()).abs();
        let grown = |after: &DataEstimate, before: &DataEstimate| after.covariance[0][0] - before.covariance[0][0];
        (heading, slips, begun, grown(&after, &before) + after.covariance[1][1] - before.covariance[1][1])
    };
    let (by_wheels, none, ..) = off(None);
    let (by_unit, slips, begun, grown) = off(Some("base"));
    assert!(by_wheels > 1.5 && none.is_empty(), "{by_wheels} {none:?}");
    assert!(by_unit < 0.05, "{by_unit}");
    assert!(slips.len() == 1 && slips[0].1 == Severity::Warning, "{slips:?}");
    assert!(slips[0].0.since(begun) <= Duration::from_millis(400), "{slips:?}");
    // 0.3 m/√m and 0.2 m/√s over 1.2 m and 4 s.
    assert!((0.15..0.6).contains(&grown), "{grown}");
}

#[test]
fn a_unit_that_is_silent_or_not_ok_changes_nothing_and_its_return_is_used() {
    let run = |imu: Option<&str>, status: Option<i8>| {
        let mut rig = Rig::with(DRIVEN, Twist::new(0.3, 0.0, 0.2), imu);
        rig.imu = status;
        rig.drive(10);
        rig.estimates()
    };
    let without = run(None, None);
    assert_eq!(run(Some("base"), None), without);
    assert_eq!(run(Some("base"), Some(lowlevel::DataImu::FAULT)), without);
    assert_eq!(run(Some("top"), Some(lowlevel::DataImu::OK)), without, "of another unit");
    let with = run(Some("base"), Some(lowlevel::DataImu::OK));
    assert_ne!(with, without);
    let mut rig = Rig::with(DRIVEN, Twist::new(0.3, 0.0, 0.1), Some("base"));
    rig.imu = None;
    rig.drive(12);
    rig.imu = Some(lowlevel::DataImu::OK);
    rig.drive(1);
    (rig.beacons, rig.slip) = (false, 0.5);
    rig.drive(3);
    let after = rig.estimates().pop().unwrap();
    let truth = rig.pose(after.timestamp as f64 * 1e-6);
    assert!(wrap(after.theta - truth.theta.radians()).abs() < 0.05, "{after:?} {truth:?}");
}
