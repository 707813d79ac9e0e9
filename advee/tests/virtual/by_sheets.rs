//! Robot whose drives are of other makers, by their data sheets alone: it is homed, driven and stopped as the shipped
//! one is.

#[path = "../support/by_sheets.rs"]
mod sheets;

use super::patrol::rig::Patrol;
use super::*;
use messages::lowlevel::CmdPower;
use messages::simulation::CmdFault;
use sheets::{Drive, Drives, GIVEN, STATED};

/// A robot with these drives; overrides beside those of [`place`].
fn robot(name: &str, drives: Drives, sets: &[&str]) -> RobotLocation {
    let mut place = RobotLocation { config: sheets::configuration(name, drives), ..place() };
    place.sets.extend(sets.iter().map(|set| (*set).to_owned()));
    place
}

fn started(place: &RobotLocation) -> Robot {
    let mut robot = Robot::at(place, Config { seed: 1, lcm_jitter: Duration::from_micros(200), ..Config::default() });
    robot.machine.run_until(at(12.0));
    robot
}

fn fault(robot: &mut Robot, target: &str, fault: &str, value: f64, duration: f64) {
    let (target, fault) = (target.into(), fault.into());
    let now = robot.machine.now();
    robot.machine.inject(now, CmdFault { timestamp: 0, target, fault, value, duration });
}

#[test]
fn it_is_homed_and_driven_by_hand() {
    let left = Drive(
        "ros2_cia402_slave.eds",
        "gear = -180\ncounts_per_turn = 4096\nhoming_method = 27\nswitch_rad = 0.45\nhoming_speed_radps = 0.1745",
    );
    for (name, drives) in [("hand-stated", STATED), ("hand-given", GIVEN), ("hand-left", [STATED[0], left])] {
        let mut robot = started(&robot(name, drives, &[]));
        assert!(robot.motion().homed, "{name}: {}", robot.motion().reason);
        for (speed, steering) in [(0.4, 0.3), (-0.3, -0.3)] {
            robot.drive(speed, steering, 4.0);
            robot.pass(3.9);
            assert!((robot.speed() - speed).abs() < 0.005, "{name}: {} m/s, {}", robot.speed(), robot.motion().reason);
            assert!((robot.motion().speed - speed).abs() < 0.02, "{name}: {} m/s", robot.motion().speed);
            assert!((robot.motion().steering - steering).abs() < 0.01, "{name}: {} rad", robot.motion().steering);
            // Half of the play.
            let true_angle = robot.seen.borrow().steering;
            assert!((true_angle - steering).abs() < 0.006, "{name}: {true_angle} rad");
        }
    }
}

#[test]
fn it_drives_to_a_goal() {
    let place = RobotLocation { sets: vec!["world.people=0".into()], ..robot("goal", STATED, &[]) };
    let mut robot = Patrol::at(&place, 1, None);
    robot.go();
    let before = robot.seen();
    robot.patrol(90.0);
    let seen = robot.seen();
    assert_eq!((seen.contacts.len(), seen.failed), (0, 0), "{:?} {:?}", seen.contacts, seen.words);
    assert!(seen.waypoints >= 3, "{} waypoints, {:?}", seen.waypoints, seen.words);
    assert!(robot.speed_since(&before, 90.0) > 0.2, "{:?}", seen.words);
}

