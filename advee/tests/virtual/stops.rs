//! Distance from the cause of a stop to standstill, at the highest speed that each configuration permits: the column
//! "stands after" of ARCHITECTURE.md, from which the bounds are read. Printed with `cargo test -p advee --test virtual
//! stops -- --nocapture`.

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
    let (way, seconds) = measured(&truth.borrow(), begin, speed);
    (way, seconds, speed)
}

/// Way and time from `begin`, at `speed`, to standstill by the samples since: time, place and speed.
fn measured(truth: &[(Instant, f64, f64, f64)], begin: Instant, speed: f64) -> (f64, f64) {
    let stood = truth.iter().position(|(.., speed)| speed.abs() < 0.001).expect("it stands");
    let step = |pair: &[(Instant, f64, f64, f64)]| {
        let (x, y) = (pair[1].1 - pair[0].1, pair[1].2 - pair[0].2);
        (x * x + y * y).sqrt()
    };
    let way: f64 = truth[..=stood].windows(2).map(step).sum();
    // Up to the first sample it went on as before.
    (way + speed * truth[0].0.since(begin).as_secs_f64(), truth[stood].0.since(begin).as_secs_f64())
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

/// A drive's object is written by another program: expedited SDO download.
fn written(index: u16, len: u8, value: u32) -> impl FnOnce(&mut Robot) {
    move |robot| {
        goes_on(robot);
        let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), value.to_le_bytes());
        let frame = can::Frame::standard(0x601, &[0x23 | (4 - len) << 2, low, high, 0, a, b, c, d]);
        assert!(robot.machine.inject_frame(robot.machine.now(), "can.main", frame));
    }
}

/// `driver_canbus` is restarted while the propulsion, which does not brake for a second, still turns.
fn restarts(robot: &mut Robot) {
    let (target, fault) = ("propulsion".into(), "unbraked".into());
    let now = robot.machine.now();
    robot.machine.inject(now, CmdFault { timestamp: 0, target, fault, value: 0.0, duration: 1.0 });
    kill("driver_canbus")(robot);
}

/// The drives are cut off their master for 0.3 s.
fn cut(robot: &mut Robot) {
    goes_on(robot);
    assert!(robot.machine.fault("can.main", "cut", 0.0, 0.3));
}

/// Way and time may exceed the table by this factor: its figures are rounded.
const MARGIN: f64 = 1.05;

/// Asserts the figures, which are the `number`th of an event's row.
#[track_caller]
fn assert_stands((event, number): (&str, usize), name: &str, (way, seconds): (f64, f64)) {
    for (unit, measured) in [("m", way), ("s", seconds)] {
        let figure = stands::figures(event, unit).get(number).copied();
        let figure = figure.unwrap_or_else(|| panic!("the table has no such figure in {unit}: {event}"));
        assert!(measured <= figure * MARGIN, "{name}: {measured:.3} {unit}, and the table says {figure} {unit}");
    }
}

