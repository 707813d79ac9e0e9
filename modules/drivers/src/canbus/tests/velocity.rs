//! `LL_CMD_VELOCITY` at the wheel, and `LL_DATA_VELOCITY`: the rules are those of `LL_CMD_MOTION`.

use super::super::protection;
use super::*;

/// Steering angle of a radius of 2 m at the wheelbase of 0.6 m, rad.
const RADIUS_2M_RAD: f64 = 0.291_456_794;

fn command(vx: f64, vy: f64, omega: f64) -> lowlevel::CmdVelocity {
    let priority = lowlevel::CmdMotion::REMOTE;
    lowlevel::CmdVelocity { timestamp: 0, vx, vy, omega, priority, source: "test".into(), session: 1 }
}

fn say(robot: &mut Robot, command: lowlevel::CmdVelocity) {
    robot.bench.message(command);
    robot.exchange();
}

/// Commands at 20 Hz.
fn drive(robot: &mut Robot, (vx, vy, omega): (f64, f64, f64), ms: u32) {
    for _ in 0..ms / 50 {
        say(robot, command(vx, vy, omega));
        robot.pass(50);
    }
}

/// Set-points of speed and steering.
fn targets(robot: &Robot) -> (f64, f64) {
    (robot.motion().speed_target, robot.motion().steering_target)
}

fn is_near(found: f64, expected: f64) -> bool {
    (found - expected).abs() < 0.002
}

fn assert_velocity(robot: &Robot, expected: (f64, f64, f64)) {
    let lowlevel::DataVelocity { vx, vy, omega, vx_target, vy_target, omega_target, residual, .. } = *robot.velocity();
    for (measured, target, expected) in
        [(vx, vx_target, expected.0), (vy, vy_target, expected.1), (omega, omega_target, expected.2)]
    {
        assert!(is_near(measured, expected) && is_near(target, expected), "{:?}", robot.velocity());
    }
    assert!(residual < 1e-9, "{residual}");
}

#[test]
fn a_velocity_drives_the_curve_and_is_measured_from_the_axes() {
    let mut robot = Robot::ready();
    drive(&mut robot, (0.4, 0.0, 0.2), 500);
    assert!(targets(&robot).0 == 0.4 && is_near(targets(&robot).1, RADIUS_2M_RAD), "{:?}", targets(&robot));
    assert_velocity(&robot, (0.4, 0.0, 0.2));
    assert_eq!((robot.holds(), robot.reason().as_str()), (vec![], ""));
    let velocity = robot.velocity();
    assert!(velocity.enabled && velocity.ready && !velocity.quick_stop && velocity.source == "test");
    drive(&mut robot, (-0.3, 0.0, 0.15), 500);
    assert!(is_near(targets(&robot).1, -RADIUS_2M_RAD), "{:?}", targets(&robot));
    assert_velocity(&robot, (-0.3, 0.0, 0.15));
}

#[test]
fn both_messages_make_the_same_frames() {
    let mut robot = Robot::ready();
    drive(&mut robot, (0.4, 0.0, 0.0), 300);
    let now = robot.bench.now();
    say(&mut robot, command(0.3, 0.0, 0.0));
    let by_velocity = robot.last_rpdo4();
    robot.command(0.3, 0.0);
    assert_eq!((by_velocity.0, by_velocity.1), (now, robot.last_rpdo4().1));
}

#[test]
fn zero_is_the_service_brake_and_keeps_the_steering() {
    let mut robot = Robot::ready();
    drive(&mut robot, (0.4, 0.0, 0.2), 500);
    drive(&mut robot, (0.0, 0.0, 0.0), 500);
    assert!(!robot.moves() && robot.motion().enabled && !robot.motion().quick_stop);
    assert!(targets(&robot).0 == 0.0 && is_near(targets(&robot).1, RADIUS_2M_RAD), "{:?}", targets(&robot));
    assert_velocity(&robot, (0.0, 0.0, 0.0));
}

