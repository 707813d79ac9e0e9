//! Operation modes and parameters that are changed while the planner runs, with the simulated robot that steers.

use super::super::modes::REFUSALS_MAX;
use super::*;
use messages::middlelevel::{CmdMode, CmdParameter};

impl Robot {
    fn enter(&mut self, mode: i8) {
        self.bench.message(CmdMode { timestamp: 0, mode, source: "test".into() });
    }

    fn set(&mut self, name: &str, value: f64) {
        self.bench.message(CmdParameter { timestamp: 0, parameter: name.into(), value, source: "test".into() });
    }

    fn value(&self, name: &str) -> f64 {
        let found = self.parameters.parameters.iter().find(|parameter| parameter.name == name);
        found.unwrap_or_else(|| panic!("{name}: {:?}", self.parameters)).value
    }

    /// Mode and state, as last published.
    fn shown(&self) -> (i8, i8) {
        (self.mode.mode, self.mode.state)
    }

    fn is_reported(&self, fault: Fault) -> bool {
        self.reports.contains(&(fault as i32))
    }
}

#[test]
fn without_a_command_the_mode_is_route_and_says_what_the_goal_does() {
    let mut robot = Robot::new();
    robot.pass(1.0);
    assert_eq!((robot.shown(), &*robot.mode.text), ((CmdMode::ROUTE, DataMode::IDLE), "there is no goal"));
    robot.goal(&[(6.0, 2.0)], false);
    robot.pass(3.0);
    assert_eq!((robot.shown(), &robot.mode.text), ((CmdMode::ROUTE, DataMode::DRIVING), &robot.goal.message));
    robot.until(DataGoal::REACHED, 20.0);
    assert_eq!(robot.shown(), (CmdMode::ROUTE, DataMode::ARRIVED));
    // Commanded again it changes nothing.
    robot.goal(&[(9.0, 2.0)], false);
    robot.pass(2.0);
    robot.enter(CmdMode::ROUTE);
    robot.until(DataGoal::REACHED, 20.0);
}

#[test]
fn in_manual_goals_are_refused_and_the_planner_is_silent() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    assert!(robot.speed > 0.5, "{}", robot.speed);
    robot.enter(CmdMode::MANUAL);
    robot.pass(2.0);
    assert_eq!((robot.goal.status, robot.speed, robot.hold()), (DataGoal::CANCELLED, 0.0, Some(Hold::ModeManual)));
    let commands = robot.commands;
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(2.0);
    let refused = "refused: mode manual: only people drive the robot";
    assert_eq!((robot.goal.status, robot.goal.message.as_str()), (DataGoal::FAILED, refused));
    assert_eq!((robot.shown(), robot.commands), ((CmdMode::MANUAL, DataMode::IDLE), commands));
    assert_eq!(robot.hold(), Some(Hold::ModeManual));
    assert!(robot.is_reported(Fault::GoalRefused));
    // A cancelled goal does not end the mode.
    robot.goal(&[], false);
    robot.pass(0.5);
    assert_eq!(robot.mode.mode, CmdMode::MANUAL);
    robot.enter(CmdMode::ROUTE);
    robot.goal(&[(12.0, 2.0)], false);
    robot.until(DataGoal::REACHED, 20.0);
}

#[test]
fn in_wait_it_stands_until_a_goal_is_commanded() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    robot.enter(CmdMode::WAIT);
    robot.pass(2.0);
    assert_eq!((robot.goal.status, robot.speed), (DataGoal::CANCELLED, 0.0));
    assert_eq!((robot.shown(), &*robot.mode.text), ((CmdMode::WAIT, DataMode::WAITING), "waits for people"));
    assert_eq!(robot.hold(), Some(Hold::WaitsForPeople));
    // A base that steers does not turn to a person.
    let commands = robot.commands;
    robot.discs = vec![disc(robot.pose.x + 0.3, robot.pose.y + 1.2)];
    robot.pass(8.0);
    assert_eq!((robot.commands, robot.speed), (commands, 0.0));
    robot.discs.clear();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(0.5);
    assert_eq!(robot.mode.mode, CmdMode::ROUTE);
    robot.until(DataGoal::REACHED, 30.0);
}

