//! Lidars of the whole robot: driver and emulated devices, on a serial line and on a connection, in the hall.

use super::bases::Base;
use super::{Robot, at, guarded_place, place, virtual_machine, with_tables};
use base::{Duration, Instant};
use messages::lowlevel::{CmdMotion, CmdVelocity, DataScan};
use messages::middlelevel::{DataPersons, TrackedPerson};
use messages::simulation::{CmdFault, DataPeople, DataTruth};
use messages::{Hold, Message};
use module::State;
use navitools::{Point, Pose, wrap};
use robot::place::RobotLocation;
use sim::check::Checkers;
use sim::host::{Config, News};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

const LIDARS: &str = r#"
[lidar.front]
model = "ld19"
port = "lidar-front"
x_m = 0.7
[lidar.rear]
model = "sick-tim7xx"
address = "127.0.0.1:2112"
x_m = -0.2
y_m = 0.1
theta_rad = 3.0
upside_down = true
"#;

/// A SICK at the front whose own field, 1.5 m long, stops the robot.
const FIELD: &str = r#"
[lidar.front]
model = "sick-tim7xx"
address = "127.0.0.1:2112"
x_m = 0.75
stop_fields = [1]
simulated_fields_m = [[[0.0, -0.4], [1.5, -0.4], [1.5, 0.4], [0.0, 0.4]]]
"#;

#[derive(Default)]
struct Observed {
    news: Vec<(Instant, String)>,
    scans: Vec<DataScan>,
    truth: DataTruth,
}

struct Rig {
    robot: Robot,
    place: RobotLocation,
    observed: Rc<RefCell<Observed>>,
}

impl Rig {
    fn new(name: &str) -> Self {
        Self::with(name, LIDARS)
    }

    fn with(name: &str, lidars: &str) -> Self {
        let world = place().config.join("../worlds/empty.toml");
        let place = RobotLocation { world: Some(world), ..with_tables(&format!("lidar-{name}"), lidars) };
        let config = Config { seed: 7, lcm_jitter: Duration::from_micros(200), ..Config::default() };
        let mut robot = Robot::at(&place, config);
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        robot.machine.observe(move |now, news| {
            let mut keep = keep.borrow_mut();
            match news {
                News::Report { module: "driver_lidar", report } => {
                    let told = format!("{:?} {} {}", report.severity, report.fault.name(), report.subject);
                    keep.news.push((now, told));
                }
                News::State { module: "driver_lidar", state } => keep.news.push((now, state.to_string())),
                News::Message { message: Message::LlDataScan(scan), .. } => keep.scans.push(scan.clone()),
                News::Message { message: Message::SimDataTruth(truth), .. } => keep.truth = truth.clone(),
                _ => {}
            }
        });
        robot.pass(12.0);
        Self { robot, place, observed }
    }

    fn scans(&self, name: &str) -> Vec<DataScan> {
        self.observed.borrow().scans.iter().filter(|scan| scan.name == name).cloned().collect()
    }

    /// Time from `since` to the first report that contains `what`.
    fn told(&self, since: Instant, what: &str) -> Option<Duration> {
        let observed = self.observed.borrow();
        let told = observed.news.iter().find(|(at, told)| *at >= since && told.contains(what));
        told.map(|(at, _)| at.since(since))
    }

    fn fault(&mut self, target: &str, fault: &str, seconds: f64) -> Instant {
        let now = self.robot.machine.now();
        let fault = CmdFault { target: target.into(), fault: fault.into(), duration: seconds, ..CmdFault::default() };
        self.robot.machine.inject(now, fault);
        now
    }
}

