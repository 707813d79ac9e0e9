//! Distance from the cause of a stop to standstill, at the highest speed that each configuration permits: the column
//! "stands after" of ARCHITECTURE.md. Printed with `cargo test -p advee --test virtual stops -- --nocapture`.

use super::*;
use messages::lowlevel::CmdPower;
use messages::simulation::CmdFault;

/// Longest time to standstill that is waited for, s.
const STANDS_MAX_S: f64 = 15.0;

/// Distance and time to standstill after `cause` at the highest speed, m and s, and that speed, m/s.
pub fn stands_after(place: &RobotLocation, cause: impl FnOnce(&mut Robot)) -> (f64, f64, f64) {
    let mut robot = Robot::at(place, Config { seed: 1, ..Config::default() });
    let truth = Rc::new(RefCell::new(Vec::new()));
    let keep = truth.clone();
    robot.machine.observe(move |now, news| {
        if let News::Message { message: Message::SimDataTruth(truth), .. } = news {
            keep.borrow_mut().push((now, truth.x, truth.y, truth.speed));
        }
    });
    robot.machine.run_until(at(12.0));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    robot.drive(0.8, 0.0, 2.5);
    robot.pass(2.45);
    let (begin, speed) = (robot.machine.now(), robot.speed());
    truth.borrow_mut().clear();
    cause(&mut robot);
    robot.pass(STANDS_MAX_S);
    let truth = truth.borrow();
    let stood = truth.iter().position(|(.., speed)| speed.abs() < 0.001).expect("it stands");
    let step = |pair: &[(Instant, f64, f64, f64)]| {
        let (x, y) = (pair[1].1 - pair[0].1, pair[1].2 - pair[0].2);
        (x * x + y * y).sqrt()
    };
    let way: f64 = truth[..=stood].windows(2).map(step).sum();
    // Up to the first sample it went on as before.
    let way = way + speed * truth[0].0.since(begin).as_secs_f64();
    (way, truth[stood].0.since(begin).as_secs_f64(), speed)
}

fn button(robot: &mut Robot) {
    let fault = CmdFault { target: "psc1".into(), fault: "stop_button".into(), duration: 1.0, ..CmdFault::default() };
    robot.machine.inject(robot.machine.now(), fault);
}

fn kill(module: &'static str) -> impl FnOnce(&mut Robot) {
    move |robot| {
        let pid = robot.machine.pid(module).expect("it runs");
        robot.drive(0.8, 0.0, 1.0);
        robot.machine.kill(pid);
    }
}

fn hang(module: &'static str) -> impl FnOnce(&mut Robot) {
    move |robot| {
        let pid = robot.machine.pid(module).expect("it runs");
        robot.drive(0.8, 0.0, 1.0);
        robot.machine.hang(pid);
    }
}

fn fault(target: &'static str, name: &'static str, duration: f64) -> impl FnOnce(&mut Robot) {
    move |robot| {
        robot.drive(0.8, 0.0, 1.0);
        let fault = CmdFault { target: target.into(), fault: name.into(), duration, ..CmdFault::default() };
        robot.machine.inject(robot.machine.now(), fault);
    }
}

/// Somebody goes on to command 0.8 m/s for a second.
fn goes_on(robot: &mut Robot) {
    robot.drive(0.8, 0.0, 1.0);
}

fn ends_after(robot: &mut Robot, speed: f64) {
    robot.machine.inject(robot.machine.now(), command(speed, 0.0));
    goes_on(robot);
}

/// The propulsion is faster than commanded.
fn runs_away(robot: &mut Robot) {
    goes_on(robot);
    let (target, fault) = ("propulsion".into(), "runaway".into());
    let now = robot.machine.now();
    robot.machine.inject(now, CmdFault { timestamp: 0, target, fault, value: 0.3, duration: 5.0 });
}

/// A frame of another master, which commands the propulsion: 0.8 m/s.
fn second_master(robot: &mut Robot) {
    goes_on(robot);
    let frame = can::Frame::standard(0x501, &[0x0F, 0, 0xC3, 0x07, 0, 0]);
    assert!(robot.machine.inject_frame(robot.machine.now(), "can.main", frame));
}

/// The propulsion does not brake, and the source falls silent.
fn unbraked(robot: &mut Robot) {
    let (target, fault) = ("propulsion".into(), "unbraked".into());
    let now = robot.machine.now();
    robot.machine.inject(now, CmdFault { timestamp: 0, target, fault, value: 0.0, duration: 5.0 });
}

/// The second way is an output of a node.
const OUTPUT: &[&str] = &["stop.second_way=canopen", "stop.output.node=5", "stop.output.index=0x6200"];

