//! Holds as listed in `LL_DATA_HOLD`: all of them, in order, with the time at which each began.

use super::super::Axis;
use super::super::objection::Objection;
use super::super::{drive, steering};
use super::*;
use canopen::axis::NotFollowing;
use canopen::axis::modes::watch::WrongMode;
use canopen::master::{BootError, LostReason, Step};
use messages::middlelevel::{CmdGoal, DataEstimate, Waypoint};
use module::ActiveHold;

fn pause(engaged: bool, source: &str) -> lowlevel::EventStop {
    lowlevel::EventStop { timestamp: 0, engaged, source: source.into() }
}

#[test]
fn all_holds_are_listed_main_one_first() {
    let mut robot = Robot::ready();
    robot.drive(0.4, 500);
    assert_eq!((robot.holds(), robot.reason().as_str()), (vec![], ""), "it drives");
    robot.missing = "driver_rs485a";
    robot.bench.message(pause(true, "bumper2"));
    let now = robot.bench.now();
    robot.epos.fault(now, 0x2310);
    robot.drive(0.4, 200);
    let stands = [
        (Hold::PauseBumper, "bumper2"),
        (Hold::DriveFault, "propulsion"),
        (Hold::CriticalModule, "driver_rs485a"),
        (Hold::NotReleased, "test"),
    ];
    assert_eq!(robot.holds(), stands);
    assert_eq!(robot.reason(), "PAUSE is engaged by bumper2");
    let latched: Vec<bool> = robot.holds.holds.iter().map(|hold| hold.latched).collect();
    assert_eq!(latched, [false, false, false, true]);
    // One has ended; the others keep their begin.
    let since = |robot: &Robot, hold: Hold| {
        robot.holds.holds.iter().find(|row| row.cause() == Some(hold)).map(|row| row.since).expect("it stands")
    };
    let before = (since(&robot, Hold::DriveFault), since(&robot, Hold::CriticalModule));
    robot.bench.message(pause(false, ""));
    robot.exchange();
    let latched = [stands[1], stands[2], (Hold::PauseLatched, ""), stands[3]];
    assert_eq!(robot.holds(), latched, "at once, not with the next period");
    assert_eq!((since(&robot, Hold::DriveFault), since(&robot, Hold::CriticalModule)), before);
}

#[test]
fn the_list_is_published_five_times_a_second_and_on_change() {
    let mut robot = Robot::ready();
    let stamp = |robot: &Robot| (robot.holds.timestamp, robot.holds.module.clone());
    let mut stamps = vec![stamp(&robot)];
    for _ in 0..1000 {
        robot.pass(1);
        stamps.push(stamp(&robot));
    }
    stamps.dedup();
    assert!((5..=6).contains(&stamps.len()), "{}", stamps.len());
    assert!(stamps.iter().all(|(_, module)| module == NAME));
    let before = robot.holds.timestamp;
    robot.pass(30);
    robot.bench.message(pause(true, "button"));
    robot.exchange();
    assert!(robot.holds.timestamp > before && robot.hold() == Some(Hold::PauseButton));
}

#[test]
fn the_source_of_pause_is_a_number() {
    let mut robot = Robot::ready();
    for (source, hold) in [
        ("bumper1", Hold::PauseBumper),
        ("bumper8", Hold::PauseBumper),
        ("sd1_front", Hold::PauseFloor),
        ("sd1_rear", Hold::PauseFloor),
        ("button", Hold::PauseButton),
        ("bumper9", Hold::PauseOther),
        ("", Hold::PauseOther),
    ] {
        robot.bench.message(pause(true, source));
        robot.exchange();
        assert_eq!(robot.holds(), [(hold, source)]);
        robot.bench.message(pause(false, source));
    }
    // The power controller's names are those of the contract.
    for byte in 0..=u8::MAX {
        let known = rs485::boards::psc1::source_name(byte).map(messages::StopSource::from_name);
        assert!(known.is_none_or(|source| source as u8 == byte), "{byte:#x}: {known:?}");
    }
}

