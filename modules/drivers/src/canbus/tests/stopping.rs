//! The driver measures that the robot stops; if it does not, the motors' feed is cut.

use super::*;
use base::can::Frame;
use canopen::Dictionary;
use canopen::dictionary::{Access, DataType, Entry};
use messages::lowlevel::{CmdPower, DataPower};

/// A robot with a power controller whose PAUSE line is open.
fn powered() -> Robot {
    let mut robot = Robot::with(epos::dictionary(1), Config { has_pause_line: true, ..config() });
    live(&mut robot, 3000);
    assert!(robot.motion().homed, "{}", robot.reason());
    robot
}

/// Time passes; the power controller reports that the line is open.
fn live(robot: &mut Robot, ms: u32) {
    for _ in 0..ms / 50 {
        robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() });
        robot.pass(50);
    }
}

fn drive(robot: &mut Robot, speed: f64, ms: u32) {
    for _ in 0..ms / 50 {
        robot.command(speed, 0.0);
        live(robot, 50);
    }
}

/// The drive reports a speed, m/s, whatever it is commanded.
fn measured(robot: &mut Robot, speed: f64, ms: u32) {
    robot.epos.stubborn = true;
    for n in 0..ms / 10 {
        // Changes are reported.
        robot.epos.node.set(0x606C, 0, (speed * 2483.0) as i64 + i64::from(n % 2));
        robot.pass(10);
        if n % 20 == 0 {
            robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() });
        }
    }
}

/// The power controller reports the channel of the motors.
fn report(robot: &mut Robot, on: bool) {
    let motors = lowlevel::Channel { name: "motors".into(), on, current: 0.0 };
    robot.bench.message(DataPower { channels: vec![motors], ..Default::default() });
    robot.exchange();
}

fn order(device: i8, action: i8) -> CmdPower {
    CmdPower { timestamp: 0, device, action }
}

#[test]
fn a_drive_that_does_not_brake_is_cut_off_its_feed() {
    let mut robot = powered();
    drive(&mut robot, 0.5, 500);
    let begin = robot.bench.now();
    // The command has expired after 250 ms, and the drive goes on.
    measured(&mut robot, 0.5, 1000);
    let (at, cut) = robot.power.first().expect("the feed is cut").clone();
    assert_eq!((cut.device, cut.action), (3, CmdPower::OFF));
    assert!(at.since(begin) < Duration::from_millis(850), "{:?} after the last command", at.since(begin));
    assert!(robot.errors.contains(&(Fault::StopFailed, Severity::Error)));
    assert_eq!(robot.holds()[0], (Hold::FeedCut, ""));
    // Ordered again until the power controller says so.
    assert!(!robot.power.is_empty());
    live(&mut robot, 1000);
    assert!(robot.power.len() >= 3, "{:?}", robot.power.len());
    report(&mut robot, false);
    let orders = robot.power.len();
    robot.epos.stubborn = false;
    robot.epos.node.set(0x606C, 0, 0);
    live(&mut robot, 3000);
    assert_eq!(robot.power.len(), orders);
    // Neither by a press, nor by RUN, nor by another channel; a person switches the motors on.
    robot.press(0.3);
    let (module, source) = (NAME.into(), "test".into());
    robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source });
    robot.bench.message(order(5, CmdPower::ON));
    live(&mut robot, 100);
    assert_eq!(robot.holds()[0], (Hold::FeedCut, ""));
    robot.bench.message(order(3, CmdPower::ON));
    live(&mut robot, 100);
    assert_eq!(robot.holds()[0], (Hold::FeedOff, ""), "until the power controller has switched them");
    report(&mut robot, true);
    drive(&mut robot, 0.0, 50);
    drive(&mut robot, 0.3, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_process_that_did_not_cut_the_feed_says_that_it_is_off_and_waits_for_the_report_that_it_is_on() {
    let mut robot = powered();
    // An earlier process cut it, or somebody switched the channel off.
    report(&mut robot, false);
    live(&mut robot, 100);
    assert_eq!((robot.holds()[0], robot.power.len()), ((Hold::FeedOff, ""), 0));
    drive(&mut robot, 0.0, 50);
    drive(&mut robot, 0.3, 500);
    let (module, source) = (NAME.into(), "test".into());
    robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source });
    live(&mut robot, 100);
    assert_eq!((robot.holds()[0], robot.moves()), ((Hold::FeedOff, ""), false));
    report(&mut robot, true);
    // A source that commanded motion all the time must send zero first.
    drive(&mut robot, 0.3, 100);
    assert_eq!((robot.holds()[0], robot.moves()), ((Hold::NotReleased, "test"), false));
    drive(&mut robot, 0.0, 50);
    drive(&mut robot, 0.3, 500);
    assert!(robot.moves() && robot.power.is_empty(), "{}", robot.reason());
}

