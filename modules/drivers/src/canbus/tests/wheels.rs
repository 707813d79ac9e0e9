//! Bases without steering: a drive for each wheel, all commanded as one body.

use super::super::{Cia402, Cia402Config, protection};
use super::*;
use canopen::eds::Eds;
use settings::Section as _;
use settings::robot::{Base, Circle, Differential, Layout, Rectangle};
use std::sync::Arc;

/// Motor speed at 1 m/s.
const RPM_PER_MPS: f64 = 2483.0;
/// Half of the track, m.
const HALF_TRACK: f64 = 0.21;
const DIFFERENTIAL: Base =
    Base { layout: Layout::Differential(Differential { track_m: 2.0 * HALF_TRACK }), strain: 0.3 };
const MECANUM: Base = Base { layout: Layout::Mecanum(Rectangle { wheelbase_m: 0.4, track_m: 0.4 }), strain: 0.3 };
const OMNI: Base = Base { layout: Layout::Omni(Circle { radius_m: 0.25, wheels: 3, first_rad: 0.0 }), strain: 0.3 };

fn configured(base: Base) -> Config {
    let axes = [
        Axis::Left,
        Axis::Right,
        Axis::FrontLeft,
        Axis::FrontRight,
        Axis::RearLeft,
        Axis::RearRight,
        Axis::Wheel1,
        Axis::Wheel2,
        Axis::Wheel3,
    ];
    let axis = |name: &&str| axes.into_iter().find(|axis| axis.name() == *name).expect("an axis");
    let wheel = |(n, axis)| PropulsionConfig { axis, node: n, drive: epos_with(RPM_PER_MPS), writable: Vec::new() };
    let wheels = (1..).zip(base.axes().iter().map(axis)).map(wheel).collect();
    Config { base: Some(base), wheels, steering: None, ..config() }
}

/// Booted, without a command.
fn ready(config: Config) -> Robot {
    let nodes: Vec<u8> = config.wheels.iter().map(|wheel| wheel.node).collect();
    let mut robot = Robot::with(epos::dictionary(1), config);
    robot.icla = Fake::new(epos::dictionary(2), 6);
    robot.more = nodes[2..].iter().map(|node| Fake::new(epos::dictionary(*node), 6)).collect();
    robot.pass(1000);
    assert_eq!(robot.bench.shell.state(), State::Run);
    assert!(robot.motion().homed, "{}", robot.reason());
    robot.frames.clear();
    robot
}

fn say(robot: &mut Robot, (vx, vy, omega): (f64, f64, f64)) {
    let priority = lowlevel::CmdMotion::REMOTE;
    let command = lowlevel::CmdVelocity { timestamp: 0, vx, vy, omega, priority, source: "test".into(), session: 1 };
    robot.bench.message(command);
    robot.exchange();
}

/// Commands at 20 Hz.
fn drive(robot: &mut Robot, twist: (f64, f64, f64), ms: u32) {
    for _ in 0..ms / 50 {
        say(robot, twist);
        robot.pass(50);
    }
}

/// Speeds of the wheels, m/s.
fn wheels(robot: &Robot) -> Vec<f64> {
    let drives = [&robot.epos, &robot.icla].into_iter().chain(&robot.more);
    drives.map(|drive| drive.node.get(0x606C, 0).unwrap() as f64 / RPM_PER_MPS).collect()
}

fn assert_wheels(robot: &Robot, expected: &[f64]) {
    let found = wheels(robot);
    let near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1.0 / RPM_PER_MPS);
    assert!(near && found.len() == expected.len(), "{found:?} instead of {expected:?}: {}", robot.reason());
}

fn assert_velocity(robot: &Robot, expected: (f64, f64, f64)) {
    let lowlevel::DataVelocity { vx, vy, omega, vx_target, vy_target, omega_target, .. } = *robot.velocity();
    for (measured, target, expected) in
        [(vx, vx_target, expected.0), (vy, vy_target, expected.1), (omega, omega_target, expected.2)]
    {
        let near = |found: f64| (found - expected).abs() < 0.003;
        assert!(near(measured) && near(target), "{:?}", robot.velocity());
    }
}