#[test]
fn scans_say_where_the_walls_are() {
    let rig = Rig::new("walls");
    let world = robot::config::world(&rig.place.config, rig.place.world.as_deref(), &rig.place.sets).expect("a world");
    let truth = rig.observed.borrow().truth.clone();
    let robot = Pose::new(truth.x, truth.y, truth.theta);
    for (name, per_turn, beams_min) in [("front", 10.0, 300), ("rear", 15.0, 200)] {
        let scans = rig.scans(name);
        let turns = scans.last().unwrap().revolution - scans[0].revolution;
        let took = (scans.last().unwrap().timestamp - scans[0].timestamp) as f64 / 1e6;
        assert!((turns as f64 / took / per_turn - 1.0).abs() < 0.05, "{name}: {turns} revolutions in {took} s");
        let last: Vec<_> =
            scans.iter().filter(|scan| scan.revolution == scans.last().unwrap().revolution - 1).collect();
        assert!(last.len() >= 6, "{name}: {} sectors a revolution", last.len());
        let mut beams = 0;
        for scan in last {
            let lidar = robot * Pose::new(scan.x, scan.y, scan.theta);
            for (n, range) in scan.ranges.iter().enumerate().filter(|(_, range)| range.is_finite()) {
                let angle = lidar.theta.radians() + wrap(scan.angle_min + n as f64 * scan.angle_step);
                let hit = world.ray(lidar.point(), (angle.cos(), angle.sin()), 40.0).expect("walls all around");
                // Half a degree of the surroundings' steps, beside the noise.
                let step = 0.0045 * hit.distance / hit.cos_incidence.max(0.05);
                let off = (f64::from(*range) - hit.distance).abs();
                assert!(off < 0.06 + step, "{name}: {off} m off at {angle} rad, {} m", hit.distance);
                beams += 1;
            }
        }
        assert!(beams >= beams_min, "{name}: {beams} beams of a revolution");
    }
}

#[test]
fn a_lidar_that_is_cut_off_is_reported_and_comes_back() {
    let mut rig = Rig::new("cut");
    for (name, bus) in [("front", "lidar.front"), ("rear", "lidar.rear")] {
        let cut = rig.fault(bus, "silent", 3.0);
        rig.robot.pass(8.0);
        let lost = rig.told(cut, &format!("Error LidarLost {bus}"));
        assert!(lost.is_some_and(|lost| lost <= Duration::from_secs(1)), "{name}: {lost:?}");
        let back = rig.told(cut, &format!("Notice LidarLost {bus}"));
        let within = Duration::from_secs(3)..=Duration::from_secs(5);
        assert!(back.is_some_and(|back| within.contains(&back)), "{name}: {back:?}");
    }
    let stalled = rig.fault("lidar.front", "stall", 2.0);
    rig.robot.pass(1.5);
    assert!(rig.told(stalled, "lidar.front").is_some_and(|told| told <= Duration::from_secs(1)));
    let blind = rig.fault("lidar.rear", "blind", 2.0);
    rig.robot.pass(1.5);
    assert!(rig.told(blind, "LidarBlocked lidar.rear").is_some_and(|told| told <= Duration::from_secs(1)));
}

#[test]
fn what_is_in_a_field_that_a_lidar_evaluates_stops_the_robot_as_pause_does() {
    let mut rig = Rig::with("field", FIELD);
    rig.robot.drive_anew(0.5, 0.0, 30.0);
    rig.robot.pass(25.0);
    let truth = rig.observed.borrow().truth.clone();
    // The wall is at 20 m.
    assert!((17.7..18.3).contains(&truth.x) && truth.speed.abs() < 0.01, "{truth:?}");
    assert_eq!(rig.robot.hold(), Some(Hold::PauseField));
}

#[test]
fn without_results_of_its_fields_a_lidar_stops_the_robot_and_nothing_resumes_by_itself() {
    let mut rig = Rig::with("field-lost", FIELD);
    for fault in ["silent", "stuck", "blind"] {
        rig.robot.drive_anew(0.2, 0.0, 8.0);
        rig.robot.pass(2.0);
        assert!(rig.robot.speed() > 0.15, "{fault}: {} m/s, {:?}", rig.robot.speed(), rig.robot.hold());
        rig.fault("lidar.front", fault, 2.0);
        // Engaged within 0.5 s, and braked from 0.2 m/s.
        rig.robot.pass(1.0);
        assert_eq!(rig.robot.hold(), Some(Hold::PauseField), "{fault}");
        assert!(rig.robot.speed().abs() < 0.01, "{fault}: {} m/s", rig.robot.speed());
        rig.robot.pass(6.0);
        assert_eq!(rig.robot.hold(), Some(Hold::PauseLatched), "{fault}");
        assert!(rig.robot.speed().abs() < 0.01, "{fault}: it resumed by itself");
    }
}