#[test]
fn a_power_channel_that_is_not_the_second_way_does_not_hold_the_robot() {
    let stop = Stop { second_way: SecondWay::None, ..config().stop };
    let mut robot = Robot::with(epos::dictionary(1), Config { has_pause_line: true, stop, ..config() });
    live(&mut robot, 3000);
    report(&mut robot, false);
    drive(&mut robot, 0.3, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_drive_that_keeps_its_speed_to_the_last_digit_is_cut_off_its_feed_as_soon() {
    for phase in (0..400).step_by(50) {
        let mut robot = powered();
        drive(&mut robot, 0.5, 500);
        // Nothing changes, so the drive reports nothing by itself.
        robot.epos.stubborn = true;
        robot.epos.node.set(0x606C, 0, (0.5 * 2483.0) as i64);
        drive(&mut robot, 0.5, phase);
        let begin = robot.bench.now();
        live(&mut robot, 1500);
        let (at, cut) = robot.power.first().expect("the feed is cut").clone();
        assert_eq!((cut.device, cut.action), (3, CmdPower::OFF));
        // The command has expired after 250 ms; 650 ms later the feed is to be cut.
        assert!(at.since(begin) < Duration::from_millis(900), "{phase}: {:?} after the command", at.since(begin));
    }
}

/// The propulsion brakes from 0.5 m/s, at 1.5 m/s².
fn brake(robot: &mut Robot) {
    for n in 0..200 {
        let speed = (0.5 - 1.5 * f64::from(n) * 0.01).max(0.0);
        robot.epos.node.set(0x606C, 0, (speed * 2483.0) as i64);
        robot.pass(10);
    }
}

/// A drive that turned at 0.5 m/s was silent for 0.35 s, counts as lost, and sends nothing but its heartbeat.
fn silent() -> Robot {
    let mut robot = powered();
    drive(&mut robot, 0.5, 500);
    robot.epos.stubborn = true;
    robot.epos.node.set(0x606C, 0, (0.5 * 2483.0) as i64);
    robot.epos.silent = true;
    drive(&mut robot, 0.5, 350);
    assert_eq!(robot.holds()[0], (Hold::DriveLost, "propulsion"));
    robot.epos.silent = false;
    robot
}

/// The cable of a drive that turned at 0.5 m/s, and does not watch the master, was broken for 3 s: it was asked in vain
/// by a boot-up, which is tried again each second.
fn cut() -> Robot {
    let mut robot = powered();
    drive(&mut robot, 0.5, 500);
    robot.epos.stubborn = true;
    robot.epos.node.set(0x606C, 0, (0.5 * 2483.0) as i64);
    robot.epos.alive = false;
    drive(&mut robot, 0.5, 3000);
    assert_eq!(robot.holds()[0], (Hold::DriveBootFailed, "propulsion"));
    robot.epos.alive = true;
    robot
}

#[test]
fn a_drive_that_was_silent_and_does_not_brake_is_cut_off_its_feed_before_it_is_booted() {
    for mut robot in [silent(), cut()] {
        let begin = robot.bench.now();
        live(&mut robot, 650);
        let (at, cut) = robot.power.first().expect("the feed is cut").clone();
        assert_eq!((cut.device, cut.action), (3, CmdPower::OFF));
        assert!(at.since(begin) < Duration::from_millis(600), "{:?} after its heartbeat returned", at.since(begin));
    }
}

#[test]
fn a_drive_that_was_silent_and_brakes_is_left_alone() {
    for mut robot in [silent(), cut()] {
        brake(&mut robot);
        assert_eq!(robot.power, []);
    }
}

/// A drive that turned at 0.5 m/s was stopped by an NMT command of another master, so it is reset.
fn foreign_stop() -> Robot {
    let mut robot = powered();
    drive(&mut robot, 0.5, 500);
    robot.epos.stubborn = true;
    robot.epos.node.set(0x606C, 0, (0.5 * 2483.0) as i64);
    robot.pass(100);
    robot.bench.can(PortId(0), Frame::standard(0x701, &[0x04]));
    robot.exchange();
    assert_eq!(robot.holds()[0], (Hold::DriveLost, "propulsion"));
    robot
}

#[test]
fn a_drive_that_is_reset_while_it_turns_and_is_not_heard_is_cut_off_its_feed() {
    let mut robot = foreign_stop();
    robot.epos.silent = true;
    live(&mut robot, 400);
    assert_eq!(robot.power, []);
    live(&mut robot, 100);
    assert_eq!(robot.power.first().map(|(_, cut)| (cut.device, cut.action)), Some((3, CmdPower::OFF)));
    assert_eq!(robot.holds()[0], (Hold::FeedCut, ""));
}

#[test]
fn a_drive_that_is_reset_while_it_turns_and_brakes_is_left_alone() {
    let mut robot = foreign_stop();
    brake(&mut robot);
    assert_eq!(robot.power, []);
}

#[test]
fn a_pause_that_does_not_cut_the_feed_is_watched_like_any_stop() {
    let mut robot = powered();
    drive(&mut robot, 0.5, 500);
    let rope = lowlevel::EventStop { timestamp: 0, engaged: true, source: "a rope".into() };
    robot.bench.message(rope);
    measured(&mut robot, 0.5, 1000);
    assert_eq!(robot.power.first().map(|(_, cut)| (cut.device, cut.action)), Some((3, CmdPower::OFF)));
    assert_eq!(robot.holds()[0], (Hold::FeedCut, ""));
}

#[test]
fn requests_of_others_do_not_keep_the_speed_from_being_read() {
    let mut robot = powered();
    drive(&mut robot, 0.5, 500);
    robot.epos.stubborn = true;
    robot.epos.node.set(0x606C, 0, (0.5 * 2483.0) as i64);
    drive(&mut robot, 0.5, 400);
    let begin = robot.bench.now();
    // Nothing changes, so the drive reports nothing by itself; somebody reads its serial number all the time.
    for n in 0..1500 {
        for request in 0..20 {
            let (index, subindex) = (0x1018, 4);
            let read = lowlevel::CmdSdo { request: 20 * n + request, node: 1, index, subindex, ..Default::default() };
            robot.bench.message(read);
        }
        robot.pass(1);
        if n % 200 == 0 {
            robot.bench.message(lowlevel::EventStop { timestamp: 0, engaged: false, source: String::new() });
        }
    }
    let (at, cut) = robot.power.first().expect("the feed is cut").clone();
    assert_eq!((cut.device, cut.action), (3, CmdPower::OFF));
    assert!(at.since(begin) < Duration::from_millis(900), "{:?} after the command", at.since(begin));
}

#[test]
fn a_feed_that_returns_without_a_person_is_cut_again() {
    let mut robot = powered();
    drive(&mut robot, 0.5, 500);
    measured(&mut robot, 0.5, 1000);
    let mut orders_after = |on| {
        report(&mut robot, on);
        let before = robot.power.len();
        robot.pass(1100);
        robot.power.len() - before
    };
    assert_eq!(orders_after(false), 0);
    // The power controller was reset.
    assert!(orders_after(true) >= 2);
    assert_eq!(orders_after(false), 0);
}

#[test]
fn a_drive_that_is_faster_than_commanded_is_braked_first() {
    let mut robot = powered();
    drive(&mut robot, 0.2, 500);
    robot.frames.clear();
    for _ in 0..8 {
        robot.command(0.2, 0.0);
        measured(&mut robot, 0.5, 50);
    }
    assert!(robot.frames.iter().any(|(_, frame)| frame.data().starts_with(&[0x0B, 0x00])), "a quick stop");
    assert!(robot.errors.contains(&(Fault::SpeedExceeded, Severity::Error)));
    assert_eq!(robot.power, [], "not cut before it was told to brake");
    assert_eq!(robot.holds()[0], (Hold::SpeedExceeded, ""));
    // It brakes.
    robot.epos.stubborn = false;
    robot.epos.node.set(0x606C, 0, 0);
    live(&mut robot, 1000);
    assert_eq!(robot.power, []);
    robot.press(0.2);
    live(&mut robot, 100);
    assert_eq!(robot.holds()[0], (Hold::SpeedExceeded, ""), "an operator must let it go");
    let (module, source) = (NAME.into(), "test".into());
    robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source });
    drive(&mut robot, 0.0, 50);
    drive(&mut robot, 0.2, 300);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn every_stop_of_a_good_drive_is_left_alone() {
    let mut robot = powered();
    for _ in 0..5 {
        drive(&mut robot, 0.6, 500);
        live(&mut robot, 1000);
        drive(&mut robot, 0.0, 50);
        drive(&mut robot, -0.6, 500);
        drive(&mut robot, 0.0, 500);
    }
    assert_eq!(robot.power, []);
    assert!(!robot.errors.iter().any(|(fault, _)| [Fault::StopFailed, Fault::SpeedExceeded].contains(fault)));
}

#[test]
fn without_a_second_way_that_is_said_at_the_start_and_the_failure_is_reported() {
    let says = |robot: &Robot| robot.notes.iter().any(|note| note.starts_with("THERE IS NO SECOND WAY TO STOP"));
    assert!(!says(&powered()) && !says(&with_output(1)));
    let mut robot = Robot::ready();
    assert!(says(&robot), "{:?}", robot.notes);
    robot.drive(0.5, 500);
    measured(&mut robot, 0.5, 1000);
    assert!(robot.errors.contains(&(Fault::StopFailed, Severity::Error)) && robot.power.is_empty());
    assert!(robot.holds().contains(&(Hold::SpeedExceeded, "")), "{}", robot.reason());
}

#[test]
fn a_wheel_that_gains_speed_while_it_is_to_stop_loses_its_power_where_nothing_cuts_its_feed() {
    for (unbraked, slope, controlword) in [
        (UnbrakedStop::Coast, 2.0, 0x00),
        // The brake helps, and is kept.
        (UnbrakedStop::Coast, 0.4, 0x0B),
        (UnbrakedStop::Brake, 2.0, 0x0B),
    ] {
        let stop = Stop { second_way: SecondWay::None, unbraked, ..config().stop };
        let mut robot = Robot::with(epos::dictionary(1), Config { stop, ..config() });
        robot.pass(3000);
        robot.press(0.3);
        robot.drive(0.3, 1500);
        robot.epos.stubborn = true;
        // The command expires after 250 ms.
        for n in 0..80 {
            let speed = 0.3 + slope * (f64::from(n) * 0.01 - 0.25).max(0.0);
            robot.epos.node.set(0x606C, 0, (speed * 2483.0) as i64);
            robot.pass(10);
        }
        assert_eq!(robot.last_rpdo4().1[0], controlword, "{unbraked:?} {slope}: {}", robot.reason());
        let failed = robot.errors.contains(&(Fault::StopFailed, Severity::Error));
        assert!(failed && robot.holds().contains(&(Hold::SpeedExceeded, "")), "{}", robot.reason());
        // Nothing moves it before an operator has let it go.
        robot.epos.stubborn = false;
        robot.epos.node.set(0x606C, 0, 0);
        robot.pass(2000);
        robot.press(0.3);
        robot.drive(0.3, 500);
        assert!(!robot.moves(), "{unbraked:?} {slope}");
        let (module, source) = (NAME.into(), "test".into());
        robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source });
        robot.pass(100);
        robot.press(0.3);
        robot.drive(0.3, 1000);
        assert!(robot.moves(), "{unbraked:?} {slope}: {}", robot.reason());
    }
}

