//! The shipped tricycle: its single front wheel is driven and steered. The rules of `sim::check` hold in each test.

use super::*;
use messages::middlelevel;
use messages::simulation::CmdFault;

/// `wheelbase_m` of `conf/tug`.
const WHEELBASE: f64 = 0.8;

#[derive(Default)]
struct Observed {
    truth: messages::simulation::DataTruth,
    estimate: middlelevel::DataEstimate,
    velocity: lowlevel::DataVelocity,
}

/// Homed, in an empty hall, since it senses nothing.
fn tug(sets: &[&str]) -> (Robot, Rc<RefCell<Observed>>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut place = RobotLocation {
        config: root.join("conf/tug"),
        world: Some(root.join("conf/worlds/empty.toml")),
        ..guarded_place()
    };
    place.sets.extend(sets.iter().map(|set| (*set).to_owned()));
    let mut robot = Robot::at(&place, Config { seed: 1, lcm_jitter: Duration::from_micros(200), ..Config::default() });
    let news = Rc::new(RefCell::new(Observed::default()));
    let keep = news.clone();
    robot.machine.observe(move |_, event| {
        if let sim::host::News::Message { message, .. } = event {
            match message {
                Message::SimDataTruth(truth) => keep.borrow_mut().truth = truth.clone(),
                Message::MlDataEstimate(estimate) => keep.borrow_mut().estimate = estimate.clone(),
                Message::LlDataVelocity(velocity) => keep.borrow_mut().velocity = velocity.clone(),
                _ => {}
            }
        }
    });
    robot.machine.run_until(at(12.0));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    (robot, news)
}

#[test]
fn it_drives_the_commanded_curves_and_knows_where_it_is() {
    let (mut robot, news) = tug(&[]);
    for (speed, steering) in [(0.3, 0.0), (0.3, 0.5), (-0.3, 0.5), (0.25, -0.6), (-0.3, -0.3)] {
        robot.drive_anew(speed, steering, 8.0);
        robot.pass(7.5);
        let Observed { truth, velocity, .. } = &*news.borrow();
        // Half of the play of the steering is 0.25 degrees.
        assert!((truth.speed - speed).abs() < 0.01 && (truth.steering - steering).abs() < 0.006, "{truth:?}");
        let omega = speed * f64::tan(steering) / WHEELBASE;
        assert!((velocity.vx - speed).abs() < 0.02 && (velocity.omega - omega).abs() < 0.02, "{velocity:?}");
    }
    robot.pass(3.0);
    let Observed { truth, estimate, .. } = &*news.borrow();
    let off = (estimate.x - truth.x).hypot(estimate.y - truth.y);
    let turned = navitools::wrap(estimate.theta - truth.theta).abs();
    let is_fine = estimate.quality == middlelevel::DataEstimate::FINE;
    assert!(off < 0.15 && turned < 0.1 && is_fine, "{off} m, {turned} rad, {estimate:?}");
    assert_eq!(truth.collisions, 0);
}

#[test]
fn the_tread_of_its_front_wheel_keeps_the_limit_of_speed() {
    let (mut robot, news) = tug(&["guard.speed_blind_mps=2.0"]);
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
fn it_goes_to_a_goal() {
    let (mut robot, news) = tug(&[]);
    let waypoint = middlelevel::Waypoint { x: 13.0, y: 8.0, theta: 0.0, tolerance: 0.1, heading: false };
    let goal = middlelevel::CmdGoal { timestamp: 0, id: 1, waypoints: vec![waypoint], ..Default::default() };
    robot.machine.inject(robot.machine.now(), goal);
    robot.pass(40.0);
    let truth = news.borrow().truth.clone();
    let off = (truth.x - 13.0).hypot(truth.y - 8.0);
    assert!(off < 0.2, "{off} m: {}", robot.motion().reason);
}

#[test]
fn it_stops_if_a_drive_its_encoder_or_the_driver_fails() {
    let faults = [
        ("propulsion", "silent", 0.0),
        ("propulsion", "reboot", 0.0),
        ("propulsion", "runaway", 0.5),
        ("steering", "silent", 0.0),
        ("steering", "fault", 0.0),
        ("steering", "reboot", 0.0),
    ];
    for (target, fault, value) in faults {
        let (mut robot, _) = tug(&[]);
        robot.drive(0.3, 0.4, 8.0);
        robot.pass(3.0);
        let now = robot.machine.now();
        let (target, fault) = (target.to_owned(), fault.to_owned());
        let what = format!("{fault} of {target}");
        robot.machine.inject(now, CmdFault { timestamp: 0, target, fault, value, duration: 2.0 });
        // Without power it rolls out.
        robot.pass(3.0);
        let took = robot.quick_stop_after(now).since(now);
        assert!(took <= Duration::from_millis(300), "{what}: {took:?}");
        assert!(robot.speed().abs() < 0.001, "{what}: {} m/s", robot.speed());
    }
    for lost in ["driver_canbus hangs", "driver_canbus dies", "watchdog dies"] {
        let (mut robot, _) = tug(&[]);
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
        assert!(robot.speed().abs() < 0.001, "{lost}: {} m/s", robot.speed());
    }
}