#[test]
fn two_wheels_drive_a_curve_and_turn_on_the_spot() {
    let mut robot = ready(configured(DIFFERENTIAL));
    drive(&mut robot, (0.4, 0.0, 0.5), 1500);
    assert_wheels(&robot, &[0.4 - 0.5 * HALF_TRACK, 0.4 + 0.5 * HALF_TRACK]);
    assert_velocity(&robot, (0.4, 0.0, 0.5));
    // The same curve of a base that steers.
    let lowlevel::DataMotion { speed, steering, .. } = *robot.motion();
    assert!((speed - 0.4).abs() < 1e-3 && (steering - libm::atan(0.5 * 0.6 / 0.4)).abs() < 3e-3, "{speed} {steering}");
    drive(&mut robot, (0.0, 0.0, -0.8), 2000);
    assert_wheels(&robot, &[0.8 * HALF_TRACK, -0.8 * HALF_TRACK]);
    assert_velocity(&robot, (0.0, 0.0, -0.8));
    assert_eq!(robot.holds(), []);
    drive(&mut robot, (0.0, 0.0, 0.0), 1000);
    assert_wheels(&robot, &[0.0, 0.0]);
}

#[test]
fn wheels_accelerate_together_so_that_the_curve_is_kept() {
    let mut robot = ready(configured(DIFFERENTIAL));
    say(&mut robot, (0.0, 0.0, 0.0));
    let wanted = (0.5 - 0.6 * HALF_TRACK) / (0.5 + 0.6 * HALF_TRACK);
    let mut steps = 0;
    for _ in 0..30 {
        say(&mut robot, (0.5, 0.0, 0.6));
        for _ in 0..50 {
            robot.pass(1);
            let [left, right] = wheels(&robot)[..] else { panic!("two wheels") };
            if right > 0.05 {
                assert!((left / right - wanted).abs() < 0.02, "{left} {right}");
                steps += 1;
            }
        }
    }
    assert!(steps > 500, "{steps}");
    // 0.5 m/s² of the faster wheel.
    assert_velocity(&robot, (0.5, 0.0, 0.6));
}

#[test]
fn a_command_of_speed_and_angle_drives_the_curve_of_a_base_that_steers() {
    let mut robot = ready(configured(DIFFERENTIAL));
    let steering = libm::atan(0.3);
    for _ in 0..30 {
        robot.command(0.4, steering);
        robot.pass(50);
    }
    // A radius of 2 m.
    assert_velocity(&robot, (0.4, 0.0, 0.2));
    assert!((robot.motion().steering_target - steering).abs() < 1e-9);
}

#[test]
fn four_mecanum_wheels_and_three_omni_wheels_move_sideways() {
    let mut robot = ready(configured(MECANUM));
    drive(&mut robot, (0.0, 0.3, 0.0), 1500);
    assert_wheels(&robot, &[-0.3, 0.3, 0.3, -0.3]);
    assert_velocity(&robot, (0.0, 0.3, 0.0));
    assert_eq!(robot.holds(), []);
    let mut robot = ready(configured(OMNI));
    drive(&mut robot, (0.0, -0.3, 0.4), 1500);
    let back = 0.3 / 2.0 + 0.4 * 0.25;
    assert_wheels(&robot, &[-0.3 + 0.4 * 0.25, back, back]);
    assert_velocity(&robot, (0.0, -0.3, 0.4));
}

#[test]
fn what_the_base_cannot_do_or_exceeds_its_limits() {
    let mut robot = ready(configured(DIFFERENTIAL));
    drive(&mut robot, (0.3, 0.2, 0.0), 1500);
    assert_velocity(&robot, (0.3, 0.0, 0.0));
    assert_eq!(robot.holds(), [(Hold::NoSideways, "test")]);
    // Beyond limits.rotation_radps.
    say(&mut robot, (0.0, 0.0, 1.01));
    assert!(robot.errors.contains(&(Fault::MotionRefused, Severity::Error)));
    robot.pass(100);
    assert_wheels(&robot, &[0.0, 0.0]);
    robot.home();
    assert!(robot.errors.contains(&(Fault::CommandForbidden, Severity::Warning)), "there is nothing to home");
}