/// A robot whose motors are fed by an output of node 5, which begins with this value.
fn with_output(value: i64) -> Robot {
    let output = OutputConfig { node: 5, index: 0x6200, subindex: 1, bits: 8, on: 1, cut: 0 };
    let stop = Stop { second_way: SecondWay::Canopen, output: Some(output), ..config().stop };
    let mut robot = Robot::with(epos::dictionary(1), Config { stop, ..config() });
    robot.output = Some(output_node(value));
    robot.pass(3000);
    robot
}

/// A robot whose motors are fed by a GPIO line, which begins with this level.
fn with_line(level: bool) -> Robot {
    let line = GpioConfig { chip: "/dev/gpiochip0".into(), line: LineId::Number(17), active_low: false };
    let stop = Stop { second_way: SecondWay::Gpio, gpio: Some(line), ..config().stop };
    let mut robot = Robot::with(epos::dictionary(1), Config { stop, ..config() });
    robot.line = Some(level);
    robot.pass(3000);
    robot
}

fn output_node(value: i64) -> Node {
    let object = Entry::new(0x6200, 1, DataType::U8, Access::ReadWrite, value);
    let mut node = Node::new(Dictionary::new(5).with(&[object]), Duration::from_millis(5));
    node.power_on(Instant::ZERO);
    node
}

