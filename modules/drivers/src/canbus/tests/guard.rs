//! The guard's bounds at the wheel: for every source, during a service brake, and while the guard is silent.

use super::super::protection;
use super::*;

fn guarded() -> Robot {
    let mut config = config();
    config.protection = protection::Config { guarded: true, ..protection::Config::default() };
    let mut robot = Robot::with(epos::dictionary(1), config);
    for _ in 0..60 {
        permit(&mut robot, 0.8);
        robot.pass(50);
    }
    assert!(robot.motion().homed, "{}", robot.reason());
    robot
}

fn permit(robot: &mut Robot, forward: f64) {
    let code = Hold::GuardStops.code();
    let guard = lowlevel::DataGuard { forward, backward: 0.5, code, subject: "sonar 2".into(), ..Default::default() };
    robot.bench.message(guard);
    robot.exchange();
}

/// Commands and is permitted, both at 20 Hz.
fn drive(robot: &mut Robot, speed: f64, permitted: f64, ms: u32) {
    for _ in 0..ms / 50 {
        permit(robot, permitted);
        robot.command(speed, 0.0);
        robot.pass(50);
    }
}

#[test]
fn a_bound_clamps_the_speed_and_is_a_notice_not_a_stop() {
    let mut robot = guarded();
    drive(&mut robot, 0.5, 0.8, 500);
    assert_eq!((robot.motion().speed_target, robot.holds()), (0.5, vec![]));
    drive(&mut robot, 0.5, 0.2, 500);
    assert_eq!(robot.motion().speed_target, 0.2);
    assert_eq!((robot.holds(), robot.reason().as_str()), (vec![(Hold::GuardStops, "sonar 2")], ""));
    assert!(robot.holds.is_free() && !robot.holds.is_idle());
    drive(&mut robot, 0.5, 0.0, 500);
    assert_eq!(robot.motion().speed_target, 0.0);
    assert!(!robot.motion().quick_stop && robot.motion().enabled, "the service brake");
    drive(&mut robot, 0.5, 0.8, 500);
    assert_eq!(robot.motion().speed_target, 0.5, "and it ends by itself");
}

#[test]
fn a_silent_guard_is_zero_and_after_a_second_a_stop_that_needs_a_release() {
    let mut robot = guarded();
    drive(&mut robot, 0.5, 0.8, 500);
    robot.drive(0.5, 300);
    assert!(robot.motion().speed_target == 0.0 && !robot.motion().quick_stop);
    drive(&mut robot, 0.5, 0.8, 200);
    assert_eq!(robot.motion().speed_target, 0.5);
    robot.drive(0.5, 1300);
    assert!(robot.motion().quick_stop);
    assert_eq!(robot.hold(), Some(Hold::GuardSilent));
    drive(&mut robot, 0.5, 0.8, 500);
    assert_eq!((robot.motion().speed_target, robot.hold()), (0.0, Some(Hold::NotReleased)));
    drive(&mut robot, 0.0, 0.8, 100);
    drive(&mut robot, 0.5, 0.8, 200);
    assert_eq!(robot.motion().speed_target, 0.5);
}

#[test]
fn a_person_creeps_past_the_guard_by_a_second_input() {
    let mut robot = guarded();
    drive(&mut robot, 0.5, 0.0, 300);
    assert_eq!(robot.motion().speed_target, 0.0);
    for _ in 0..5 {
        robot.bench.message(lowlevel::CmdCreep { timestamp: 0, source: "test".into(), session: 1, held: true });
        drive(&mut robot, 0.5, 0.0, 50);
    }
    assert_eq!(robot.motion().speed_target, 0.15);
    assert_eq!(robot.holds(), [(Hold::GuardCreep, "test")]);
    drive(&mut robot, 0.5, 0.0, 300);
    assert_eq!((robot.motion().speed_target, robot.hold()), (0.0, Some(Hold::GuardStops)));
}

#[test]
fn a_guard_that_senses_nothing_makes_the_robot_slow_whoever_commands_it() {
    let mut config = config();
    config.protection = protection::Config::default();
    let mut robot = Robot::with(epos::dictionary(1), config);
    robot.pass(3000);
    robot.drive(0.5, 500);
    assert_eq!((robot.motion().speed_target, robot.holds()), (0.3, vec![(Hold::GuardBlind, "")]));
    robot.drive(-0.5, 500);
    assert_eq!(robot.motion().speed_target, -0.3);
}

#[test]
fn without_a_guard_messages_of_one_bound_nothing_and_nobody_creeps() {
    let mut robot = Robot::ready();
    permit(&mut robot, 0.1);
    robot.bench.message(lowlevel::CmdCreep { timestamp: 0, source: "test".into(), session: 1, held: true });
    robot.drive(0.5, 2000);
    assert_eq!((robot.motion().speed_target, robot.holds()), (0.5, vec![]));
}

#[test]
fn the_zeros_of_another_sender_do_not_hide_that_the_guard_is_silent() {
    let mut robot = guarded();
    drive(&mut robot, 0.5, 0.8, 500);
    let stranger = Origin { due: false, process: None };
    for _ in 0..26 {
        robot.bench.message_from(stranger, lowlevel::DataGuard::default());
        robot.command(0.5, 0.0);
        robot.pass(50);
    }
    assert!(robot.motion().quick_stop);
    assert_eq!(robot.hold(), Some(Hold::GuardSilent));
    // And while the guard lives, they stop the robot and end with it.
    let mut robot = guarded();
    drive(&mut robot, 0.5, 0.8, 500);
    robot.bench.message_from(stranger, lowlevel::DataGuard::default());
    robot.pass(60);
    assert_eq!((robot.motion().speed_target, robot.holds()), (0.0, vec![(Hold::GuardBounds, "")]));
    drive(&mut robot, 0.5, 0.8, 500);
    assert_eq!(robot.motion().speed_target, 0.5);
}
