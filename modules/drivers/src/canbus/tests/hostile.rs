//! Failures that heartbeats do not reveal, and messages from before a stop.

use super::*;
use base::can::Id;
use messages::middlelevel::{CmdGoal, DataEstimate, Waypoint};

fn rpdo4_moves(frame: &can::Frame) -> bool {
    frame.id() == Id::Standard(0x501) && frame.data()[0] == 0x0F && frame.data()[2..6] != [0; 4]
}

impl Robot {
    fn estimate(&mut self) {
        self.bench.message(DataEstimate { quality: DataEstimate::FINE, ..Default::default() });
    }

    fn goal(&mut self, at: Instant) {
        let goal = Message::from(CmdGoal { waypoints: vec![Waypoint::default()], ..Default::default() });
        self.bench.event(Event::Message { at, from: Origin::DUE, message: &goal });
    }

    fn plan(&mut self, speed: f64, ms: u32, located: bool) {
        for _ in 0..ms / 50 {
            if located {
                self.estimate();
            }
            let (priority, source) = (arbiter_planner(), "planner".into());
            self.bench.message(lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source });
            self.exchange();
            self.pass(50);
        }
    }
}

fn arbiter_planner() -> i8 {
    super::super::arbiter::PLANNER
}

#[test]
fn a_planner_that_was_let_go_turns_the_wheels_of_a_steering_that_was_lost() {
    let mut robot = Robot::ready();
    robot.goal(robot.bench.now());
    robot.plan(0.4, 500, true);
    robot.icla.alive = false;
    robot.plan(0.4, 1000, true);
    robot.icla.alive = true;
    robot.plan(0.0, 4000, true);
    assert_eq!(robot.holds(), [(Hold::PlannerLatched, "planner")]);
    // It steers at standstill and drives when the wheels are there: it waits for the steering.
    robot.goal(robot.bench.now());
    for _ in 0..40 {
        robot.estimate();
        let speed = if (robot.motion().steering - 0.3).abs() < 0.02 { 0.3 } else { 0.0 };
        let (priority, source) = (arbiter_planner(), "planner".into());
        robot.bench.message(lowlevel::CmdMotion { timestamp: 0, speed, steering: 0.3, priority, source });
        robot.exchange();
        robot.pass(50);
    }
    assert!(robot.moves(), "{} {:?}", robot.reason(), robot.motion());
}

#[test]
fn a_recovered_estimate_does_not_release_the_planner() {
    let mut robot = Robot::ready();
    robot.goal(robot.bench.now());
    robot.plan(0.4, 500, true);
    assert!(robot.moves(), "{}", robot.reason());
    let last = robot.bench.now() - Duration::from_millis(50);
    robot.frames.clear();
    robot.plan(0.4, 400, false);
    assert!(!robot.moves());
    let stop = robot.frames.iter().find(|(_, frame)| frame.data().starts_with(&[0x0B, 0x00])).unwrap().0;
    assert_eq!(stop.since(last), Duration::from_millis(200), "at once, not at the next message");
    robot.plan(0.4, 1000, true);
    assert!(!robot.moves(), "it resumed by itself");
    assert_eq!(robot.holds(), [(Hold::PlannerLatched, "planner")]);
    robot.goal(robot.bench.now());
    robot.plan(0.4, 200, true);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_planner_that_dies_stops_the_robot_at_once_and_a_manual_source_drives_without_it() {
    let mut robot = Robot::ready();
    robot.goal(robot.bench.now());
    robot.plan(0.4, 500, true);
    assert!(robot.moves(), "{}", robot.reason());
    robot.missing = "planner";
    robot.pass(100);
    assert!(!robot.moves(), "before its last command was too old");
    robot.missing = "";
    robot.pass(200);
    robot.plan(0.4, 500, true);
    assert!(!robot.moves(), "it resumed by itself");
    robot.missing = "planner";
    robot.pass(1000);
    robot.drive(0.4, 300);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_planner_that_was_silent_before_it_was_listed_as_down_waits_for_a_release_too() {
    let mut robot = Robot::ready();
    robot.goal(robot.bench.now());
    robot.plan(0.4, 500, true);
    // It hangs: its command expires before the watchdog lists it.
    robot.pass(300);
    robot.missing = "planner";
    robot.pass(100);
    robot.missing = "";
    robot.pass(200);
    robot.plan(0.4, 500, true);
    assert!(!robot.moves(), "it resumed by itself");
    assert_eq!(robot.holds(), [(Hold::PlannerLatched, "planner")]);
    robot.goal(robot.bench.now());
    robot.plan(0.4, 200, true);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_goal_from_before_the_end_of_a_stop_does_not_release_the_planner() {
    let mut robot = Robot::ready();
    robot.goal(robot.bench.now());
    robot.plan(0.4, 500, true);
    robot.missing = "driver_rs485a";
    robot.plan(0.4, 200, true);
    let during = robot.bench.now();
    robot.missing = "";
    robot.plan(0.4, 200, true);
    // It waited in the socket.
    robot.goal(during);
    robot.plan(0.4, 500, true);
    assert!(!robot.moves());
    robot.goal(robot.bench.now());
    robot.plan(0.4, 200, true);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn an_engaged_pause_line_stops_a_robot_without_a_power_controller_too() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged: true, source: "sd1_front".into() });
    robot.exchange();
    assert!(!robot.moves());
    robot.drive(0.4, 200);
    assert_eq!(robot.holds(), [(Hold::PauseFloor, "sd1_front"), (Hold::NotReleased, "test")]);
    robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged: false, source: "sd1_front".into() });
    robot.drive(0.4, 200);
    assert!(!robot.moves(), "it resumed by itself");
    assert_eq!(robot.holds(), [(Hold::PauseLatched, ""), (Hold::NotReleased, "test")]);
}

