//! Estimator on the simulated robot: its output compared with the true pose.

use super::{Robot, command};
use base::{Duration, Fault, Instant};
use messages::middlelevel::{CmdBeaconUse, CmdEstimate, CmdGoal, DataBeaconUse, DataEstimate, Waypoint};
use messages::simulation::{CmdFault, DataTruth};
use messages::{Message, common};
use sim::host::News;
use std::cell::RefCell;
use std::rc::Rc;

#[derive(Default)]
struct Observed {
    truth: DataTruth,
    /// Instant, estimate, position error (m) and heading error (rad).
    estimates: Vec<(Instant, DataEstimate, f64, f64)>,
    errors: Vec<common::Error>,
    /// Reception of a sighting, its timestamp, and the beacon.
    sightings: Vec<(Instant, i64, i32)>,
    uses: Vec<(Instant, DataBeaconUse)>,
    /// Speeds, m/s.
    speeds: Vec<(Instant, f64)>,
}

/// Robot that is observed from its start on.
fn observed(seed: u64) -> (Robot, Rc<RefCell<Observed>>) {
    let mut robot = Robot::new(seed);
    let seen = Rc::new(RefCell::new(Observed::default()));
    let keep = seen.clone();
    robot.machine.observe(move |now, news| {
        let News::Message { message, .. } = news else { return };
        let mut seen = keep.borrow_mut();
        match message {
            Message::SimDataTruth(truth) => {
                seen.speeds.push((now, truth.speed));
                seen.truth = truth.clone();
            }
            Message::LlDataBeacons(data) => {
                seen.sightings.extend(data.beacons.iter().map(|beacon| (now, beacon.timestamp, beacon.id)));
            }
            Message::MlDataBeaconUse(uses) => seen.uses.push((now, uses.clone())),
            Message::CmEventError(error) => seen.errors.push(error.clone()),
            Message::MlDataEstimate(estimate) => {
                let off = length(estimate.x - seen.truth.x, estimate.y - seen.truth.y);
                let turned = navitools::wrap(estimate.theta - seen.truth.theta).abs();
                seen.estimates.push((now, estimate.clone(), off, turned));
            }
            _ => {}
        }
    });
    robot.machine.run_until(super::at(12.0));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    (robot, seen)
}

fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

fn fault(robot: &mut Robot, target: &str, fault: &str, value: f64) {
    let message = CmdFault { timestamp: 0, target: target.into(), fault: fault.into(), value, duration: 0.0 };
    let now = robot.machine.now();
    robot.machine.inject(now, message);
}

/// Drives in a circle of 2 m, which is free around the start of the hall.
fn round(robot: &mut Robot, seconds: f64) {
    robot.drive(0.5, 0.29, seconds);
    robot.pass(seconds);
}

#[test]
fn it_finds_the_robot_by_itself_and_follows_it() {
    let (mut robot, seen) = observed(1);
    round(&mut robot, 60.0);
    let seen = seen.borrow();
    let located = seen.estimates.iter().find(|(_, estimate, ..)| estimate.quality >= DataEstimate::COARSE);
    let (first, ..) = located.expect("it is located");
    assert!(*first < super::at(12.0), "it needs no motion to be located: {first:?}");
    let count = seen.estimates.len();
    let begin = seen.estimates[0].0;
    let rate = count as f64 / seen.estimates[count - 1].0.since(begin).as_secs_f64();
    assert!((rate - 20.0).abs() < 0.2, "{rate} Hz");
    let late: Vec<_> = seen.estimates.iter().filter(|(at, ..)| *at > super::at(32.0)).collect();
    assert!(late.iter().all(|(_, estimate, ..)| estimate.quality == DataEstimate::FINE));
    let worst = late.iter().map(|(.., off, _)| *off).fold(0.0, f64::max);
    let mean = late.iter().map(|(.., off, _)| off).sum::<f64>() / late.len() as f64;
    assert!(worst < 0.35 && mean < 0.12, "worst {worst} m, mean {mean} m");
    let turned = late.iter().map(|(.., turned)| *turned).fold(0.0, f64::max);
    assert!(turned < 0.15, "{turned} rad");
    // Its own covariance is consistent.
    let square = |(_, estimate, off, _): &&(Instant, DataEstimate, f64, f64)| {
        off * off / (estimate.covariance[0][0] + estimate.covariance[1][1])
    };
    let ratio = late.iter().map(square).sum::<f64>() / late.len() as f64;
    assert!(ratio < 5.0, "{ratio}");
}