#[test]
fn the_robot_stands_within_the_figures_of_the_table() {
    /// The beginning of the row and the number of its figure, a name, the settings, and what happens.
    type Row<'a> = ((&'a str, usize), &'a str, &'a [&'a str], Box<dyn FnOnce(&mut Robot)>);
    let coast = &["stop.pause=coast"][..];
    let delayed = &["stop.pause=delayed"][..];
    let pause = "the PAUSE line is engaged";
    let drive = "one drive is lost or in fault";
    let unbraked_by = "the robot does not brake as commanded";
    let gpio = "only with `second_way = \"gpio\"`";
    let canopen = "only with `second_way = \"canopen\"`";
    let limits = "a command is out of limits";
    let returns = "`driver_canbus` restarts";
    let rows: [Row<'_>; 26] = [
        (("the commanding source is silent", 0), "the source is silent", &[], Box::new(|_| {})),
        ((pause, 0), "PAUSE, brake", &[], Box::new(button)),
        ((pause, 1), "PAUSE, delayed", delayed, Box::new(button)),
        ((pause, 2), "PAUSE, coast", coast, Box::new(button)),
        (("the PAUSE line is unknown", 0), "PAUSE unknown", &[], Box::new(fault("psc1", "silent", 5.0))),
        (("a critical module's process dies", 0), "a critical module dies", &[], Box::new(kill("driver_rs485a"))),
        (("a critical module hangs", 0), "a critical module hangs", &[], Box::new(hang("driver_rs485a"))),
        (("the watchdog dies", 0), "the watchdog dies", &[], Box::new(kill("watchdog"))),
        (("`driver_canbus` itself dies", 0), "driver_canbus dies", &[], Box::new(kill("driver_canbus"))),
        (("`driver_canbus` itself hangs", 0), "driver_canbus hangs", &[], Box::new(hang("driver_canbus"))),
        ((returns, 0), "the driver restarts, a drive turns", &[], Box::new(restarts)),
        ((returns, 1), "the bus returns", &[], Box::new(cut)),
        ((drive, 0), "the steering drive is lost", &[], Box::new(fault("steering", "silent", 5.0))),
        ((drive, 1), "the propulsion drive is in fault", &[], Box::new(fault("propulsion", "fault", 0.0))),
        (("a drive is in another mode", 0), "another mode of operation", &[], Box::new(written(0x6060, 1, 1))),
        (("an object of a drive", 0), "the quick stop is taken away", &[], Box::new(written(0x6085, 4, 100))),
        ((unbraked_by, 0), "it does not brake, power controller", &[], Box::new(unbraked)),
        ((unbraked_by, 0), "it does not brake, output", OUTPUT, Box::new(unbraked)),
        ((unbraked_by, 0), "it does not brake, GPIO line", LINE, Box::new(unbraked)),
        ((gpio, 0), "the GPIO line does not answer", LINE, Box::new(fault("line", "silent", 5.0))),
        ((canopen, 0), "the output does not answer", OUTPUT, Box::new(fault("output", "silent", 5.0))),
        (("the guard is silent", 0), "the guard hangs", GUARDED, Box::new(hang("guard"))),
        (("the robot is faster than commanded", 0), "faster than commanded", &[], Box::new(runs_away)),
        // The table: as a command out of limits.
        ((limits, 0), "another master", &[], Box::new(second_master)),
        ((limits, 0), "a command is not a number", &[], Box::new(|robot| ends_after(robot, f64::NAN))),
        ((limits, 0), "a command is out of limits", &[], Box::new(|robot| ends_after(robot, 9.0))),
    ];
    let mut measured = Vec::new();
    for (row, name, sets, cause) in rows {
        let mut place = place();
        place.sets.extend(["limits.speed_manual_mps=0.8"].iter().chain(sets).map(|set| (*set).to_owned()));
        let (way, seconds, speed) = stands_after(&place, cause);
        println!("{name:35} from {speed:.2} m/s: {way:.2} m, {seconds:.2} s");
        measured.push((row, name, (way, seconds)));
    }
    for (row, name, stands) in measured {
        assert_stands(row, name, stands);
    }
}

/// Way and time after the encoder of the courier's left wheel counts `value` times the truth.
fn wheel_lags(value: f64) -> (f64, f64) {
    let mut base = super::bases::Base::with("courier", 2, &["guard.ranging=none", "guard.speed_blind_mps=2.0"]);
    let truth = Rc::new(RefCell::new(Vec::new()));
    let keep = truth.clone();
    base.machine.observe(move |now, news| {
        if let News::Message { message: Message::SimDataTruth(truth), .. } = news {
            keep.borrow_mut().push((now, truth.x, truth.y, truth.speed));
        }
    });
    base.drive((0.5, 0.0, 0.0), 8.0);
    base.pass(3.0);
    let (begin, speed) = (base.machine.now(), base.truth().speed);
    truth.borrow_mut().clear();
    let (target, fault) = ("left".into(), "encoder".into());
    base.machine.inject(begin, CmdFault { timestamp: 0, target, fault, value, duration: STANDS_MAX_S });
    base.pass(STANDS_MAX_S);
    let (way, seconds) = measured(&truth.borrow(), begin, speed);
    println!("a wheel counts {value:4} of its way      from {speed:.2} m/s: {way:.2} m, {seconds:.2} s");
    assert!(speed > 0.4, "{speed} m/s");
    (way, seconds)
}

#[test]
fn a_robot_whose_wheel_lags_stands_within_the_figures_of_the_table() {
    for (number, value) in [0.7, 0.0].into_iter().enumerate() {
        let name = format!("its encoder counts {value} of its way");
        assert_stands(("one of several wheels", number), &name, wheel_lags(value));
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
