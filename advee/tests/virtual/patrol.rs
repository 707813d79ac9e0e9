//! Whole robot driving autonomously in virtual time: it finds its pose, plans, drives, waits, and stops when it must.

#[path = "../../../benches/patrol/rig.rs"]
pub mod rig;

use messages::middlelevel::DataGoal;
use planner::map::Cell;
use rig::Patrol;
use robot::place::RobotLocation;
use robot::{config, map_file};
use std::fmt::Write;

/// Patrol that has driven for a while.
fn driving(world: &str, people: Option<u32>, seed: u64) -> Patrol {
    let mut robot = Patrol::new(world, people, seed, None);
    robot.go();
    drive_further(&mut robot, 1.0);
    robot
}

/// Waits until the robot has driven this far, m; the guard brakes for each false echo.
fn drive_further(robot: &mut Patrol, way: f64) {
    let before = robot.seen().way;
    for _ in 0..60 {
        robot.pass(0.5);
        let seen = robot.seen();
        if seen.way > before + way && seen.truth.speed > 0.2 {
            return;
        }
    }
    panic!("{} m: {:?}", robot.seen().way - before, robot.seen().words);
}

#[test]
fn it_patrols_the_empty_hall_without_a_contact() {
    let mut robot = Patrol::new("hall", Some(0), 1, None);
    robot.go();
    let before = robot.seen();
    robot.patrol(240.0);
    let seen = robot.seen();
    let speed = robot.speed_since(&before, 240.0);
    assert_eq!((seen.contacts.len(), seen.failed, robot.let_go), (0, 0, 0), "{:?} {:?}", seen.contacts, seen.words);
    assert!(seen.waypoints >= 12, "a lap: {} waypoints, {speed:.2} m/s, {:?}", seen.waypoints, seen.words);
    // The guard brakes for each false echo.
    assert!(speed > 0.3, "{speed:.2} m/s, {:?}", seen.words);
}

#[test]
fn it_patrols_among_visitors_and_moves_into_none() {
    let mut waypoints = 0;
    for seed in 2..=4 {
        let mut robot = Patrol::new("hall", None, seed, None);
        robot.go();
        robot.patrol(240.0);
        let seen = robot.seen();
        assert_eq!((seen.own_contacts(), seen.failed), (0, 0), "{seed}: {:?} {:?}", seen.contacts, seen.words);
        waypoints += seen.waypoints;
    }
    assert!(waypoints >= 12, "{waypoints} waypoints");
}

#[test]
fn it_knows_its_pose_after_the_turns_at_both_ends_of_an_aisle() {
    // The front wheels of this robot are unequal by 1.5 %; in the aisle it sees one beacon.
    let mut robot = Patrol::new("warehouse", Some(0), 958, None);
    robot.go();
    let before = robot.seen().causes;
    robot.patrol(120.0);
    let seen = robot.seen();
    let searching = ("goal", Some(messages::Hold::EstimateSearching));
    let seconds = |causes: &std::collections::BTreeMap<_, f64>| causes.get(&searching).copied().unwrap_or(0.0);
    let searched = seconds(&seen.causes) - seconds(&before);
    assert!(searched < 1.0 && robot.let_go == 0, "{searched} s, {:?}", seen.words);
    assert!(seen.waypoints >= 4, "{} waypoints: {:?}", seen.waypoints, seen.words);
}

#[test]
fn a_cancelled_goal_leaves_the_robot_at_standstill() {
    let mut robot = driving("hall", Some(0), 3);
    robot.send_to(9, &[]);
    robot.pass(3.0);
    let seen = robot.seen();
    assert_eq!((seen.goal.status, seen.goal.id), (DataGoal::CANCELLED, 9));
    assert!(seen.truth.speed.abs() < 0.01, "{}", seen.truth.speed);
}

#[test]
fn a_planner_that_dies_is_no_danger_and_nothing_resumes_by_itself() {
    let mut robot = driving("hall", Some(0), 4);
    let pid = robot.machine.pid(planner::NAME).unwrap();
    robot.machine.kill(pid);
    robot.pass(3.0);
    assert!(robot.seen().truth.speed.abs() < 0.01, "{}", robot.seen().truth.speed);
    robot.pass(10.0);
    let seen = robot.seen();
    assert!(seen.truth.speed.abs() < 0.01 && robot.planner_runs());
    assert_eq!((seen.goal.status, seen.goal_holds.first()), (DataGoal::IDLE, Some(messages::Hold::NoGoal)));
    robot.send();
    drive_further(&mut robot, 0.5);
}

