//! Proof that the rules detect bugs: each deliberate bug (`bug.rs`) is found by the soak within one robot-hour, by a
//! rule that it breaks; and without a bug nothing is found.
//!
//! `tools/sabotage` builds and runs this test in a copy of the tree with `hooks.patch`; it prints the time and the
//! rule.
//! `BUG=PauseIgnored` selects one of them.

use cli::soak::Robot;
use module::sabotage::{self, Bug};
use robot::config;
use robot::place::RobotLocation;
use sim::soak::{Kind, Scenario, Violation};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;

const SEED: u64 = 1;
const HOUR_S: f64 = 3600.0;
const OFTEN: f64 = 30.0;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

fn scenario() -> Scenario {
    config::scenario(&folder("scenarios/default.toml")).expect("the shipped scenario")
}

fn robot(scenario: Scenario) -> Robot {
    let place = RobotLocation {
        config: folder("conf/advee"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        // Visitors have tests of their own.
        sets: vec!["world.people=0".into()],
        sim: true,
        world: None,
    };
    Robot::new(place, scenario, SEED).expect("the shipped configuration")
}

/// Rules broken by a bug; which of them is detected first is random.
fn rules(bug: Bug) -> &'static [&'static str] {
    match bug {
        Bug::TimeToLiveIgnored => &["fresh", "authority"],
        Bug::LimitsIgnored => &["fresh", "refused"],
        Bug::PauseIgnored => &["pause"],
        Bug::ResumesByItself | Bug::PlannerNotLatched | Bug::EstimateIgnored => &["resumes"],
        Bug::TwoAuthorities => &["authority"],
        // An axis that needs no reference is not homed.
        Bug::HomingNotRequired => &["homed", "moves"],
        Bug::StateIgnored => &["idle"],
        // The order to stop does not reach the lost drive, so its feed is cut when it answers again; or the planner
        // goes on then, since it met no stop.
        Bug::LostDriveIgnored => &["drives", "feed", "resumes"],
        // The steering keeps turning, too.
        Bug::CriticalIgnored => &["critical", "stop", "released"],
        Bug::WatchdogNotMissed => &["critical", "stop", "released"],
        Bug::BlindnessIgnored => &["blind"],
        Bug::EchoesIgnored => &["promise"],
        Bug::WatchdogDeaf => &["stop", "wanted", "moves"],
        Bug::TwoProcesses => &["single"],
        Bug::RestartDelayIgnored => &["restarts"],
        Bug::WantedForgotten => &["wanted", "stopped"],
        Bug::StopLeft | Bug::StopLeftByError => &["stopped"],
        Bug::WallClock => &["clock"],
        Bug::PauseOfTheLast => &["pause", "released"],
        Bug::HomesByItself => &["released"],
        // The steering keeps turning, too.
        Bug::SpeedUnwatched => &["feed", "released"],
        Bug::FeedCutEarly => &["feed"],
        // After an accepted release comes motion, a state, or the first set-point without a cause for it.
        Bug::AnybodyBelieved => {
            &["authority", "foreign", "pause", "released", "resumes", "second_robot", "stopped", "wanted"]
        }
        Bug::AnybodyCommands => &["foreign"],
        Bug::BoundIgnored => &["bounded"],
        Bug::RivalIgnored => &["rival"],
        Bug::SecondRobotIgnored => &["second_robot"],
        Bug::LatenessForgiven => &["late_watchdog"],
    }
}

