//! The guard on the whole robot: with any source the robot stops before a wall, and does not drive where it is blind.

use super::*;
use messages::simulation::{CmdFault, DataTruth};

pub struct Guarded {
    pub robot: Robot,
    pub truth: Rc<RefCell<DataTruth>>,
}

/// Shipped robot with a guard, homed.
pub fn guarded(seed: u64) -> Guarded {
    let mut robot = Robot::at(&guarded_place(), Config { seed, ..Config::default() });
    let truth = Rc::new(RefCell::new(DataTruth::default()));
    let keep = truth.clone();
    robot.machine.observe(move |_, news| {
        if let News::Message { message: Message::SimDataTruth(truth), .. } = news {
            *keep.borrow_mut() = truth.clone();
        }
    });
    robot.machine.run_until(at(12.0));
    assert!(robot.motion().homed, "{}", robot.motion().reason);
    Guarded { robot, truth }
}

#[test]
fn driven_by_hand_towards_a_wall_it_comes_to_stand_before_it() {
    let Guarded { mut robot, truth } = guarded(1);
    let start = truth.borrow().x;
    // From x = 3 through the hall, past its columns, to a stand's wall at x = 15.
    robot.drive(0.6, -0.02, 60.0);
    robot.pass(59.0);
    let truth = truth.borrow().clone();
    assert!(truth.collisions == 0 && truth.x > start + 3.0, "{truth:?}");
    assert!(truth.speed.abs() < 0.05 && truth.clearance > 0.0, "{truth:?}");
    assert!(robot.seen.borrow().holds.is_free(), "a bound is no refusal: {:?}", robot.seen.borrow().holds);
}

#[test]
fn with_a_dead_sonar_board_nobody_drives_forward() {
    let Guarded { mut robot, .. } = guarded(2);
    let now = robot.machine.now();
    let fault = CmdFault { target: "sd1_front".into(), fault: "silent".into(), duration: 60.0, ..CmdFault::default() };
    robot.machine.inject(now, fault);
    // What the guard itself permits: the driver, which stops for the lost board, too, would hide a guard that is wrong.
    let permitted = Rc::new(RefCell::new(Vec::new()));
    let keep = permitted.clone();
    robot.machine.observe(move |now, news| {
        if let News::Message { message: Message::LlDataGuard(guard), .. } = news {
            keep.borrow_mut().push((now, guard.forward));
        }
    });
    robot.pass(8.0);
    robot.drive(0.4, 0.0, 3.0);
    robot.pass(2.5);
    assert!(robot.speed().abs() < 0.01, "{} m/s", robot.speed());
    let permitted = permitted.borrow();
    // The last measurement is good for `guard.age_max_s`, 0.8 s.
    let late: Vec<f64> =
        permitted.iter().filter(|(at, _)| at.since(now) > Duration::from_secs(1)).map(|it| it.1).collect();
    assert!(late.len() > 150, "{} messages of the guard", late.len());
    assert!(
        late.iter().all(|forward| *forward == 0.0),
        "it permits {:?} m/s",
        late.iter().copied().fold(0.0, f64::max)
    );
    assert!(permitted[0].1 > 0.0, "with the board it permitted nothing either");
}

#[test]
fn a_guard_that_dies_stops_the_robot_and_nothing_resumes_by_itself() {
    let Guarded { mut robot, .. } = guarded(3);
    robot.drive(0.4, 0.0, 16.0);
    // A false echo may slow it for a moment.
    let fast = (0..80).any(|_| {
        robot.pass(0.05);
        robot.speed() > 0.3
    });
    assert!(fast, "{} m/s", robot.speed());
    let pid = robot.machine.pid("guard").expect("it runs");
    robot.machine.kill(pid);
    robot.pass(1.0);
    assert!(robot.speed().abs() < 0.01, "{} m/s", robot.speed());
    // It is restarted; the commands go on.
    robot.pass(8.0);
    assert!(robot.speed().abs() < 0.01 && robot.machine.pid("guard").is_some(), "{} m/s", robot.speed());
    robot.pass(6.0);
    robot.drive_anew(0.3, 0.0, 3.0);
    robot.pass(2.0);
    assert!(robot.speed() > 0.05, "{} m/s, {:?}", robot.speed(), robot.seen.borrow().holds);
}
