//! Soak: the same seed gives the same soak, with one job or two; violations are found and reduced; the shipped scenario
//! passes; earlier failures do not recur.
//!
//! `SOAK_HOURS=20 SOAK_SEED=7 cargo test -p advee --test soak shipped` runs it longer.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/courier_on_two_buses.rs"]
mod courier_on_two_buses;
#[path = "support/rovers.rs"]
mod rovers;
#[path = "support/by_sheets.rs"]
mod sheets;

use base::Duration;
use cli::soak::{Progress, Robot};
use courier_on_two_buses::{BUSES, Folder};
use messages::Message;
use robot::checks;
use robot::config;
use robot::place::RobotLocation;
use robot::topology::virtual_machine_recorded;
use rovers::Rover;
use sim::host::News;
use sim::soak::{Disk, Fault, Kind, Scenario, Stage, draw, episode, shrink};
use std::cell::RefCell;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::rc::Rc;
use std::sync::atomic::AtomicBool;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn place(world: &str) -> RobotLocation {
    RobotLocation {
        config: root().join("conf/advee"),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: Vec::new(),
        sim: true,
        world: Some(world.into()),
    }
}

fn shipped() -> Scenario {
    config::scenario(&root().join("scenarios/default.toml")).expect("the shipped scenario")
}

/// One short turn of the shipped scenario.
fn short() -> Scenario {
    Scenario { chaos: Duration::from_secs(20), calm: Duration::from_secs(30), turns: 1, ..shipped() }
}

fn robot(scenario: Scenario, world: &str, seed: u64) -> Robot {
    Robot::new(place(world), scenario, seed).expect("the shipped configuration")
}

/// The shipped robots with another base than the reference one.
const BASES: [&str; 5] = ["courier", "rover", "tug", "porter", "tripod"];

#[test]
fn the_shipped_scenario_holds_for_robots_with_other_bases() {
    // The tug with a driven rear axle: no boards of the reference robot, whose base it has.
    let driven_behind = ("tug", vec!["geometry.driven=\"rear\"".to_owned()]);
    for (name, sets) in BASES.map(|name| (name, Vec::new())).into_iter().chain([driven_behind]) {
        let place = RobotLocation { config: root().join("conf").join(name), sets, ..place("hall") };
        let report = Robot::new(place, shipped(), 1).expect(name).many(2, 2, &Progress::none()).unwrap();
        assert_eq!(report.violations, [], "advee soak --config conf/{name}");
        assert!(report.figures.distance > 30.0, "{name}: {} m", report.figures.distance);
        // Of each wheel, and nothing of what it does not have.
        assert!(report.faults.contains_key("drive_silent"), "{name}: {:?}", report.faults);
        assert!(!report.faults.contains_key("sonar_blind"), "{name}: {:?}", report.faults);
    }
}

/// `SOAK_HOURS` and `SOAK_SEED` as above.
#[test]
fn the_shipped_scenario_holds_for_wheels_on_two_can_buses() {
    let folder = Folder::new("soak");
    let scenario = shipped();
    let (hours, seed) = (number("SOAK_HOURS").unwrap_or(0.3), number("SOAK_SEED").unwrap_or(1.0) as u64);
    let episodes = (hours * 3600.0 / scenario.episode().as_secs_f64()).ceil() as u64;
    let world = Some(root().join("conf/worlds/hall.toml"));
    let place = RobotLocation { config: folder.path.clone(), world, ..place("hall") };
    let robot = Robot::new(place.clone(), scenario, seed).expect("the shipped scenario");
    let report = robot.many(episodes, 2, &Progress::none()).unwrap();
    assert_eq!(report.violations, [], "seed {seed}");
    assert!(report.figures.distance > 30.0, "{} m", report.figures.distance);
    // A fault of the bus comes to either of them.
    let cuts = only(vec![kind("cut", "can.main", "cut", 600.0)]);
    let faults = Robot::new(place, cuts, seed).expect("a scenario").faults(0);
    for bus in BUSES {
        assert!(faults.iter().any(|fault| fault.target == bus), "{bus} is never cut");
    }
}