/// The guard bounds the speed; the hall is free ahead.
const GUARDED: &[&str] = &["guard.ranging=sonar"];
/// The second way is a GPIO line.
const LINE: &[&str] = &["stop.second_way=gpio", "stop.gpio.chip=gpio-motors", "stop.gpio.line=17"];

#[test]
fn the_robot_stands_within_the_figures_of_the_table() {
    type Cause = Box<dyn FnOnce(&mut Robot)>;
    let coast = &["stop.pause=coast"][..];
    let delayed = &["stop.pause=delayed"][..];
    let rows: [(&str, &[&str], Cause, f64); 22] = [
        ("the source is silent", &[], Box::new(|_| {}), 0.50),
        ("PAUSE, brake", &[], Box::new(button), 0.30),
        ("PAUSE, delayed", delayed, Box::new(button), 0.35),
        ("PAUSE, coast", coast, Box::new(button), 0.60),
        ("PAUSE unknown", &[], Box::new(fault("psc1", "silent", 5.0)), 1.50),
        ("a critical module dies", &[], Box::new(kill("driver_rs485a")), 0.35),
        ("a critical module hangs", &[], Box::new(hang("driver_rs485a")), 0.50),
        ("the watchdog dies", &[], Box::new(kill("watchdog")), 0.55),
        ("driver_canbus dies", &[], Box::new(kill("driver_canbus")), 0.50),
        ("driver_canbus hangs", &[], Box::new(hang("driver_canbus")), 0.50),
        ("the steering drive is lost", &[], Box::new(fault("steering", "silent", 5.0)), 0.50),
        ("it does not brake, power controller", &[], Box::new(unbraked), 0.90),
        ("it does not brake, output", OUTPUT, Box::new(unbraked), 0.90),
        ("it does not brake, GPIO line", LINE, Box::new(unbraked), 0.90),
        ("the GPIO line does not answer", LINE, Box::new(fault("line", "silent", 5.0)), 1.50),
        ("the output does not answer", OUTPUT, Box::new(fault("output", "silent", 5.0)), 1.50),
        ("the guard hangs", GUARDED, Box::new(hang("guard")), 0.50),
        ("faster than commanded", &[], Box::new(runs_away), 1.10),
        ("another master", &[], Box::new(second_master), 0.30),
        ("a command is not a number", &[], Box::new(|robot| ends_after(robot, f64::NAN)), 0.30),
        ("a command is out of limits", &[], Box::new(|robot| ends_after(robot, 9.0)), 0.30),
        ("the propulsion drive is in fault", &[], Box::new(fault("propulsion", "fault", 0.0)), 2.20),
    ];
    for (name, sets, cause, most) in rows {
        let mut place = place();
        place.sets.extend(["limits.speed_manual_mps=0.8"].iter().chain(sets).map(|set| (*set).to_owned()));
        let (way, seconds, speed) = stands_after(&place, cause);
        println!("{name:35} from {speed:.2} m/s: {way:.2} m, {seconds:.2} s");
        assert!(way <= most, "{name}: {way:.2} m");
    }
}

#[test]
fn a_feed_that_was_cut_is_switched_on_by_a_person_alone() {
    for sets in [&[][..], OUTPUT, LINE] {
        let mut place = place();
        place.sets.extend(sets.iter().map(|set| (*set).to_owned()));
        let mut robot = Robot::at(&place, Config { seed: 1, ..Config::default() });
        robot.machine.run_until(at(12.0));
        robot.drive(0.6, 0.0, 2.0);
        robot.pass(1.5);
        unbraked(&mut robot);
        robot.pass(3.5);
        assert_eq!((robot.hold(), robot.speed()), (Some(Hold::FeedCut), 0.0), "{sets:?}");
        // The drive works again, and its driver is another process.
        robot.pass(2.0);
        let pid = robot.machine.pid("driver_canbus").expect("it runs");
        if !sets.is_empty() {
            robot.machine.kill(pid);
            robot.pass(5.0);
            assert_eq!(robot.hold(), Some(Hold::FeedOff));
        }
        robot.drive_anew(0.3, 0.0, 1.0);
        robot.pass(1.0);
        assert_eq!(robot.speed(), 0.0, "{sets:?}");
        let now = robot.machine.now();
        robot.machine.inject(now, CmdPower { timestamp: 0, device: 3, action: CmdPower::ON });
        robot.pass(5.0);
        robot.drive_anew(0.3, 0.0, 3.0);
        robot.pass(2.9);
        assert!((robot.speed() - 0.3).abs() < 0.02, "{sets:?}: {}", robot.motion().reason);
    }
}
