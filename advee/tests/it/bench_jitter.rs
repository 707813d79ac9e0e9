//! `advee bench jitter` as used from the shell: the loop alone, and heartbeats and bus of the running simulated robot.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{self, Robot, advee};
use serde_json::Value;
use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

/// Bus without participants, and so without a port that another test may use.
const ALONE: &str = "memq://";

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn complaint(output: &Output) -> String {
    assert!(!output.status.success(), "{output:?}");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(text.lines().count(), 1, "one line: {text}");
    text
}

#[test]
fn the_loop_is_measured_for_the_given_time() {
    let run =
        |args: &[&str]| advee(ALONE, Path::new("run")).args(["bench", "jitter", "--json"]).args(args).output().unwrap();
    let report = json(&run(&["--interval", "2000", "--for", "0.5", "--histogram"]));
    let row = &report["rows"][0];
    let number = |key: &str| row[key].as_u64().unwrap();
    // From the first to the last instant, inclusive; a late end misses some more.
    assert!(number("count") + number("missed") >= 251 && number("count") <= 251, "{report}");
    assert_eq!(number("period_us"), 2000);
    assert!(number("min_us") <= number("p99_us") && number("p99_us") <= number("p999_us"), "{report}");
    assert!(number("p999_us") <= number("max_us"), "{report}");
    let seen: u64 = row["histogram"].as_array().unwrap().iter().map(|pair| pair[1].as_u64().unwrap()).sum();
    assert!(seen <= number("count"), "{report}");
    assert!(complaint(&run(&["--interval", "5"])).contains("--interval"));
    assert!(complaint(&run(&["--can", "can0", "--beats"])).contains("--beats"));
    assert!(complaint(&run(&["--can", "no-such-interface0", "--for", "0.1"])).contains("no-such-interface0"));
}

/// In real time the loop waits with another system call.
#[test]
fn real_time_is_enabled_or_refused_in_one_line() {
    let run = |args: &[&str]| advee(ALONE, Path::new("run")).args(["bench", "jitter"]).args(args).output().unwrap();
    let output = run(&["--priority", "1", "--interval", "5000", "--for", "0.5", "--json"]);
    if !output.status.success() {
        let why = complaint(&output);
        assert!(why.contains("SCHED_FIFO 1 is refused") && why.contains("ulimit -r"), "{why}");
        testing::machine_or_skip::<()>(Err(format!("real-time rights: {why}")));
        return;
    }
    let report = json(&output);
    let row = &report["rows"][0];
    assert!(report["how"].as_str().unwrap().contains("SCHED_FIFO 1"), "{report}");
    let (count, missed) = (row["count"].as_u64().unwrap(), row["missed"].as_u64().unwrap());
    assert!(count + missed >= 101 && count <= 101, "{report}");
    assert!(complaint(&run(&["--priority", "100"])).contains("--priority"));
}

#[test]
fn bench_without_arguments_lists_its_commands() {
    let output = advee(ALONE, Path::new("run")).arg("bench").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("advee bench jitter "), "{output:?}");
}

#[test]
fn ctrl_c_ends_a_measurement_with_its_report() {
    let mut command = advee(ALONE, Path::new("run"));
    command.args(["bench", "jitter", "--interval", "10000"]).stdout(std::process::Stdio::piped());
    let child = command.spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(700));
    support::signal(child.id() as i32, "INT");
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("the live host's loop, normal scheduler") && text.contains("late by"), "{text}");
}

/// This row of the first measurement of two seconds, with at least half of the beats in them, that is `right`. A busy
/// machine disturbs a measurement: the next is taken, for a minute.
fn row_within(robot: &Robot, what: &[&str], name: &str, right: impl Fn(&Value) -> bool) -> Value {
    let until = Instant::now() + Duration::from_secs(60);
    loop {
        let report = json(&robot.advee(&[&["bench", "jitter", "--for", "2", "--json"], what].concat()));
        let rows = report["rows"].as_array().unwrap();
        let row = rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("no {name}: {report}"));
        if row["count"].as_u64().unwrap() >= 20 && right(row) {
            return row.clone();
        }
        assert!(Instant::now() < until, "{report}");
    }
}

#[test]
fn a_running_robot_is_measured_on_its_bus_and_in_its_heartbeat_pages() {
    let robot = Robot::ready(&[]);
    let can = format!("udp:239.74.163.2:{}", robot::topology::can_port_beside(robot.port));
    let master = row_within(&robot, &["--can", &can], "0x77f heartbeat 127", |row| {
        (45_000..55_000).contains(&row["period_us"].as_u64().unwrap())
    });
    assert!(master["longest_gap_us"].as_u64() >= master["period_us"].as_u64(), "{master}");
    let driver = row_within(&robot, &["--beats"], "driver_canbus main", |row| {
        (35_000.0..70_000.0).contains(&row["mean_us"].as_f64().unwrap())
    });
    assert_eq!(driver["period_us"].as_u64().unwrap(), 50_000);

    let elsewhere = robot.run_dir.join("nobody");
    let nobody = advee(&robot.url, &elsewhere).args(["bench", "jitter", "--beats", "--for", "1"]).output().unwrap();
    assert!(complaint(&nobody).contains("no module beats"));
    let nothing = robot.advee(&["bench", "jitter", "--can", &can, "--id", "0x123", "--for", "0.5"]);
    assert!(complaint(&nothing).contains("came twice"));
}
