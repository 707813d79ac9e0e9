//! `advee i2c …` as its user runs it: on the running simulated robot, beside its driver, and against what is no bus.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{self, Robot, advee};
use messages::common;
use serde_json::Value;
use std::process::Output;

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[track_caller]
fn good(robot: &Robot, arguments: &[&str]) -> String {
    let output = robot.advee(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    text(&output)
}

#[track_caller]
fn refused(robot: &Robot, arguments: &[&str]) -> String {
    let output = robot.advee(arguments);
    let why = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && why.lines().count() == 1, "{arguments:?}: {why}");
    why
}

fn json(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn the_simulated_robot_s_fan_controller_is_found_read_and_written_while_its_driver_runs() {
    let mut robot = Robot::start(&[]);
    let runs = |view: &support::View| {
        view.processes.get("driver_aux").is_some_and(|process| process.state == common::DataState::RUN)
    };
    robot.until("driver_aux RUN", 10.0, runs);

    let found = json(&good(&robot, &["i2c", "scan", "--json"]));
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(
        (&found[0]["address"], &found[0]["chip"], &found[0]["name"]),
        (&24.into(), &"max6615".into(), &"fan1".into())
    );
    assert!(good(&robot, &["i2c", "scan"]).ends_with("1 chip on i2c.aux; 112 addresses asked\n"));

    let dump = good(&robot, &["i2c", "dump", "fan1"]);
    assert!(dump.starts_with("fan1 (0x18) on i2c.aux: MAX6615\n"), "{dump}");
    for line in ["03  3c* over-temperature limit 1   60 °C", "07  30* fan-start duty 1           20 %"] {
        assert!(dump.lines().any(|found| found == line), "{line}: {dump}");
    }
    let registers = json(&good(&robot, &["i2c", "dump", "0x18", "--bus", "aux", "--json"]));
    assert_eq!(registers.len(), 34);

    let limit = json(&good(&robot, &["i2c", "get", "fan1", "over-temperature_limit_2", "--json"]));
    assert_eq!((&limit[0]["value"], &limit[0]["meaning"]), (&75.into(), &"75 °C".into()));
    // What its driver does not watch stays as it was written; the rest is put right.
    let wrote = good(&robot, &["i2c", "set", "fan1", "over_temperature_mask", "0x80"]);
    assert_eq!(wrote, "fan1 (0x18) 06 over-temperature mask: 0x80  channel 1\n");
    assert_eq!(good(&robot, &["i2c", "get", "0x18", "0x06"]), wrote);
    robot.until("driver_aux RUN as before", 3.0, runs);

    let why = refused(&robot, &["i2c", "set", "fan1", "temperature_1", "7"]);
    assert!(why.contains("register 00, temperature 1, cannot be written"), "{why}");
    let why = refused(&robot, &["i2c", "set", "fan1", "0x06", "256"]);
    assert!(why.contains("a register has a byte"), "{why}");
    let why = refused(&robot, &["i2c", "get", "0x19", "0x00"]);
    assert!(why.contains("nobody answers at this address"), "{why}");
    let why = refused(&robot, &["i2c", "get", "fan9", "0x00"]);
    assert!(why.contains("no chip \"fan9\": expected an address from 0x00 to 0x7f, or one of fan1 (0x18)"), "{why}");
    let why = refused(&robot, &["i2c", "get", "fan1", "speed"]);
    assert!(why.contains("no register \"speed\""), "{why}");
    let why = refused(&robot, &["i2c", "scan", "--bus", "main"]);
    assert!(why.contains("robot.toml has no bus [i2c.main]; it has aux"), "{why}");

    // A chip that is gone is told by the tools and by the driver, and comes back.
    good(&robot, &["fault", "fan1", "hold", "--for", "3"]);
    robot.until("driver_aux ERROR", 5.0, |view| {
        view.processes.get("driver_aux").is_some_and(|process| process.state == common::DataState::ERROR)
    });
    let why = refused(&robot, &["i2c", "scan"]);
    assert!(why.contains("a line of the bus is held low"), "{why}");
    robot.until("driver_aux RUN again", 8.0, runs);
}

#[test]
fn what_is_no_bus_is_refused_by_name() {
    for (port, why) in [
        ("/dev/full", "/dev/full is not an I2C adapter"),
        ("/dev/no-such-adapter", "/dev/no-such-adapter: "),
        ("gpio:/dev/full:1:2", "lines 1 and 2: "),
        ("unix:/no/such/socket", "/no/such/socket: "),
        ("i2c-1", "expected /dev/i2c-1, gpio:/dev/gpiochip0:SDA:SCL or unix:PATH"),
    ] {
        let mut command = advee("memq://", &std::env::temp_dir());
        let output = command.args(["i2c", "scan", "--port", port]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains(why) && said.lines().count() == 1, "{port}: {said}");
    }
}
