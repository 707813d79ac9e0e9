//! `advee up --sim --speed N`: the simulated robot in virtual time, with programs on its bus.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{self, Robot, View, python, python_types, workspace};
use messages::simulation::{CmdRun, DataClock, DataRun};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit for what depends on the speed of this machine.
const SOON: f64 = 90.0;
/// Of a timestamp, µs.
const SECOND: i64 = 1_000_000;

#[track_caller]
fn good(robot: &Robot, arguments: &[&str]) -> String {
    let output = robot.advee(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[track_caller]
fn refused(robot: &Robot, arguments: &[&str]) -> String {
    let output = robot.advee(arguments);
    let why = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && why.lines().count() == 1, "{arguments:?}: {why}");
    why
}

fn time(view: &View) -> DataRun {
    view.time.clone().unwrap_or_default()
}

fn rate(view: &View) -> f64 {
    view.clock.as_ref().map_or(f64::NAN, |clock| clock.rate)
}

/// True position of the robot, m.
fn position(view: &View) -> [f64; 2] {
    view.truth.as_ref().map_or([f64::NAN; 2], |truth| [truth.x, truth.y])
}

fn is_ready(view: &View) -> bool {
    view.all_run() && view.is_homed()
}

/// Starts a robot in virtual time and waits until it may be driven.
fn ready(extra: &[&str]) -> Robot {
    let mut robot = Robot::start(extra);
    robot.until("all modules RUN and the steering homed", SOON, is_ready);
    robot
}

#[test]
fn virtual_time_is_fast_stands_still_steps_and_begins_anew() {
    let mut robot = ready(&["--speed", "20"]);
    assert_eq!((time(&robot.view).speed, time(&robot.view).paused), (20.0, false));
    // What is announced as the factor is what a program measures.
    robot.pass(1.5);
    let (begun, first) = (Instant::now(), robot.view.clock.clone().unwrap());
    robot.pass(3.0);
    let DataClock { timestamp, rate: announced } = robot.view.clock.clone().unwrap();
    let measured = (timestamp - first.timestamp) as f64 / 1e6 / begun.elapsed().as_secs_f64();
    assert!(announced > 1.5 && announced < 22.0, "{announced}");
    assert!((0.5..2.0).contains(&(announced / measured)), "announced {announced}, measured {measured}");

    let [x, y] = position(&robot.view);
    let goal = format!("{},{}", x + 2.0, y);
    good(&robot, &["goal", &goal, "--when-ready", "--wait"]);
    robot.until("it is there", SOON, |view| (position(view)[0] - x - 2.0).abs() < 0.5);

    // Motion commands by the wall clock are refused, once in words.
    robot.until("a motion command is refused", SOON, {
        let mut bus = support::listen(&robot.url);
        let command =
            messages::lowlevel::CmdMotion { speed: 0.3, priority: 1, source: "test".into(), ..Default::default() };
        let mut bytes = Vec::new();
        messages::Message::from(command).encode(&mut bytes).unwrap();
        move |view| {
            bus.publish("LL_CMD_MOTION", &bytes).unwrap();
            time(view).refused > 5 && view.texts.iter().any(|text| text.text.starts_with("test is not in step"))
        }
    });
    assert_eq!(time(&robot.view).not_in_step, ["test"]);
    assert_eq!(robot.view.texts.iter().filter(|text| text.text.contains("not in step")).count(), 1);
    assert!(refused(&robot, &["drive", "0.3", "0", "--for", "1"]).contains("advee sim speed 1"));

    assert!(good(&robot, &["sim", "pause"]).starts_with("paused, else at 20 times real time"));
    robot.until("time stands still", SOON, |view| time(view).paused && rate(view) == 0.0);
    robot.pass(0.3);
    let before = (time(&robot.view).timestamp, robot.view.truth.clone());
    robot.pass(1.5);
    assert_eq!((time(&robot.view).timestamp, robot.view.truth.clone()), before);
    good(&robot, &["sim", "step", "0.5"]);
    robot.until("a step has passed", SOON, |view| time(view).paused && time(view).timestamp > before.0);
    let stepped = time(&robot.view).timestamp - before.0;
    assert!((stepped - SECOND / 2).abs() <= 1, "{stepped} µs");
    good(&robot, &["sim", "step"]);
    robot.until("a tick has passed", SOON, |view| time(view).paused && time(view).timestamp > before.0 + stepped);
    let ticked = time(&robot.view).timestamp - before.0 - stepped;
    assert!((ticked - SECOND / 20).abs() <= 1, "{ticked} µs");

    // A new start, in another world and in the same one.
    let why = refused(&robot, &["sim", "world", "nowhere"]);
    assert!(why.contains("nowhere"), "{why}");
    assert!(refused(&robot, &["sim", "world", "../hall"]).contains("a name in conf/worlds"));
    assert_eq!(time(&robot.view).world, "hall");
    good(&robot, &["sim", "run"]);
    good(&robot, &["sim", "world", "empty"]);
    let last = time(&robot.view).timestamp;
    let start = [10.0, 6.0];
    robot.until("it begins in the other world", SOON, |view| time(view).world == "empty" && position(view) == start);
    robot.until("it runs there", SOON, is_ready);
    assert!(time(&robot.view).timestamp > last, "timestamps never go back");
    good(&robot, &["goal", "12,6", "--when-ready", "--wait"]);
    robot.until("it has moved", SOON, |view| position(view)[0] > 11.0);
    good(&robot, &["sim", "reset"]);
    robot.until("it is at its start", SOON, |view| position(view) == start);

    // A scenario that was drawn on the page comes as the text of a world.
    let mut page = support::listen(&robot.url);
    let mut scenario = |world: &str, timestamp: i64| {
        let world = world.into();
        let command =
            CmdRun { timestamp, action: CmdRun::SCENARIO, world, source: "test".into(), ..Default::default() };
        let mut bytes = Vec::new();
        messages::Message::from(command).encode(&mut bytes).unwrap();
        page.publish("SIM_CMD_RUN", &bytes).unwrap();
    };
    let files = |robot: &Robot| {
        let names = std::fs::read_dir(&robot.run_dir).unwrap().map(|entry| entry.unwrap().file_name());
        names.filter(|name| name.to_string_lossy().starts_with("scenario-")).count()
    };
    scenario("start = [3.0, 4.0, 0.0]\nmoon = 1\n", 1);
    robot.until("a wrong scenario is refused", SOON, |view| time(view).command == 1);
    let why = time(&robot.view).refusal;
    assert!(why.starts_with("scenario:2: moon: unknown key"), "{why}");
    assert_eq!((time(&robot.view).world.as_str(), files(&robot)), ("empty", 0));
    scenario("start = [3.0, 4.0, 0.0]\nmap = \"/etc/hostname\"\n", 3);
    robot.until("a scenario that names a file is refused", SOON, |view| time(view).command == 3);
    let why = time(&robot.view).refusal;
    assert!(why.starts_with("scenario: map: a world that is sent as text names no file"), "{why}");
    scenario(include_str!("../../../modules/web/page/src/map/scenario.fixture.toml"), 2);
    let drawn = [2.5, 6.0];
    robot.until("it begins in the scenario", SOON, |view| time(view).command == 2 && position(view) == drawn);
    robot.until("it runs in the scenario", SOON, is_ready);
    assert_eq!((time(&robot.view).refusal.as_str(), files(&robot)), ("", 1));
    good(&robot, &["sim", "world", "hall"]);
    robot.until("it is in the hall", SOON, |view| time(view).world == "hall");
    assert_eq!(files(&robot), 0);

    assert_eq!(robot.stop(), 0);
    assert_eq!(robot.processes(), Vec::<u32>::new());
    assert!(!robot.run_dir.exists(), "{:?}", robot.run_dir);
    let runs = std::fs::read_dir(support::logs(&robot.run_dir)).unwrap().count();
    assert!(runs >= 3, "{runs} runs are logged: one for each start");
}

#[test]
fn at_the_speed_of_a_robot_motion_commands_pass() {
    let unguarded = ["--set", "guard.ranging=none", "--set", "guard.speed_blind_mps=2.0"];
    let mut robot = ready(&[&["--speed", "1"][..], &unguarded].concat());
    let begun = Instant::now();
    while robot.view.speed().is_nan() || robot.view.speed() < 0.1 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{}", robot.view.reason());
        robot.command(0.3, 0.0);
        robot.pass(0.05);
    }
    assert_eq!((time(&robot.view).refused, time(&robot.view).not_in_step), (0, vec![]));
    assert_eq!(robot.stop(), 0);
}