#[test]
fn ignored_sources_are_named_and_the_planner_with_its_missing_needs() {
    let mut robot = Robot::ready();
    let command = |robot: &mut Robot, source: &str, priority| {
        robot.bench.message(lowlevel::CmdMotion {
            timestamp: 0,
            speed: 0.4,
            steering: 0.0,
            priority,
            source: source.into(),
        });
        robot.exchange();
    };
    command(&mut robot, "planner", 0);
    assert_eq!(robot.holds(), [(Hold::PlannerNoEstimate, ""), (Hold::PlannerLatched, "planner")]);
    robot.bench.message(DataEstimate { quality: DataEstimate::FINE, ..Default::default() });
    robot.exchange();
    assert_eq!(robot.holds(), [(Hold::PlannerLatched, "planner")]);
    assert_eq!(robot.holds.holds[0].words(), "planner waits: an operator must resume it");
    robot.pass(300);
    // Two gamepads and the planner behind a manual source.
    robot.drive(0.0, 50);
    robot.drive(0.4, 100);
    command(&mut robot, "planner", 0);
    command(&mut robot, "other", 1);
    assert_eq!(robot.holds(), [], "the motion acts");
    robot.pass(1);
    robot.bench.message(pause(true, "button"));
    robot.exchange();
    let stands = [(Hold::PauseButton, "button"), (Hold::Contested, "other"), (Hold::Overruled, "planner")];
    assert_eq!(robot.holds(), stands);
    command(&mut robot, "planner", 0);
    command(&mut robot, "other", 1);
    command(&mut robot, "test", 1);
    // Equal causes in the order in which their sources first commanded.
    let stands = [
        (Hold::PauseButton, "button"),
        (Hold::NotReleased, "test"),
        (Hold::NotReleased, "other"),
        (Hold::PlannerLatched, "planner"),
    ];
    assert_eq!(robot.holds(), stands);
    // A released source is no longer named.
    robot.pass(300);
    robot.bench.message(pause(false, ""));
    robot.exchange();
    assert_eq!(robot.holds(), [(Hold::PauseLatched, "")]);
    robot.press(0.0001);
    robot.pass(300);
    assert_eq!(robot.holds(), [(Hold::NobodyCommands, "")]);
}

#[test]
fn a_lost_estimate_is_listed_before_the_latched_planner() {
    let mut robot = Robot::ready();
    let goal = Message::from(CmdGoal { waypoints: vec![Waypoint::default()], ..Default::default() });
    robot.bench.event(Event::Message { at: robot.bench.now(), from: Origin::DUE, message: &goal });
    robot.bench.message(DataEstimate { quality: DataEstimate::FINE, ..Default::default() });
    let source: String = "planner".into();
    robot.bench.message(lowlevel::CmdMotion { timestamp: 0, speed: 0.4, steering: 0.0, priority: 0, source });
    robot.pass(100);
    assert_eq!(robot.holds(), [], "{}", robot.reason());
    robot.bench.message(DataEstimate { quality: DataEstimate::LOST, ..Default::default() });
    robot.exchange();
    assert_eq!(robot.holds(), [(Hold::PlannerNoEstimate, ""), (Hold::PlannerLatched, "planner")]);
    robot.missing = "planner";
    robot.pass(100);
    assert_eq!(robot.holds()[0], (Hold::PlannerModule, "planner"));
}

#[test]
fn causes_are_compared_without_strings_and_their_texts_match_the_list() {
    fn is_plain<T: Copy + PartialEq>(_: T) {}
    let canbus = Canbus::new(config()).expect("a good configuration");
    let steering = |objection| Objection::Drive(Axis::Steering, objection);
    let absent = drive::Absence::Lost(LostReason::Heartbeat);
    let failed = drive::Absence::BootFailed(Step::DeviceType, BootError::NoHeartbeat);
    let homing = canopen::axis::modes::hm::HomingError::Timeout;
    for (objection, words) in [
        (steering(drive::Objection::Absent(absent)), "the steering drive is lost: heartbeat missing"),
        (steering(drive::Objection::Absent(failed)), "the steering drive cannot be booted: device type: no heartbeat"),
        (
            steering(drive::Objection::Fault(drive::InFault::Inherited)),
            "the steering drive is in fault since before it was booted",
        ),
        (
            steering(drive::Objection::Trouble(drive::Trouble::Mode(WrongMode { asked: 1, shown: -4 }))),
            "the steering drive does not hold its configuration: its mode is -4, not 1 (profile position)",
        ),
        (
            steering(drive::Objection::Trouble(drive::Trouble::NotFollowing(
                NotFollowing { target: 0.4, measured: 0.0 },
                "rad",
            ))),
            "the steering drive does not take its target: 0.00 instead of 0.40 rad",
        ),
        (steering(drive::Objection::NotAnswering), "the steering drive does not answer"),
        (steering(drive::Objection::StateUnknown), "the steering drive has not reported its state"),
        (Objection::NotHomed(steering::NotHomed::Unreleased), "the steering is to be homed: it waits for an operator"),
        (Objection::NotHomed(steering::NotHomed::Failed(homing)), "homing the steering failed: takes too long"),
    ] {
        is_plain(objection);
        assert_eq!(canbus.words(objection), words);
        let ActiveHold { hold, subject, .. } = canbus.active_hold(objection);
        assert!(words.starts_with(&hold.words(subject)), "{hold:?}");
    }
}