#[test]
fn it_stands_within_the_figures_of_the_shipped_one() {
    let kills = |robot: &mut Robot| {
        let pid = robot.machine.pid("driver_canbus").expect("it runs");
        robot.drive(0.8, 0.0, 1.0);
        robot.machine.kill(pid);
    };
    let hangs = |robot: &mut Robot| {
        let pid = robot.machine.pid("driver_canbus").expect("it runs");
        robot.drive(0.8, 0.0, 1.0);
        robot.machine.hang(pid);
    };
    type Cause<'a> = &'a dyn Fn(&mut Robot);
    let rows: [(&str, Cause<'_>, f64); 9] = [
        ("the source is silent", &|_| {}, 0.50),
        ("PAUSE, brake", &|robot| fault(robot, "psc1", "stop_button", 0.0, 1.0), 0.30),
        ("driver_canbus dies", &kills, 0.50),
        ("driver_canbus hangs", &hangs, 0.50),
        ("the steering drive is lost", &|robot| goes_on(robot, "steering", "silent", 5.0), 0.50),
        ("the propulsion drive is lost", &|robot| goes_on(robot, "propulsion", "silent", 5.0), 0.50),
        ("it does not brake, power controller", &|robot| fault(robot, "propulsion", "unbraked", 0.0, 5.0), 0.90),
        ("faster than commanded", &|robot| goes_on(robot, "propulsion", "runaway", 5.0), 1.10),
        ("the propulsion drive is in fault", &|robot| goes_on(robot, "propulsion", "fault", 0.0), 0.50),
    ];
    for (name, drives) in [("stops-stated", STATED), ("stops-given", GIVEN)] {
        for (cause, act, most) in rows {
            let place = robot(name, drives, &["limits.speed_manual_mps=0.8"]);
            let (way, seconds, speed) = stops::stands_after(&place, |robot| act(robot));
            println!("{name}: {cause:35} from {speed:.2} m/s: {way:.2} m, {seconds:.2} s");
            assert!(way <= most, "{name}: {cause}: {way:.2} m");
        }
    }
}

/// Somebody goes on to command 0.8 m/s for a second while a drive fails.
fn goes_on(robot: &mut Robot, target: &str, name: &str, duration: f64) {
    robot.drive(0.8, 0.0, 1.0);
    fault(robot, target, name, 0.0, duration);
}

#[test]
fn after_a_fault_and_after_a_cut_feed_it_drives_when_somebody_wants_it() {
    for (name, drives) in [("again-stated", STATED), ("again-given", GIVEN)] {
        let mut robot = started(&robot(name, drives, &[]));
        robot.drive(0.4, 0.0, 2.0);
        robot.pass(1.5);
        fault(&mut robot, "propulsion", "fault", 0.0, 0.0);
        robot.pass(3.0);
        assert_eq!(robot.speed(), 0.0, "{name}");
        robot.drive_anew(0.3, 0.0, 3.0);
        robot.pass(2.9);
        assert!((robot.speed() - 0.3).abs() < 0.02, "{name}: {}", robot.motion().reason);

        fault(&mut robot, "propulsion", "unbraked", 0.0, 4.0);
        robot.pass(4.5);
        assert_eq!((robot.hold(), robot.speed()), (Some(Hold::FeedCut), 0.0), "{name}");
        robot.drive_anew(0.3, 0.0, 1.0);
        robot.pass(1.0);
        assert_eq!(robot.speed(), 0.0, "{name}: the feed is cut");
        let now = robot.machine.now();
        robot.machine.inject(now, CmdPower { timestamp: 0, device: 3, action: CmdPower::ON });
        robot.pass(5.0);
        robot.drive_anew(0.3, 0.0, 3.0);
        robot.pass(2.9);
        assert!((robot.speed() - 0.3).abs() < 0.02, "{name}: {}", robot.motion().reason);
    }
}

#[test]
fn drives_that_were_off_are_booted_and_a_steering_that_does_not_say_that_it_is_homed_is_homed_again() {
    for (name, drives) in [("boot-stated", STATED), ("boot-given", GIVEN)] {
        let mut robot = started(&robot(name, drives, &[]));
        fault(&mut robot, "propulsion", "reboot", 0.0, 0.0);
        fault(&mut robot, "steering", "reboot", 0.0, 0.0);
        robot.pass(2.0);
        assert!(!robot.motion().homed, "{name}");
        // It homes at the operator's press, and drives at the next.
        robot.drive_anew(0.3, 0.0, 1.0);
        robot.pass(10.0);
        assert!(robot.motion().homed, "{name}: {}", robot.motion().reason);
        robot.drive_anew(0.3, 0.0, 3.0);
        robot.pass(2.9);
        assert!((robot.speed() - 0.3).abs() < 0.02, "{name}: {}", robot.motion().reason);
    }
}

#[test]
fn a_drive_of_another_version_is_mapped_anew() {
    let mut robot = started(&robot("layout", STATED, &[]));
    fault(&mut robot, "propulsion", "layout", 0.0, 0.0);
    robot.pass(3.0);
    robot.drive_anew(0.3, 0.0, 3.0);
    robot.pass(2.9);
    assert!((robot.speed() - 0.3).abs() < 0.02, "{}", robot.motion().reason);
}

/// The keys say tenths of rpm, and the drive's own object says rpm: it is ten times faster than commanded, and what it
/// measures looks right. The rules know its unit from the drive.
#[test]
fn a_unit_of_velocity_that_is_not_the_drive_s_shows() {
    let wrong = Drive("maxon_epos4_50_15_node1.dcf", "gear = -26\nvelocity_unit = \"0.1 rpm\"");
    let place = robot("wrong-unit", [wrong, STATED[1]], &[]);
    let mut machine = virtual_machine(&place, Config { seed: 1, ..Config::default() }).expect("a configuration");
    let limits = robot::checks::limits(&place, Duration::from_secs(10)).expect("a configuration");
    let seen = Rc::new(RefCell::new((Checkers::new(limits), 0.0_f64)));
    let keep = seen.clone();
    machine.observe(move |now, news| {
        let (checkers, fastest) = &mut *keep.borrow_mut();
        checkers.observe(now, news);
        if let News::Message { message: Message::SimDataTruth(truth), .. } = news {
            *fastest = fastest.max(truth.speed.abs());
        }
    });
    machine.spawn("watchdog", State::Run).expect("the watchdog starts");
    machine.run_until(at(12.0));
    for n in 0..40 {
        machine.inject(at(12.0) + n * Duration::from_millis(50), command(0.1, 0.0));
    }
    machine.run_until(at(16.0));
    let (checkers, fastest) = &*seen.borrow();
    assert!(*fastest > 0.5, "{fastest} m/s");
    assert_eq!(checkers.violation().map(|violation| violation.rule), Some("fresh"));
}

/// The steering drive has no profile in this mode: the driver makes it, a position for each SYNC.
#[test]
fn a_steering_in_cyclic_synchronous_position_is_homed_steers_and_stops() {
    let cyclic = Drive(
        "ros2_cia402_slave.eds",
        "gear = -180\ncounts_per_turn = 4096\nhoming_method = 23\nswitch_rad = -0.6283\nhoming_speed_radps = 0.1745\n\
         mode = \"cyclic synchronous position\"",
    );
    steers_by_set_points(&robot("cyclic-steering", [STATED[0], cyclic], &["can.main.sync_s=0.01"]));
}

/// The same in the older mode, which is the only one of the position that the drive offers.
#[test]
fn a_steering_in_interpolated_position_is_homed_steers_and_stops() {
    let place = robot("interpolated-steering", STATED, &["can.main.sync_s=0.01"]);
    let sheet = place.config.join("steering.eds");
    let text = std::fs::read_to_string(&sheet).expect("the sheet");
    let modes = text.replace("DefaultValue=0x000000A5", "DefaultValue=0x00000064");
    assert_ne!(modes, text);
    let object = "\n[60C1]\nParameterName=Interpolation data\nObjectType=9\nSubNumber=2\n".to_owned()
        + "[60C1sub0]\nParameterName=Highest sub-index\nObjectType=7\nDataType=5\nAccessType=const\nDefaultValue=1\n"
        + "[60C1sub1]\nParameterName=Set-point\nObjectType=7\nDataType=4\nAccessType=rw\nPDOMapping=1\n";
    std::fs::write(&sheet, modes + &object).expect("a file");
    steers_by_set_points(&place);
}

fn steers_by_set_points(place: &RobotLocation) {
    let mut robot = started(place);
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    for (speed, steering) in [(0.4, 0.3), (-0.3, -0.3)] {
        robot.drive(speed, steering, 4.0);
        robot.pass(3.9);
        assert!((robot.speed() - speed).abs() < 0.005, "{} m/s, {}", robot.speed(), robot.motion().reason);
        assert!((robot.motion().steering - steering).abs() < 0.01, "{} rad", robot.motion().steering);
        let true_angle = robot.seen.borrow().steering;
        assert!((true_angle - steering).abs() < 0.006, "{true_angle} rad");
    }
    for name in ["silent", "fault"] {
        let place = robot_with_speed(place);
        let (way, seconds, speed) = stops::stands_after(&place, |robot| goes_on(robot, "steering", name, 5.0));
        println!("{name}: from {speed:.2} m/s: {way:.2} m, {seconds:.2} s");
        assert!(way <= 0.5, "{name}: {way:.2} m");
    }
    // It was off: it is homed again at the operator's press, and drives at the next.
    fault(&mut robot, "steering", "reboot", 0.0, 0.0);
    robot.pass(2.0);
    robot.drive_anew(0.3, 0.0, 1.0);
    robot.pass(10.0);
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    robot.drive_anew(0.3, 0.2, 3.0);
    robot.pass(2.9);
    assert!((robot.speed() - 0.3).abs() < 0.02, "{}", robot.motion().reason);
    assert!((robot.motion().steering - 0.2).abs() < 0.01, "{} rad", robot.motion().steering);
}

/// The same, which somebody may drive at 0.8 m/s.
fn robot_with_speed(place: &RobotLocation) -> RobotLocation {
    let mut place = place.clone();
    place.sets.push("limits.speed_manual_mps=0.8".into());
    place
}
