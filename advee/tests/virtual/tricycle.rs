//! The shipped tricycle, whose single front wheel is driven and steered, and other bases with one steering angle,
//! made of its folder by other lines. The rules of `sim::check` hold in each test.

use super::*;
use messages::middlelevel;
use messages::simulation::CmdFault;

/// A base: `conf/tug` with other lines, absolute values in place of the shipped ones.
#[derive(Clone, Copy)]
struct Base {
    name: &'static str,
    lines: &'static [(&'static str, &'static str)],
    wheelbase: f64,
    /// The driven wheel is steered, too: it rolls on the longer curve.
    driven_front: bool,
    /// Place of a driven wheel of the fixed axle, to the left of its middle, m.
    driven_left: f64,
}

const TUG: Base = Base { name: "tug", lines: &[], wheelbase: 0.8, driven_front: true, driven_left: 0.0 };
/// The fixed axle is driven, and the steered wheel rolls: a tricycle, a bicycle, and two front wheels by Ackermann are
/// the same to the driver.
const REAR_DRIVEN: Base = Base {
    name: "rear-driven",
    lines: &[(DRIVEN, "driven = \"rear\"")],
    wheelbase: 0.8,
    driven_front: false,
    driven_left: 0.0,
};
/// The steered wheel, which is driven, is behind the fixed axle, as of a fork-lift truck: the body lies to the other
/// side of the axle, and the steering turns the other way.
const REAR_STEERED: Base = Base {
    name: "rear-steered",
    lines: &[("rear_overhang_m = 0.15", "rear_overhang_m = 0.95")],
    wheelbase: 0.8,
    driven_front: true,
    driven_left: 0.0,
};
/// The same, longer, with a driven front axle.
const LONG_REAR_STEERED: Base = Base {
    name: "long-rear-steered",
    lines: &[
        (DRIVEN, "driven = \"rear\""),
        ("rear_overhang_m = 0.15", "rear_overhang_m = 1.25"),
        ("wheelbase_m = 0.80 ", "wheelbase_m = 1.10 "),
        ("length_m = 1.10", "length_m = 1.40"),
    ],
    wheelbase: 1.1,
    driven_front: false,
    driven_left: 0.0,
};
/// The fork-lift truck by its name.
const FORK_LIFT: Base = Base {
    name: "fork-lift",
    lines: &[
        (DRIVEN, "\n[base]\nkind = \"tricycle\"\nsteered = \"rear\"\ndriven = \"steered\""),
        ("rear_overhang_m = 0.15", "rear_overhang_m = 0.95"),
    ],
    wheelbase: 0.8,
    driven_front: true,
    driven_left: 0.0,
};
/// Only the left wheel of the fixed axle is driven.
const LEFT_DRIVEN: Base = Base {
    name: "left-driven",
    lines: &[(DRIVEN, "\n[base]\nkind = \"tricycle\"\ndriven_left_m = 0.25")],
    wheelbase: 0.8,
    driven_front: false,
    driven_left: 0.25,
};
const DRIVEN: &str = "driven = \"front\"";
const BASES: [Base; 6] = [TUG, REAR_DRIVEN, REAR_STEERED, LONG_REAR_STEERED, FORK_LIFT, LEFT_DRIVEN];

#[derive(Default)]
struct Observed {
    truth: messages::simulation::DataTruth,
    estimate: middlelevel::DataEstimate,
    velocity: lowlevel::DataVelocity,
    /// Measured speed of the driven tread, m/s.
    tread: f64,
    /// Errors, and when they were reported.
    errors: Vec<(Instant, String)>,
    /// Greatest true speed, m/s.
    fastest: f64,
}

impl Base {
    /// Its folder; that of a test has its name.
    fn folder(&self, shipped: &Path) -> std::path::PathBuf {
        if self.lines.is_empty() {
            return shipped.into();
        }
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{}-{}", self.name, std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        for file in ["modules.toml", "sim.toml"] {
            std::fs::copy(shipped.join(file), folder.join(file)).expect("a copy");
        }
        let mut robot = std::fs::read_to_string(shipped.join("robot.toml")).expect("the tug");
        for (line, other) in self.lines {
            assert!(robot.contains(line), "{line}");
            robot = robot.replace(line, other);
        }
        // Tests run at the same time: another one reads all of it, or the earlier one.
        let new = folder.join(format!("{:?}.new", std::thread::current().id()));
        std::fs::write(&new, robot).expect("a file");
        std::fs::rename(new, folder.join("robot.toml")).expect("the file");
        folder
    }
}