#[test]
fn home_is_driven_to_and_kept() {
    let home = Pose::new(9.0, 3.0, 0.0);
    let mut robot = Robot::with(Some(hall()), Some(home));
    robot.pass(1.0);
    assert!(robot.mode.has_home);
    robot.enter(CmdMode::HOME);
    robot.until(DataGoal::REACHED, 60.0);
    robot.pass(1.0);
    assert!(robot.pose.point().distance(home.point()) < 0.2, "{:?}", robot.pose);
    assert!(robot.pose.theta.radians().abs() < crate::goal::HEADING_TOLERANCE_RAD, "{:?}", robot.pose);
    assert_eq!((robot.shown(), robot.goal.id), ((CmdMode::HOME, DataMode::ARRIVED), -4));
    let commands = robot.commands;
    robot.pass(2.0);
    assert_eq!((robot.commands, robot.speed), (commands, 0.0));
}

#[test]
fn a_goal_or_a_cancelled_one_ends_the_way_home() {
    for waypoints in [&[(9.0, 4.0)][..], &[]] {
        let mut robot = Robot::with(Some(hall()), Some(Pose::new(9.0, 2.0, 0.0)));
        robot.pass(1.0);
        robot.enter(CmdMode::HOME);
        robot.pass(4.0);
        assert!(robot.speed > 0.3, "{}", robot.speed);
        robot.goal(waypoints, false);
        robot.pass(0.2);
        assert_eq!((robot.mode.mode, robot.goal.id), (CmdMode::ROUTE, 5));
        if !waypoints.is_empty() {
            robot.until(DataGoal::REACHED, 40.0);
        }
        robot.pass(2.0);
        assert_eq!((robot.mode.mode, robot.speed), (CmdMode::ROUTE, 0.0));
    }
    // An impossible goal does not end it.
    let mut robot = Robot::with(Some(hall()), Some(Pose::new(9.0, 2.0, 0.0)));
    robot.pass(1.0);
    robot.enter(CmdMode::HOME);
    robot.pass(4.0);
    robot.goal(&[(50.0, 2.0)], false);
    robot.pass(0.5);
    assert_eq!((robot.mode.mode, robot.goal.id), (CmdMode::HOME, -4));
    assert!(robot.speed > 0.3, "{}", robot.speed);
}

#[test]
fn without_a_home_place_or_with_one_outside_the_map_it_stands_and_says_why() {
    let mut robot = Robot::new();
    robot.goal(&[(12.0, 2.0)], false);
    robot.pass(4.0);
    robot.enter(CmdMode::HOME);
    robot.pass(2.0);
    let shown = (robot.shown(), robot.mode.has_home, &*robot.mode.text);
    assert_eq!(shown, ((CmdMode::HOME, DataMode::FAILED), false, "no home place is configured"));
    assert_eq!((robot.speed, robot.hold()), (0.0, Some(Hold::NoHome)));
    assert!(robot.is_reported(Fault::ModeRefused));
    let mut robot = Robot::with(Some(hall()), Some(Pose::new(50.0, 3.0, 0.0)));
    robot.enter(CmdMode::HOME);
    robot.pass(1.0);
    assert_eq!(robot.shown(), (CmdMode::HOME, DataMode::FAILED));
    assert!(robot.mode.text.contains("outside the map"), "{}", robot.mode.text);
}