/// The power stage of the propulsion is fed or not, and the drive stands.
fn stands(robot: &mut Robot) {
    robot.epos.stubborn = false;
    robot.epos.node.set(0x606C, 0, 0);
    robot.pass(300);
}

#[test]
fn a_drive_that_does_not_brake_is_cut_off_by_an_output() {
    is_cut_off(with_output(1));
    is_cut_off(with_line(true));
}

fn is_cut_off(mut robot: Robot) {
    robot.drive(0.5, 500);
    assert!(robot.moves() && robot.written.is_empty(), "{}", robot.reason());
    let begin = robot.bench.now();
    measured(&mut robot, 0.5, 1000);
    let (at, value) = *robot.written.first().expect("the feed is cut");
    assert!(value == 0 && at.since(begin) < Duration::from_millis(850), "{:?} after the last command", at.since(begin));
    assert!(robot.errors.contains(&(Fault::StopFailed, Severity::Error)));
    assert_eq!(robot.holds()[0], (Hold::FeedCut, ""));
    // Neither by a press, nor by RUN; by a person who switches the motors on, but not while it rolls.
    robot.press(0.3);
    let (module, source) = (NAME.into(), "test".into());
    robot.bench.message(common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source });
    robot.bench.message(order(3, CmdPower::ON));
    measured(&mut robot, 0.4, 500);
    stands(&mut robot);
    assert_eq!((robot.holds()[0], robot.written.len()), ((Hold::FeedCut, ""), 1));
    robot.bench.message(order(5, CmdPower::ON));
    robot.pass(500);
    assert_eq!((robot.holds()[0], robot.written.len()), ((Hold::FeedCut, ""), 1));
    robot.bench.message(order(3, CmdPower::ON));
    robot.pass(100);
    assert_eq!(robot.written.last().map(|(_, value)| *value), Some(1));
    robot.drive(0.0, 50);
    robot.drive(0.3, 500);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn an_output_is_not_cut_while_the_drive_brakes() {
    is_not_cut(with_output(1));
    is_not_cut(with_line(true));
}

