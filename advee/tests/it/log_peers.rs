//! Output of the logger of a whole robot, opened by independent readers: PyPI's `mcap`, `mcap-ros2-support`, `rosbags`.

use crate::support::{Robot, logs, python, workspace};
use messages::common::CmdLog;
use serde_json::Value;
use std::process::Command;

#[test]
fn a_run_of_the_robot_is_read_by_the_official_readers_and_by_rosbags() {
    let Some(python) = python() else { return };
    let mut robot = Robot::ready(&[]);
    robot.drive(0.3, 0.1, 2.0);
    robot.publish(CmdLog { timestamp: 0, action: CmdLog::MARK, text: "here".into() });
    robot.pass(1.0);
    let ticks = robot.view.odo.as_ref().map(|odo| odo.ticks_left).expect("it drove");
    assert_eq!(robot.stop(), 0);
    let mut files: Vec<_> = std::fs::read_dir(logs(&robot.run_dir))
        .expect("the log folder")
        .flat_map(|run| std::fs::read_dir(run.expect("a run").path()).expect("its files"))
        .map(|file| file.expect("a file").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "mcap"))
        .collect();
    files.sort();
    let read = Command::new(python).arg(workspace().join("advee/tests/it/peers/read_log.py")).args(&files).output();
    let read = read.expect("Python runs");
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let read: Value = serde_json::from_slice(&read.stdout).expect("JSON");
    let names =
        |list: &Value| list.as_array().into_iter().flatten().filter_map(Value::as_str).map(String::from).collect();
    let attachments: Vec<String> = names(&read["files"][0]["attachments"]);
    for name in ["robot.toml", "modules.toml", "version.txt"] {
        assert!(attachments.iter().any(|there| there == name), "{attachments:?}");
    }
    let metadata: Vec<String> = names(&read["files"][0]["metadata"]);
    assert!(metadata.iter().any(|name| name == "mark") && metadata.iter().any(|name| name == "advee"), "{metadata:?}");
    // Each ROS topic has the same number of messages in all three, and each channel its ROS form.
    let counts = read["mcap"].as_object().expect("topics");
    for (topic, count) in counts.iter().filter(|(topic, _)| topic.starts_with('/')) {
        assert_eq!((&read["ros2"][topic], &read["rosbags"][topic]), (count, count), "{topic}");
    }
    for channel in ["LL_DATA_ODO", "LL_DATA_SRFS", "CM_DATA_PROCESSES", "ML_DATA_ESTIMATE", "CM_DATA_STATE"] {
        let count = counts.get(channel).and_then(Value::as_u64).expect(channel);
        assert!(count > 5 && counts[&format!("/{channel}")] == count, "{channel}: {count}");
    }
    for topic in ["/diagnostics", "/odometry", "/pose", "/battery", "/tf", "/scene", "/marks", "/range/0"] {
        assert!(counts.contains_key(topic), "{topic} is not among {:?}", counts.keys());
    }
    let last = read["last"]["/LL_DATA_ODO"]["ticks_left"].as_i64().expect("a number");
    assert!((last - i64::from(ticks)).abs() < 200, "{last} ticks in the log, {ticks} heard");
}
