//! The PAUSE line: latched until a deliberate act, for every source.

use super::*;
use messages::middlelevel::{CmdGoal, CmdMode, Waypoint};

fn pause(engaged: bool, source: &str) -> lowlevel::EventStop {
    lowlevel::EventStop { timestamp: 0, engaged, source: source.into() }
}

#[test]
fn an_opened_line_lets_nothing_move_until_a_deliberate_act() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.bench.message(pause(true, "bumper1"));
    robot.drive(0.4, 300);
    robot.bench.message(pause(false, ""));
    robot.frames.clear();
    robot.drive(0.4, 1000);
    robot.pass(10_000);
    let enabled = |frame: &can::Frame| frame.id() == can::Id::Standard(0x501) && frame.data()[0] & 0x0F == 0x0F;
    assert!(!robot.frames.iter().any(|(_, frame)| enabled(frame)), "the axis was enabled by itself");
    assert_eq!(robot.holds(), [(Hold::PauseLatched, "")]);
    assert!(robot.holds.holds[0].latched);
    robot.press(0.4);
    robot.drive(0.4, 200);
    assert!(robot.moves(), "{}", robot.reason());
}

/// Time passes; `driver_lidar` reports ten times a second whether the fields of its lidar are free, if at all.
fn hear(robot: &mut Robot, engaged: Option<bool>, speed: Option<f64>, ms: u32) {
    for n in 0..ms / 50 {
        if let Some(engaged) = engaged.filter(|_| n % 2 == 0) {
            robot.bench.message(pause(engaged, "lidar.front"));
        }
        speed.into_iter().for_each(|speed| robot.command(speed, 0.0));
        robot.pass(50);
    }
}

#[test]
fn the_fields_of_a_lidar_stop_the_robot_if_infringed_or_silent_and_nothing_resumes_by_itself() {
    let fields = vec!["lidar.front".to_owned()];
    let mut robot = Robot::with(epos::dictionary(1), Config { fields, ..config() });
    let unknown = (Hold::PauseFieldUnknown, "lidar.front");
    robot.pass(1000);
    assert!(robot.holds().contains(&unknown), "{:?}", robot.holds());
    hear(&mut robot, Some(false), None, 4000);
    assert!(robot.motion().homed, "{}", robot.reason());
    robot.press(0.4);
    hear(&mut robot, Some(false), Some(0.4), 500);
    assert!(robot.moves(), "{}", robot.reason());

    hear(&mut robot, Some(true), Some(0.4), 500);
    assert!(!robot.moves() && robot.holds().contains(&(Hold::PauseField, "lidar.front")), "{:?}", robot.holds());
    hear(&mut robot, Some(false), Some(0.4), 1000);
    assert!(!robot.moves() && robot.holds().contains(&(Hold::PauseLatched, "")), "{:?}", robot.holds());
    robot.press(0.4);
    hear(&mut robot, Some(false), Some(0.4), 500);
    assert!(robot.moves(), "{}", robot.reason());

    hear(&mut robot, None, Some(0.4), 1000);
    assert!(!robot.moves() && robot.holds().contains(&unknown), "{:?}", robot.holds());
    hear(&mut robot, Some(false), Some(0.4), 1000);
    assert!(!robot.moves(), "it resumed by itself");
    robot.press(0.4);
    hear(&mut robot, Some(false), Some(0.4), 500);
    assert!(robot.moves(), "{}", robot.reason());
}

/// A robot with an input of the steering's drive that stops it, and is closed.
fn with_an_input() -> Robot {
    let input = StopInput { signal: None, axis: Some(Axis::Steering), bit: Some(16) };
    let stop = Stop { inputs: vec![input], ..config().stop };
    let mut robot = Robot::with(epos::dictionary(1), Config { stop, ..config() });
    robot.icla.node.set(0x60FD, 0, 1 << 16);
    robot.pass(3000);
    robot.home();
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
    robot
}

const INPUT: &str = "drive.steering.16";

