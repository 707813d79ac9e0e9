//! Homing moves the wheels: it waits for an operator, and a reference that the drive kept is kept.

use super::*;
use messages::middlelevel::{CmdGoal, DataEstimate, Waypoint};

/// Booted; the steering has never been homed.
fn unhomed() -> Robot {
    let mut robot = Robot::with(epos::dictionary(1), Config { homing_release: HomingRelease::Operator, ..config() });
    robot.pass(5000);
    assert_eq!(robot.bench.shell.state(), State::Run);
    robot
}

/// Started by a watchdog.
fn guarded() -> Config {
    Config { guarded: true, ..config() }
}

fn run(robot: &mut Robot, module: &str, manual: bool) {
    let (module, source) = (module.into(), "test".into());
    robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual, source });
    robot.exchange();
}

fn goal(robot: &mut Robot) {
    robot.bench.message(CmdGoal { waypoints: vec![Waypoint::default()], ..Default::default() });
    robot.exchange();
}

#[test]
fn the_wheels_do_not_move_before_an_operator_lets_them() {
    let mut robot = unhomed();
    robot.pass(60_000);
    assert_eq!((robot.icla.homings, robot.motion().homed), (0, false));
    assert_eq!(robot.holds(), [(Hold::ToBeHomed, "steering")]);
    assert!(robot.holds.holds[0].latched);
    // Not by a program, by zero, by motion without zero, nor by a planner.
    run(&mut robot, "*", false);
    robot.drive(0.0, 500);
    robot.bench.message(lowlevel::CmdMotion { source: "new".into(), speed: 0.3, priority: 1, ..Default::default() });
    robot.bench.message(lowlevel::CmdMotion { source: "planner".into(), speed: 0.3, ..Default::default() });
    robot.pass(1000);
    assert_eq!(robot.icla.homings, 0);
}

#[test]
fn each_deliberate_act_lets_the_wheels_be_homed() {
    type Act = fn(&mut Robot);
    let acts: [(&str, Act); 5] = [
        ("press", |robot| robot.press(0.3)),
        ("goal", goal),
        ("run", |robot| run(robot, NAME, true)),
        ("run planner", |robot| run(robot, "planner", true)),
        ("home", Robot::home),
    ];
    for (name, act) in acts {
        let mut robot = unhomed();
        act(&mut robot);
        robot.pass(3000);
        assert_eq!((robot.icla.homings, robot.motion().homed), (1, true), "{name}: {}", robot.reason());
        assert!(!robot.moves(), "{name}");
    }
}