#[test]
fn a_simulation_in_real_time_refuses_to_stand_still() {
    let mut robot = Robot::start(&[]);
    robot.until("the clock is published", 30.0, |view| view.clock.is_some());
    assert_eq!(rate(&robot.view), 1.0);
    assert!(refused(&robot, &["sim", "pause"]).contains("advee up --sim --speed"));
}

/// A program that takes part in virtual time, and its lines.
struct Pilot {
    child: Child,
    lines: BufReader<std::process::ChildStdout>,
}

impl Pilot {
    fn start(robot: &Robot) -> Option<Self> {
        let python = python()?;
        let types = robot.run_dir.with_extension("types");
        python_types(&python, &types);
        let script = workspace().join("advee/tests/it/speed/pilot.py");
        let mut command = Command::new(python);
        let url = format!("udpm://239.255.76.67:{}?ttl=0", robot.port);
        command.arg(script).arg(url).env("PYTHONPATH", &types).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        Some(Self { child, lines })
    }

    fn line(&mut self) -> Value {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{line:?}: {error}"))
    }
}

impl Drop for Pilot {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_program_in_python_that_answers_the_clock_is_waited_for_and_moves_the_robot() {
    support::undisturbed(is_waited_for);
}

fn is_waited_for() {
    let mut robot = ready(&["--speed", "20", "--world", "empty"]);
    let [x, _] = position(&robot.view);
    let Some(mut pilot) = Pilot::start(&robot) else { return };
    robot.until("it is in step", SOON, |view| time(view).in_step == ["pilot"]);
    // It takes 20 ms for each tick of 50 ms, and misses none.
    let said = pilot.line();
    assert_eq!((&said["ticks"], &said["missed"]), (&Value::from(100), &Value::from(0)), "{said}");
    robot.until("the robot was moved by it", SOON, |view| position(view)[0] > x + 0.3);
    assert_eq!((time(&robot.view).refused, time(&robot.view).not_in_step), (0, vec![]));
    robot.until("time passes as fast as it", SOON, |view| rate(view) < 2.6);
    // One that is halted stays in step while time stands still, and answers once both go on.
    support::signal(pilot.child.id() as i32, "STOP");
    robot.until("time stands still", SOON, {
        let mut bus = support::listen(&robot.url);
        let mut bytes = Vec::new();
        let pause = CmdRun { timestamp: 1, action: CmdRun::PAUSE, source: "test".into(), ..CmdRun::default() };
        messages::Message::from(pause).encode(&mut bytes).unwrap();
        move |view| {
            bus.publish("SIM_CMD_RUN", &bytes).unwrap();
            time(view).paused
        }
    });
    robot.pass(2.5);
    assert_eq!((time(&robot.view).in_step, time(&robot.view).not_in_step), (vec!["pilot".to_string()], vec![]));
    support::signal(pilot.child.id() as i32, "CONT");
    good(&robot, &["sim", "run"]);
    // One that hangs holds up nobody.
    support::signal(pilot.child.id() as i32, "STOP");
    robot.until("it is given up", SOON, |view| time(view).not_in_step == ["pilot"] && time(view).in_step.is_empty());
    let stamp = time(&robot.view).timestamp;
    robot.until("time passes on", SOON, |view| time(view).timestamp > stamp + 5 * SECOND);
    support::signal(pilot.child.id() as i32, "CONT");
    robot.until("it answers again", SOON, |view| time(view).in_step == ["pilot"]);
    let _ = std::fs::remove_dir_all(robot.run_dir.with_extension("types"));
}