/// The shipped robots that the lidars guard, the number of wheels that are driven each by itself, and their lidars.
const GUARDED: [(&str, u16, &[&str]); 2] =
    [("courier", 2, &["lidar.top"]), ("advee-lidar", 0, &["lidar.front", "lidar.rear"])];

/// A robot in the empty hall that drives along the middle at 0.35 m/s by hand.
fn driving(name: &str, wheels: u16, seconds: f64) -> Base {
    let mut robot = Base::ready(name, wheels);
    robot.drive((0.35, 0.0, 0.0), seconds);
    robot.pass(5.0);
    let truth = robot.truth();
    assert!(truth.speed > 0.3, "{name}: {truth:?}");
    robot
}

#[test]
fn a_robot_comes_to_stand_before_the_wall_that_its_lidars_see() {
    for (name, wheels, _) in GUARDED {
        let mut robot = driving(name, wheels, 60.0);
        robot.pass(54.0);
        let truth = robot.truth();
        assert!(truth.collisions == 0 && truth.x > 18.0, "{name}: {truth:?}");
        assert!(truth.speed.abs() < 0.01 && (0.05..0.4).contains(&truth.clearance), "{name}: {truth:?}");
    }
}

#[test]
fn without_what_a_lidar_sees_a_robot_stands_and_goes_on_when_it_sees_again() {
    for (name, wheels, lidars) in GUARDED {
        for (lidar, fault) in
            lidars.iter().flat_map(|lidar| ["silent", "stuck", "garbled", "stall", "blind"].map(|fault| (lidar, fault)))
        {
            let mut robot = driving(name, wheels, 30.0);
            let (target, fault) = ((*lidar).into(), fault.into());
            let fault = CmdFault { target, fault, duration: 4.0, ..CmdFault::default() };
            robot.machine.inject(robot.machine.now(), fault.clone());
            // Reported within 1 s, and braked from 0.35 m/s.
            robot.pass(2.5);
            let truth = robot.truth();
            assert!(truth.speed.abs() < 0.01, "{name}, {fault:?}: {truth:?}");
            robot.pass(6.5);
            let truth = robot.truth();
            assert!(truth.speed > 0.3 && truth.collisions == 0, "{name}, {fault:?}: {truth:?}");
        }
    }
}

/// People in the empty hall beside the robot: one who stands, and one who walks to and fro.
const WALKERS: &str = "
[[walkers]]
points = [[11.5, 7.0]]
[[walkers]]
points = [[8.0, 4.2], [12.0, 4.2]]
";

/// People as the robot published them, and where all of them really were at that time.
fn tracked(name: &str, wheels: u16, seconds: f64) -> Vec<(DataPersons, Vec<Point>)> {
    let world = format!("{}{WALKERS}", include_str!("../../../conf/worlds/empty.toml"));
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("tracked-{name}-{}.toml", std::process::id()));
    std::fs::write(&file, world).expect("a file");
    let mut robot = Base::in_world(name, wheels, &file);
    std::fs::remove_file(file).expect("the file");
    robot.pass(10.0);
    let seen = Rc::new(RefCell::new((Vec::<DataPersons>::new(), Vec::<DataPeople>::new())));
    let keep = seen.clone();
    robot.machine.observe(move |_, news| match news {
        News::Message { message: Message::MlDataPersons(persons), .. } => keep.borrow_mut().0.push(persons.clone()),
        News::Message { message: Message::SimDataPeople(people), .. } => keep.borrow_mut().1.push(people.clone()),
        _ => {}
    });
    robot.pass(seconds);
    let (persons, truths) = std::mem::take(&mut *seen.borrow_mut());
    let placed = persons.into_iter().filter_map(|message| {
        let next = truths.iter().position(|truth| truth.timestamp >= message.timestamp)?;
        let (before, after) = (truths.get(next.checked_sub(1)?)?, &truths[next]);
        let span = (after.timestamp - before.timestamp) as f64;
        let share = (message.timestamp - before.timestamp) as f64 / span;
        let between = |from: f64, to: f64| from + share * (to - from);
        let people = 0..after.x.len();
        let at = people.map(|n| Point { x: between(before.x[n], after.x[n]), y: between(before.y[n], after.y[n]) });
        Some((message, at.collect()))
    });
    placed.collect()
}

