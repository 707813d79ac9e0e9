//! Configurations of earlier releases: read as they were then, renamed by `advee config migrate`, and driven with.

use crate::command::Outcome;
use crate::support::{self, Robot};
use base::{Duration, Instant};
use messages::{Hold, Message, lowlevel};
use module::State;
use robot::config::{Config, FILES};
use robot::place::RobotLocation;
use robot::topology::virtual_machine;
use sim::check::Checkers;
use sim::host::{self, News};
use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// The configuration of the reference robot of release 0.1, byte for byte.
fn of_0_1() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/configurations/0.1")
}

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee")
}

/// Each moved key of that configuration with its new name.
const MOVED: [(&str, &str); 3] = [("joystick", "gamepad"), ("rate", "rate_hz"), ("beat_timeout", "beat_timeout_s")];

/// Today's configuration, with the defaults of the keys that 0.1 did not have, and the values that 0.1 set differently.
/// It has no guard.
fn shipped_as_in_0_1(sim: bool) -> Config {
    let sets = [
        "can.main.homing_release=operator",
        "stop.pause=coast",
        "gamepad.quiet_s=0.5",
        "guard.ranging=none",
        "planner.margin_m=0.2",
        "planner.stop_distance_m=0.25",
        "planner.reaction_s=0.37",
        "planner.coasting_mps2=0.25",
        "rs485.a.transport=two-byte",
        "rs485.b.transport=two-byte",
        "rs485.power.transport=two-byte",
    ]
    .map(String::from);
    let mut config = Config::load(&shipped(), sim, &sets).expect("the shipped configuration");
    config.robot.planner.behaviour.speed = None;
    let boards = config.robot.rs485.iter_mut().flat_map(|bus| &mut bus.driver.nodes);
    boards.filter(|board| board.name.starts_with("sd1_")).for_each(|board| board.rate_hz = 4.0);
    config
}

/// A copy of the configuration of 0.1.
fn copy(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    for file in FILES {
        fs::copy(of_0_1().join(file), folder.join(file)).expect("a file of 0.1");
    }
    let world = Path::new("worlds/hall.toml");
    fs::create_dir_all(folder.join("worlds")).expect("a folder");
    fs::copy(shipped().join("..").join(world), folder.join(world)).expect("the hall");
    folder
}

fn advee(args: &[&str], folder: &Path) -> Outcome {
    let mut command = support::advee("udpm://239.255.76.67:7667?ttl=0", &folder.join("run"));
    Outcome::of(command.args(args).arg(folder).output().expect("the executable is built"))
}

#[test]
fn a_configuration_of_0_1_is_read_as_the_one_of_today() {
    for sim in [false, true] {
        let (old, notices) = Config::load_with_notices(&of_0_1(), sim, &[]).unwrap();
        let (_, none) = Config::load_with_notices(&shipped(), sim, &[]).unwrap();
        assert_eq!(old, shipped_as_in_0_1(sim));
        assert_eq!(none, [""; 0]);
        assert_eq!(notices.len(), MOVED.len(), "{notices:#?}");
        for (old, new) in MOVED {
            let of_it = |line: &&String| line.contains(&format!(": {old} is the old name of {new}"));
            assert_eq!(notices.iter().filter(of_it).count(), 1, "{old}: {notices:#?}");
        }
    }
    let sets = ["joystick.scale=0.5", "gamepad.expo=1"].map(String::from);
    let error = Config::load(&of_0_1(), true, &sets).unwrap_err().to_string();
    assert!(error.starts_with("--set: gamepad.expo: unknown key, expected one of device, grab, speed, "), "{error}");
    let (config, notices) = Config::load_with_notices(&shipped(), true, &sets[..1]).unwrap();
    assert_eq!(config.robot.gamepad.unwrap().driver.scale, 0.5);
    assert_eq!(notices, ["--set: joystick is the old name of gamepad; advee config migrate renames it"]);
}