fn is_not_cut(mut robot: Robot) {
    for _ in 0..5 {
        robot.drive(0.6, 500);
        robot.pass(1000);
        robot.drive(0.0, 50);
        robot.drive(-0.6, 500);
        robot.missing = "driver_rs485a";
        robot.pass(500);
        robot.missing = "";
        robot.pass(500);
        robot.drive(0.0, 50);
    }
    assert_eq!(robot.written, []);
}

#[test]
fn an_output_that_does_not_answer_stops_the_robot_and_is_cut_when_it_returns() {
    is_lost(with_output(1));
    is_lost(with_line(true));
}

fn is_lost(mut robot: Robot) {
    robot.drive(0.5, 500);
    let output = (robot.output.take(), robot.line.take());
    robot.drive(0.5, 700);
    assert!(robot.moves(), "an answer or two are missing");
    robot.drive(0.5, 700);
    assert!(!robot.moves());
    assert_eq!(robot.holds()[0], (Hold::SecondWayLost, ""));
    assert!(robot.errors.contains(&(Fault::SecondWayLost, Severity::Error)));
    (robot.output, robot.line) = output;
    robot.drive(0.5, 1000);
    assert!(robot.errors.contains(&(Fault::SecondWayLost, Severity::Notice)));
    assert_eq!(robot.holds(), [(Hold::NotReleased, "test")]);
    // It is gone when it is needed.
    robot.drive(0.0, 50);
    robot.drive(0.5, 300);
    let output = (robot.output.take(), robot.line.take());
    measured(&mut robot, 0.5, 1000);
    assert_eq!((robot.holds()[0], robot.written.len()), ((Hold::FeedCut, ""), 0));
    (robot.output, robot.line) = output;
    measured(&mut robot, 0.5, 1000);
    assert_eq!(robot.written.last().map(|(_, value)| *value), Some(0));
}