#[test]
fn what_the_base_cannot_do_is_left_out_and_named_while_it_is_commanded() {
    for (asked, speed, steering, holds) in [
        ((0.4, 0.1, 0.0), 0.4, 0.0, vec![Hold::NoSideways]),
        ((0.0, -0.1, 0.0), 0.0, 0.0, vec![Hold::NoSideways]),
        ((0.0, 0.0, 0.5), 0.0, 0.0, vec![Hold::NoTurnOnSpot]),
        ((0.0, 0.1, -0.5), 0.0, 0.0, vec![Hold::NoSideways, Hold::NoTurnOnSpot]),
        ((0.1, 0.0, 0.5), 0.1, 0.61, vec![Hold::TurnTooNarrow]),
        ((-0.1, 0.0, 0.5), -0.1, -0.61, vec![Hold::TurnTooNarrow]),
    ] {
        let mut robot = Robot::ready();
        drive(&mut robot, (0.4, 0.0, 0.0), 500);
        drive(&mut robot, asked, 500);
        assert!(is_near(targets(&robot).0, speed) && is_near(targets(&robot).1, steering), "{asked:?}");
        assert_eq!(robot.holds(), holds.into_iter().map(|hold| (hold, "test")).collect::<Vec<_>>());
        assert!(robot.holds.is_free() && robot.reason().is_empty(), "{asked:?}: {}", robot.reason());
        assert!(robot.motion().enabled && !robot.motion().quick_stop && robot.velocity().ready, "{asked:?}");
        drive(&mut robot, (0.4, 0.0, 0.1), 500);
        assert_eq!((robot.holds(), targets(&robot).0), (vec![], 0.4), "it goes on without a release");
    }
}

#[test]
fn out_of_limits_or_not_a_number_stops_any_source() {
    let nan = f64::NAN;
    for asked in [(nan, 0.0, 0.0), (0.0, nan, 0.0), (0.0, 0.0, nan), (1.3, 0.0, 0.0), (0.4, 1.3, 0.0), (0.4, 0.0, 1.5)]
    {
        let mut robot = Robot::ready();
        robot.drive(0.4, 500);
        assert!(robot.moves());
        say(&mut robot, lowlevel::CmdVelocity { source: "other".into(), ..command(asked.0, asked.1, asked.2) });
        assert!(!robot.moves(), "{asked:?}");
        assert!(robot.errors.contains(&(Fault::MotionRefused, Severity::Error)));
        drive(&mut robot, (0.4, 0.0, 0.0), 600);
        assert!(!robot.moves(), "the correct source must send zero first");
        drive(&mut robot, (0.0, 0.0, 0.0), 100);
        drive(&mut robot, (0.4, 0.0, 0.0), 200);
        assert!(robot.moves(), "{}", robot.reason());
    }
    let mut robot = Robot::ready();
    say(&mut robot, lowlevel::CmdVelocity { priority: 4, ..command(0.1, 0.0, 0.0) });
    assert!(robot.errors.contains(&(Fault::MotionRefused, Severity::Error)), "a priority that nobody has");
}

#[test]
fn silence_is_a_quick_stop_and_an_old_command_is_none() {
    let mut robot = Robot::ready();
    drive(&mut robot, (0.4, 0.0, 0.1), 500);
    say(&mut robot, command(0.4, 0.0, 0.1));
    robot.pass(249);
    assert!(robot.moves());
    robot.pass(60);
    assert!(!robot.moves() && robot.velocity().quick_stop);
    drive(&mut robot, (0.4, 0.0, 0.1), 500);
    assert!(!robot.moves(), "it resumed by itself");
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")]);
    let message = Message::from(lowlevel::CmdVelocity { source: "frozen".into(), ..command(0.4, 0.0, 0.0) });
    let at = robot.bench.now() - Duration::from_millis(250);
    robot.bench.event(Event::Message { at, from: Origin::DUE, message: &message });
    robot.pass(100);
    assert!(!robot.moves());
}

#[test]
fn both_messages_of_a_source_release_and_hold_as_one() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    drive(&mut robot, (0.2, 0.0, 0.0), 100);
    assert_eq!((targets(&robot).0, robot.holds()), (0.2, vec![]));
    robot.pass(300);
    robot.drive(0.4, 100);
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")], "the motion of the other message was not released");
    drive(&mut robot, (0.0, 0.0, 0.0), 50);
    robot.drive(0.4, 200);
    assert!(robot.moves(), "{}", robot.reason());
    // One that came by a slower way.
    let message = Message::from(command(0.0, 0.0, 0.0));
    robot.command(0.4, 0.0);
    let at = robot.bench.now() - Duration::from_millis(20);
    robot.bench.event(Event::Message { at, from: Origin::DUE, message: &message });
    robot.exchange();
    assert!(robot.moves());
}

#[test]
fn another_program_under_the_same_name_must_send_zero() {
    let mut robot = Robot::ready();
    drive(&mut robot, (0.4, 0.0, 0.0), 500);
    say(&mut robot, lowlevel::CmdVelocity { session: 2, ..command(0.4, 0.0, 0.0) });
    robot.pass(60);
    assert!(!robot.moves());
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")]);
    for (vx, moves) in [(0.4, false), (0.0, false), (0.4, true)] {
        say(&mut robot, lowlevel::CmdVelocity { session: 2, ..command(vx, 0.0, 0.0) });
        robot.pass(60);
        assert_eq!(robot.moves(), moves, "{}", robot.reason());
    }
}

