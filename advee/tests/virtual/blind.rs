//! A ranging board that falls silent while the robot drives, or whose sonars hear nothing any more: the robot stands,
//! says why, and stays until a person acts. The board also has the floor sensors, so this holds for every source, in
//! either direction.

use super::patrol::rig::Patrol;
use messages::lowlevel::{CmdMotion, DataHold};
use messages::simulation::CmdFault;
use messages::{Hold, lowlevel};

const STANDS_MPS: f64 = 0.02;

fn fault(robot: &mut Patrol, boards: &[&str], fault: &str) {
    let now = robot.machine.now();
    for board in boards {
        let command = CmdFault { target: (*board).into(), fault: fault.into(), ..CmdFault::default() };
        robot.machine.inject(now, command);
    }
}

/// Boards that the list names as lost.
fn lost(holds: &DataHold) -> Vec<&str> {
    let lost = holds.holds.iter().filter(|hold| hold.cause() == Some(Hold::RangingLost));
    lost.map(|hold: &lowlevel::Hold| hold.subject.as_str()).collect()
}

/// Advances the time with commands of an operator at 20 Hz.
fn hand(robot: &mut Patrol, speed: f64, seconds: f64) {
    for _ in 0..(seconds * 20.0) as u32 {
        let now = robot.machine.now();
        let (priority, source) = (CmdMotion::REMOTE, "operator".into());
        robot.machine.inject(now, CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source });
        robot.pass(0.05);
    }
}

#[test]
fn a_patrol_among_visitors_stands_within_a_second_of_the_loss_of_a_board() {
    for (seed, boards) in [(1, &["sd1_front"][..]), (2, &["sd1_rear"]), (3, &["sd1_front", "sd1_rear"])] {
        let mut robot = Patrol::with("hall", None, seed, None, &["planner.speed_mps=0.8"]);
        robot.go();
        let fast = (0..1200).any(|_| {
            robot.patrol(0.1);
            robot.seen().truth.speed > 0.6
        });
        assert!(fast, "{boards:?}: {:?}", robot.seen().words);
        fault(&mut robot, boards, "silent");
        robot.pass(1.0);
        let seen = robot.seen();
        assert!(seen.truth.speed.abs() < STANDS_MPS, "{boards:?}: {:.3} m/s after a second", seen.truth.speed);
        assert_eq!(lost(&seen.holds), boards, "{:?}", seen.holds);
        assert!(seen.motion.reason.ends_with("does not answer"), "{}", seen.motion.reason);
        robot.pass(0.5);
        let told = robot.seen();
        assert_eq!(lost(&told.goal_holds), boards, "{}", told.goal.message);
        // It stays, also when an operator sends the goal again.
        robot.patrol(80.0);
        assert!((robot.seen().way - told.way).abs() < 0.05 && robot.seen().own_contacts() == 0, "{boards:?}");
        robot.send();
        robot.pass(5.0);
        assert!(robot.seen().truth.speed.abs() < STANDS_MPS);
        // The boards are back: it waits for an operator.
        fault(&mut robot, boards, "none");
        robot.pass(10.0);
        let back = robot.seen();
        assert!((back.way - told.way).abs() < 0.05, "{boards:?}");
        assert_eq!(back.goal_holds.first(), Some(Hold::PlannerLatched), "{}", back.goal.message);
        robot.send();
        // A visitor may stand in its way for a while.
        for _ in 0..12 {
            if robot.seen().way < back.way + 0.5 {
                robot.pass(10.0);
            }
        }
        assert!(robot.seen().way > back.way + 0.5, "{:?}", robot.seen().words);
    }
}

#[test]
fn a_patrol_stands_when_the_sonars_of_a_board_that_answers_hear_nothing_any_more() {
    for (world, board) in [("hall", "sd1_front"), ("hall", "sd1_rear"), ("corridor", "sd1_front")] {
        let mut robot = Patrol::new(world, None, 4, None);
        robot.go();
        let fast = (0..1200).any(|_| {
            robot.patrol(0.1);
            robot.seen().truth.speed > 0.4
        });
        assert!(fast, "{board}: {:?}", robot.seen().words);
        fault(&mut robot, &[board], "blind");
        robot.pass(1.5);
        let seen = robot.seen();
        assert!(seen.truth.speed.abs() < STANDS_MPS, "{world} {board}: {:.3} m/s after 1.5 s", seen.truth.speed);
        assert_eq!(lost(&seen.holds), [board], "{:?}", seen.holds);
        robot.patrol(60.0);
        assert!((robot.seen().way - seen.way).abs() < 0.05 && robot.seen().own_contacts() == 0, "{world} {board}");
        fault(&mut robot, &[board], "none");
        robot.pass(5.0);
        assert_eq!(lost(&robot.seen().holds), [""; 0], "one echo shows that it hears");
    }
}

#[test]
fn by_hand_it_stands_within_a_second_as_well_and_needs_a_zero() {
    for (board, speed) in [("sd1_front", 0.6), ("sd1_rear", 0.6), ("sd1_front", -0.4), ("sd1_rear", -0.4)] {
        let mut robot = Patrol::new("hall", Some(0), 1, None);
        robot.go();
        robot.send_to(2, &[]);
        robot.pass(3.0);
        hand(&mut robot, 0.0, 0.5);
        hand(&mut robot, speed, 2.0);
        assert!(robot.seen().truth.speed * speed > 0.1, "{:?}", robot.seen().holds);
        fault(&mut robot, &[board], "silent");
        hand(&mut robot, speed, 1.0);
        let seen = robot.seen();
        assert!(seen.truth.speed.abs() < STANDS_MPS, "{board} {speed}: {:.3} m/s after a second", seen.truth.speed);
        assert_eq!(lost(&seen.holds), [board]);
        fault(&mut robot, &[board], "none");
        hand(&mut robot, speed, 5.0);
        assert!((robot.seen().way - seen.way).abs() < 0.05, "the command was never released");
        hand(&mut robot, 0.0, 0.5);
        hand(&mut robot, speed, 2.0);
        assert!(robot.seen().truth.speed * speed > 0.1, "{:?}", robot.seen().holds);
    }
}