#[test]
fn all_wheels_stop_if_one_is_in_fault_lost_or_does_not_follow() {
    type Harm = fn(&mut Robot);
    let harms: [(&str, Harm, u32); 5] = [
        ("fault", |robot| robot.more[1].fault(robot.bench.now(), 0x7300), 0),
        ("reset", |robot| robot.more[1].power_on(robot.bench.now()), 10),
        ("dead", |robot| robot.more[1].alive = false, 250),
        ("mute", |robot| robot.more[1].silent = true, 250),
        // One command later, and 200 ms after it is measured.
        ("blocked", |robot| robot.more[1].blocked = true, 300),
    ];
    for (what, harm, within_ms) in harms {
        let mut robot = ready(configured(MECANUM));
        drive(&mut robot, (0.4, 0.0, 0.0), 1500);
        assert_wheels(&robot, &[0.4; 4]);
        harm(&mut robot);
        robot.exchange();
        let mut ms = 0;
        while wheels(&robot)[..3].iter().any(|speed| *speed != 0.0) {
            assert!(ms <= within_ms, "{what}: {:?} after {ms} ms", wheels(&robot));
            // Commands go on, and so does a motor that is blocked.
            say(&mut robot, (0.4, 0.0, 0.0));
            robot.pass(1);
            ms += 1;
        }
        drive(&mut robot, (0.4, 0.0, 0.0), 500);
        assert_wheels(&robot, &[0.0; 4][..3].iter().copied().chain([wheels(&robot)[3]]).collect::<Vec<_>>());
        assert!(!robot.reason().is_empty(), "{what}");
    }
}

#[test]
fn wheels_that_contradict_each_other_stop_the_robot() {
    let mut robot = ready(configured(MECANUM));
    drive(&mut robot, (0.2, 0.0, 0.0), 1500);
    // Less than what a wheel by itself may be off: 0.02 m/s root mean square of all.
    robot.more[1].misread = (0.09 * RPM_PER_MPS) as i64;
    drive(&mut robot, (0.21, 0.0, 0.0), 250);
    assert!(robot.holds().is_empty() && robot.velocity().residual > 0.02, "{:?}", robot.velocity());
    drive(&mut robot, (0.21, 0.0, 0.0), 150);
    assert!(robot.errors.contains(&(Fault::WheelsDisagree, Severity::Error)));
    robot.more[1].misread = 0;
    drive(&mut robot, (0.21, 0.0, 0.0), 500);
    assert_wheels(&robot, &[0.0; 4]);
    assert!(robot.errors.contains(&(Fault::WheelsDisagree, Severity::Notice)), "over at standstill");
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")]);
    drive(&mut robot, (0.0, 0.0, 0.0), 200);
    drive(&mut robot, (0.2, 0.0, 0.0), 1500);
    assert_wheels(&robot, &[0.2; 4]);
    // A base of two wheels on two motions fits any measurement.
    let mut robot = ready(configured(DIFFERENTIAL));
    drive(&mut robot, (0.2, 0.0, 0.0), 1500);
    robot.icla.misread = (0.09 * RPM_PER_MPS) as i64;
    drive(&mut robot, (0.21, 0.0, 0.0), 1500);
    assert_eq!(robot.holds(), []);
}

#[test]
fn a_slow_wheel_that_stands_stops_the_robot_as_well() {
    let mut robot = ready(configured(DIFFERENTIAL));
    // 0.06 and 0.34 m/s.
    let curve = (0.2, 0.0, 0.14 / HALF_TRACK);
    drive(&mut robot, curve, 1500);
    robot.epos.blocked = true;
    for _ in 0..8 {
        say(&mut robot, (0.2, 0.0, curve.2 - 0.01));
        robot.pass(50);
    }
    assert_eq!(robot.holds()[0], (Hold::DriveNoTarget, "left"), "{:?}", wheels(&robot));
}

#[test]
fn no_wheel_turns_before_all_are_enabled() {
    let mut robot = ready(configured(DIFFERENTIAL));
    robot.icla.stubborn = true;
    robot.drive(0.0, 100);
    for _ in 0..40 {
        say(&mut robot, (0.3, 0.0, 0.0));
        robot.pass(50);
        assert_wheels(&robot, &[0.0, 0.0]);
    }
    robot.icla.stubborn = false;
    robot.drive(0.0, 1500);
    drive(&mut robot, (0.3, 0.0, 0.0), 1500);
    assert_wheels(&robot, &[0.3, 0.3]);
}

