//! `advee gym` as a program uses it: a request per line, an answer per line, in virtual time.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use super::support::workspace;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

struct Gym {
    process: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Gym {
    fn new(arguments: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_advee"))
            .arg("gym")
            .arg("--config")
            .arg(workspace().join("conf/advee"))
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (input, output) = (process.stdin.take(), BufReader::new(process.stdout.take().unwrap()));
        Self { process, input, output }
    }

    /// Answer to a line, as text.
    fn line(&mut self, line: &str) -> String {
        let mut input = self.input.as_ref().unwrap();
        input.write_all(format!("{line}\n").as_bytes()).unwrap();
        let mut answer = String::new();
        self.output.read_line(&mut answer).unwrap();
        answer
    }

    fn ask(&mut self, request: &Value) -> Value {
        serde_json::from_str(&self.line(&request.to_string())).unwrap()
    }

    fn error(&mut self, line: &str) -> String {
        let answer: Value = serde_json::from_str(&self.line(line)).unwrap();
        answer["error"].as_str().unwrap_or_else(|| panic!("{line}: {answer}")).into()
    }

    /// Exit code after the end of the input.
    fn end(mut self) -> Option<i32> {
        drop(self.input.take());
        self.process.wait().unwrap().code()
    }
}

/// In the hall without columns and people.
fn reset(seed: u64) -> Value {
    json!({ "reset": { "seed": seed, "world": "empty", "start": [10.0, 6.0, 0.0], "goal": [14.0, 7.0] } })
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

#[test]
fn equal_seeds_and_steps_give_equal_answers() {
    let run = |seed| {
        let mut gym = Gym::new(&[]);
        let mut lines = vec![gym.line(&reset(seed).to_string())];
        for n in 0..20 {
            let steering = f64::from(n % 5) * 0.1 - 0.2;
            let step = json!({ "step": { "v": 0.5, "steering": steering, "seconds": 0.25 } });
            lines.push(gym.line(&step.to_string()));
        }
        assert_eq!(gym.end(), Some(0));
        lines
    };
    let lines = run(7);
    assert_eq!(run(7), lines);
    assert_ne!(run(8), lines);
    let last: Value = serde_json::from_str(&lines[20]).unwrap();
    assert!(number(&last["info"]["speed"]) > 0.2, "{last}");
    let (observed, info) = (&last["observation"], &last["info"]);
    assert_eq!((number(&observed["time"]), &info["commanded"], &info["end"]), (5.0, &json!(true), &Value::Null));
    assert!(number(&observed["guard"]["forward"]) > 0.2, "{observed}");
    assert_eq!(observed["sonars"].as_array().map(Vec::len), Some(16));
    let off = (number(&observed["estimate"]["x"]) - number(&info["truth"][0])).abs();
    assert!(off < 0.5 && number(&observed["estimate"]["sd_x"]) > 0.0, "{observed} {info}");
}

#[test]
fn bad_lines_are_answered_and_the_next_one_is_served() {
    let mut gym = Gym::new(&[]);
    assert!(gym.error(r#"{"step": {"v": 0.1}}"#).contains("reset first"));
    assert!(gym.error("drive!").contains("expected"));
    assert!(gym.error(&"x".repeat(70_000)).contains("longer than 65536 bytes"));
    assert!(gym.error(r#"{"reset": {"world": "nowhere"}}"#).contains("nowhere"));
    assert!(gym.error(r#"{"reset": {"start": [0, 0, 0]}}"#).contains("touches"));
    let robot = gym.ask(&json!({ "robot": {} }))["robot"].clone();
    assert_eq!((&robot["protocol"], &robot["name"], &robot["steers"]), (&json!(1), &json!("advee"), &json!(true)));
    let modules = robot["modules"].as_array().unwrap();
    assert!(modules.contains(&json!("guard")) && !modules.contains(&json!("planner")), "{robot}");
    let state = gym.ask(&reset(1));
    assert_eq!((&state["terminated"], number(&state["reward"]["time"])), (&json!(false), 0.0), "{state}");
    // A failed reset leaves no episode.
    gym.error(r#"{"reset": {"world": "nowhere"}}"#);
    assert!(gym.error(r#"{"step": {"v": 0.1}}"#).contains("reset first"));
    assert_eq!(gym.end(), Some(0));
}

#[test]
fn the_rules_of_the_robot_hold_for_what_is_commanded() {
    let mut gym = Gym::new(&["--without", "driver_joydev", "--without", "driver_aux"]);
    gym.ask(&json!({ "reset": { "world": "empty", "start": [12.0, 6.0, 0.0], "goal": [30.0, 6.0] } }));
    let step = json!({ "step": { "v": 0.8, "omega": 0.0, "seconds": 10.0 } });
    let mut state = Value::Null;
    for _ in 0..4 {
        state = gym.ask(&step);
    }
    let info = &state["info"];
    assert_eq!((number(&info["contacts"]), &info["end"]), (0.0, &Value::Null), "{state}");
    assert!(number(&info["truth"][0]) > 17.0 && number(&info["clearance"]) > 0.0, "it drove to the wall: {state}");
    assert!(number(&info["speed"]).abs() < 0.05 && number(&state["observation"]["guard"]["forward"]) < 0.05, "{state}");
    // Beyond the limits of the robot: it is stopped, and not followed.
    gym.ask(&reset(1));
    let state = gym.ask(&json!({ "step": { "v": 5.0, "seconds": 3.0 } }));
    assert!(number(&state["info"]["speed"]).abs() < 1e-3 && state["info"]["commanded"] == json!(false), "{state}");
    assert_eq!(gym.end(), Some(0));
}

#[test]
fn an_episode_ends_at_the_goal_or_with_its_time() {
    let mut gym = Gym::new(&[]);
    let mut state = gym.ask(&reset(3));
    let (mut progress, begin) = (0.0, number(&state["info"]["distance"]));
    while state["terminated"] == json!(false) && state["truncated"] == json!(false) {
        let steering = number(&state["observation"]["goal"]["bearing"]).clamp(-0.6, 0.6);
        state = gym.ask(&json!({ "step": { "v": 0.6, "steering": steering, "seconds": 0.5 } }));
        progress += number(&state["reward"]["progress"]);
    }
    assert_eq!((&state["info"]["end"], &state["terminated"]), (&json!("reached"), &json!(true)), "{state}");
    assert!((begin - progress - number(&state["info"]["distance"])).abs() < 1e-9, "{state}");
    assert!(gym.error(r#"{"step": {"v": 0.1}}"#).contains("is over"));
    gym.ask(&json!({ "reset": { "world": "empty", "goal": [14, 7], "seconds": 2 } }));
    let state = gym.ask(&json!({ "step": { "v": 0, "seconds": 5 } }));
    assert_eq!((&state["info"]["end"], &state["truncated"]), (&json!("time"), &json!(true)), "{state}");
    assert_eq!(number(&state["reward"]["time"]), 2.0);
    assert_eq!(gym.end(), Some(0));
}

#[test]
fn a_module_that_the_robot_needs_cannot_be_left_out() {
    for (name, why) in [("guard", "does not move without it"), ("estimator", "needs it"), ("cook", "no such module")] {
        let output = Command::new(env!("CARGO_BIN_EXE_advee"))
            .args(["gym", "--without", name, "--config"])
            .arg(workspace().join("conf/advee"))
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && error.contains(why), "{name}: {error}");
    }
}