/// The rover on each motor controller that is no ODrive.
const CONTROLLERS: [Rover; 3] = [Rover::VescsOnCan, Rover::VescsOnUarts, Rover::RoboClaw];

/// `SOAK_HOURS` and `SOAK_SEED` as above.
#[test]
fn the_shipped_scenario_holds_for_motor_controllers_on_can_and_serial_lines() {
    let scenario = shipped();
    let (hours, seed) = (number("SOAK_HOURS").unwrap_or(0.3), number("SOAK_SEED").unwrap_or(1.0) as u64);
    let episodes = (hours * 3600.0 / scenario.episode().as_secs_f64()).ceil() as u64;
    for rover in CONTROLLERS {
        let folder = rover.folder("soak");
        let world = Some(root().join("conf/worlds/hall.toml"));
        let place = RobotLocation { config: folder.path.clone(), world, ..place("hall") };
        let robot = Robot::new(place, scenario.clone(), seed).expect("the shipped scenario");
        let report = robot.many(episodes, 2, &Progress::none()).unwrap();
        assert_eq!(report.violations, [], "{rover:?}: seed {seed}");
        let hours = report.time.as_secs_f64() / 3600.0;
        assert!(report.figures.distance > 50.0 * hours, "{rover:?}: {} m: it stands", report.figures.distance);
        // Of its own lines, and nothing that nobody can do to it.
        let has = |begin: &str| report.faults.keys().any(|kind| kind.starts_with(begin));
        let on_can = rover == Rover::VescsOnCan;
        for (begin, is_due) in [("drive_line_", !on_can), ("can_", on_can), ("drive_silent", true), ("sonar_", false)] {
            assert_eq!(has(begin), is_due, "{rover:?} {begin}: {:?}", report.faults);
        }
        assert!(on_can || !has("foreign_node_stop") && !has("foreign_set_point"), "{rover:?}: {:?}", report.faults);
    }
}

fn number(name: &str) -> Option<f64> {
    std::env::var(name).ok()?.parse().ok()
}

#[test]
fn the_same_seed_is_the_same_soak_on_one_job_or_two_and_another_seed_another() {
    let run = |seed, jobs| {
        let report = robot(short(), "hall", seed).many(4, jobs, &Progress::none()).unwrap();
        assert_eq!(report.violations, []);
        (report.digest(), report.faults, report.figures)
    };
    let one = run(3, 1);
    assert!(one == run(3, 1) && one == run(3, 2));
    assert_ne!(one.0, run(4, 2).0);
}

#[test]
fn the_shipped_scenario_holds() {
    let scenario = shipped();
    let hours = number("SOAK_HOURS").unwrap_or(1.0);
    let seed = number("SOAK_SEED").unwrap_or(1.0) as u64;
    let episodes = (hours * 3600.0 / scenario.episode().as_secs_f64()).ceil() as u64;
    let jobs = std::thread::available_parallelism().map_or(1, usize::from);
    let report = robot(scenario, "hall", seed).many(episodes, jobs, &Progress::none()).unwrap();
    assert_eq!(report.violations, [], "advee soak --seed {seed} --episode NUMBER");
    let hours = report.time.as_secs_f64() / 3600.0;
    assert!(
        report.figures.distance > 300.0 * hours,
        "{} m: a robot that stands proves nothing",
        report.figures.distance
    );
    assert!(report.faults.len() > 30 && report.faults.values().sum::<u64>() > 200, "{:?}", report.faults);
    let worst = report.figures.worst;
    // Where the guard has stopped it already, silence stops nothing.
    assert!(worst.silence_to_stop.is_none_or(|time| time < Duration::from_millis(260)), "{worst:?}");
    let bounds = [
        (worst.rules.pause_to_stop, 20),
        (worst.rules.loss_to_stop, 302),
        (worst.rules.calm_to_wanted, 10_000),
        (worst.calm_to_motion, 20_000),
    ];
    for (time, ms) in bounds {
        assert!(time.is_some_and(|time| time <= Duration::from_millis(ms)), "{ms} ms: {worst:?}");
    }
}

