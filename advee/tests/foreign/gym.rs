//! The Gymnasium environment of `examples/gym`, by the checker of Gymnasium.

use crate::support::workspace;
use std::process::Command;
use testing::peer_or_skip;

/// Runs a Python program of the tests with the environment of the examples; its output.
fn python(program: &str, arguments: &[&str]) -> Option<String> {
    let python = peer_or_skip(testing::python(&["gymnasium", "numpy"]))?;
    let output = Command::new(python)
        .arg(workspace().join(program))
        .args(arguments)
        .env("PYTHONPATH", workspace().join("examples/gym"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("ADVEE", env!("CARGO_BIN_EXE_advee"))
        .output()
        .expect("it runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    Some(text(&output.stdout))
}

#[test]
fn gymnasium_accepts_the_environment_of_each_kind_of_robot() {
    for config in ["advee", "courier"] {
        let folder = workspace().join("conf").join(config);
        let Some(text) = python("advee/tests/foreign/python/gym_check.py", &[folder.to_str().expect("UTF-8")]) else {
            return;
        };
        assert!(text.lines().any(|line| line == "200 steps"), "{config}: {text}");
    }
}

#[test]
fn the_example_tunes_its_law() {
    let arguments = ["--world", "empty", "--generations", "1", "--population", "3", "--goals", "1", "--tests", "1"];
    let Some(text) = python("examples/gym/tune.py", &arguments) else { return };
    let starts = |word: &str| text.lines().any(|line| line.starts_with(word));
    assert!(starts("generation 1: best ") && starts("before ") && starts("after "), "{text}");
}