#[test]
fn without_beacons_it_uses_odometry_and_poses_set_by_hand() {
    let (mut robot, seen) = observed(2);
    fault(&mut robot, "sbs1", "hidden", 0.0);
    round(&mut robot, 20.0);
    let (_, last, off, _) = seen.borrow().estimates.last().cloned().expect("20 Hz");
    assert!(last.quality >= DataEstimate::COARSE && off < 1.0, "{last:?} {off}");
    let covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]];
    let DataTruth { x, y, theta, .. } = seen.borrow().truth.clone();
    let now = robot.machine.now();
    robot.machine.inject(now, CmdEstimate { timestamp: 0, x: x + 0.1, y, theta, covariance });
    robot.pass(0.2);
    let (_, last, off, _) = seen.borrow().estimates.last().cloned().expect("20 Hz");
    assert!(last.quality == DataEstimate::FINE && (off - 0.1).abs() < 0.02, "{last:?} {off}");
}

#[test]
fn blocked_encoders_are_reported_and_mislead_the_estimator_only_briefly() {
    let (mut robot, seen) = observed(3);
    round(&mut robot, 30.0);
    fault(&mut robot, "so1", "stuck", 0.0);
    round(&mut robot, 20.0);
    let seen = seen.borrow();
    let number = Fault::OdometryStuck as i32;
    assert!(seen.errors.iter().any(|error| error.number == number && error.module == "estimator"));
    let (end, last, off, _) = seen.estimates.last().expect("20 Hz");
    assert!(last.quality < DataEstimate::FINE && *off < 1.0, "{last:?} {off}");
    let since = *end - Duration::from_secs(15);
    let honest = |(_, estimate, off, _): &(Instant, DataEstimate, f64, f64)| {
        *off < 10.0 * (estimate.covariance[0][0] + estimate.covariance[1][1]).sqrt()
    };
    assert!(seen.estimates.iter().filter(|(at, ..)| *at > since).all(honest));
}

#[test]
fn at_standstill_the_estimate_does_not_drift() {
    let (mut robot, seen) = observed(4);
    let now = robot.machine.now();
    robot.machine.inject(now, command(0.0, 0.0));
    robot.pass(60.0);
    let seen = seen.borrow();
    let late: Vec<_> = seen.estimates.iter().filter(|(at, ..)| *at > super::at(25.0)).collect();
    let moved = |(_, estimate, ..): &&(Instant, DataEstimate, f64, f64)| {
        length(estimate.x - late[0].1.x, estimate.y - late[0].1.y)
    };
    assert!(late.iter().map(moved).fold(0.0, f64::max) < 1e-3);
    assert!(late.iter().all(|(_, estimate, off, _)| *off < 0.4 && estimate.quality >= DataEstimate::COARSE));
}

/// Kidnaps the robot while it moves as before, and checks the requirements: within three sweeps, of a second each, it
/// no longer reports FINE; within five seconds after the third beacon it knows its pose.
fn carry_off(robot: &mut Robot, seen: &RefCell<Observed>, number: f64) -> Instant {
    let then = robot.machine.now();
    let before = seen.borrow().truth.clone();
    assert_eq!(seen.borrow().estimates.last().map(|(_, last, ..)| last.quality), Some(DataEstimate::FINE));
    fault(robot, "robot", "kidnap", number);
    robot.pass(0.1);
    let there = seen.borrow().truth.clone();
    assert!(length(there.x - before.x, there.y - before.y) > 1.0, "{there:?}");
    robot.pass(14.9);
    let seen = seen.borrow();
    let mut after = seen.estimates.iter().filter(|(at, ..)| *at > then);
    let (uneasy, ..) = after.find(|(_, estimate, ..)| estimate.quality < DataEstimate::FINE).expect("it is noticed");
    assert!(uneasy.since(then) <= Duration::from_secs(3), "noticed after {:?}", uneasy.since(then));
    let mut beacons = Vec::new();
    let third = seen.sightings.iter().filter(|(_, stamp, _)| *stamp > there.timestamp).find(|(.., id)| {
        if !beacons.contains(id) {
            beacons.push(*id);
        }
        beacons.len() == 3
    });
    let (third, ..) = third.expect("three beacons are in sight from there");
    let right = |(_, estimate, off, turned): &&(Instant, DataEstimate, f64, f64)| {
        estimate.quality >= DataEstimate::COARSE && *off < 0.5 && *turned < 0.2
    };
    let (found, ..) = after.find(right).expect("it finds itself");
    assert!(found.since(*third) <= Duration::from_secs(5), "found after {:?}", found.since(*third));
    then
}