#[test]
fn it_approaches_a_person_who_stands_slowly_and_stops_at_the_distance() {
    let mut robot = Robot::new();
    robot.enter(CmdMode::APPROACH);
    robot.pass(3.0);
    assert_eq!((robot.shown(), &*robot.mode.text), ((CmdMode::APPROACH, DataMode::WAITING), "waits for people"));
    assert_eq!((robot.commands, robot.hold()), (0, Some(Hold::WaitsForPeople)));
    let person = Point { x: 5.0, y: 2.0 };
    robot.discs = vec![(person, 0.15)];
    let (mut fastest, mut n) = (0.0_f64, 0);
    while robot.mode.state != DataMode::ARRIVED || robot.pose.x < 2.3 {
        robot.step();
        fastest = fastest.max(robot.speed.abs());
        n += 1;
        assert!(n < 6000, "at {:?}: {:?} {:?}", robot.pose, robot.mode, robot.goal);
    }
    robot.pass(2.0);
    let gap = person.x - (robot.pose.x + BODY.front);
    assert!((0.9..1.6).contains(&gap) && robot.speed == 0.0, "{gap} m, {} m/s", robot.speed);
    assert!(fastest > 0.1 && fastest <= 0.4 + 1e-9, "{fastest} m/s");
    // The person leaves.
    robot.discs.clear();
    robot.pass(10.0);
    assert_eq!((robot.shown(), robot.speed), ((CmdMode::APPROACH, DataMode::WAITING), 0.0));
}

#[test]
fn a_person_who_walks_away_is_not_followed() {
    let mut robot = Robot::new();
    robot.enter(CmdMode::APPROACH);
    robot.discs = vec![disc(5.0, 2.0)];
    let mut n = 0;
    while robot.speed < 0.2 {
        robot.step();
        n += 1;
        assert!(n < 3000, "{:?} {:?}", robot.mode, robot.goal);
    }
    let from = robot.pose.x;
    for _ in 0..800 {
        robot.discs[0].0.x += STEP.as_secs_f64();
        robot.step();
    }
    assert!(robot.pose.x < from + 2.0, "from {from}: {:?}", robot.pose);
    for _ in 0..500 {
        robot.step();
        assert_eq!(robot.speed, 0.0, "{:?} {:?}", robot.mode, robot.goal);
    }
    assert_eq!((robot.shown(), robot.hold()), ((CmdMode::APPROACH, DataMode::WAITING), Some(Hold::WaitsForPeople)));
}

#[test]
fn it_stands_before_a_person_where_its_distances_let_it_arrive() {
    let mut robot = Robot::behaving(Behaviour { approach_distance: 0.5, ..Behaviour::default() });
    for (name, value) in [("people_margin_m", 0.7), ("stop_distance_m", 0.2)] {
        robot.set(name, value);
    }
    robot.enter(CmdMode::APPROACH);
    let person = Point { x: 5.0, y: 2.0 };
    robot.discs = vec![(person, 0.15)];
    let mut n = 0;
    while robot.mode.state != DataMode::ARRIVED || robot.pose.x < 2.3 {
        robot.step();
        n += 1;
        assert!(n < 6000, "at {:?}: {:?} {:?}", robot.pose, robot.mode, robot.goal);
        assert_ne!(robot.hold(), Some(Hold::BackingOut), "before a person: {:?} {:?}", robot.pose, robot.goal);
    }
    robot.pass(10.0);
    let gap = person.x - (robot.pose.x + BODY.front);
    assert!((0.6..1.3).contains(&gap) && robot.speed == 0.0, "{gap} m, {} m/s", robot.speed);
    assert_eq!(robot.shown(), (CmdMode::APPROACH, DataMode::ARRIVED));
}