#[test]
fn a_release_from_before_a_stop_does_not_home() {
    let mut robot = unhomed();
    let before = robot.bench.now();
    robot.missing = "driver_rs485a";
    robot.pass(300);
    robot.press(0.3);
    robot.home();
    goal(&mut robot);
    robot.missing = "";
    robot.pass(300);
    // It waited in the socket.
    let homing = Message::from(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
    robot.bench.event(Event::Message { at: before, from: Origin::DUE, message: &homing });
    robot.pass(3000);
    assert_eq!((robot.icla.homings, robot.motion().homed), (0, false));
    robot.home();
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
}

#[test]
fn a_drive_that_rebooted_is_homed_by_an_operator_alone() {
    let mut robot = Robot::ready();
    let before = robot.icla.homings;
    robot.icla.power_on(robot.bench.now());
    robot.pass(10_000);
    assert_eq!((robot.icla.homings, robot.motion().homed), (before, false), "the start releases the first one only");
    assert_eq!(robot.holds(), [(Hold::ToBeHomed, "steering")]);
    robot.home();
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
}

#[test]
fn a_pause_during_homing_needs_a_new_release() {
    let mut robot = unhomed();
    robot.home();
    robot.pass(30);
    assert_eq!(robot.holds(), [(Hold::Homing, "steering")]);
    let pause = |engaged| lowlevel::EventStop { timestamp: 0, engaged, source: "button".into() };
    robot.bench.message(pause(true));
    robot.pass(1000);
    robot.bench.message(pause(false));
    let homings = robot.icla.homings;
    robot.pass(5000);
    assert_eq!((robot.icla.homings, robot.motion().homed), (homings, false));
    assert_eq!(robot.holds(), [(Hold::PauseLatched, ""), (Hold::ToBeHomed, "steering")]);
    robot.press(0.3);
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
}

#[test]
fn a_stop_on_the_way_to_straight_ahead_needs_a_new_release() {
    let mut robot = unhomed();
    robot.home();
    robot.pass(30);
    // It ends its homing, and does not turn straight ahead yet.
    robot.icla.stubborn = true;
    robot.pass(200);
    assert_eq!(robot.holds(), [(Hold::Centering, "steering")]);
    let (homings, aside) = (robot.icla.homings, robot.icla.node.get(0x6064, 0));
    robot.missing = "driver_rs485a";
    robot.pass(200);
    robot.icla.stubborn = false;
    robot.missing = "";
    robot.pass(5000);
    assert_eq!((robot.icla.node.get(0x6064, 0), robot.motion().homed), (aside, false), "it turned by itself");
    assert_eq!(robot.holds(), [(Hold::ToBeHomed, "steering")]);
    run(&mut robot, NAME, true);
    robot.pass(1000);
    assert!(robot.motion().homed, "{}", robot.reason());
    assert_eq!((robot.icla.node.get(0x6064, 0), robot.icla.homings), (Some(0), homings));
}

#[test]
fn a_reference_that_the_drive_kept_is_kept() {
    let mut robot = Robot::ready();
    let homings = robot.icla.homings;
    // The cable is pulled for a while.
    robot.icla.alive = false;
    robot.pass(3000);
    robot.icla.alive = true;
    robot.pass(5000);
    assert_eq!((robot.icla.homings, robot.motion().homed), (homings, true), "{}", robot.reason());
    // The driver's process is started again.
    let Robot { epos, icla, .. } = robot;
    let mut robot = Robot::with(canopen::drives::epos::dictionary(1), guarded());
    (robot.epos, robot.icla, robot.restarts) = (epos, icla, 1);
    robot.pass(5000);
    assert_eq!((robot.icla.homings, robot.motion().homed), (homings, true), "{}", robot.reason());
}

#[test]
fn a_reference_of_another_configuration_is_not_kept() {
    for (index, value) in [(0x607C, 17), (0x6098, 28)] {
        let Robot { epos, mut icla, .. } = Robot::ready();
        icla.node.set(index, 0, value);
        let mut robot = Robot::with(canopen::drives::epos::dictionary(1), guarded());
        (robot.epos, robot.icla, robot.restarts) = (epos, icla, 1);
        robot.pass(5000);
        assert_eq!(robot.holds(), [(Hold::ToBeHomed, "steering")], "0x{index:X}");
    }
}

#[test]
fn the_start_of_the_robot_does_not_home_after_a_restart_of_the_driver() {
    let mut robot = Robot::with(epos::dictionary(1), guarded());
    robot.restarts = 1;
    robot.pass(10_000);
    assert_eq!((robot.icla.homings, robot.motion().homed), (0, false));
}

#[test]
fn a_goal_that_lets_the_wheels_be_homed_is_driven_to_afterwards() {
    let mut robot = unhomed();
    let plan = |robot: &mut Robot, ms: u32| {
        for _ in 0..ms / 50 {
            robot.bench.message(DataEstimate { quality: DataEstimate::FINE, ..Default::default() });
            robot.bench.message(lowlevel::CmdMotion { source: "planner".into(), speed: 0.3, ..Default::default() });
            robot.exchange();
            robot.pass(50);
        }
    };
    plan(&mut robot, 500);
    goal(&mut robot);
    plan(&mut robot, 4000);
    assert!(robot.motion().homed && robot.moves(), "{}", robot.reason());
    // A stop in between ends that.
    let mut robot = unhomed();
    goal(&mut robot);
    robot.missing = "driver_rs485a";
    plan(&mut robot, 300);
    robot.missing = "";
    robot.pass(100);
    robot.home();
    plan(&mut robot, 4000);
    assert!(robot.motion().homed && !robot.moves());
    assert_eq!(robot.holds(), [(Hold::PlannerLatched, "planner")]);
}