#[test]
fn turning_drives_are_stopped_before_they_are_booted_again() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    // Shorter than the drive's timeout of the master's heartbeat.
    robot.bench.event(Event::Port { port: PortId(0), input: Input::Down("bus-off") });
    robot.exchange();
    robot.pass(20);
    robot.frames.clear();
    robot.bench.event(Event::Port { port: PortId(0), input: Input::Up });
    robot.exchange();
    let propulsion = can::Frame::standard(0x501, &[0x0B, 0, 0, 0, 0, 0]);
    let steering = can::Frame::standard(0x302, &[0x02, 0, 0, 0, 0, 0]);
    let sent: Vec<_> = robot.frames.iter().map(|(_, frame)| *frame).collect();
    assert_eq!(sent[..2], [propulsion, steering]);
    let stop = |frame: &can::Frame| [propulsion, steering].contains(frame);
    assert!(!sent[2..].iter().any(stop), "once at a time");
    robot.pass(5000);
    assert!(robot.bench.shell.state() == State::Run && !robot.moves(), "{}", robot.reason());
    robot.frames.clear();
    robot.pass(1000);
    assert!(!robot.frames.iter().any(|(_, frame)| stop(frame)), "they are booted, and stand");
}

#[test]
fn a_command_from_the_future_lives_no_longer_than_any_other() {
    let mut robot = Robot::ready();
    let source = "clock".into();
    let message = Message::from(lowlevel::CmdMotion { timestamp: 0, speed: 0.4, steering: 0.0, priority: 1, source });
    let at = robot.bench.now() + Duration::from_secs(3600);
    robot.bench.event(Event::Message { at, from: Origin::DUE, message: &message });
    robot.exchange();
    robot.pass(249);
    assert!(robot.moves(), "{}", robot.reason());
    robot.pass(2);
    assert!(!robot.moves());
}

#[test]
fn the_robot_does_not_drive_before_it_steers() {
    let mut robot = Robot::ready();
    robot.pass(500);
    // Quick-stopped by PAUSE, then released: both drives are to be enabled again, and the steering does not obey.
    let pause = |engaged| lowlevel::EventStop { timestamp: 0, engaged, source: "button".into() };
    robot.bench.message(pause(true));
    robot.pass(200);
    robot.icla.stubborn = true;
    robot.bench.message(pause(false));
    robot.frames.clear();
    robot.press(0.4);
    robot.drive(0.4, 3000);
    assert!(!robot.frames.iter().any(|(_, frame)| rpdo4_moves(frame)), "driven without steering");
}