/// `SOAK_HOURS` and `SOAK_SEED` as above.
#[test]
fn the_shipped_scenario_holds_for_drives_by_their_data_sheets() {
    let scenario = shipped();
    let (hours, seed) = (number("SOAK_HOURS").unwrap_or(0.3), number("SOAK_SEED").unwrap_or(1.0) as u64);
    let episodes = (hours / 2.0 * 3600.0 / scenario.episode().as_secs_f64()).ceil() as u64;
    for (name, drives) in [("soak-stated", sheets::STATED), ("soak-given", sheets::GIVEN)] {
        let hall = Some(root().join("conf/worlds/hall.toml"));
        let place = RobotLocation { config: sheets::configuration(name, drives), world: hall, ..place("hall") };
        let robot = Robot::new(place, scenario.clone(), seed).expect("the shipped scenario");
        let report = robot.many(episodes, 2, &Progress::none()).unwrap();
        assert_eq!(report.violations, [], "{name}: seed {seed}");
        assert!(report.figures.distance > 300.0 * report.time.as_secs_f64() / 3600.0, "{name}: it stands");
    }
}

#[test]
fn a_source_that_falls_silent_is_a_stop_without_a_guard_too() {
    let sets = ["guard.ranging=none", "guard.speed_blind_mps=2.0"].map(String::from).into();
    let place = RobotLocation { sets, ..place("hall") };
    // A few episodes; in which of them a source falls silent while the robot drives depends on where it drives.
    let silence = |seed: u64| {
        let robot = Robot::new(place.clone(), shipped(), seed).expect("the shipped configuration");
        let report = robot.many(4, 2, &Progress::none()).unwrap();
        assert_eq!(report.violations, [], "seed {seed}");
        report.figures.worst.silence_to_stop
    };
    let time = (2..12).find_map(silence).expect("in one of ten seeds");
    assert!(time < Duration::from_millis(260), "{time:?}");
}

#[test]
fn earlier_failures_do_not_recur() {
    for regression in config::regressions(&root().join("scenarios/regressions.toml")).expect("a good file") {
        // As at the time of the failure.
        let sets = if regression.people { Vec::new() } else { vec!["world.people=0".into()] };
        let config = root().join("conf").join(&regression.config);
        let place = RobotLocation { config, sets, ..place(&regression.world) };
        let robot = Robot::new(place, shipped(), regression.seed).expect("a shipped configuration");
        let outcome = robot.episode(regression.episode, &regression.faults).unwrap();
        assert_eq!(outcome.violation, None, "{}", regression.cause);
    }
}

/// Scenario with only these kinds of faults.
fn only(kinds: Vec<Kind>) -> Scenario {
    Scenario { kinds, ..short() }
}

fn kind(name: &str, target: &str, fault: &str, per_hour: f64) -> Kind {
    let (targets, value, lasts) = (vec![target.into()], (0.0, 0.0), (0.0, 0.0));
    Kind { name: name.into(), targets, fault: fault.into(), per_hour, value, lasts }
}