fn tug(sets: &[&str]) -> (Robot, Rc<RefCell<Observed>>) {
    robot_on(TUG, sets)
}

/// Homed, in an empty hall, since it senses nothing.
fn robot_on(base: Base, sets: &[&str]) -> (Robot, Rc<RefCell<Observed>>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut place = RobotLocation {
        config: base.folder(&root.join("conf/tug")),
        world: Some(root.join("conf/worlds/empty.toml")),
        ..guarded_place()
    };
    place.sets.extend(sets.iter().map(|set| (*set).to_owned()));
    let mut robot = Robot::at(&place, Config { seed: 1, lcm_jitter: Duration::from_micros(200), ..Config::default() });
    let news = Rc::new(RefCell::new(Observed::default()));
    let keep = news.clone();
    robot.machine.observe(move |now, event| {
        if let sim::host::News::Message { message, .. } = event {
            match message {
                Message::SimDataTruth(truth) => {
                    let mut seen = keep.borrow_mut();
                    seen.fastest = seen.fastest.max(truth.speed.abs());
                    seen.truth = truth.clone();
                }
                Message::CmEventError(error) if error.severity == messages::common::Error::ERROR => {
                    keep.borrow_mut().errors.push((now, error.message.clone()));
                }
                Message::MlDataEstimate(estimate) => keep.borrow_mut().estimate = estimate.clone(),
                Message::LlDataAxes(axes) => {
                    let propulsion = axes.axes.iter().find(|axis| axis.name == "propulsion");
                    keep.borrow_mut().tread = propulsion.map_or(f64::NAN, |axis| axis.velocity);
                }
                Message::LlDataVelocity(velocity) => keep.borrow_mut().velocity = velocity.clone(),
                _ => {}
            }
        }
    });
    robot.machine.run_until(at(12.0));
    assert!(robot.motion().homed, "{}: {}", base.name, robot.motion().reason);
    (robot, news)
}

#[test]
fn they_drive_the_commanded_curves_and_know_where_they_are() {
    BASES.iter().for_each(|base| drives_the_commanded_curves_and_knows_where_it_is(*base));
}

fn drives_the_commanded_curves_and_knows_where_it_is(base: Base) {
    let (mut robot, news) = robot_on(base, &[]);
    for (speed, steering) in [(0.3, 0.0), (0.3, 0.5), (-0.3, 0.5), (0.25, -0.6), (-0.3, -0.3)] {
        robot.drive_anew(speed, steering, 8.0);
        robot.pass(7.5);
        let Observed { truth, velocity, tread, .. } = &*news.borrow();
        // Half of the play of the steering is 0.25 degrees.
        let name = base.name;
        assert!((truth.speed - speed).abs() < 0.01 && (truth.steering - steering).abs() < 0.006, "{name}: {truth:?}");
        let omega = speed * f64::tan(steering) / base.wheelbase;
        assert!((velocity.vx - speed).abs() < 0.02 && (velocity.omega - omega).abs() < 0.02, "{name}: {velocity:?}");
        // The robot turns to the left by a positive angle while it goes forward, whichever end steers.
        let rolls = if base.driven_front { speed / steering.cos() } else { speed - omega * base.driven_left };
        assert!((tread - rolls).abs() < 0.02, "{name}: {tread} m/s, {rolls} expected, {truth:?}");
    }
    robot.pass(3.0);
    let Observed { truth, estimate, .. } = &*news.borrow();
    let off = (estimate.x - truth.x).hypot(estimate.y - truth.y);
    let turned = navitools::wrap(estimate.theta - truth.theta).abs();
    let is_fine = estimate.quality == middlelevel::DataEstimate::FINE;
    assert!(off < 0.15 && turned < 0.1 && is_fine, "{}: {off} m, {turned} rad, {estimate:?}", base.name);
    assert_eq!(truth.collisions, 0);
}

#[test]
fn the_tread_of_a_driven_front_wheel_keeps_the_limit_of_speed() {
    BASES.iter().filter(|base| base.driven_front).for_each(|base| tread_keeps_the_limit_of_speed(*base));
}