#[test]
fn a_digital_input_of_a_drive_that_opens_is_pause_and_nothing_resumes_by_itself() {
    let mut robot = with_an_input();
    robot.press(0.4);
    robot.drive(0.4, 500);
    assert!(robot.moves(), "{}", robot.reason());
    robot.icla.node.set(0x60FD, 0, !(1 << 16) & 0xFFFF_FFFF);
    robot.drive(0.4, 300);
    assert!(!robot.moves() && robot.holds().contains(&(Hold::PauseInput, INPUT)), "{:?}", robot.holds());
    robot.icla.node.set(0x60FD, 0, 1 << 16);
    robot.drive(0.4, 2000);
    assert!(!robot.moves() && robot.holds().contains(&(Hold::PauseLatched, "")), "{:?}", robot.holds());
    robot.press(0.4);
    robot.drive(0.4, 300);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_digital_input_that_is_not_known_is_pause_which_stays_when_it_is_known_again() {
    let mut robot = with_an_input();
    robot.press(0.4);
    robot.drive(0.4, 500);
    robot.icla.deaf = true;
    robot.drive(0.4, 600);
    assert!(!robot.moves() && robot.holds().contains(&(Hold::PauseInputUnknown, INPUT)), "{:?}", robot.holds());
    robot.icla.deaf = false;
    robot.pass(15_000);
    assert!(robot.holds().contains(&(Hold::PauseLatched, "")), "{:?}", robot.holds());
}

#[test]
fn a_robot_whose_emergency_stop_is_not_read_reports_that_at_its_start() {
    let reports = |mut robot: Robot| {
        robot.pass(1);
        robot.notes.iter().any(|note| note.contains("no emergency stop is read"))
    };
    assert!(reports(Robot::new()));
    assert!(!reports(with_an_input()));
    assert!(!reports(Robot::with(epos::dictionary(1), Config { has_pause_line: true, ..config() })));
}

#[test]
fn acts_while_the_line_is_engaged_do_not_count() {
    let mut robot = Robot::ready();
    robot.bench.message(pause(true, "bumper1"));
    robot.exchange();
    robot.press(0.4);
    robot.bench.message(CmdGoal { waypoints: vec![Waypoint::default()], ..Default::default() });
    robot.bench.message(pause(false, ""));
    robot.pass(1000);
    assert_eq!(robot.holds(), [(Hold::PauseLatched, "")]);
    robot.bench.message(CmdGoal { waypoints: vec![Waypoint::default()], ..Default::default() });
    robot.exchange();
    assert_eq!(robot.holds(), [(Hold::NobodyCommands, "")]);
}

#[test]
fn only_a_mode_that_orders_the_robot_to_drive_releases_it_like_a_goal() {
    for mode in [CmdMode::MANUAL, CmdMode::ROUTE, CmdMode::WAIT, CmdMode::APPROACH, CmdMode::HOME, 5, -1] {
        let mut robot = Robot::ready();
        robot.bench.message(pause(true, "bumper1"));
        robot.exchange();
        robot.bench.message(pause(false, ""));
        robot.pass(1000);
        robot.bench.message(CmdMode { mode, ..Default::default() });
        robot.exchange();
        let is_order = [CmdMode::APPROACH, CmdMode::HOME].contains(&mode);
        let holds = if is_order { Hold::NobodyCommands } else { Hold::PauseLatched };
        assert_eq!(robot.holds(), [(holds, "")], "{mode}");
    }
}

#[test]
fn the_fault_of_a_drive_without_feed_is_not_reset_while_the_robot_rolls() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.bench.message(pause(true, "bumper1"));
    robot.exchange();
    // The feed is cut, and the robot rolls.
    robot.epos.fault(robot.bench.now(), 0x3220);
    robot.epos.stubborn = true;
    robot.epos.node.set(0x606C, 0, 900);
    robot.pass(100);
    robot.bench.message(pause(false, ""));
    robot.pass(3000);
    let resets = |frame: &can::Frame| frame.id() == can::Id::Standard(0x501) && frame.data()[0] & 0x80 != 0;
    assert!(!robot.frames.iter().any(|(_, frame)| resets(frame)), "reset while it rolls");
    robot.epos.node.set(0x606C, 0, 0);
    robot.epos.stubborn = false;
    robot.pass(3000);
    assert_ne!(robot.epos.power.state(), PowerState::Fault, "it stands, and the line is open");
    assert_eq!(robot.holds(), [(Hold::PauseLatched, "")]);
    robot.press(0.4);
    robot.drive(0.4, 200);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn what_another_sender_engaged_in_the_power_controllers_name_stays_engaged() {
    let by = |due, pid| Origin { due, process: Some(Process { pid, uid: 1000 }) };
    let mut robot = Robot::ready();
    robot.bench.message_from(by(true, 7), pause(false, ""));
    robot.drive(0.4, 500);
    robot.bench.message_from(by(false, 300), pause(true, "button"));
    robot.drive(0.0, 200);
    for _ in 0..5 {
        robot.bench.message_from(by(true, 7), pause(false, ""));
        robot.press(0.4);
        robot.drive(0.4, 500);
        assert!(!robot.moves() && robot.holds()[0] == (Hold::PauseOther, "button"), "{:?}", robot.holds());
    }
    robot.bench.message_from(by(false, 301), pause(false, "button"));
    robot.press(0.4);
    assert_eq!(robot.holds()[0], (Hold::PauseOther, "button"), "another sender");
    robot.bench.message_from(by(false, 300), pause(false, "button"));
    robot.press(0.4);
    robot.drive(0.4, 200);
    assert!(robot.moves(), "{}", robot.reason());
}
