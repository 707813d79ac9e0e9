//! What an operator sees and ends from the shell on the running simulated robot: faults, goals, modules.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{self, Robot, View, advee};
use std::io::{BufRead, BufReader};
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

/// Time limit for what the robot does by itself.
const SOON: Duration = Duration::from_secs(30);

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[track_caller]
fn good(robot: &Robot, arguments: &[&str]) -> String {
    let output = robot.advee(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    said(&output)
}

#[track_caller]
fn refused(robot: &Robot, arguments: &[&str]) -> String {
    let output = robot.advee(arguments);
    let why = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && why.lines().count() == 1, "{arguments:?}: {why}");
    why
}

/// A robot whose modules run; homed or not.
fn running() -> Robot {
    let mut robot = Robot::start(&[]);
    robot.until("all modules RUN", 30.0, View::all_run);
    robot
}

/// Repeats a command until its output is as wanted.
#[track_caller]
fn until(robot: &Robot, arguments: &[&str], wanted: impl Fn(&str) -> bool) -> String {
    let begun = Instant::now();
    loop {
        let text = good(robot, arguments);
        if wanted(&text) {
            return text;
        }
        assert!(begun.elapsed() < SOON, "{arguments:?}: {text}");
    }
}

#[test]
fn a_fault_is_listed_refused_injected_followed_and_ended_from_the_shell() {
    let mut robot = running();
    let list = good(&robot, &["fault"]);
    assert!(list.lines().any(|line| line.starts_with("fan1 ") && line.contains("stall")), "{list}");
    assert!(list.contains("put:X,Y,THETA") && list.contains("advee fault none"), "{list}");
    let one = good(&robot, &["fault", "psc1"]);
    assert!(one.contains("psc1 bumper") && one.contains("the bumper switch VALUE, 1 to 8, is pressed"), "{one}");
    let why = refused(&robot, &["fault", "fan2", "stall"]);
    assert!(why.contains("there is no target fan2; there are robot, gamepad, "), "{why}");
    let why = refused(&robot, &["fault", "fan1", "melt"]);
    assert!(why.contains("fan1 has no fault melt; it has "), "{why}");
    // From anywhere: the robot that runs in the folder is known with its own configuration.
    let elsewhere = |arguments: &[&str]| {
        let output = advee(&robot.url, &robot.run_dir).current_dir("/").args(arguments).output().unwrap();
        said(&output) + &String::from_utf8_lossy(&output.stderr)
    };
    assert_eq!(elsewhere(&["fault"]), list);
    assert!(elsewhere(&["fault", "fan2", "stall"]).contains("there is no target fan2; there are robot, gamepad, "));
    // What is refused here is not sent, and so is no report of the simulator.
    let errors = good(&robot, &["errors", "simulator"]);
    assert_eq!(errors, "no fault is active\n");

    let mut follow = advee(&robot.url, &robot.run_dir)
        .args(["errors", "driver_aux", "--follow"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(follow.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert_eq!(lines.next().as_deref(), Some("no fault is active"));
    let done = good(&robot, &["fault", "fan1", "stall"]);
    assert_eq!(done, "fan1 stall until: advee fault fan1 none\n");
    let began = lines.next().unwrap();
    assert!(began.contains("ACTIVE") && began.contains("driver_aux") && began.contains("FanFailed"), "{began}");
    // A command that starts later lists it, too.
    let late = good(&robot, &["errors"]);
    assert!(late.lines().any(|line| line.starts_with("ACTIVE ") && line.contains("FanFailed")), "{late}");
    let json = good(&robot, &["errors", "--json"]);
    let fault: serde_json::Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert_eq!((&fault["module"], &fault["standing"]), (&"driver_aux".into(), &true.into()));
    let view = good(&robot, &["diag", "--json", "--view", "overview"]);
    let view: serde_json::Value = serde_json::from_str(&view).unwrap();
    assert!(view["concerns"][0]["words"].as_str().is_some_and(|words| words.contains("fan_left failed")), "{view}");

    assert_eq!(good(&robot, &["fault", "none"]), "all faults are ended\n");
    assert!(lines.next().unwrap().contains("CLEARED"));
    support::signal(follow.id() as i32, "INT");
    assert!(follow.wait().unwrap().success());
    until(&robot, &["errors", "driver_aux"], |text| text == "no fault is active\n");
    assert!(refused(&robot, &["errors", "nobody"]).contains("nobody is not heard"));
    let begin = std::time::Instant::now();
    let none = refused(&robot, &["io"]);
    assert!(none.contains("robot.toml names no inputs or outputs"), "{none}");
    assert!(begin.elapsed().as_secs() < 30, "waits for a driver that does not run: {:?}", begin.elapsed());
    assert_eq!(robot.stop(), 0);
}

#[test]
fn the_goal_is_shown_and_a_measurement_is_no_module_of_the_robot() {
    let mut robot = running();
    let words = ["idle", "driving", "reached", "blocked", "failed", "cancelled"];
    let goal = good(&robot, &["goal"]);
    assert!(words.iter().any(|word| goal.starts_with(word)), "{goal}");
    assert!(good(&robot, &["goal", "--json"]).starts_with('{'));
    let why = refused(&robot, &["goal", "--wait"]);
    assert!(why.contains("--wait needs a target"), "{why}");

    assert!(good(&robot, &["mode"]).starts_with("route, "));
    assert!(good(&robot, &["mode", "wait"]).starts_with("wait, waiting: waits for people"));
    assert!(good(&robot, &["mode", "--json"]).contains("\"mode\":2"));
    assert!(refused(&robot, &["mode", "home"]).contains("no home place is configured"));
    assert!(good(&robot, &["mode", "route"]).starts_with("route, "));
    let parameters = good(&robot, &["parameters"]);
    assert!(parameters.lines().count() == 9 && parameters.contains("(0.1 to 0.5, configured 0.5)"), "{parameters}");
    assert_eq!(good(&robot, &["parameters", "speed_mps", "0.3"]), "speed_mps is 0.3 until the planner restarts\n");
    let slower = good(&robot, &["parameters", "speed_mps", "--json"]);
    assert!(slower.contains("\"value\":0.3,\"minimum\":0.1,\"maximum\":0.5,\"configured\":0.5"), "{slower}");
    for (name, value, why) in [("speed_mps", "0.6", "not within 0.1 to 0.5"), ("speed", "0.3", "no parameter")] {
        let refused = refused(&robot, &["parameters", name, value]);
        assert!(refused.contains(why), "{refused}");
    }

    let mut measures = robot.spawn(&["bench", "jitter"]);
    // Modules announce themselves once a second, which is how long the table listens.
    for _ in 0..2 {
        let table = good(&robot, &["state"]);
        assert!(!table.contains("jitter") && table.contains("planner"), "{table}");
    }
    support::signal(measures.id() as i32, "INT");
    assert!(measures.wait().unwrap().success());
    assert_eq!(robot.stop(), 0);
}

#[test]
fn tools_of_an_empty_run_folder_say_where_a_simulated_robot_runs() {
    let mut robot = running();
    let elsewhere = robot.run_dir.join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    for arguments in [&["can", "scan"][..], &["rs485", "monitor"], &["web", "code"]] {
        let output = advee(&robot.url, &elsewhere).args(arguments).stdin(Stdio::null()).output().unwrap();
        let why = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{arguments:?}");
        assert!(why.contains("; a simulated robot runs with --run-dir "), "{arguments:?}: {why}");
    }
    assert_eq!(robot.stop(), 0);
}

#[test]
fn a_robot_that_a_driver_refuses_is_not_started() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("one-drive-{}", std::process::id()));
    let conf = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf");
    for part in ["advee", "worlds"] {
        std::fs::create_dir_all(folder.join(part)).unwrap();
        for entry in std::fs::read_dir(conf.join(part)).unwrap().flatten() {
            std::fs::copy(entry.path(), folder.join(part).join(entry.file_name())).unwrap();
        }
    }
    let robot = folder.join("advee/robot.toml");
    let text = std::fs::read_to_string(&robot).unwrap();
    let (before, after) = text.split_once("[[can.main.nodes]]\nid = 2").unwrap();
    let after = after.split_once("\n[").unwrap().1;
    std::fs::write(&robot, format!("{before}[{after}")).unwrap();
    let config = folder.join("advee").display().to_string();
    for arguments in [&["doctor", "--sim"][..], &["config", "check"], &["up", "--sim", "--headless"]] {
        let mut command = advee("memq://", &folder.join("run"));
        let output = command.args(arguments).args(["--config", &config]).stdin(Stdio::null()).output().unwrap();
        let text = said(&output) + &String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{arguments:?}: {text}");
        assert!(text.contains("robot.toml has no [can.<bus>] with both axes"), "{arguments:?}: {text}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