fn tread_keeps_the_limit_of_speed(base: Base) {
    let (mut robot, news) = robot_on(base, &["guard.speed_blind_mps=2.0"]);
    robot.drive(0.5, 0.0, 6.0);
    robot.pass(5.5);
    let straight = news.borrow().truth.speed;
    robot.pass(2.0);
    robot.drive_anew(0.5, 0.6, 6.0);
    robot.pass(5.5);
    let truth = news.borrow().truth.clone();
    // The wheel rolls on the longer curve.
    assert!(straight > 0.4 && (truth.speed / truth.steering.cos() - straight).abs() < 0.01, "{straight}: {truth:?}");
}

#[test]
fn they_go_to_a_goal() {
    BASES.iter().for_each(|base| goes_to_a_goal(*base));
}

fn goes_to_a_goal(base: Base) {
    let (mut robot, news) = robot_on(base, &[]);
    let waypoint = middlelevel::Waypoint { x: 13.0, y: 8.0, theta: 0.0, tolerance: 0.1, heading: false };
    let goal = middlelevel::CmdGoal { timestamp: 0, id: 1, waypoints: vec![waypoint], ..Default::default() };
    robot.machine.inject(robot.machine.now(), goal);
    robot.pass(40.0);
    let truth = news.borrow().truth.clone();
    let off = (truth.x - 13.0).hypot(truth.y - 8.0);
    assert!(off < 0.2, "{}: {off} m: {}", base.name, robot.motion().reason);
}

#[test]
fn they_stop_if_a_drive_or_the_driver_fails() {
    BASES.iter().for_each(|base| stops_if_a_drive_or_the_driver_fails(*base));
}

fn stops_if_a_drive_or_the_driver_fails(base: Base) {
    let faults = [
        ("propulsion", "silent", 0.0),
        ("propulsion", "reboot", 0.0),
        ("propulsion", "runaway", 0.5),
        ("steering", "silent", 0.0),
        ("steering", "fault", 0.0),
        ("steering", "reboot", 0.0),
    ];
    for (target, fault, value) in faults {
        let (mut robot, _) = robot_on(base, &[]);
        robot.drive(0.3, 0.4, 8.0);
        robot.pass(3.0);
        let now = robot.machine.now();
        let (target, fault) = (target.to_owned(), fault.to_owned());
        let what = format!("{}: {fault} of {target}", base.name);
        robot.machine.inject(now, CmdFault { timestamp: 0, target, fault, value, duration: 2.0 });
        // Without power it rolls out.
        robot.pass(3.0);
        let took = robot.quick_stop_after(now).since(now);
        assert!(took <= Duration::from_millis(300), "{what}: {took:?}");
        assert!(robot.speed().abs() < 0.001, "{what}: {} m/s", robot.speed());
    }
    for lost in ["driver_canbus hangs", "driver_canbus dies", "watchdog dies"] {
        let (mut robot, _) = robot_on(base, &[]);
        robot.drive(0.3, 0.4, 8.0);
        robot.pass(3.0);
        let (module, what) = lost.split_once(' ').expect("two words");
        let pid = robot.machine.pid(module).expect("it runs");
        if what == "hangs" {
            robot.machine.hang(pid);
        } else {
            robot.machine.kill(pid);
        }
        // 250 ms, then 0.36 m/s at 1.5 m/s².
        robot.pass(0.6);
        assert!(robot.speed().abs() < 0.001, "{}: {lost}: {} m/s", base.name, robot.speed());
    }
}

/// Longest time until a wrong encoder is reported, and until the quick stop of the driven wheel is on the wire.
const WRONG_MAX: Duration = Duration::from_millis(500);

/// Injects a wrong encoder for 4 s, commands what `then` does, and fails unless it is reported and the quick stop
/// commanded in time: the drive carries it out by the same encoder. Returns a line with the figures.
fn assert_stops_by(
    what: &str,
    (robot, news): &mut (Robot, Rc<RefCell<Observed>>),
    (target, value): (&str, f64),
    then: impl FnOnce(&mut Robot),
) -> String {
    let since = robot.machine.now();
    let fault = CmdFault { timestamp: 0, target: target.into(), fault: "encoder".into(), value, duration: 4.0 };
    robot.machine.inject(since, fault);
    then(robot);
    news.borrow_mut().errors.clear();
    news.borrow_mut().fastest = 0.0;
    robot.pass(2.0);
    let (first, fastest) = (news.borrow().errors.first().cloned(), news.borrow().fastest);
    let report = first.map(|(at, message)| (at.since(since), message));
    assert!(report.as_ref().is_some_and(|(took, _)| *took <= WRONG_MAX), "{what}: {report:?}");
    let stops = robot.quick_stop_after(since).since(since);
    assert!(stops <= WRONG_MAX, "{what}: {stops:?}");
    format!("{what}: {report:?}, stops after {stops:?}, at most {fastest:.2} m/s")
}