#[test]
fn a_fault_that_outlives_the_chaos_is_found_and_the_list_reduced_to_it() {
    // Unlimited, as 0 means; with many harmless faults besides.
    let scenario = only(vec![kind("harmless", "clock", "step", 2000.0), kind("mute", "psc1", "silent", 400.0)]);
    let robot = robot(scenario.clone(), "empty", 1);
    let number = (0..20).find(|number| draw(&scenario, 1, *number).iter().any(|fault| fault.kind == "mute")).unwrap();
    let faults = draw(&scenario, 1, number);
    assert!(faults.len() > 5, "{faults:?}");
    let breaks = |faults: &[Fault]| robot.episode(number, faults).unwrap().violation.map(|violation| violation.rule);
    assert_eq!(breaks(&faults), Some("wanted"));
    let minimal = shrink(&faults, 100, |some| breaks(some) == Some("wanted"));
    assert_eq!(minimal.iter().map(|fault| fault.kind.as_str()).collect::<Vec<_>>(), ["mute"]);
}

#[test]
fn an_unknown_fault_is_reported_and_ends_the_soak() {
    let report = robot(only(vec![kind("odd", "sd1_frnt", "silent", 3000.0)]), "empty", 1);
    let report = report.many(3, 2, &Progress::none()).unwrap();
    let [(0, violation)] = &report.violations[..] else { panic!("{:?}", report.violations) };
    assert_eq!(violation.rule, "scenario");
    assert!(violation.what.contains("fault silent of sd1_frnt"), "{violation}");
}

/// Effect of these faults in an episode: digest of all messages except the commands that inject them, and the number of
/// reports of lost inputs.
fn effect(world: &str, scenario: &Scenario, faults: &[Fault]) -> (u64, u32) {
    effect_on(&place(world), scenario, faults)
}

/// The same of another robot.
fn effect_on(place: &RobotLocation, scenario: &Scenario, faults: &[Fault]) -> (u64, u32) {
    let (limits, world) = (
        checks::limits(place, scenario.restart_delay_max).unwrap(),
        config::world(&place.config, place.world.as_deref(), &place.sets).unwrap(),
    );
    let disk = Disk::default();
    let stage = Stage { scenario, world: &world, limits: &limits, seed: 1, disk: &disk, stop: &AtomicBool::new(false) };
    let seen = Rc::new(RefCell::new((DefaultHasher::new(), 0)));
    let keep = seen.clone();
    let outcome = episode(&stage, 0, faults, &mut |config| {
        let disk = disk.clone();
        let sink = move |_: &str| {
            let disk = disk.clone();
            Some(Box::new(move |_: &[u8]| !disk.is_full()) as record::Sink)
        };
        let mut machine = virtual_machine_recorded(place, config, sink).map_err(|error| error.to_string())?;
        let seen = keep.clone();
        machine.observe(move |now, news| {
            let (hasher, lost) = &mut *seen.borrow_mut();
            match news {
                News::Message { message: Message::SimCmdFault(_), .. } => {}
                News::Message { message, .. } => {
                    let mut bytes = Vec::new();
                    message.encode(&mut bytes).expect("it was sent");
                    (now.as_nanos(), bytes).hash(hasher);
                }
                News::Can { frame, .. } => (now.as_nanos(), frame.data()).hash(hasher),
                News::Report { report, .. } if report.fault == base::Fault::InputsLost => *lost += 1,
                _ => {}
            }
        });
        machine.keep(watchdog::NAME)?;
        Ok(machine)
    });
    assert_eq!(outcome.unwrap().violation, None, "{faults:?}");
    let (hasher, lost) = &*seen.borrow();
    (hasher.finish(), *lost)
}

