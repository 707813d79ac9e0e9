//! Operation modes and live parameters of the planner on the whole robot, in an empty hall. The rules of `sim::check`
//! hold in each test: nothing drives without an operator's order.

use super::*;
use messages::middlelevel::{CmdGoal, CmdMode, CmdParameter, DataGoal, DataMode, DataParameters, Waypoint};
use messages::simulation::{CmdFault, DataTruth};

#[derive(Default)]
struct Observed {
    truth: DataTruth,
    /// Greatest speed since it was last cleared, m/s.
    fastest: f64,
    goal: DataGoal,
    mode: DataMode,
    parameters: DataParameters,
    /// Numbers of all reports.
    reports: Vec<i32>,
}

impl Observed {
    fn take(&mut self, message: &Message) {
        match message {
            Message::SimDataTruth(truth) => {
                self.fastest = self.fastest.max(truth.speed.abs());
                self.truth = truth.clone();
            }
            Message::MlDataGoal(goal) => self.goal = goal.clone(),
            Message::MlDataMode(mode) => self.mode = mode.clone(),
            Message::MlDataParameters(parameters) => self.parameters = parameters.clone(),
            Message::CmEventError(error) => self.reports.push(error.number),
            _ => {}
        }
    }
}

struct Modes {
    robot: Robot,
    observed: Rc<RefCell<Observed>>,
}