/// Nothing else of them measures a speed: a dead encoder of the only driven wheel, whose drive then accelerates, is
/// noticed as a wheel that stands, a reversed one as a wheel that turns the wrong way.
#[test]
fn a_dead_or_reversed_encoder_of_the_only_driven_wheel_is_reported_and_stops_it() {
    // While it drives, at any speed that is judged, either way.
    let all = [(0.3, [0.0, -1.0]), (0.06, [0.0, -1.0]), (-0.3, [0.0, -1.0]), (0.5, [0.0, -1.0])];
    for (base, speeds) in BASES.into_iter().map(|base| (base, if base.lines.is_empty() { &all[..] } else { &all[..1] }))
    {
        for (speed, value) in speeds.iter().flat_map(|(speed, values)| values.map(|value| (*speed, value))) {
            let mut driving = robot_on(base, &[]);
            driving.0.drive_anew(speed, 0.0, 8.0);
            driving.0.pass(3.0);
            let what = format!("{}: encoder {value} at {speed} m/s", base.name);
            println!("{}", assert_stops_by(&what, &mut driving, ("propulsion", value), |_| {}));
        }
    }
    // From standstill.
    for (speed, value) in [(0.3, 0.0), (0.3, -1.0), (0.06, 0.0), (0.06, -1.0)] {
        let mut standing = tug(&[]);
        let what = format!("tug: encoder {value} from standstill to {speed} m/s");
        let begins = |robot: &mut Robot| robot.drive_anew(speed, 0.0, 4.0);
        println!("{}", assert_stops_by(&what, &mut standing, ("propulsion", value), begins));
    }
}

/// The angle has no other witness either: a steering whose encoder is dead or reversed turns on until its end.
#[test]
fn a_dead_or_reversed_encoder_of_the_steering_is_reported_when_it_turns_and_stops_the_robot() {
    for base in BASES {
        for (value, from, to) in [(0.0, 0.0, 0.4), (-1.0, 0.0, 0.4), (0.0, 0.4, -0.2), (-1.0, 0.4, 0.3)] {
            let mut driving = robot_on(base, &[]);
            driving.0.drive_anew(0.3, from, 3.0);
            driving.0.pass(3.0);
            let what = format!("{}: steering encoder {value}, {from} to {to} rad", base.name);
            let steers = |robot: &mut Robot| robot.drive(0.3, to, 4.0);
            let line = assert_stops_by(&what, &mut driving, ("steering", value), steers);
            println!("{line}, then at {:.2} rad", driving.1.borrow().truth.steering);
        }
    }
}

/// The drive's own loop keeps the angle that it measures, and nothing contradicts it.
#[test]
fn a_slipping_encoder_of_the_steering_turns_it_no_farther_than_what_it_counts() {
    for counts in [1.5, 0.6] {
        let (mut robot, news) = tug(&[]);
        robot.drive_anew(0.3, 0.0, 2.0);
        robot.pass(2.0);
        let (target, fault) = ("steering".into(), "encoder".into());
        robot
            .machine
            .inject(robot.machine.now(), CmdFault { timestamp: 0, target, fault, value: counts, duration: 9.0 });
        robot.drive(0.3, 0.3, 3.0);
        robot.pass(2.9);
        let observed = news.borrow();
        println!("steering counts {counts} times its way: {:?}, {:?}", observed.truth.steering, observed.errors);
        // Half of the play.
        assert!((observed.truth.steering - 0.3 / counts).abs() < 0.006, "{counts}: {:?}", observed.truth);
    }
}

/// Greatest speed that the tug reaches, m/s, beyond the one commanded, when its only encoder counts backwards: until
/// that is found, and its drive, which accelerates it, is switched off.
const REVERSED_GAIN_MPS: f64 = 1.0;

