//! Drives that fault, stand, change their mode or do not answer: what is reported, and what enables them again.

use super::*;
use base::can::{Frame, Id};

fn reports(robot: &Robot, fault: Fault) -> Vec<Severity> {
    robot.errors.iter().filter(|(told, _)| *told == fault).map(|(_, severity)| *severity).collect()
}

/// Number of times for which the drive with this RPDO was told to enable its operation.
fn enabled(robot: &Robot, rpdo: u16) -> usize {
    let enables = |frame: &Frame| frame.id() == Id::Standard(rpdo) && frame.data()[0] & 0x8F == 0x0F;
    robot.frames.iter().filter(|(_, frame)| enables(frame)).count()
}

#[test]
fn a_drive_that_faulted_is_not_enabled_before_a_deliberate_command() {
    for (steering, rpdo) in [(true, 0x302), (false, 0x501)] {
        let mut robot = Robot::ready();
        robot.drive(0.4, 500);
        assert!(robot.moves(), "{}", robot.reason());
        let now = robot.bench.now();
        let drive = if steering { &mut robot.icla } else { &mut robot.epos };
        drive.fault(now, 0x8611);
        robot.exchange();
        robot.frames.clear();
        // The source goes on, then is let go and idles at zero: neither is a deliberate command.
        robot.drive(0.4, 3000);
        robot.drive(0.0, 3000);
        robot.pass(2000);
        assert_eq!(robot.holds(), [(Hold::NobodyCommands, "")], "the fault is reset");
        let drive = if steering { &robot.icla } else { &robot.epos };
        assert_eq!(drive.power.state(), PowerState::SwitchOnDisabled, "{steering}");
        assert_eq!(enabled(&robot, rpdo), 0, "{steering}: it was enabled by itself");
        robot.press(0.4);
        robot.drive(0.4, 500);
        assert!(robot.moves(), "{}", robot.reason());
    }
}

#[test]
fn a_blocked_steering_gets_its_current_once_for_each_command() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    for round in 0..3 {
        if round > 0 {
            robot.press(0.4);
        }
        // It faults as soon as it is enabled.
        let mut times = 0;
        for _ in 0..100 {
            if robot.icla.power.state() == PowerState::OperationEnabled {
                times += 1;
                let now = robot.bench.now();
                robot.icla.fault(now, 0x8611);
            }
            robot.drive(0.4, 50);
        }
        assert_eq!(times, 1, "round {round}");
        assert_eq!(robot.hold(), Some(Hold::NotReleased));
    }
}