#[test]
fn an_unconfirmed_stop_is_repeated_and_blocks_motion() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.epos.stubborn = true;
    robot.pass(4000);
    let before = robot.bench.now();
    robot.pass(1000);
    let stops = |(at, frame): &&(Instant, can::Frame)| *at > before && frame.data().starts_with(&[0x0B, 0x00]);
    let stops = robot.frames.iter().filter(stops).count();
    assert!(stops >= 19, "{stops} quick stops in a second");
    assert_eq!(robot.holds()[..2], [(Hold::SpeedExceeded, ""), (Hold::DriveStuck, "propulsion")]);
    robot.drive(0.0, 200);
    robot.frames.clear();
    robot.drive(0.4, 1000);
    assert!(!robot.frames.iter().any(|(_, frame)| rpdo4_moves(frame)));
    robot.epos.stubborn = false;
    robot.pass(2000);
    assert!(!robot.moves());
    let (module, source) = (NAME.into(), "test".into());
    robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source });
    robot.drive(0.0, 50);
    robot.drive(0.4, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_that_sends_only_heartbeats_stops_the_robot() {
    for propulsion in [true, false] {
        let mut robot = Robot::ready();
        robot.drive(0.4, 500);
        let mute = if propulsion { &mut robot.epos } else { &mut robot.icla };
        mute.mute = true;
        robot.drive(0.4, 1000);
        assert_eq!(robot.hold(), Some(Hold::DriveDeaf), "{propulsion}: {}", robot.reason());
        assert!(!robot.moves(), "{propulsion}");
        let told = robot.errors.iter().filter(|(fault, _)| *fault == Fault::DriveFault).count();
        assert!(told > 0);
        robot.epos.mute = false;
        robot.icla.mute = false;
        robot.drive(0.4, 2000);
        assert!(!robot.moves(), "it resumed by itself");
        robot.drive(0.0, 50);
        robot.drive(0.4, 500);
        assert!(robot.moves(), "{propulsion}: {}", robot.reason());
    }
}

#[test]
fn a_drive_that_does_not_answer_is_booted_again() {
    for propulsion in [true, false] {
        let mut robot = Robot::ready();
        robot.drive(0.4, 500);
        let (drive, node, stop) = if propulsion { (&mut robot.epos, 1, 0x0B) } else { (&mut robot.icla, 2, 0x02) };
        drive.mute = true;
        robot.frames.clear();
        robot.drive(0.4, 4000);
        let reset = can::Frame::standard(0, &[0x82, node]);
        let at = robot.frames.iter().position(|(_, frame)| *frame == reset).expect("a reset of its communication");
        let stops = |frame: &can::Frame| frame.data() == [stop, 0, 0, 0, 0, 0];
        assert!(robot.frames[..at].iter().any(|(_, frame)| stops(frame)), "{propulsion}: it was not stopped before");
        let drive = if propulsion { &mut robot.epos } else { &mut robot.icla };
        drive.mute = false;
        robot.pass(8000);
        assert!(!robot.moves(), "it resumed by itself");
        robot.drive(0.0, 50);
        robot.drive(0.4, 500);
        assert!(robot.moves(), "{propulsion}: {}", robot.reason());
    }
}

#[test]
fn the_steering_is_homed_only_at_known_standstill() {
    let mut robot = Robot::ready();
    // The robot rolls, pushed; the frame that would report it is lost, then the steering is to be homed.
    robot.epos.mute = true;
    robot.epos.node.set(0x606C, 0, 1000);
    robot.pass(20);
    robot.epos.mute = false;
    robot.pass(500);
    robot.bench.message(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
    robot.pass(100);
    assert!(robot.errors.contains(&(Fault::CommandForbidden, Severity::Warning)));
    assert!(robot.motion().homed);
    // The steering reboots: an operator homes it once the robot stands, not before.
    robot.icla.power_on(robot.bench.now());
    robot.pass(3000);
    robot.home();
    robot.pass(3000);
    assert!(!robot.motion().homed, "homed while it rolls");
    robot.epos.node.set(0x606C, 0, 0);
    robot.pass(3000);
    assert!(!robot.motion().homed, "homed by itself");
    robot.home();
    robot.pass(3000);
    assert!(robot.motion().homed, "{}", robot.reason());
}

#[test]
fn a_reboot_clears_the_fault_of_a_drive_and_the_next_one_is_reported() {
    let mut robot = Robot::ready();
    for n in 1..3 {
        let now = robot.bench.now();
        robot.epos.fault(now, 0x2310);
        robot.pass(100);
        let now = robot.bench.now();
        robot.epos.power = canopen::axis::drive::Drive::new(6, true);
        robot.epos.node.power_on(now);
        robot.pass(3000);
        let told = |severity| robot.errors.iter().filter(|told| **told == (Fault::DriveFault, severity)).count();
        assert_eq!((told(Severity::Error), told(Severity::Notice)), (n, n));
    }
}

#[test]
fn an_invalid_priority_is_rejected() {
    for priority in [-1, 4, i8::MIN, i8::MAX] {
        let mut robot = Robot::ready();
        robot.drive(0.4, 500);
        let source = "odd".into();
        robot.bench.message(lowlevel::CmdMotion { timestamp: 0, speed: 0.0, steering: 0.0, priority, source });
        robot.exchange();
        assert!(!robot.moves(), "{priority}");
    }
}

#[test]
fn a_stop_shorter_than_the_pause_between_two_commands_is_a_stop() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    robot.command(0.4, 0.0);
    let pause = |engaged| lowlevel::EventStop { timestamp: 0, engaged, source: "button".into() };
    robot.bench.message(pause(true));
    robot.pass(5);
    robot.bench.message(pause(false));
    robot.pass(5);
    robot.drive(0.4, 500);
    assert!(!robot.moves(), "it resumed by itself");
    assert_eq!(robot.holds(), [(Hold::PauseLatched, ""), (Hold::NotReleased, "test")]);
    robot.press(0.4);
    robot.drive(0.4, 200);
    assert!(robot.moves(), "{}", robot.reason());
}