#[test]
fn people_whom_a_lidar_sees_are_published_where_they_are_each_under_one_number() {
    let all = tracked("courier", 2, 20.0);
    assert!((95..=101).contains(&all.len()), "5 Hz: {}", all.len());
    let find = |persons: &DataPersons, at: Point| {
        let near = |person: &&TrackedPerson| at.distance(Point { x: person.x, y: person.y }) < 0.3;
        persons.persons.iter().find(near).cloned()
    };
    let stands = all.iter().map(|(persons, at)| find(persons, at[0]).map(|person| person.id)).collect::<Vec<_>>();
    assert!(stands.iter().all(|id| id.is_some() && *id == stands[0]), "{stands:?}");
    let walks = all.iter().filter_map(|(persons, at)| find(persons, at[1])).collect::<Vec<_>>();
    assert!(walks.len() * 10 >= all.len() * 9, "{} of {}", walks.len(), all.len());
    assert!(walks.iter().any(|person| person.vx > 0.4) && walks.iter().any(|person| person.vx < -0.4), "{walks:?}");
    let alone = all.iter().filter(|(persons, _)| persons.persons.len() <= 2).count();
    assert!(alone * 10 >= all.len() * 9, "nobody else is there: {alone} of {}", all.len());
    assert_eq!(tracked("rover", 2, 3.0), [], "a robot without lidars publishes none");
}

/// Rule that the courier violates when it is driven by hand towards a wall in sight of its lidar, with this laid over
/// its configuration, and the number of its contacts with what was in sight. The rules are those of the shipped
/// courier.
fn driven_into_a_wall(sets: &[&str]) -> (Option<&'static str>, u64) {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/courier");
    let world = Some(config.join("../worlds/empty.toml"));
    let mut place = RobotLocation { config, world, ..guarded_place() };
    place.sets.push("world.start=[16.0, 6.0, 0.0]".into());
    let world = robot::config::world(&place.config, place.world.as_deref(), &place.sets).expect("a world");
    let limits = robot::checks::limits(&place, Duration::from_secs(10)).expect("a configuration");
    place.sets.extend(sets.iter().map(|set| (*set).to_owned()));
    let mut machine = virtual_machine(&place, Config { seed: 1, ..Config::default() }).expect("a configuration");
    let checkers = Rc::new(RefCell::new(Checkers::new(limits).in_world(&world)));
    let keep = checkers.clone();
    machine.observe(move |now, news| keep.borrow_mut().observe(now, news));
    machine.spawn("watchdog", State::Run).expect("the watchdog starts");
    machine.run_until(at(12.0));
    for n in 0..300 {
        let vx = if n < 10 { 0.0 } else { 0.35 };
        let command = CmdVelocity { vx, priority: CmdMotion::REMOTE, source: "test".into(), ..CmdVelocity::default() };
        machine.inject(at(12.0) + n * Duration::from_millis(50), command);
    }
    machine.run_until(at(27.0));
    let checkers = checkers.borrow();
    let (seen, hidden) = checkers.hits();
    assert_eq!(hidden.count, 0, "{sets:?}: nothing hides the wall");
    (checkers.violation().map(|violation| violation.rule), seen.count)
}

#[test]
fn a_robot_whose_guard_does_not_use_its_lidar_is_found_by_the_rule_of_what_was_in_sight() {
    assert_eq!(driven_into_a_wall(&[]), (None, 0));
    // A guard by sonars, of which this robot has none, permits the speed of a robot that senses nothing.
    let blind = ["guard.ranging=sonar", "guard.speed_blind_mps=2.0"];
    assert_eq!(driven_into_a_wall(&blind), (Some("sight"), 1));
}