#[test]
fn an_output_that_is_off_stays_so_until_a_person_switches_it_on() {
    stays_off(with_output(0));
    stays_off(with_line(false));
}

/// The process that cut it has died: this one does not feed the motors again.
fn stays_off(mut robot: Robot) {
    robot.drive(0.0, 50);
    robot.drive(0.3, 500);
    assert_eq!((robot.holds()[0], robot.written.len()), ((Hold::FeedOff, ""), 0));
    robot.bench.message(order(3, CmdPower::ON));
    robot.pass(4000);
    robot.drive(0.0, 50);
    robot.drive(0.3, 500);
    assert!(robot.moves(), "{}", robot.reason());
    // Somebody else switches it off.
    match &mut robot.output {
        Some(output) => output.set(0x6200, 1, 0),
        None => robot.line = Some(false),
    }
    robot.drive(0.3, 500);
    assert_eq!((robot.holds()[0], robot.moves()), ((Hold::FeedOff, ""), false));
}

#[test]
fn an_order_to_switch_on_is_not_obeyed_after_the_output_was_lost() {
    for mut robot in [with_output(0), with_line(false)] {
        let output = (robot.output.take(), robot.line.take());
        robot.bench.message(order(3, CmdPower::ON));
        robot.pass(2000);
        assert_eq!(robot.holds()[0], (Hold::SecondWayLost, ""));
        (robot.output, robot.line) = output;
        robot.pass(2000);
        assert_eq!(robot.holds()[0], (Hold::FeedOff, ""));
        assert!(robot.written.iter().all(|(_, value)| *value == 0), "revoked by a cut: {:?}", robot.written);
    }
}

#[test]
fn an_order_that_a_port_holds_while_it_hangs_is_followed_by_a_cut() {
    let mut robot = with_line(false);
    robot.held = Some(Vec::new());
    robot.bench.message(order(3, CmdPower::ON));
    robot.pass(3000);
    assert_eq!(robot.holds()[0], (Hold::SecondWayLost, ""));
    // Nor is one taken meanwhile.
    robot.bench.message(order(3, CmdPower::ON));
    robot.pass(1000);
    let held = robot.held.take().unwrap();
    assert!(held.contains(&Signal::Level(true)), "it was on its way: {held:?}");
    let now = robot.bench.now();
    held.into_iter().for_each(|signal| robot.line_asked(now, signal));
    robot.pass(2000);
    assert_eq!((robot.holds()[0], robot.line), ((Hold::FeedOff, ""), Some(false)));
}

#[test]
fn a_line_whose_port_is_down_stops_the_robot_at_once() {
    let mut robot = with_line(true);
    robot.drive(0.5, 500);
    robot.line = None;
    robot.bench.event(Event::Port { port: LINE, input: Input::Down("line 17: Device or resource busy") });
    robot.exchange();
    assert_eq!(robot.holds()[0], (Hold::SecondWayLost, ""));
    assert!(robot.errors.contains(&(Fault::SecondWayLost, Severity::Error)));
    // The host opens it again and again, and the line answers at last.
    for _ in 0..3 {
        robot.bench.event(Event::Port { port: LINE, input: Input::Up });
        robot.pass(500);
        assert_eq!((robot.holds()[0], robot.moves()), ((Hold::SecondWayLost, ""), false));
        robot.bench.event(Event::Port { port: LINE, input: Input::Down("line 17: Device or resource busy") });
    }
    assert!(!robot.errors.contains(&(Fault::SecondWayLost, Severity::Notice)));
    robot.line = Some(true);
    robot.bench.event(Event::Port { port: LINE, input: Input::Up });
    robot.pass(500);
    assert!(robot.errors.contains(&(Fault::SecondWayLost, Severity::Notice)));
    robot.drive(0.0, 50);
    robot.drive(0.5, 500);
    assert!(robot.moves() && robot.written.is_empty(), "{}", robot.reason());
}