#[test]
fn every_kind_of_fault_of_the_shipped_scenario_has_an_effect() {
    let scenario = Scenario { settle: Duration::from_secs(13), ..short() };
    let at = scenario.settle + Duration::from_secs(2);
    // A step of the clock shows in processes started after it.
    let kill = Fault {
        at: at + Duration::from_secs(1),
        kind: "kill".into(),
        target: "driver_rs485b".into(),
        fault: "kill".into(),
        value: 0.0,
        lasts: 0.0,
    };
    let shipped = place("hall");
    // A courier has a lidar; here another one has an inertial unit, too.
    let courier = RobotLocation { config: root().join("conf/courier"), ..shipped.clone() };
    let mut oriented = courier.clone();
    oriented.sets.extend(["imu.base.model=witmotion", "imu.base.port=imu-base"].map(String::from));
    // Its drives are on serial lines.
    let folder = Rover::VescsOnUarts.folder("effects");
    let world = Some(root().join("conf/worlds/hall.toml"));
    let on_lines = RobotLocation { config: folder.path.clone(), world, ..shipped.clone() };
    let places = [&shipped, &courier, &oriented, &on_lines];
    let without = places.map(|place| effect_on(place, &scenario, std::slice::from_ref(&kill)).0);
    for kind in &scenario.kinds {
        let of = ["lidar", "imu", "drive_line", "drive_garbled"];
        let robot = of.iter().position(|name| kind.name.starts_with(name)).map_or(0, |place| (place + 1).min(3));
        let (place, without) = (places[robot], without[robot]);
        let target = match (robot, kind.targets[0].as_str()) {
            (3, "serial") => "serial.left".into(),
            (3, _) => "left".into(),
            (_, target) => target.to_owned(),
        };
        let fault = kind.fault.clone();
        let fault =
            Fault { at, kind: kind.name.clone(), target, fault, value: kind.value.1, lasts: kind.lasts.1.min(15.0) };
        assert_ne!(effect_on(place, &scenario, &[fault, kill.clone()]).0, without, "{}", kind.name);
    }
}

#[test]
fn a_full_disk_is_reported_once_by_each_process_and_stops_none() {
    let scenario = short();
    let full = |at_s, lasts| Fault {
        at: Duration::from_secs(at_s),
        kind: "disk_full".into(),
        target: "disk".into(),
        fault: "full".into(),
        value: 0.0,
        lasts,
    };
    let config = config::Config::load(&root().join("conf/advee"), true, &[]).unwrap();
    // In virtual time nothing is logged or viewed; the watchdog is not in its list of modules.
    let virtually = config.modules.iter().filter(|module| !["logger", "web"].contains(&module.name()));
    let modules = virtually.count() as u32 + 1;
    assert_eq!(effect("empty", &scenario, &[]).1, 0);
    // A rule requires the robot to move in calm.
    assert_eq!(effect("empty", &scenario, &[full(22, 5.0), full(30, 5.0)]).1, modules);
}

