//! The estimator on the simulated robot: what it says beside where the body is.

use super::{Robot, command};
use base::{Duration, Fault, Instant};
use messages::middlelevel::{CmdEstimate, DataEstimate};
use messages::simulation::{CmdFault, DataTruth};
use messages::{Message, common};
use sim::host::News;
use std::cell::RefCell;
use std::rc::Rc;

#[derive(Default)]
struct Told {
    truth: DataTruth,
    /// When, the estimate, how far it is off (m), and how far its heading is (rad).
    estimates: Vec<(Instant, DataEstimate, f64, f64)>,
    errors: Vec<common::Error>,
}

/// A robot that is observed from its start on.
fn observed(seed: u64) -> (Robot, Rc<RefCell<Told>>) {
    let mut robot = Robot::new(seed);
    let told = Rc::new(RefCell::new(Told::default()));
    let keep = told.clone();
    robot.machine.observe(move |now, news| {
        let News::Message { message, .. } = news else { return };
        let mut told = keep.borrow_mut();
        match message {
            Message::SimDataTruth(truth) => told.truth = truth.clone(),
            Message::CmEventError(error) => told.errors.push(error.clone()),
            Message::MlDataEstimate(estimate) => {
                let off = length(estimate.x - told.truth.x, estimate.y - told.truth.y);
                let turned = navitools::wrap(estimate.theta - told.truth.theta).abs();
                told.estimates.push((now, estimate.clone(), off, turned));
            }
            _ => {}
        }
    });
    robot.machine.run_until(super::at(12.0));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    (robot, told)
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
    let (mut robot, told) = observed(1);
    round(&mut robot, 60.0);
    let told = told.borrow();
    let located = told.estimates.iter().find(|(_, estimate, ..)| estimate.quality >= DataEstimate::COARSE);
    let (first, ..) = located.expect("it is located");
    assert!(*first < super::at(12.0), "it needs no motion to be located: {first:?}");
    let count = told.estimates.len();
    let begin = told.estimates[0].0;
    let rate = count as f64 / told.estimates[count - 1].0.since(begin).as_secs_f64();
    assert!((rate - 20.0).abs() < 0.2, "{rate} Hz");
    let late: Vec<_> = told.estimates.iter().filter(|(at, ..)| *at > super::at(32.0)).collect();
    assert!(late.iter().all(|(_, estimate, ..)| estimate.quality == DataEstimate::FINE));
    let worst = late.iter().map(|(.., off, _)| *off).fold(0.0, f64::max);
    let mean = late.iter().map(|(.., off, _)| off).sum::<f64>() / late.len() as f64;
    assert!(worst < 0.35 && mean < 0.12, "worst {worst} m, mean {mean} m");
    let turned = late.iter().map(|(.., turned)| *turned).fold(0.0, f64::max);
    assert!(turned < 0.15, "{turned} rad");
    // What it says of itself is true.
    let square = |(_, estimate, off, _): &&(Instant, DataEstimate, f64, f64)| {
        off * off / (estimate.covariance[0][0] + estimate.covariance[1][1])
    };
    let ratio = late.iter().map(square).sum::<f64>() / late.len() as f64;
    assert!(ratio < 5.0, "{ratio}");
}

#[test]
fn without_beacons_it_goes_by_odometry_and_by_hand() {
    let (mut robot, told) = observed(2);
    fault(&mut robot, "sbs1", "hidden", 0.0);
    round(&mut robot, 20.0);
    let (_, last, off, _) = told.borrow().estimates.last().cloned().expect("20 Hz");
    assert!(last.quality >= DataEstimate::COARSE && off < 1.0, "{last:?} {off}");
    let covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]];
    let DataTruth { x, y, theta, .. } = told.borrow().truth.clone();
    let now = robot.machine.now();
    robot.machine.inject(now, CmdEstimate { timestamp: 0, x: x + 0.1, y, theta, covariance });
    robot.pass(0.2);
    let (_, last, off, _) = told.borrow().estimates.last().cloned().expect("20 Hz");
    assert!(last.quality == DataEstimate::FINE && (off - 0.1).abs() < 0.02, "{last:?} {off}");
}

#[test]
fn encoders_that_stand_while_it_drives_are_told_and_do_not_mislead_it_for_long() {
    let (mut robot, told) = observed(3);
    round(&mut robot, 30.0);
    fault(&mut robot, "so1", "stuck", 0.0);
    round(&mut robot, 20.0);
    let told = told.borrow();
    let number = Fault::OdometryStuck as i32;
    assert!(told.errors.iter().any(|error| error.number == number && error.module == "estimator"));
    let (end, last, off, _) = told.estimates.last().expect("20 Hz");
    assert!(last.quality < DataEstimate::FINE && *off < 1.0, "{last:?} {off}");
    let since = *end - Duration::from_secs(15);
    let honest = |(_, estimate, off, _): &(Instant, DataEstimate, f64, f64)| {
        *off < 10.0 * (estimate.covariance[0][0] + estimate.covariance[1][1]).sqrt()
    };
    assert!(told.estimates.iter().filter(|(at, ..)| *at > since).all(honest));
}

#[test]
fn standing_it_stays_where_it_is() {
    let (mut robot, told) = observed(4);
    let now = robot.machine.now();
    robot.machine.inject(now, command(0.0, 0.0));
    robot.pass(60.0);
    let told = told.borrow();
    let late: Vec<_> = told.estimates.iter().filter(|(at, ..)| *at > super::at(25.0)).collect();
    let moved = |(_, estimate, ..): &&(Instant, DataEstimate, f64, f64)| {
        length(estimate.x - late[0].1.x, estimate.y - late[0].1.y)
    };
    assert!(late.iter().map(moved).fold(0.0, f64::max) < 1e-3);
    assert!(late.iter().all(|(_, estimate, off, _)| *off < 0.4 && estimate.quality >= DataEstimate::COARSE));
}
