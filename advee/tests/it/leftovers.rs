//! No process of a robot is left over, whichever process is killed; and two robots never share a run folder.

use crate::support::{self, Robot};
use std::time::{Duration, Instant};

/// Waits until the robot has no process left: modules end after 3 s without a watchdog.
#[track_caller]
fn all_gone(robot: &Robot) {
    let begin = Instant::now();
    while !robot.processes().is_empty() {
        assert!(begin.elapsed() < Duration::from_secs(5), "left over: {:?}", robot.processes());
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn nothing_outlives_a_parent_that_is_killed_and_the_next_one_clears_up() {
    let mut robot = Robot::start(&[]);
    robot.until("the boards' driver runs", 10.0, |view| view.runs("driver_rs485a"));
    let old = robot.view.pid("driver_rs485a");
    let refused = robot.advee(&["up", "--sim", "--headless"]);
    let why = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        refused.status.code() == Some(1)
            && why.contains(&format!("is held by another advee up, process {}: end that robot first", up(&robot)))
            && why.lines().count() == 1,
        "{why}"
    );

    support::signal(up(&robot), "KILL");
    all_gone(&robot);
    assert!(robot.run_dir.join("lock").exists(), "killed, it could not clear up");

    let mut next = support::advee(&robot.url, &robot.run_dir);
    let next = next.args(["up", "--sim", "--headless"]).stderr(std::process::Stdio::piped()).spawn().unwrap();
    robot.until("the next one runs", 10.0, |view| view.runs("driver_rs485a") && view.pid("driver_rs485a") != old);
    support::signal(next.id() as i32, "TERM");
    let ended = next.wait_with_output().unwrap();
    assert!(ended.status.success(), "{}: {}", ended.status, String::from_utf8_lossy(&ended.stderr));
    assert!(robot.processes().is_empty() && !robot.run_dir.exists());
}

#[test]
fn a_watchdog_that_is_killed_is_replaced_and_its_modules_live_on() {
    let mut robot = Robot::ready(&[]);
    let pids = |robot: &Robot| robot.view.processes.values().map(|process| process.pid).collect::<Vec<_>>();
    let (old, modules) = (watchdog(&robot), pids(&robot));
    support::signal(old, "KILL");
    robot.pass(0.2);
    robot.until("the new one has heard of all", 3.0, support::View::all_run);
    assert_ne!(watchdog(&robot), old);
    assert_eq!(pids(&robot), modules);
    assert_eq!(robot.stop(), 0);
    assert!(robot.processes().is_empty() && !robot.run_dir.exists());
}

fn up(robot: &Robot) -> i32 {
    find(robot, "\0up\0")
}

fn watchdog(robot: &Robot) -> i32 {
    find(robot, "\0run\0watchdog\0")
}

fn find(robot: &Robot, words: &str) -> i32 {
    let is_it = |pid: &u32| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&line).contains(words)
    };
    robot.processes().into_iter().find(is_it).expect("it runs") as i32
}