#[test]
fn a_line_that_reads_back_other_than_ordered_is_lost_and_ordered_again() {
    let mut robot = with_line(true);
    robot.drive(0.5, 500);
    robot.stuck = true;
    measured(&mut robot, 0.5, 3000);
    assert_eq!(robot.holds()[0], (Hold::FeedCut, ""));
    assert!(robot.errors.contains(&(Fault::SecondWayLost, Severity::Error)));
    assert!(robot.written.len() >= 5 && robot.written.iter().all(|(_, value)| *value == 0), "{:?}", robot.written);
    robot.stuck = false;
    robot.pass(500);
    assert_eq!(robot.line, Some(false));
    assert!(robot.errors.contains(&(Fault::SecondWayLost, Severity::Notice)));
    // In the other direction: it does not follow the person's order later, when nobody expects it.
    stands(&mut robot);
    robot.stuck = true;
    robot.bench.message(order(3, CmdPower::ON));
    robot.pass(2000);
    robot.stuck = false;
    robot.pass(2000);
    assert_eq!((robot.holds()[0], robot.line), ((Hold::FeedOff, ""), Some(false)));
}

#[test]
fn an_output_whose_state_is_unknown_is_none() {
    let stop = Stop { second_way: SecondWay::Canopen, ..config().stop };
    let output = OutputConfig { node: 5, index: 0x6200, subindex: 1, bits: 16, on: 1, cut: 0 };
    let mut robot =
        Robot::with(epos::dictionary(1), Config { stop: Stop { output: Some(output), ..stop }, ..config() });
    robot.pass(1000);
    assert_eq!(robot.holds()[0], (Hold::SecondWayLost, ""), "no node");
    // Of another size than configured.
    robot.output = Some(output_node(1));
    robot.pass(1000);
    assert_eq!(robot.holds()[0], (Hold::SecondWayLost, ""));
    assert!(robot.errors.contains(&(Fault::SecondWayLost, Severity::Error)));
}

#[test]
fn nobody_else_writes_the_output() {
    let mut robot = with_output(1);
    for (request, index, data) in [(7, 0x6200, vec![0]), (8, 0x1017, vec![0, 0])] {
        let request = lowlevel::CmdSdo { timestamp: 0, request, node: 5, index, subindex: 1, write: true, data };
        robot.bench.message(request);
        robot.pass(100);
    }
    let codes: Vec<i64> = robot.answers.iter().map(|answer| answer.abort_code).collect();
    assert_eq!((codes, robot.written.len()), (vec![i64::from(canopen::Abort::LOCAL_CONTROL.0); 2], 0));
}

#[test]
fn an_object_that_the_stop_depends_on_is_restored_within_ten_seconds() {
    for (index, value) in [(0x6085, 60), (0x6083, 1), (0x607F, 1), (0x1016, 0)] {
        let mut robot = Robot::ready();
        let sub = u8::from(index == 0x1016);
        let right = robot.epos.node.get(index, sub);
        robot.epos.node.set(index, sub, value);
        robot.drive(0.3, 10_500);
        assert_eq!(robot.epos.node.get(index, sub), right, "0x{index:X}");
        assert!(robot.errors.contains(&(Fault::DriveParameter, Severity::Error)));
        assert!(robot.errors.contains(&(Fault::DriveParameter, Severity::Notice)));
        assert!(!robot.moves(), "it was stopped, and must be let go");
    }
}

#[test]
fn what_another_program_may_have_changed_is_restored_at_once() {
    let mut robot = Robot::ready();
    robot.drive(0.3, 1000);
    let right = robot.epos.node.get(0x6085, 0);
    robot.epos.node.set(0x6085, 0, 60);
    // However often it asks.
    for _ in 0..100 {
        robot.bench.can(PortId(0), Frame::standard(0x601, &[0x23, 0x85, 0x60, 0, 0x3C, 0, 0, 0]));
        robot.pass(1);
    }
    assert_eq!(robot.epos.node.get(0x6085, 0), right);
    assert!(robot.errors.contains(&(Fault::DriveParameter, Severity::Error)));
}

