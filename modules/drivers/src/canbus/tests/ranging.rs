//! A lost ranging board stops every source, and nothing resumes by itself.

use super::super::ranging::RangingBoard;
use super::*;
use messages::lowlevel::{DataRanges, Reading};
use messages::middlelevel::{CmdGoal, DataEstimate, Waypoint};

fn robot() -> Robot {
    let board = |name: &str, id| RangingBoard { name: name.into(), sonars: vec![id, id + 1], infrareds: vec![id] };
    let ranging = vec![board("sd1_front", 0), board("sd1_rear", 2)];
    let ranging_age_max = Duration::from_millis(600);
    Robot::with(epos::dictionary(1), Config { ranging, ranging_age_max, ..config() })
}

/// Readings of this instant; boards in `dead` are unknown.
fn measure(robot: &mut Robot, dead: &[i32]) {
    let timestamp = robot.bench.now().as_nanos() as i64 / 1000;
    let reading = |kind: i8, id: i32| Reading {
        timestamp,
        id,
        kind,
        status: if dead.contains(&(id / 2)) { Reading::UNKNOWN } else { Reading::SILENT },
        distance: f64::NAN,
        ..Default::default()
    };
    let sonars = (0..4).map(|id| reading(Reading::SONAR, id));
    let readings = sonars.chain([0, 2].map(|id| reading(Reading::INFRARED, id))).collect();
    robot.bench.message(DataRanges { timestamp, readings });
    robot.exchange();
}

/// Commands at 20 Hz for a time, with readings.
fn drive(robot: &mut Robot, source: Option<i8>, dead: &[i32], ms: u32) {
    for _ in 0..ms / 50 {
        measure(robot, dead);
        robot.bench.message(DataEstimate { quality: DataEstimate::FINE, ..Default::default() });
        if let Some(priority) = source {
            let name = if priority == lowlevel::CmdMotion::PLANNER { "planner" } else { "test" };
            let command =
                lowlevel::CmdMotion { timestamp: 0, speed: 0.4, steering: 0.0, priority, source: name.into() };
            robot.bench.message(command);
        }
        robot.exchange();
        robot.pass(50);
    }
}

fn release(robot: &mut Robot) {
    let waypoints = vec![Waypoint::default()];
    robot.bench.message(CmdGoal { timestamp: 0, id: 1, waypoints, r#loop: false });
}

#[test]
fn nothing_moves_before_all_boards_have_measured_not_even_the_steering() {
    let mut robot = robot();
    robot.pass(3000);
    assert_eq!(
        robot.holds(),
        [(Hold::RangingLost, "sd1_front"), (Hold::RangingLost, "sd1_rear"), (Hold::ToBeHomed, "steering")]
    );
    drive(&mut robot, None, &[1], 3000);
    assert_eq!(robot.holds()[0], (Hold::RangingLost, "sd1_rear"));
    drive(&mut robot, None, &[], 3000);
    assert_eq!(robot.hold(), Some(Hold::NobodyCommands));
    assert!(robot.motion().homed);
}

#[test]
fn a_lost_board_stops_planner_and_hand_until_a_person_acts() {
    for (priority, last) in [
        (lowlevel::CmdMotion::PLANNER, Hold::PlannerLatched),
        (lowlevel::CmdMotion::REMOTE, Hold::NotReleased),
        (lowlevel::CmdMotion::MAINTENANCE, Hold::NotReleased),
    ] {
        for (dead, name) in [(0, "sd1_front"), (1, "sd1_rear")] {
            let mut robot = robot();
            drive(&mut robot, None, &[], 6000);
            release(&mut robot);
            drive(&mut robot, Some(priority), &[], 1000);
            assert_eq!((robot.holds(), robot.reason().as_str()), (vec![], ""));
            assert!(robot.motion().speed_target > 0.39);
            drive(&mut robot, Some(priority), &[dead], 500);
            assert!(robot.motion().speed_target > 0.39, "{name}: a poll or two may fail");
            drive(&mut robot, Some(priority), &[dead], 200);
            assert_eq!(robot.holds()[0], (Hold::RangingLost, name));
            assert_eq!(robot.reason(), format!("ranging board {name} does not answer"));
            assert!(robot.motion().quick_stop && robot.motion().speed_target == 0.0);
            assert!(robot.errors.contains(&(Fault::RangingLost, Severity::Error)));
            // The board is back: the same command does not move the robot.
            drive(&mut robot, Some(priority), &[], 2000);
            assert_eq!((robot.hold(), robot.motion().speed_target), (Some(last), 0.0), "{name}");
        }
    }
}

#[test]
fn a_driver_that_falls_silent_is_no_better_than_dead_boards() {
    let mut robot = robot();
    drive(&mut robot, None, &[], 6000);
    drive(&mut robot, Some(lowlevel::CmdMotion::REMOTE), &[], 1000);
    robot.drive(0.4, 700);
    assert_eq!(robot.holds()[..2], [(Hold::RangingLost, "sd1_front"), (Hold::RangingLost, "sd1_rear")]);
    assert!(robot.motion().quick_stop);
}

#[test]
fn a_robot_without_ranging_boards_is_not_affected() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 2000);
    assert_eq!((robot.holds(), robot.motion().speed_target > 0.39), (vec![], true));
}