#[test]
fn a_kidnapping_at_standstill_is_noticed_and_the_pose_found_again() {
    for (seed, number) in [(5, 1.0), (6, 3.0), (7, 4.0)] {
        let (mut robot, seen) = observed(seed);
        round(&mut robot, 20.0);
        robot.pass(10.0);
        assert!(robot.speed().abs() < 1e-3, "it stands");
        carry_off(&mut robot, &seen, number);
    }
}

#[test]
fn a_kidnapping_on_the_way_to_a_goal_stops_the_robot_and_the_pose_is_found_again() {
    for (seed, number) in [(8, 1.0), (9, 2.0)] {
        let (mut robot, seen) = observed(seed);
        let waypoints = vec![Waypoint { x: 12.5, y: 6.0, ..Default::default() }];
        let now = robot.machine.now();
        robot.machine.inject(now, CmdGoal { id: 1, waypoints, ..Default::default() });
        robot.pass(10.0);
        assert!(robot.speed().abs() > 0.1, "the planner drives: {}", robot.speed());
        let then = carry_off(&mut robot, &seen, number);
        let seen = seen.borrow();
        let stopped = seen.speeds.iter().find(|(at, speed)| *at > then && speed.abs() < 0.01);
        let (stopped, _) = stopped.expect("it stops");
        assert!(stopped.since(then) <= Duration::from_secs(5), "stopped after {:?}", stopped.since(then));
        let late = seen.speeds.iter().filter(|(at, _)| at > stopped);
        assert!(late.map(|(_, speed)| speed.abs()).fold(0.0, f64::max) < 0.01, "it drove on by itself");
    }
}

#[test]
fn each_beacon_is_reported_and_an_excluded_one_is_not_looked_for() {
    let (mut robot, seen) = observed(10);
    round(&mut robot, 30.0);
    let (at, last) = seen.borrow().uses.last().cloned().expect("1 Hz");
    assert!(robot.machine.now().since(at) <= Duration::from_secs(1) && last.beacons.len() == 6, "{last:?}");
    let used: Vec<_> = last.beacons.iter().filter(|beacon| beacon.accepted > 10).collect();
    assert!(used.len() >= 3, "{last:?}");
    for beacon in &used {
        // Nothing lies: the residuals are those of the pose's accuracy, 6 deviations at most.
        assert!(beacon.active && beacon.permitted && beacon.deviation > 0.0, "{beacon:?}");
        assert!(!beacon.fits || beacon.residual.abs() < 6.0 * beacon.deviation, "{beacon:?}");
        assert!(beacon.refused * 5 < beacon.accepted, "{beacon:?}");
    }
    let id = used[0].id;
    let now = robot.machine.now();
    robot.machine.inject(now, CmdBeaconUse { timestamp: 0, id, permitted: false });
    // The scanner finishes its sweep.
    robot.pass(4.0);
    let then = robot.machine.now();
    round(&mut robot, 20.0);
    let now = robot.machine.now();
    let seen_since = |id: i32| seen.borrow().sightings.iter().any(|(at, _, seen)| *at > then && *seen == id);
    assert!(!seen_since(id) && used[1..].iter().any(|beacon| seen_since(beacon.id)));
    let (_, last) = seen.borrow().uses.last().cloned().expect("1 Hz");
    let excluded = last.beacons.iter().find(|beacon| beacon.id == id).expect("it stays on the map");
    assert!(!excluded.active && !excluded.permitted, "{excluded:?}");
    assert!(seen.borrow().estimates.last().is_some_and(|(_, estimate, ..)| estimate.quality >= DataEstimate::COARSE));
    robot.machine.inject(now, CmdBeaconUse { timestamp: 0, id: CmdBeaconUse::ALL, permitted: true });
    robot.pass(0.2);
    let (_, last) = seen.borrow().uses.last().cloned().expect("at once");
    assert!(last.beacons.iter().all(|beacon| beacon.permitted && beacon.active), "{last:?}");
}