#[test]
fn the_speed_is_capped_by_what_pause_leaves_of_the_brakes() {
    let stop = |pause, distance_m| Stop { pause, distance_m, ..Stop::usual() };
    let cap = |stop: Stop| (stop.speed_max_mps(1.5, false) * 1000.0).round() / 1000.0;
    assert_eq!(cap(stop(PauseStop::Coast, 0.25)), 0.274);
    assert_eq!(cap(stop(PauseStop::Brake, 0.25)), 0.866);
    assert_eq!(cap(stop(PauseStop::Delayed, 0.25)), 0.866);
    assert_eq!(cap(stop(PauseStop::Delayed, 2.0)), 0.9, "1.5 m/s² for 0.6 s");
    let mut robot = Robot::with(epos::dictionary(1), Config { stop: stop(PauseStop::Coast, 0.25), ..config() });
    robot.pass(3000);
    // Within the limits: followed as far as permitted, and not refused.
    robot.drive(1.0, 500);
    assert!(robot.moves(), "{}", robot.reason());
    assert_eq!(robot.holds(), [(Hold::StopDistance, "")]);
    assert!((robot.motion().speed_target - 0.274).abs() < 0.001, "{}", robot.motion().speed_target);
    robot.drive(0.2, 500);
    assert!(robot.moves() && robot.holds().is_empty(), "{:?}", robot.holds());
}

#[test]
fn a_stop_whose_cause_ends_at_once_is_finished_by_the_quick_stop() {
    let mut robot = Robot::ready();
    robot.drive(0.6, 500);
    robot.epos.stubborn = true;
    robot.missing = "driver_rs485a";
    while robot.hold() != Some(Hold::CriticalModule) {
        robot.command(0.6, 0.0);
        robot.pass(1);
    }
    robot.missing = "";
    robot.frames.clear();
    // It brakes with 1.5 m/s². The module is back after 0.1 s; the source sends zero, then presses again.
    for n in 0..38 {
        robot.epos.node.set(0x606C, 0, ((0.6 - 0.015 * f64::from(n)) * 2483.0) as i64);
        robot.pass(10);
        if n > 10 && n % 5 == 0 {
            robot.command(if n < 20 { 0.0 } else { 0.3 }, 0.0);
        }
    }
    let enabled = |frame: &can::Frame| frame.id() == can::Id::Standard(0x501) && frame.data()[0] & 0x0F == 0x0F;
    assert!(!robot.frames.iter().any(|(_, frame)| enabled(frame)), "the quick stop was given up");
    assert_eq!(robot.holds(), [(Hold::Stopping, "")]);
    robot.epos.stubborn = false;
    robot.epos.node.set(0x606C, 0, 0);
    robot.drive(0.3, 200);
    assert!(robot.moves(), "{}", robot.reason());
}

#[test]
fn a_driver_that_is_started_while_the_robot_rolls_finishes_the_stop() {
    let mut robot = Robot::ready();
    robot.drive(0.6, 500);
    let Robot { mut epos, icla, .. } = robot;
    epos.stubborn = true;
    let mut robot = Robot::new();
    (robot.epos, robot.icla, robot.restarts) = (epos, icla, 1);
    // The source sends zero, as after every stop, while the robot brakes. The propulsion is booted last.
    for n in 0..70 {
        robot.epos.node.set(0x606C, 0, ((0.6 - 0.008 * f64::from(n)) * 2483.0) as i64);
        robot.epos.deaf = (2..5).contains(&n);
        robot.pass(10);
        if n % 5 == 0 {
            robot.command(0.0, 0.0);
        }
    }
    let enabled = |frame: &can::Frame| frame.id() == can::Id::Standard(0x501) && frame.data()[0] & 0x0F == 0x0F;
    assert!(!robot.frames.iter().any(|(_, frame)| enabled(frame)), "the quick stop was given up");
    assert_eq!(robot.holds(), [(Hold::Stopping, "")]);
}
