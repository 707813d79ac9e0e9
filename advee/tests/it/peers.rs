//! Independent programs on the robot's buses: the official LCM, python-can, CANopen for Python.

use crate::support::{self, Robot, python, workspace};
use std::process::Command;

#[test]
fn a_program_on_the_official_lcm_drives_a_square() {
    let Some(python) = python() else { return };
    let robot = Robot::ready(&[]);
    let build = robot.run_dir.with_extension("types");
    support::python_types(&python, &build);

    let square = Command::new(&python)
        .arg(workspace().join("examples/square.py"))
        .env("LCM_DEFAULT_URL", &robot.url)
        .env("PYTHONPATH", &build)
        .output()
        .unwrap();
    let _ = std::fs::remove_dir_all(&build);
    let (out, err) = (String::from_utf8_lossy(&square.stdout), String::from_utf8_lossy(&square.stderr));
    assert!(square.status.success(), "{out}{err}");
    let result: serde_json::Value = serde_json::from_str(out.trim()).unwrap();
    let corners: Vec<[f64; 2]> = serde_json::from_value(result["corners"].clone()).unwrap();
    let side = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    // One side of 1 m and the two halves of rounded corners of radius 0.6 / tan 0.5 = 1.1 m.
    for pair in corners.windows(2) {
        assert!((1.5..5.0).contains(&side(pair[0], pair[1])), "{corners:?}");
    }
    assert_eq!(result["collisions"], 0);
}

#[test]
fn a_python_can_listener_sees_the_canopen_traffic() {
    let Some(python) = python() else { return };
    let mut robot = Robot::ready(&[]);
    let port = can_port(&robot);
    let listener = Command::new(&python)
        .arg(workspace().join("examples/listen.py"))
        .args([&port, "2"])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    robot.drive(0.3, 0.1, 2.0);
    let output = listener.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}");
    // RPDO4 to the EPOS, RPDO2 to the IclA, both drives' heartbeats and the master's.
    for identifier in ["501", "302", "181", "481", "701", "702", "77F"] {
        assert!(text.lines().any(|line| line.starts_with(identifier)), "{identifier} is missing:\n{text}");
    }
}

#[test]
fn canopen_for_python_reads_both_drives_by_sdo() {
    let Some(python) = python() else { return };
    let robot = Robot::ready(&[]);
    let script = workspace().join("advee/tests/it/peers/sdo.py");
    let output = Command::new(&python).arg(script).arg(can_port(&robot)).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    let read: serde_json::Value = serde_json::from_str(out.trim()).unwrap();
    assert_eq!(
        read["epos"],
        serde_json::json!({"type": 0x0002_0192, "vendor": 0xFB, "name": "EPOS", "absent": 0x0602_0000})
    );
    assert_eq!(read["icla"]["type"], 0x0002_0192);
}

fn can_port(robot: &Robot) -> String {
    robot::topology::can_port_beside(robot.port).to_string()
}