/// Nothing else cuts its motor's feed, and its drive carries out a quick stop by the encoder that is wrong.
#[test]
fn a_drive_whose_reversed_encoder_accelerates_the_only_wheel_is_switched_off_until_an_operator_acts() {
    for (speed, moves) in [(0.3, true), (-0.3, true), (0.2, true), (0.3, false)] {
        let (mut robot, news) = tug(&[]);
        let what = format!("{speed} m/s, {}", if moves { "driving" } else { "from standstill" });
        if moves {
            robot.drive_anew(speed, 0.0, 3.5);
            robot.pass(3.0);
        }
        let since = robot.machine.now();
        let (target, fault) = ("propulsion".into(), "encoder".into());
        robot.machine.inject(since, CmdFault { timestamp: 0, target, fault, value: -1.0, duration: 20.0 });
        if !moves {
            robot.drive_anew(speed, 0.0, 3.0);
        }
        {
            let mut seen = news.borrow_mut();
            seen.fastest = 0.0;
            seen.errors.clear();
        }
        robot.pass(2.0);
        let (fastest, errors) = (news.borrow().fastest, news.borrow().errors.clone());
        let off = errors.iter().find(|(_, message)| message.contains("told to stop, the robot drives at"));
        let took = off.map(|(at, _)| at.since(since));
        println!("{what}: found after {took:?}, at most {fastest:.2} m/s");
        assert!(took.is_some_and(|took| took < Duration::from_secs(2)), "{what}: {errors:?}");
        assert!(fastest < speed.abs() + REVERSED_GAIN_MPS, "{what}: {fastest} m/s");
        // It rolls out, whatever is commanded.
        let rolls = news.borrow().truth.speed.abs();
        robot.pass(2.0);
        assert!(news.borrow().truth.speed.abs() < rolls - 0.1, "{what}: {:?}", news.borrow().truth);
        robot.pass(12.0);
        robot.drive_anew(speed, 0.0, 3.0);
        robot.pass(3.0);
        assert!(robot.speed().abs() < 0.001, "{what}: {} m/s", robot.speed());
        assert_eq!(robot.hold(), Some(Hold::SpeedExceeded), "{what}");
        // The encoder counts right again, and an operator lets it go.
        robot.pass(3.0);
        let run = messages::common::CmdState {
            timestamp: 0,
            module: "driver_canbus".into(),
            state: State::Run as i8,
            manual: true,
            source: "test".into(),
        };
        robot.machine.inject(robot.machine.now(), run);
        robot.pass(0.5);
        robot.drive_anew(speed, 0.0, 4.0);
        robot.pass(3.5);
        assert!((robot.speed() - speed).abs() < 0.02, "{what}: {} m/s, {}", robot.speed(), robot.motion().reason);
    }
}

/// A robot whose encoder is dead would accelerate unseen again at the next press.
#[test]
fn a_dead_encoder_of_the_only_driven_wheel_holds_the_robot_until_an_operator_acts() {
    let (mut robot, news) = tug(&[]);
    robot.drive_anew(0.3, 0.0, 8.0);
    robot.pass(3.0);
    let (target, fault) = ("propulsion".into(), "encoder".into());
    let fault = CmdFault { timestamp: 0, target, fault, value: 0.0, duration: 16.0 };
    robot.machine.inject(robot.machine.now(), fault);
    robot.pass(1.5);
    assert_eq!(robot.hold(), Some(Hold::WheelStood));
    for _ in 0..2 {
        robot.pass(6.0);
        let before = news.borrow().truth.speed.abs();
        robot.drive_anew(0.3, 0.0, 1.0);
        robot.pass(1.0);
        assert!(news.borrow().truth.speed.abs() <= before, "{before}: {:?}", news.borrow().truth);
        assert_eq!(robot.hold(), Some(Hold::WheelStood));
    }
    robot.pass(2.0);
    let (module, source) = ("driver_canbus".into(), "test".into());
    let run = messages::common::CmdState { timestamp: 0, module, state: State::Run as i8, manual: true, source };
    robot.machine.inject(robot.machine.now(), run);
    robot.pass(0.5);
    robot.drive_anew(0.3, 0.0, 4.0);
    robot.pass(3.5);
    assert!((robot.speed() - 0.3).abs() < 0.02, "{} m/s: {}", robot.speed(), robot.motion().reason);
}