#[test]
fn a_drive_that_was_lost_is_not_enabled_before_a_deliberate_command() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.icla.alive = false;
    robot.drive(0.4, 1000);
    robot.icla.alive = true;
    robot.frames.clear();
    robot.drive(0.0, 4000);
    assert_eq!((robot.bench.shell.state(), robot.motion().homed), (State::Run, true), "{}", robot.reason());
    assert_eq!(enabled(&robot, 0x302), 0);
    robot.drive(0.4, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn the_report_of_a_fault_does_not_say_more_than_is_known() {
    let mut robot = Robot::ready();
    // The emergency is lost, and the statusword arrives.
    robot.epos.power.fault();
    robot.epos.power.fault_reaction_done();
    robot.pass(700);
    assert_eq!(robot.reason(), "the propulsion drive is in fault, its emergency was not received");
    // Another one comes with its emergency; then the module starts anew, and finds the drive in fault.
    robot.pass(3000);
    let now = robot.bench.now();
    robot.epos.fault(now, 0x2310);
    robot.pass(100);
    assert_eq!(robot.reason(), "the propulsion drive is in fault, error code 0x2310");
    let now = robot.bench.now();
    robot.epos.node.power_on(now);
    robot.pass(300);
    assert_eq!(robot.reason(), "the propulsion drive is in fault since before it was booted");
}

#[test]
fn a_drive_whose_requests_are_not_answered_is_reported_once_until_it_answers() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.errors.clear();
    // PDOs and heartbeats go on, the SDO server is silent.
    robot.icla.deaf = true;
    robot.drive(0.4, 1500);
    assert_eq!(reports(&robot, Fault::DriveFault), [Severity::Error]);
    assert_eq!((robot.hold(), robot.moves()), (Some(Hold::DriveDeaf), false), "{}", robot.reason());
    robot.icla.deaf = false;
    robot.drive(0.4, 5000);
    assert_eq!(reports(&robot, Fault::DriveFault), [Severity::Error, Severity::Notice]);
    assert!(!robot.moves(), "it resumed by itself");
    robot.press(0.4);
    robot.drive(0.4, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_in_another_mode_stops_the_robot_and_is_booted_again() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.errors.clear();
    robot.epos.node.set(0x6060, 0, -4);
    robot.epos.node.set(0x6061, 0, -4);
    let begin = robot.bench.now();
    robot.frames.clear();
    robot.drive(0.4, 300);
    let stop = robot.frames.iter().find(|(_, frame)| frame.data() == [0x0B, 0, 0, 0, 0, 0]).expect("a quick stop").0;
    assert!(stop.since(begin) <= Duration::from_millis(250), "{:?}", stop.since(begin));
    assert_eq!(robot.hold(), Some(Hold::DriveParameter), "{}", robot.reason());
    // The fake keeps its speed in this mode.
    robot.epos.node.set(0x606C, 0, 0);
    robot.drive(0.4, 3000);
    assert_eq!(reports(&robot, Fault::DriveParameter), [Severity::Error, Severity::Notice]);
    assert_eq!((robot.epos.node.get(0x6061, 0), robot.moves()), (Some(3), false), "{}", robot.reason());
    robot.press(0.4);
    robot.drive(0.4, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_that_stands_although_it_is_to_move_stops_the_robot() {
    let mut robot = Robot::ready();
    // It says that it is enabled, and nothing turns.
    robot.epos.blocked = true;
    robot.press(0.4);
    let begin = robot.bench.now();
    robot.errors.clear();
    robot.drive(0.4, 2500);
    assert_eq!((robot.hold(), robot.errors.is_empty()), (None, true), "{}", robot.reason());
    robot.drive(0.4, 500);
    assert_eq!(robot.hold(), Some(Hold::DriveNoTarget), "{}", robot.reason());
    assert_eq!(robot.motion().reason, "the propulsion drive does not take its target: 0.00 instead of 0.40 m/s");
    assert!(robot.bench.now().since(begin) < Duration::from_millis(3100));
    robot.drive(0.4, 3000);
    assert_eq!(reports(&robot, Fault::DriveFault), [Severity::Error, Severity::Notice]);
    assert_eq!(robot.hold(), Some(Hold::NotReleased));
    robot.epos.blocked = false;
    robot.press(0.4);
    robot.drive(0.4, 5000);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_steering_that_stands_although_it_is_to_steer_stops_the_robot() {
    let mut robot = Robot::ready();
    robot.press(0.4);
    robot.drive(0.4, 2000);
    // It is enabled and acknowledges its targets, its motor does not turn, and it reports no following error.
    robot.icla.blocked = true;
    robot.errors.clear();
    let steer = |robot: &mut Robot, ms: u32| {
        for _ in 0..ms / 50 {
            robot.command(0.4, 0.35);
            robot.pass(50);
        }
    };
    let begin = robot.bench.now();
    steer(&mut robot, 1500);
    assert_eq!((robot.hold(), robot.errors.is_empty()), (None, true), "{}", robot.reason());
    while robot.hold().is_none() {
        steer(&mut robot, 50);
        assert!(robot.bench.now().since(begin) < Duration::from_millis(2500), "it is not noticed");
    }
    assert_eq!(robot.hold(), Some(Hold::DriveNoTarget), "{}", robot.reason());
    assert_eq!(robot.motion().reason, "the steering drive does not take its target: 0.00 instead of 0.35 rad");
    assert!(!robot.moves());
    steer(&mut robot, 3000);
    assert_eq!(reports(&robot, Fault::DriveFault), [Severity::Error, Severity::Notice]);
    assert_eq!(robot.hold(), Some(Hold::NotReleased));
    robot.icla.blocked = false;
    robot.press(0.4);
    steer(&mut robot, 5000);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_that_stands_although_it_is_to_move_stops_a_robot_without_odometry_soon() {
    let ready = || {
        let mut robot = Robot::with(epos::dictionary(1), Config { odometry: false, ..config() });
        robot.pass(3000);
        assert!(robot.motion().homed, "{}", robot.reason());
        robot.press(0.4);
        robot
    };
    let mut robot = ready();
    robot.epos.blocked = true;
    robot.drive(0.4, 300);
    assert_eq!(robot.hold(), None, "{}", robot.reason());
    robot.drive(0.4, 200);
    assert_eq!(robot.hold(), Some(Hold::DriveNoTarget), "{}", robot.reason());
    // Its encoder may be dead: it does not try again by itself, nor at the next press.
    robot.epos.blocked = false;
    robot.pass(1500);
    robot.press(0.4);
    robot.drive(0.4, 500);
    assert_eq!((robot.hold(), robot.moves()), (Some(Hold::WheelStood), false), "{}", robot.reason());
    let (module, source) = (NAME.into(), "test".into());
    robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source });
    robot.pass(100);
    robot.press(0.4);
    robot.drive(0.4, 500);
    assert!(robot.moves(), "{}", robot.reason());
    let mut robot = ready();
    robot.drive(0.4, 2000);
    robot.icla.blocked = true;
    for most in [250, 250] {
        assert_eq!(robot.hold(), None, "{}", robot.reason());
        for _ in 0..most / 50 {
            robot.command(0.4, 0.35);
            robot.pass(50);
        }
    }
    assert_eq!(robot.hold(), Some(Hold::DriveNoTarget), "{}", robot.reason());
    assert_eq!(robot.motion().reason, "the steering drive does not take its target: 0.00 instead of 0.35 rad");
}

#[test]
fn emergencies_that_alternate_are_reported_with_their_numbers() {
    let mut robot = Robot::ready();
    robot.errors.clear();
    for count in 0..20 {
        // The manufacturer counts in its own bytes.
        robot.epos.node.emergency(0x3210, 0x04, [count; 5]);
        robot.pass(200);
        robot.epos.node.emergency(0, 0, [0; 5]);
        robot.pass(200);
    }
    assert_eq!(reports(&robot, Fault::DriveEmergency), [Severity::Error, Severity::Notice]);
    robot.pass(12_000);
    assert_eq!(reports(&robot, Fault::DriveEmergency).len(), 4, "the others of each, in one report");
    // Long after, it is news again; a fifth one displaces the oldest, and nothing that was counted is lost.
    robot.pass(20_000);
    for code in [0x3210, 0x3210, 0x4210, 0x5210, 0x6210, 0x7210] {
        robot.epos.node.emergency(code, 0x04, [0; 5]);
        robot.pass(500);
    }
    assert_eq!(reports(&robot, Fault::DriveEmergency).len(), 4 + 5 + 1);
}

#[test]
fn an_emergency_that_is_repeated_is_reported_with_its_number() {
    let mut robot = Robot::ready();
    robot.errors.clear();
    for _ in 0..25 {
        robot.epos.node.emergency(0x3210, 0x04, [0; 5]);
        robot.pass(200);
    }
    assert_eq!(reports(&robot, Fault::DriveEmergency).len(), 1);
    robot.pass(10_000);
    assert_eq!(reports(&robot, Fault::DriveEmergency).len(), 2, "the others, in one report");
    robot.epos.node.emergency(0x4210, 0x08, [0; 5]);
    robot.pass(200);
    assert_eq!(reports(&robot, Fault::DriveEmergency).len(), 3);
}

#[test]
fn pdos_that_are_too_short_are_reported() {
    let mut robot = Robot::ready();
    robot.errors.clear();
    for _ in 0..5 {
        robot.bench.can(PortId(0), Frame::standard(0x481, &[0x37, 0x02]));
        robot.pass(20);
    }
    assert_eq!(reports(&robot, Fault::CanMalformed), [Severity::Warning; 3], "the first, second and fourth");
}

#[test]
fn a_module_that_ends_leaves_its_drives_without_power_and_without_fault() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    let (module, source) = (NAME.into(), "test".into());
    let state = State::Terminate as i8;
    robot.bench.message(common::CmdState { timestamp: 0, module, state, manual: true, source });
    robot.exchange();
    robot.pass(1000);
    assert!(robot.ended, "it has ended");
    let states = [&robot.epos, &robot.icla].map(|drive| drive.power.state());
    assert_eq!(states, [PowerState::SwitchOnDisabled; 2]);
    // Its heartbeat is missing from now on, and no drive minds.
    robot.pass(2000);
    let states = [&robot.epos, &robot.icla].map(|drive| drive.power.state());
    assert_eq!(states, [PowerState::SwitchOnDisabled; 2]);
    let states = [&robot.epos, &robot.icla].map(|drive| drive.node.nmt_state());
    assert_eq!(states, [Some(canopen::NmtState::PreOperational); 2]);
}

#[test]
fn a_module_that_ends_does_not_wait_for_a_drive_that_tells_nothing() {
    let mut robot = Robot::ready();
    // The propulsion sends nothing but its heartbeat, and then not even its boot-up message. While that is awaited, its
    // last speed becomes too old to count as standstill.
    robot.epos.mute = true;
    robot.pass(700);
    robot.epos.silent = true;
    let state = State::Terminate as i8;
    robot.bench.message(common::CmdState { module: NAME.into(), state, manual: true, ..Default::default() });
    robot.exchange();
    robot.pass(2000);
    assert!(robot.ended, "it has ended");
}
