//! `advee lidar …` as used from the shell: with an emulated device on a pseudo-terminal, and with the running simulated
//! courier.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::command::Outcome;
use crate::support::{self, Robot, workspace};
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::Stdio;

/// Where the lidar of the test really sits.
const PLACE: [(&str, f64); 3] = [("x_m", 0.12), ("y_m", -0.05), ("theta_rad", 0.08)];

/// An empty hall with the robot near a corner.
fn corner() -> PathBuf {
    let empty = std::fs::read_to_string(workspace().join("conf/worlds/empty.toml")).unwrap();
    let world = empty.replace("start = [10.0, 6.0, 0.0]", "start = [16.5, 3.0, 0.1]");
    let file = std::env::temp_dir().join(format!("advee-lidar-corner-{}.toml", std::process::id()));
    std::fs::write(&file, world).unwrap();
    file
}

fn courier(world: &str) -> Robot {
    let places = PLACE.map(|(key, value)| format!("lidar.top.{key}={value}"));
    let sets: Vec<&str> = places.iter().flat_map(|set| ["--set", set.as_str()]).collect();
    let mut robot = Robot::start(&[&["--config", "conf/courier", "--world", world][..], &sets].concat());
    robot.until("all modules RUN", 20.0, support::View::all_run);
    robot
}

fn run(robot: &Robot, args: &[&str]) -> Outcome {
    Outcome::of(robot.advee(&[args, &["--config", "conf/courier"]].concat()))
}

#[test]
fn a_held_port_is_left_alone_and_the_place_of_a_lidar_is_measured() {
    let world = corner();
    support::undisturbed(|| {
        let robot = courier(&world.display().to_string());
        // The port belongs to the driver: what the bus says is shown.
        let told = run(&robot, &["lidar", "info"]).good();
        let mut lines = told.lines();
        assert!(lines.next().unwrap().contains("the port is held by driver_lidar, process "), "{told}");
        assert!(lines.next().unwrap().trim_end().ends_with("status     OK"), "{told}");
        assert!(told.contains("10.0 turns/s, 4") && told.trim_end().ends_with("faults     none"), "{told}");
        let value = run(&robot, &["lidar", "info", "top", "--json"]).values().remove(0);
        assert_eq!((&value["held"]["by"], &value["well"]), (&"driver_lidar".into(), &true.into()), "{value}");
        let port = robot.run_dir.join("lidar-top").display().to_string();
        let told = run(&robot, &["lidar", "scan", &port]).good();
        assert!(told.contains("held by driver_lidar, process ") && told.ends_with(", as lidar.top\n"), "{told}");

        // The robot is driven by other commands while the place is measured.
        let mut align = support::advee(&robot.url, &robot.run_dir);
        align.args(["lidar", "align", "top", "--for", "90"]).stdin(Stdio::null()).stdout(Stdio::piped());
        let mut align = align.spawn().expect("the executable is built");
        let mut out = BufReader::new(align.stdout.take().unwrap());
        let mut line = String::new();
        while !line.starts_with("Now drive") {
            line.clear();
            assert!(out.read_line(&mut line).unwrap() > 0, "it has ended");
        }
        for way in [["0.2", "0", "5"], ["0", "0.5", "3"], ["0.2", "0", "5"], ["0.15", "-0.3", "4"]] {
            let [speed, rotation, seconds] = way;
            let drove = run(&robot, &["drive", speed, "--rotation", rotation, "--for", seconds]);
            assert_eq!(drove.code, Some(0), "{way:?}: {drove:?}");
        }
        let mut text = String::new();
        out.read_to_string(&mut text).unwrap();
        assert!(align.wait().unwrap().success(), "{text}");
        let toml: Vec<&str> = text.lines().skip_while(|line| *line != "[lidar.top]").skip(1).collect();
        for ((key, truth), line) in PLACE.into_iter().zip(toml) {
            let measured: f64 = line.strip_prefix(&format!("{key} = ")).unwrap().parse().unwrap();
            assert!((measured - truth).abs() < 0.01, "{key}: {text}");
        }
    });
    std::fs::remove_file(world).unwrap();
}