#[test]
fn a_press_by_velocity_releases_homing_and_a_planner_needs_an_operator() {
    let mut robot = Robot::with(epos::dictionary(1), Config { homing_release: HomingRelease::Operator, ..config() });
    robot.pass(5000);
    assert!(robot.velocity().omega.is_nan() && !robot.velocity().ready && robot.velocity().vx == 0.0);
    drive(&mut robot, (0.0, 0.0, 0.0), 500);
    assert_eq!(robot.icla.homings, 0);
    say(&mut robot, command(0.3, 0.0, 0.0));
    robot.pass(3000);
    assert!(robot.motion().homed && robot.velocity().ready, "{}", robot.reason());
    assert_velocity(&robot, (0.0, 0.0, 0.0));
    let planner = lowlevel::CmdVelocity { source: "guide".into(), priority: 0, ..command(0.3, 0.0, 0.0) };
    say(&mut robot, planner);
    robot.pass(50);
    assert!(!robot.moves() && robot.holds().contains(&(Hold::PlannerLatched, "guide")), "{:?}", robot.holds());
}

#[test]
fn the_caps_of_speed_keep_the_curve() {
    let mut robot = Robot::ready();
    // By hand 0.6 m/s; the radius stays 2 m.
    drive(&mut robot, (1.0, 0.0, 0.5), 500);
    assert!(targets(&robot).0 == 0.6 && is_near(targets(&robot).1, RADIUS_2M_RAD), "{:?}", targets(&robot));
    assert_velocity(&robot, (0.6, 0.0, 0.3));
}

#[test]
fn the_guard_bounds_and_a_person_creeps_as_with_the_other_message() {
    let guard = protection::Config { guarded: true, ..protection::Config::default() };
    let mut robot = Robot::with(epos::dictionary(1), Config { protection: guard, ..config() });
    let drive_permitted = |robot: &mut Robot, asked, forward, creeps, ms: u32| {
        for _ in 0..ms / 50 {
            let (code, subject) = (Hold::GuardStops.code(), "sonar 2".into());
            robot.bench.message(lowlevel::DataGuard { forward, code, subject, ..Default::default() });
            let creep = lowlevel::CmdCreep { timestamp: 0, source: "test".into(), session: 1, held: creeps };
            robot.bench.message(creep);
            drive(robot, asked, 50);
        }
    };
    drive_permitted(&mut robot, (0.0, 0.0, 0.0), 0.8, false, 3000);
    drive_permitted(&mut robot, (0.4, 0.0, 0.2), 0.2, false, 500);
    assert_velocity(&robot, (0.2, 0.0, 0.1));
    assert_eq!(robot.holds(), [(Hold::GuardStops, "sonar 2")]);
    drive_permitted(&mut robot, (0.4, 0.1, 0.2), 0.0, false, 500);
    assert_eq!((targets(&robot).0, robot.velocity().omega_target), (0.0, 0.0));
    assert_eq!(robot.holds(), [(Hold::GuardStops, "sonar 2"), (Hold::NoSideways, "test")]);
    drive_permitted(&mut robot, (0.4, 0.0, 0.2), 0.0, true, 500);
    assert_eq!((targets(&robot).0, robot.holds()), (0.15, vec![(Hold::GuardCreep, "test")]));
    drive(&mut robot, (0.4, 0.0, 0.2), 1300);
    assert_eq!((robot.motion().quick_stop, robot.hold()), (true, Some(Hold::GuardSilent)));
}

#[test]
fn pause_stops_it_and_what_the_base_cannot_do_is_not_said_meanwhile() {
    let mut robot = Robot::ready();
    drive(&mut robot, (0.4, 0.1, 0.0), 500);
    robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged: true, source: "button".into() });
    drive(&mut robot, (0.4, 0.1, 0.0), 300);
    assert!(!robot.moves() && !robot.velocity().ready);
    assert_eq!(robot.holds(), [(Hold::PauseButton, "button"), (Hold::NotReleased, "test")]);
    robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged: false, source: "button".into() });
    drive(&mut robot, (0.4, 0.0, 0.0), 300);
    assert!(!robot.moves(), "it resumed by itself");
    drive(&mut robot, (0.0, 0.0, 0.0), 50);
    drive(&mut robot, (0.4, 0.0, 0.1), 300);
    assert!(robot.moves(), "{}", robot.reason());
}