#[test]
fn the_bounds_of_the_guard_hold_in_every_direction() {
    let protection = protection::Config { guarded: true, ..protection::Config::default() };
    let bounds = |robot: &mut Robot| {
        let guard = lowlevel::DataGuard { forward: 0.3, left: 0.1, turn_left: 0.2, ..lowlevel::DataGuard::default() };
        robot.bench.message(guard);
    };
    let settle = |base, twist| {
        let mut robot = ready(Config { protection, ..configured(base) });
        for _ in 0..60 {
            bounds(&mut robot);
            say(&mut robot, twist);
            robot.pass(50);
        }
        robot
    };
    let robot = settle(MECANUM, (0.0, 0.4, 0.0));
    assert_velocity(&robot, (0.0, 0.1, 0.0));
    assert_eq!(robot.holds(), [(Hold::GuardBounds, "")]);
    let robot = settle(MECANUM, (0.0, -0.4, 0.0));
    assert_velocity(&robot, (0.0, 0.0, 0.0));
    let robot = settle(DIFFERENTIAL, (0.0, 0.0, 0.8));
    assert_velocity(&robot, (0.0, 0.0, 0.2));
    let robot = settle(DIFFERENTIAL, (0.0, 0.0, -0.8));
    assert_velocity(&robot, (0.0, 0.0, 0.0));
    // No field covers motion to the side while it drives.
    let robot = settle(MECANUM, (0.2, 0.1, 0.0));
    assert_velocity(&robot, (0.2, 0.0, 0.0));
    assert_eq!(robot.holds(), [(Hold::NoSideways, "test")]);
    // The fields forward are those of a base that steers: 0.61 rad at 0.6 m.
    let narrowest = 0.3 * libm::tan(0.61) / 0.6;
    let robot = settle(DIFFERENTIAL, (0.3, 0.0, 0.9));
    assert_eq!(robot.holds()[0], (Hold::GuardBounds, ""), "{:?}", robot.holds());
    let velocity = robot.velocity();
    assert!((velocity.omega / velocity.vx - narrowest / 0.3).abs() < 0.02 && velocity.omega <= 0.201, "{velocity:?}");
}

#[test]
fn a_robot_that_senses_nothing_turns_no_faster_than_its_outline_may_move() {
    let protection = protection::Config { speed_blind: 0.3, reach: 0.5, ..protection::Config::default() };
    let mut robot = ready(Config { protection, ..configured(DIFFERENTIAL) });
    drive(&mut robot, (0.0, 0.0, 1.0), 1500);
    assert_velocity(&robot, (0.0, 0.0, 0.6));
    assert_eq!(robot.holds(), [(Hold::GuardBlind, "")]);
}

/// A wheel drive that sends its torque.
const TORQUE_SHEET: &[u8] = include_bytes!("../../../../../conf/porter/wheel.eds");
const GEAR: f64 = 20.0;

/// Four mecanum wheels on such drives, booted; `change` makes its devices from its sheet.
fn with_torque(change: fn(&str) -> String) -> Robot {
    let sheet = Arc::new(Eds::parse(TORQUE_SHEET).expect("a sheet"));
    let mut config = configured(MECANUM);
    for wheel in &mut config.wheels {
        let keys = Cia402Config { gear: Some(GEAR), ..Cia402Config::usual() };
        let drive = Cia402 { keys, sheet: Some(sheet.clone()), motor_rpm_max: None };
        wheel.drive = PropulsionDrive::Cia402 { drive, circumference: 60.0 * GEAR / RPM_PER_MPS };
    }
    let text = std::str::from_utf8(TORQUE_SHEET).expect("ASCII");
    let device = Eds::parse(change(text).as_bytes()).expect("a sheet");
    let mut robot = Robot::with(device.dictionary(1), config);
    robot.icla = Fake::new(device.dictionary(2), 6);
    robot.more = [3, 4].map(|node| Fake::new(device.dictionary(node), 6)).into();
    robot.pass(2500);
    assert_eq!(robot.bench.shell.state(), State::Run, "{:?}", robot.notes);
    robot
}

/// The motors have these torques, per mille of the rated one.
fn set_torques(robot: &mut Robot, torques: [i64; 4]) {
    let drives = [&mut robot.epos, &mut robot.icla].into_iter().chain(&mut robot.more);
    drives.zip(torques).for_each(|(drive, torque)| drive.node.set(0x6077, 0, torque));
}

/// Both front wheels against both rear ones.
const FIGHT: [i64; 4] = [1000, 1000, -1000, -1000];