fn advee(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_advee"))
        .args(["soak", "--config"])
        .arg(root().join("conf/advee"))
        .args(arguments)
        .output()
        .expect("it starts");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn the_command_reports_for_people_and_machines_and_repeats_one_episode() {
    let folder = std::env::temp_dir().join(format!("advee-soak-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("scenario.toml");
    let write = |text: &str| std::fs::write(&file, text).unwrap();
    let path = file.display().to_string();
    write(
        "settle_s = 12\nchaos_s = 5\ncalm_s = 15\nturns = 1\n[faults.kill]\ntargets = [\"driver_rs485b\"]\nfault = \
         \"kill\"\nper_hour = 1500\n",
    );
    let (code, json, complaints) = advee(&["--hours", "0.02", "--world", "empty", "--scenario", &path, "--json"]);
    assert_eq!((code, complaints.as_str()), (Some(0), ""));
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    for key in ["hours", "digest", "violations", "faults", "distance", "goals", "contacts", "speed_factor"] {
        assert!(!report[key].is_null(), "{key}: {report}");
    }
    assert_eq!((report["episodes"].as_u64(), report["violations"].as_array().map(Vec::len)), (Some(3), Some(0)));
    for key in ["distance_by", "contacts_by", "goals_sent", "goals_given_up"] {
        assert!(!report[key].is_null(), "{key}: {report}");
    }
    let by = &report["distance_by"];
    let sum: f64 = ["operator", "planner", "others"].iter().map(|who| by[who].as_f64().unwrap()).sum();
    assert!((sum - report["distance"].as_f64().unwrap()).abs() < 1e-6, "{report}");
    let episode = ["--seed", "1", "--episode", "0", "--world", "empty", "--scenario", &path];
    let (code, text, _) = advee(&episode);
    assert!(code == Some(0) && text.contains("violations      0") && text.contains("  kill "), "{text}");

    // A trace changes nothing.
    let digest = |text: &str| text.lines().find(|line| line.starts_with("digest")).map(str::to_owned);
    let (code, traced, _) = advee(&[&episode[..], &["--trace", "14,14.1"]].concat());
    let at = |line: &&str| line.trim_start().split(' ').next().and_then(|at| at.parse().ok());
    let times: Vec<f64> =
        traced.lines().take_while(|line| line.starts_with("   1")).filter_map(|line| at(&line)).collect();
    assert!(times.len() > 50 && times.iter().all(|at| (14.0..=14.1).contains(at)), "{traced}");
    assert!(traced.contains(" sent ") && traced.contains(" served ") && traced.contains("LlDataMotion"), "{traced}");
    assert_eq!((code, digest(&traced)), (Some(0), digest(&text)));

    write(
        "settle_s = 12\nchaos_s = 5\ncalm_s = 25\nturns = 1\n[faults.mute]\ntargets = [\"psc1\"]\nfault = \
         \"silent\"\nper_hour = 3000\n[faults.harmless]\ntargets = [\"clock\"]\nfault = \"step\"\nper_hour = 3600\n",
    );
    let (code, text, told) = advee(&["--hours", "0.01", "--world", "empty", "--scenario", &path]);
    assert_eq!(code, Some(1), "{text}");
    // What was found is printed at once, then each reduction.
    let lines: Vec<&str> = told.lines().collect();
    let reduced = |line: &&str| line.starts_with("episode 0: ") && line.contains(" faults are enough (");
    assert!(lines[0].starts_with("episode 0: at ") && lines.len() > 1 && lines[1..].iter().all(reduced), "{told}");
    let repeat = text.lines().find_map(|line| line.strip_prefix("repeat: advee soak ")).expect("a command");
    let arguments: Vec<&str> = repeat.split(' ').collect();
    let at = arguments.iter().position(|word| *word == "--config").expect("the configuration is part of it");
    let (code, again, _) = advee(&[&arguments[..at], &arguments[at + 2..]].concat());
    assert!(code == Some(1) && again.contains("rule wanted"), "{again}");
    assert!(repeat.contains(" --episode 0 --faults "), "{repeat}");
    let once_more = again.lines().find_map(|line| line.strip_prefix("repeat: advee soak "));
    assert_eq!(once_more, Some(repeat), "the command repeats itself: {again}");

    // Interrupted as soon as it runs: nothing was judged.
    let mut child = Command::new(env!("CARGO_BIN_EXE_advee"))
        .args(["soak", "--config"])
        .arg(root().join("conf/advee"))
        .arg("--scenario")
        .arg(root().join("scenarios/default.toml"))
        .args(["--episode", "0", "--trace", "0,1e6"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut first = String::new();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    stdout.read_line(&mut first).unwrap();
    let pid = nix::unistd::Pid::from_raw(child.id() as i32);
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGINT).unwrap();
    let mut text = String::new();
    stdout.read_to_string(&mut text).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(128 + 2));
    assert!(text.contains("robot-hours     0.00 in 0 episodes"), "{text}");
    let why = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(why, "advee: interrupted: 0 of 1 episodes were judged\n");

    write("turns = 0\n[faults.x]\nfault = \"hang\"\n");
    let (code, _, complaints) = advee(&["--scenario", &path]);
    assert_eq!(code, Some(i32::from(module::exit::RESOURCE)));
    assert!(complaints.contains(":1: turns = 0: expected an integer from 1 to 10000"), "{complaints}");
    assert!(complaints.contains(":2: faults.x.targets: missing"), "{complaints}");
    std::fs::remove_dir_all(&folder).unwrap();
}