/// Faults that must occur for a bug to show, by the prefixes of their kinds: their rate is thirty times the usual one.
fn often(bug: Option<Bug>) -> &'static [&'static str] {
    match bug {
        Some(Bug::StopLeft) => &["state_stop", "state_run"],
        Some(Bug::StopLeftByError) => &["state_stop", "drive_"],
        Some(Bug::WantedForgotten) => &["state_pause", "process_killed"],
        Some(Bug::PlannerNotLatched) => &["motion_planned"],
        Some(Bug::BlindnessIgnored) => &["board_silent"],
        Some(Bug::EstimateIgnored) => &["motion_planned_blindly", "process_hung"],
        Some(Bug::HomesByItself) => &["drive_rebooted"],
        Some(Bug::PauseOfTheLast) => &["pause_told"],
        Some(Bug::SpeedUnwatched) => &["drive_unbraked", "drive_runaway"],
        Some(Bug::AnybodyCommands) => &["foreign_motion"],
        Some(Bug::AnybodyBelieved | Bug::SecondRobotIgnored | Bug::RivalIgnored) => &["foreign_"],
        Some(Bug::LatenessForgiven) => &["process_slow"],
        Some(Bug::WatchdogDeaf) => &["process_hung"],
        _ => &[],
    }
}

/// Kind of fault that is the only one with a bug that others would hide, or that needs to be met: somebody drives by
/// hand straight ahead, without regard to obstacles.
fn alone(bug: Option<Bug>) -> Option<Kind> {
    let (name, target, speed_mps, lasts) = match bug {
        // Of the operator's priority, so that the first one holds the motion; slower and faster than the operator.
        Some(Bug::TwoAuthorities) => ("rival", "remote", (-0.5, 0.5), (2.0, 8.0)),
        Some(Bug::EchoesIgnored) => ("blindly", "maintenance", (0.4, 0.6), (6.0, 12.0)),
        _ => return None,
    };
    let (targets, fault) = (vec![target.into()], "drive".into());
    Some(Kind { name: name.into(), targets, fault, per_hour: 240.0, value: speed_mps, lasts })
}

/// Result of a robot-hour with this bug: the violation, and the seconds until then.
fn soak(bug: Option<Bug>) -> Option<(f64, Violation)> {
    let mut scenario = scenario();
    for kind in &mut scenario.kinds {
        let often = often(bug).iter().any(|name| kind.name.starts_with(name));
        kind.per_hour *= if often { OFTEN } else { 1.0 };
    }
    if let Some(kind) = alone(bug) {
        scenario.kinds = vec![kind];
    }
    let robot = robot(scenario);
    sabotage::set(bug);
    let mut passed = 0.0;
    for number in 0.. {
        if passed >= HOUR_S {
            break;
        }
        let outcome = robot.episode(number, &robot.faults(number)).expect("the robot is made");
        passed += outcome.time.as_secs_f64();
        if let Some(violation) = outcome.violation {
            return Some((passed, violation)).filter(|_| passed <= HOUR_S);
        }
    }
    None
}

fn name(bug: Option<Bug>) -> String {
    bug.map_or("none".into(), |bug| format!("{bug:?}"))
}

#[test]
fn each_deliberate_bug_is_found_within_a_robot_hour_and_without_one_nothing_is() {
    let only = std::env::var("BUG").ok();
    let all = std::iter::once(None).chain(Bug::ALL.map(Some));
    let asked = |bug: &Option<Bug>| only.as_ref().is_none_or(|only| *only == name(*bug));
    let bugs: Vec<Option<Bug>> = all.filter(asked).collect();
    let (next, found) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let work = || {
        while let Some(bug) = bugs.get(next.fetch_add(1, Relaxed)) {
            let violation = soak(*bug);
            found.lock().expect("no one panics with it").push((*bug, violation));
        }
    };
    let jobs = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| (0..jobs).for_each(|_| drop(scope.spawn(work))));
    let mut wrong = Vec::new();
    for (bug, violation) in found.into_inner().expect("no one panicked") {
        let name = name(bug);
        let line = match &violation {
            Some((after, violation)) => format!("{name:<20} {:>6.1} min  {violation}", after / 60.0),
            None => format!("{name:<20}      -"),
        };
        println!("{line}");
        let well = match (bug, &violation) {
            (None, violation) => violation.is_none(),
            (Some(bug), Some((_, violation))) => rules(bug).contains(&violation.rule),
            (Some(_), None) => false,
        };
        if !well {
            wrong.push(line);
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