#[test]
fn a_configuration_of_0_1_is_migrated_with_its_comments_and_gives_no_notice_any_more() {
    let folder = copy("migrated");
    let check = advee(&["config", "check"], &folder);
    assert_eq!((check.code, check.err.lines().count()), (Some(0), MOVED.len()), "{check:?}");
    assert!(check.err.lines().all(|line| line.starts_with("advee: NOTICE: ")), "{check:?}");

    let before = FILES.map(|file| fs::read_to_string(folder.join(file)).unwrap());
    let shown = advee(&["config", "migrate"], &folder).good();
    for line in
        ["-[joystick]", "+[gamepad]", "-rate = 20                      # Hz", "+rate_hz = 20                   # Hz"]
    {
        assert!(shown.lines().any(|shown| shown == line), "{line}\n{shown}");
    }
    assert!(shown.contains("robot.toml\n@@ -") && shown.contains("modules.toml\n@@ -"), "{shown}");
    assert_eq!(FILES.map(|file| fs::read_to_string(folder.join(file)).unwrap()), before, "nothing is written");

    advee(&["config", "migrate", "--write"], &folder).good();
    assert!(advee(&["config", "check"], &folder).good().ends_with(": good, for the robot and the simulated robot\n"));
    assert!(advee(&["config", "migrate"], &folder).good().ends_with(": no key has moved\n"));
    for (file, before) in FILES.iter().zip(before) {
        let after = fs::read_to_string(folder.join(file)).unwrap();
        let comments = |text: &str| {
            let lines = text.lines().filter_map(|line| line.split_once('#'));
            lines.map(|(_, comment)| comment.to_owned()).collect::<Vec<_>>()
        };
        assert_eq!((comments(&after), after.lines().count()), (comments(&before), before.lines().count()), "{file}");
    }
    for sim in [false, true] {
        assert_eq!(Config::load(&folder, sim, &[]).unwrap(), shipped_as_in_0_1(sim));
    }
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_folder_without_a_world_is_no_simulated_robot_until_one_is_named() {
    let folder = copy("worldless");
    let hall = folder.join("hall.toml");
    fs::rename(folder.join("worlds/hall.toml"), &hall).expect("the hall");
    let refused = advee(&["config", "check"], &folder);
    assert_eq!(refused.code, Some(i32::from(module::exit::RESOURCE)));
    let why = refused.bad();
    assert!(why.contains("worlds/hall.toml: ") && why.contains("a world is a file that --world names"), "{why}");
    // Standard error has the notices of old names.
    let named = advee(&["config", "check", "--world", hall.to_str().unwrap()], &folder);
    let is_good = named.code == Some(0) && named.out.ends_with(": good, for the robot and the simulated robot\n");
    assert!(is_good, "{named:?}");
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_cannot_be_migrated_is_refused_and_left_as_it_is() {
    let folder = copy("refused");
    let robot = fs::read_to_string(folder.join("robot.toml")).unwrap();
    let twice = robot.replacen("[joystick]", "[gamepad]\n[joystick]", 1);
    fs::write(folder.join("robot.toml"), &twice).unwrap();
    let line = 1 + twice.lines().position(|line| line == "[joystick]").unwrap();
    for args in [&["config", "check"][..], &["config", "migrate", "--write"]] {
        let refused = advee(args, &folder);
        assert_eq!(refused.code, Some(i32::from(module::exit::RESOURCE)));
        let why = format!("robot.toml:{line}: joystick: the old name of gamepad, which is also set");
        assert!(refused.bad().ends_with(&why));
    }
    assert_eq!(fs::read_to_string(folder.join("robot.toml")).unwrap(), twice);
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_running_robot_publishes_each_notice_once() {
    let world = shipped().join("../worlds/hall.toml");
    let args = ["--config", "--world"].into_iter().zip([of_0_1(), world].map(|path| path.display().to_string()));
    let args: Vec<String> = args.flat_map(|(option, path)| [option.to_owned(), path]).collect();
    // Nothing in it lets the start of the robot release homing.
    let args = [args, vec!["--set".into(), "can.main.homing_release=start".into()]].concat();
    let robot = Robot::ready(&args.iter().map(String::as_str).collect::<Vec<_>>());
    let notices = robot.view.texts.iter().filter(|text| text.text.starts_with("NOTICE: "));
    let notices: Vec<_> = notices.map(|text| (text.module.as_str(), text.text.as_str())).collect();
    assert_eq!(notices.len(), MOVED.len(), "{notices:#?}");
    assert!(notices.iter().all(|(module, _)| *module == "watchdog"), "{notices:#?}");
}

#[test]
fn soak_and_a_module_by_itself_print_each_notice_once() {
    let folder = copy("noticed");
    let scenario = folder.join("scenario.toml");
    fs::write(&scenario, "settle_s = 12\nchaos_s = 1\ncalm_s = 1\nturns = 1\n").unwrap();
    let advee = |args: &[&str]| {
        let url = format!("udpm://239.255.76.67:{}?ttl=0", support::unique_port());
        let mut command = support::advee(&url, &folder.join("run"));
        command.arg("--config").arg(&folder).args(args);
        command
    };
    let [path, world] = [scenario, shipped().join("../worlds/empty.toml")].map(|path| path.display().to_string());
    let soak = ["soak", "--episode", "0", "--faults", "none", "--world", &world, "--scenario", &path];
    // A soak refuses a bus and a run folder: it has none.
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_advee"));
    command.current_dir(support::workspace()).arg("--config").arg(&folder).args(soak);
    let soak = Outcome::of(command.output().expect("the executable is built"));
    assert_eq!((soak.code, soak.err.lines().count()), (Some(0), MOVED.len()), "{soak:?}");
    assert!(soak.err.lines().all(|line| line.starts_with("advee: NOTICE: ")), "{soak:?}");

    // The watchdog's modules leave the notices to it; a module that is refused ends before it opens anything.
    let refused = |guarded: bool| {
        let mut command = advee(&["run", "nobody", "--sim"]);
        if guarded {
            command.env(::host::processes::VARIABLE, "1");
        }
        let outcome = Outcome::of(command.output().expect("the executable is built"));
        assert_eq!(outcome.code, Some(i32::from(module::exit::RESOURCE)), "{outcome:?}");
        outcome.err.lines().filter(|line| line.starts_with("advee: NOTICE: ")).count()
    };
    assert_eq!((refused(false), refused(true)), (MOVED.len(), 0));
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_module_without_its_bus_ends_with_the_code_for_that() {
    let run_dir = std::env::temp_dir().join(format!("advee-no-bus-{}", std::process::id()));
    let mut command = support::advee("nowhere://", &run_dir);
    command.args(["run", "driver_aux", "--sim"]);
    let outcome = Outcome::of(command.output().expect("the executable is built"));
    assert_eq!(outcome.code, Some(i32::from(module::exit::START)), "{outcome:?}");
    assert!(outcome.err.starts_with("advee: "), "{outcome:?}");
    let _ = fs::remove_dir_all(&run_dir);
}

#[test]
fn a_configuration_of_0_1_drives_as_fast_as_a_robot_that_senses_nothing() {
    let place = RobotLocation {
        config: of_0_1(),
        run_dir: "/run/advee".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: vec!["world.people=0".into()],
        sim: true,
        world: Some(shipped().join("../worlds/hall.toml")),
    };
    let at = |seconds: f64| Instant::ZERO + Duration::from_secs_f64(seconds);
    let mut machine = virtual_machine(&place, host::Config::default()).unwrap();
    let limits = robot::checks::limits(&place, Duration::from_secs(10)).unwrap();
    let checkers = Rc::new(RefCell::new(Checkers::new(limits)));
    let speed = Rc::new(RefCell::new(f64::NAN));
    let (told, notice) = (Rc::new(RefCell::new(0)), Rc::new(RefCell::new(false)));
    let (rules, seen, warned, noticed) = (checkers.clone(), speed.clone(), told.clone(), notice.clone());
    machine.observe(move |now, news| {
        rules.borrow_mut().observe(now, news);
        match news {
            News::Message { message: Message::SimDataTruth(truth), .. } => *seen.borrow_mut() = truth.speed,
            News::Message { message: Message::LlDataHold(list), .. } if list.is_of_motion() => {
                *noticed.borrow_mut() |= list.first() == Some(Hold::GuardBlind);
            }
            News::Note { module: "driver_canbus", line } => {
                *warned.borrow_mut() += u32::from(line.contains("NOTHING SENSES WHAT IS IN THE WAY: AT MOST 0.3 m/s"));
            }
            _ => {}
        }
    });
    machine.spawn("watchdog", State::Run).expect("the watchdog starts");
    // An operator lets the wheels be homed.
    machine.inject(at(2.0), lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() });
    machine.run_until(at(12.0));
    for n in 0..60 {
        let priority = lowlevel::CmdMotion::REMOTE;
        let command = lowlevel::CmdMotion { timestamp: 0, speed: 0.4, steering: 0.1, priority, source: "test".into() };
        machine.inject(at(12.0) + n * Duration::from_millis(50), command);
    }
    machine.run_until(at(15.0));
    assert!((*speed.borrow() - 0.3).abs() < 0.02, "{} m/s", speed.borrow());
    assert_eq!((*told.borrow(), *notice.borrow()), (1, true));
    machine.run_until(at(18.0));
    assert!(speed.borrow().abs() < 0.001, "{} m/s", speed.borrow());
    assert_eq!(checkers.borrow().violation(), None);
}