#[test]
fn a_flood_of_refused_commands_is_reported_a_limited_number_of_times() {
    let mut robot = Robot::new();
    // Between two periodic messages.
    robot.pass(0.5);
    let refused = |robot: &Robot| {
        let faults = [Fault::ModeRefused as i32, Fault::ParameterRefused as i32];
        robot.reports.iter().filter(|number| faults.contains(number)).count()
    };
    for _ in 0..500 {
        robot.enter(9);
        robot.set("speed_mps", 7.0);
    }
    robot.pass(0.1);
    assert_eq!(refused(&robot), usize::from(REFUSALS_MAX));
    robot.pass(1.5);
    robot.set("speed_mps", 7.0);
    robot.pass(0.1);
    assert_eq!(refused(&robot), usize::from(REFUSALS_MAX) + 1);
}

#[test]
fn a_mode_that_does_not_exist_is_refused_and_the_robot_goes_on() {
    let mut robot = Robot::new();
    robot.goal(&[(9.0, 2.0)], false);
    robot.pass(3.0);
    for mode in [5, -1, 127] {
        robot.reports.clear();
        robot.enter(mode);
        robot.pass(0.2);
        assert!(robot.is_reported(Fault::ModeRefused) && robot.mode.mode == CmdMode::ROUTE, "{mode}");
    }
    robot.until(DataGoal::REACHED, 20.0);
}

#[test]
fn a_lower_speed_limit_slows_the_robot_at_once_and_one_out_of_range_is_refused() {
    let mut robot = Robot::new();
    robot.goal(&[(30.0, 2.0)], false);
    robot.pass(5.0);
    assert!(robot.speed > 0.6, "{}", robot.speed);
    robot.set("speed_mps", 0.3);
    robot.pass(2.0);
    assert_eq!(robot.value("speed_mps"), 0.3);
    for _ in 0..300 {
        robot.step();
        assert!((0.2..=0.3 + 1e-9).contains(&robot.speed), "{} m/s", robot.speed);
    }
    assert!(!robot.is_reported(Fault::ParameterRefused));
    for (name, value) in [("speed_mps", 0.9), ("speed_mps", f64::NAN), ("margin_m", 0.1), ("attempts", 3.0)] {
        robot.reports.clear();
        robot.set(name, value);
        robot.pass(0.2);
        assert!(robot.is_reported(Fault::ParameterRefused), "{name} {value}");
    }
    assert_eq!((robot.value("speed_mps"), robot.value("margin_m")), (0.3, 0.15));
    robot.set("speed_mps", 0.8);
    robot.pass(4.0);
    assert!(robot.speed > 0.6, "{}", robot.speed);
}

#[test]
fn at_the_lowest_speeds_it_still_goes_on_when_what_was_in_the_way_has_left() {
    let mut robot = Robot::new();
    robot.pass(0.5);
    for name in ["speed_mps", "speed_reverse_mps", "speed_unseen_mps", "speed_approach_mps"] {
        let least = robot.parameters.parameters.iter().find(|parameter| parameter.name == name).unwrap().minimum;
        robot.set(name, least);
    }
    robot.discs = vec![disc(3.8, 2.0)];
    robot.goal(&[(5.0, 2.0)], false);
    robot.until(DataGoal::BLOCKED, 30.0);
    assert!(robot.pose.x > 2.2, "{:?}: {:?}", robot.pose, robot.goal);
    robot.discs.clear();
    robot.until(DataGoal::REACHED, 90.0);
}

#[test]
fn with_greater_distances_it_stands_farther_from_an_obstacle() {
    let gap = |parameters: &[(&str, f64)]| {
        let mut robot = Robot::new();
        parameters.iter().for_each(|(name, value)| robot.set(name, *value));
        robot.discs = vec![disc(6.0, 2.0)];
        robot.goal(&[(10.0, 2.0)], false);
        robot.until(DataGoal::BLOCKED, 15.0);
        6.0 - 0.15 - (robot.pose.x + BODY.front)
    };
    // 0.25 m more; where an obstacle is met is known to 0.1 m.
    let (usual, greater) = (gap(&[]), gap(&[("margin_m", 0.3), ("stop_distance_m", 0.2)]));
    assert!(greater > usual + 0.1, "{usual} m, {greater} m");
}