impl Modes {
    /// Shipped robot, homed, at 10, 6 in the empty hall.
    fn new(seed: u64, sets: &[String]) -> Self {
        let mut place = guarded_place();
        place.world = Some(Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/worlds/empty.toml"));
        place.sets.extend_from_slice(sets);
        let config = Config { seed, lcm_jitter: Duration::from_micros(200), ..Config::default() };
        let mut robot = Robot::at(&place, config);
        let observed = Rc::new(RefCell::new(Observed::default()));
        let keep = observed.clone();
        robot.machine.observe(move |_, news| {
            if let News::Message { message, .. } = news {
                keep.borrow_mut().take(message);
            }
        });
        robot.machine.run_until(at(12.0));
        assert!(robot.motion().homed, "{}", robot.motion().reason);
        Self { robot, observed }
    }

    fn send(&mut self, message: impl Into<Message>) {
        let now = self.robot.machine.now();
        self.robot.machine.inject(now, message);
    }

    fn enter(&mut self, mode: i8) {
        self.send(CmdMode { timestamp: 0, mode, source: "test".into() });
    }

    fn go(&mut self, id: i32, x: f64, y: f64) {
        let waypoints = vec![Waypoint { x, y, ..Waypoint::default() }];
        self.send(CmdGoal { timestamp: 0, id, waypoints, r#loop: false });
    }

    /// Passes until it is so, at most this long.
    #[track_caller]
    fn until(&mut self, what: &str, seconds: f64, is: impl Fn(&Observed) -> bool) {
        for _ in 0..(seconds * 10.0) as u32 {
            self.robot.pass(0.1);
            if is(&self.observed.borrow()) {
                return;
            }
        }
        let Observed { truth, mode, goal, .. } = &*self.observed.borrow();
        panic!("{what}, after {seconds} s: {mode:?}, {goal:?}, {truth:?}");
    }

    fn truth(&self) -> DataTruth {
        self.observed.borrow().truth.clone()
    }

    fn is_standing(&self) -> bool {
        self.truth().speed.abs() < 0.01
    }

    /// Passes, and asserts that the robot stands all the while.
    #[track_caller]
    fn stands_for(&mut self, seconds: f64) {
        self.observed.borrow_mut().fastest = 0.0;
        self.robot.pass(seconds);
        let seen = self.observed.borrow();
        assert!(seen.fastest < 0.01, "{} m/s: {:?}, {:?}", seen.fastest, seen.mode, seen.goal);
    }
}

#[test]
fn it_drives_home_by_one_order_and_stays_there() {
    let mut modes = Modes::new(1, &["planner.home=[14.0, 4.0, 0.0]".into()]);
    modes.robot.pass(3.0);
    assert!(modes.is_standing() && modes.observed.borrow().mode.has_home);
    modes.enter(CmdMode::HOME);
    modes.until("it is at home", 90.0, |seen| (seen.mode.mode, seen.mode.state) == (CmdMode::HOME, DataMode::ARRIVED));
    modes.robot.pass(2.0);
    let truth = modes.truth();
    let turned = navitools::wrap(truth.theta).abs();
    assert!((truth.x - 14.0).hypot(truth.y - 4.0) < 0.3 && turned < 0.3, "{truth:?}");
    assert!(modes.is_standing() && truth.collisions == 0, "{truth:?}");
}

fn is_home(seen: &Observed) -> bool {
    (seen.mode.mode, seen.mode.state) == (CmdMode::HOME, DataMode::ARRIVED)
}

#[test]
fn after_pause_on_the_way_home_it_stands_until_an_operator_orders_it_again() {
    let mut modes = Modes::new(7, &["planner.home=[15.0, 6.0, 0.0]".into()]);
    modes.enter(CmdMode::HOME);
    modes.until("it drives", 60.0, |seen| seen.truth.speed > 0.2);
    modes.send(CmdFault { target: "psc1".into(), fault: "stop_button".into(), duration: 2.0, ..CmdFault::default() });
    // The line is open again, and the mode is as it was.
    modes.robot.pass(4.0);
    modes.stands_for(8.0);
    assert_eq!(modes.observed.borrow().mode.mode, CmdMode::HOME);
    modes.enter(CmdMode::HOME);
    modes.until("it is at home", 120.0, is_home);
}

#[test]
fn a_planner_that_is_restarted_on_the_way_home_goes_nowhere() {
    let mut modes = Modes::new(8, &["planner.home=[15.0, 6.0, 0.0]".into()]);
    modes.enter(CmdMode::HOME);
    modes.until("it drives", 60.0, |seen| seen.truth.speed > 0.2);
    let pid = modes.robot.machine.pid("planner").expect("it runs");
    modes.robot.machine.kill(pid);
    modes.until("it is there again", 20.0, |seen| seen.mode.mode == CmdMode::ROUTE);
    modes.robot.pass(2.0);
    modes.stands_for(8.0);
    modes.enter(CmdMode::HOME);
    modes.until("it is at home", 120.0, is_home);
}

#[test]
fn without_a_home_place_home_moves_nothing() {
    let mut modes = Modes::new(2, &[]);
    modes.enter(CmdMode::HOME);
    modes.robot.pass(3.0);
    let seen = modes.observed.borrow();
    assert_eq!((seen.mode.mode, seen.mode.state), (CmdMode::HOME, DataMode::FAILED), "{:?}", seen.mode);
    assert!(seen.reports.contains(&(base::Fault::ModeRefused as i32)));
    drop(seen);
    assert!(modes.is_standing());
}

/// A map of the empty hall alone, in a folder of this process: what else stands there is taken for people.
fn map_of_the_hall() -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("modes-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let (width, height) = (400, 240);
    let mut picture = format!("P2\n{width} {height}\n255\n");
    for y in 0..height {
        let is_wall = |x: usize| x == 0 || x == width - 1 || y == 0 || y == height - 1;
        let row: Vec<&str> = (0..width).map(|x| if is_wall(x) { "0" } else { "254" }).collect();
        picture += &row.join(" ");
        picture.push('\n');
    }
    std::fs::write(folder.join("hall.pgm"), picture).expect("a file");
    let text = "image: hall.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n\
        occupied_thresh: 0.65\nfree_thresh: 0.196\n";
    std::fs::write(folder.join("hall.yaml"), text).expect("a file");
    format!("planner.map={:?}", folder.join("hall.yaml").display().to_string())
}

#[test]
fn it_approaches_somebody_who_stands_and_stops_before_them() {
    // A column as wide as legs, which the planner's map does not have, 2.25 m before the robot.
    let mut modes = Modes::new(3, &["world.columns=[[13.0, 6.0, 0.12]]".into(), map_of_the_hall()]);
    modes.robot.pass(2.0);
    assert!(modes.is_standing(), "by itself it approaches nobody");
    modes.enter(CmdMode::APPROACH);
    let start = modes.truth().x;
    modes.until("it stands before somebody", 120.0, |seen| {
        seen.mode.state == DataMode::ARRIVED && seen.truth.x > start + 0.2 && seen.truth.speed.abs() < 0.01
    });
    let (truth, fastest) = (modes.truth(), modes.observed.borrow().fastest);
    // From the front to the middle: 1.2 m, and what the tracker and the end of a path are off.
    let gap = 13.0 - (truth.x + 0.75);
    assert!((0.7..1.8).contains(&gap) && truth.collisions == 0, "{gap} m, {truth:?}");
    assert!(fastest < 0.45, "{fastest} m/s");
}

#[test]
fn after_a_take_over_by_hand_it_approaches_nobody_until_an_operator_orders_it_again() {
    // Too far away to be found at first.
    let mut modes = Modes::new(9, &["world.columns=[[15.0, 6.0, 0.12]]".into(), map_of_the_hall()]);
    modes.enter(CmdMode::APPROACH);
    modes.stands_for(3.0);
    // A person drives the robot there, and lets it go.
    modes.robot.drive_anew(0.4, 0.0, 6.0);
    modes.robot.pass(9.0);
    let left = modes.truth().x;
    assert!(left > 11.5, "{left} m");
    modes.stands_for(20.0);
    assert_eq!(modes.observed.borrow().mode.mode, CmdMode::APPROACH);
    modes.enter(CmdMode::APPROACH);
    modes.until("it stands before somebody", 120.0, |seen| {
        seen.mode.state == DataMode::ARRIVED && seen.truth.x > left + 0.2 && seen.truth.speed.abs() < 0.01
    });
}

#[test]
fn in_manual_a_person_drives_and_goals_are_refused() {
    let mut modes = Modes::new(4, &[]);
    modes.enter(CmdMode::MANUAL);
    modes.robot.pass(0.5);
    modes.go(7, 14.0, 6.0);
    modes.robot.pass(3.0);
    let goal = modes.observed.borrow().goal.clone();
    assert_eq!((goal.id, goal.status), (7, DataGoal::FAILED), "{goal:?}");
    assert!(modes.is_standing());
    modes.robot.drive_anew(0.3, 0.0, 3.0);
    modes.robot.pass(2.5);
    assert!(modes.truth().speed > 0.2, "{:?}", modes.truth());
}

#[test]
fn in_wait_it_stands_and_a_goal_ends_that() {
    let mut modes = Modes::new(5, &[]);
    modes.go(1, 15.0, 6.0);
    modes.until("it drives", 60.0, |seen| seen.truth.speed > 0.2);
    modes.enter(CmdMode::WAIT);
    modes.robot.pass(3.0);
    assert!(modes.is_standing(), "{:?}", modes.truth());
    assert_eq!(modes.observed.borrow().mode.mode, CmdMode::WAIT);
    modes.go(2, 15.0, 6.0);
    modes.until("it drives again", 60.0, |seen| seen.truth.speed > 0.2);
    assert_eq!(modes.observed.borrow().mode.mode, CmdMode::ROUTE);
}

#[test]
fn a_lower_speed_limit_holds_for_goals_and_a_greater_one_than_configured_is_refused() {
    let mut modes = Modes::new(6, &[]);
    let limit = |modes: &Modes| {
        let seen = modes.observed.borrow();
        let speed = seen.parameters.parameters.iter().find(|parameter| parameter.name == "speed_mps");
        speed.expect("the limit").clone()
    };
    let configured = limit(&modes);
    assert_eq!(configured.value, configured.maximum);
    let set = |value: f64| CmdParameter { timestamp: 0, parameter: "speed_mps".into(), value, source: "test".into() };
    modes.go(1, 17.0, 6.0);
    modes.until("it drives", 60.0, |seen| seen.truth.speed > 0.25);
    modes.send(set(0.15));
    modes.robot.pass(1.5);
    modes.observed.borrow_mut().fastest = 0.0;
    modes.robot.pass(4.0);
    let fastest = modes.observed.borrow().fastest;
    assert!(fastest > 0.05 && fastest < 0.18, "{fastest} m/s");
    modes.send(set(configured.maximum + 0.1));
    modes.robot.pass(0.5);
    assert!(modes.observed.borrow().reports.contains(&(base::Fault::ParameterRefused as i32)));
    assert_eq!(limit(&modes).value, 0.15);
}

#[test]
fn a_goal_counts_once_the_last_zero_by_hand_has_expired() {
    for (after, drives) in [(0.05, false), (0.25, true)] {
        let mut modes = Modes::new(4, &[]);
        modes.robot.pass(3.0);
        modes.robot.drive_anew(0.3, 0.0, 1.0);
        modes.robot.pass(1.0);
        modes.robot.drive(0.0, 0.0, 1.5);
        // The last zero is 50 ms old.
        modes.robot.pass(1.5 + after);
        modes.go(1, 14.0, 6.0);
        if drives {
            modes.until("it drives", 10.0, |seen| seen.truth.speed > 0.2);
        } else {
            modes.stands_for(3.0);
            assert_eq!(modes.robot.hold(), Some(Hold::PlannerLatched));
        }
    }
}