#[test]
fn wheels_that_work_against_each_other_stop_the_robot() {
    let mut robot = with_torque(str::to_owned);
    drive(&mut robot, (0.3, 0.0, 0.1), 1500);
    set_torques(&mut robot, FIGHT);
    drive(&mut robot, (0.3, 0.0, 0.1), 150);
    assert_eq!((robot.holds(), robot.errors.len()), (vec![], 0), "{:?}", robot.errors);
    drive(&mut robot, (0.3, 0.0, 0.1), 50);
    assert_wheels(&robot, &[0.0; 4]);
    // These wheels stand at once, and then it is over.
    let reported = [(Fault::WheelsDisagree, Severity::Error), (Fault::WheelsDisagree, Severity::Notice)];
    assert_eq!(robot.errors, reported);
    drive(&mut robot, (0.3, 0.0, 0.1), 500);
    assert_wheels(&robot, &[0.0; 4]);
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")]);
    // It has not ended: the next motion ends, too, when the set-points are reached.
    drive(&mut robot, (0.0, 0.0, 0.0), 200);
    drive(&mut robot, (0.3, 0.0, 0.1), 500);
    assert_eq!(robot.errors.len(), 2, "{:?}", robot.errors);
    drive(&mut robot, (0.3, 0.0, 0.1), 500);
    assert_eq!(robot.errors[2..], reported);
    set_torques(&mut robot, [0; 4]);
    drive(&mut robot, (0.0, 0.0, 0.0), 200);
    drive(&mut robot, (0.3, 0.0, 0.1), 1500);
    assert!(robot.errors.len() == 4 && robot.holds().is_empty(), "{:?}", robot.errors);
}

#[test]
fn torques_that_move_the_robot_hold_it_or_do_not_last_are_no_fault() {
    let mut robot = with_torque(str::to_owned);
    drive(&mut robot, (0.3, 0.0, 0.0), 1500);
    for torques in [
        // Ahead, to the side, a turn, back, and all that a PDO can say.
        [3000, 3000, 3000, 3000],
        [-2000, 2000, 2000, -2000],
        [-2000, 2000, -2000, 2000],
        [-1500; 4],
        [i64::from(i16::MAX); 4],
        [i64::from(i16::MIN); 4],
        // A fifth of the rated torque, where three tenths are allowed.
        [200, 200, -200, -200],
    ] {
        set_torques(&mut robot, torques);
        drive(&mut robot, (0.3, 0.0, 0.0), 600);
        assert_eq!((robot.holds(), robot.errors.len()), (vec![], 0), "{torques:?}: {:?}", robot.errors);
    }
    // A gap in the floor.
    for torques in [FIGHT, [0; 4], FIGHT, [0; 4]] {
        set_torques(&mut robot, torques);
        drive(&mut robot, (0.3, 0.0, 0.0), 100);
    }
    // A robot that stands enabled.
    drive(&mut robot, (0.0, 0.0, 0.0), 1000);
    set_torques(&mut robot, FIGHT);
    drive(&mut robot, (0.0, 0.0, 0.0), 1000);
    assert_eq!((robot.holds(), robot.errors.len()), (vec![], 0), "{:?}", robot.errors);
}

#[test]
fn without_a_torque_nothing_stops_and_that_is_reported_once() {
    let unseen = "no torque of all wheels is received";
    let count = |robot: &Robot, text: &str| robot.notes.iter().filter(|note| note.contains(text)).count();
    // A rated torque that was never set.
    let mut robot = with_torque(|text| text.replacen("DefaultValue=150\n", "DefaultValue=0\n", 1));
    set_torques(&mut robot, FIGHT);
    for reported in [1, 1] {
        drive(&mut robot, (0.3, 0.0, 0.0), 3000);
        assert_eq!((robot.holds(), robot.errors.len(), count(&robot, unseen)), (vec![], 0, reported));
    }
    // One that is known.
    let mut robot = with_torque(str::to_owned);
    drive(&mut robot, (0.3, 0.0, 0.0), 3000);
    assert_eq!((count(&robot, unseen), count(&robot, "in a PDO")), (0, 0), "{:?}", robot.notes);
    // Drives that send none.
    let mut robot = ready(configured(MECANUM));
    robot.pass(1);
    let blind = "no torque of front_left, front_right, rear_left, rear_right in a PDO";
    assert_eq!(count(&robot, blind), 1, "{:?}", robot.notes);
    assert_eq!(count(&ready(configured(DIFFERENTIAL)), "in a PDO"), 0);
}

#[test]
fn a_torque_in_a_pdo_is_published_and_not_read() {
    let mut robot = with_torque(str::to_owned);
    set_torques(&mut robot, [-500; 4]);
    drive(&mut robot, (0.3, 0.0, 0.0), 1000);
    let row = &robot.wheels.wheels[0];
    assert_eq!((row.torque, row.load), (-0.075, 0.5));
    robot.frames.clear();
    robot.pass(3000);
    let read = robot.frames.iter().filter(|(_, frame)| frame.data().starts_with(&[0x40, 0x77, 0x60]));
    assert_eq!(read.count(), 0);
}