#[test]
fn an_estimator_that_dies_stops_it() {
    // It stops where a new estimator sees enough beacons to find the pose by itself.
    let mut robot = driving("hall", Some(0), 2);
    let pid = robot.machine.pid("estimator").unwrap();
    robot.machine.kill(pid);
    robot.pass(2.5);
    assert!(robot.seen().truth.speed.abs() < 0.01, "{}", robot.seen().truth.speed);
    robot.pass(20.0);
    let seen = robot.seen();
    assert!(seen.truth.speed.abs() < 0.01);
    assert_eq!(seen.goal_holds.first(), Some(messages::Hold::PlannerLatched), "{}", seen.goal.message);
}

#[test]
fn an_impossible_goal_does_not_end_the_patrol() {
    let mut robot = driving("hall", Some(0), 7);
    for (id, x, y) in [(21, f64::NAN, 3.0), (22, 16.0, 5.5), (23, 500.0, 5.5)] {
        let failed = robot.seen().failed;
        robot.send_to(id, &[(x, y)]);
        drive_further(&mut robot, 0.5);
        let seen = robot.seen();
        assert_eq!(
            (seen.goal.id, seen.goal.status, seen.failed),
            (1, DataGoal::DRIVING, failed + 1),
            "{:?}",
            seen.words
        );
        assert_eq!(robot.let_go, 0, "nothing was released");
    }
}

#[test]
fn invalid_goals_are_refused_with_a_reason() {
    let mut robot = Patrol::new("hall", Some(0), 6, None);
    robot.go();
    for (id, x, y, words) in [
        (11, f64::NAN, 3.0, "refused: waypoint 0 at NaN"),
        (12, 16.0, 5.5, "cannot reach waypoint 1"),
        (13, 500.0, 5.5, "cannot reach waypoint 1"),
    ] {
        robot.send_to(id, &[(x, y)]);
        robot.pass(12.0);
        let goal = robot.seen().goal;
        assert_eq!((goal.id, goal.status), (id, DataGoal::FAILED), "{}", goal.message);
        assert!(goal.message.starts_with(words), "{}", goal.message);
        assert!(robot.seen().truth.speed.abs() < 0.01);
    }
}

#[test]
fn it_drives_in_a_world_of_a_map_around_what_is_in_its_way() {
    // The hall as a map, with a block that no route knows: between the first waypoints, from 7.4 to 7.9 m by 5 to 7 m.
    let shipped = rig::place("hall", &["world.people=0".into()]);
    let hall = config::world(&shipped.config, shipped.world.as_deref(), &shipped.sets).unwrap();
    let mut map = map_file::of_rooms(&hall).unwrap();
    let frame = *map.frame();
    let ((left, low), (right, high)) = (frame.cell(7.425, 5.025).unwrap(), frame.cell(7.875, 6.975).unwrap());
    for (column, row) in (low..=high).flat_map(|row| (left..=right).map(move |column| (column, row))) {
        map.set(column, row, Cell::Occupied);
    }
    let folder = std::env::temp_dir().join(format!("advee-virtual-map-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    map_file::save(&map, &folder.join("hall.yaml")).unwrap();
    let mut text = String::from("map = \"hall.yaml\"\nstart = [3.0, 6.0, 0.0]\n");
    for beacon in &hall.beacons {
        writeln!(text, "[[beacons]]\nid = {}\nx = {:?}\ny = {:?}", beacon.id, beacon.at.x, beacon.at.y).unwrap();
    }
    text += "[[routes]]\nname = \"patrol\"\nloop = true\nwaypoints = [[12.0, 6.0], [8.0, 10.0], [3.0, 8.0]]\n";
    std::fs::write(folder.join("hall.toml"), text).unwrap();
    let place = RobotLocation { world: Some(folder.join("hall.toml")), sets: Vec::new(), ..shipped };
    let world = config::world(&place.config, place.world.as_deref(), &[]).unwrap();
    let mut robot = Patrol::at(&place, 1, None);
    robot.go();
    let (mut nearest, mut passed) = (f64::INFINITY, false);
    for _ in 0..600 {
        robot.pass(0.2);
        let truth = robot.seen().truth;
        let clearance = world.clearance(navitools::Pose::new(truth.x, truth.y, truth.theta), -0.15, 0.75, 0.3);
        nearest = nearest.min(clearance);
        passed |= truth.x > 8.5;
    }
    let seen = robot.seen();
    // Each module reads it when it starts.
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!((seen.contacts.len(), seen.failed), (0, 0), "{:?} {:?}", seen.contacts, seen.words);
    assert!(passed && seen.waypoints >= 3, "{} waypoints, {:?}", seen.waypoints, seen.words);
    assert!(nearest > 0.02, "{nearest} m from a wall");
}
