//! ROS 2 output read by independent readers: rosbags and mcap-ros2-support, of PyPI, decode every message by the schema
//! that accompanies it, and must find the values of the LCM message. `make test` installs them; `ADVEE_PYTHON` names
//! another Python that has them.
#![allow(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test fails by panicking, and starts its peer")]

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::dynamic;
use crate::translated::{lcm_json, pairs, read, samples, scene, schema, translate, translator};
use lcm_gen::dynamic::Types;
use lcm_gen::{Schema, build};
use logger::ros::{Topic, Translator};
use messages::{Message, lowlevel};
use serde_json::{Value as Json, json};
use testing::Random;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Python with both readers.
fn python() -> Option<PathBuf> {
    testing::peer_or_skip(testing::python(&["rosbags", "mcap_ros2"]))
}

/// Result of both readers for each message, and the last line.
fn decode(python: &Path, messages: &[(Topic, Vec<u8>)]) -> (Vec<[Json; 2]>, Json) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/decode.py");
    let mut child = Command::new(python).arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut to = child.stdin.take().unwrap();
    let lines: String = messages
        .iter()
        .map(|(topic, cdr)| {
            let hex: String = cdr.iter().map(|byte| format!("{byte:02x}")).collect();
            format!("{}\n", json!({ "name": &*topic.schema_name, "text": &*topic.schema_text, "cdr": hex }))
        })
        .collect();
    // It answers while the input is still being written.
    let asking = std::thread::spawn(move || to.write_all(lines.as_bytes()));
    let output = child.wait_with_output().unwrap();
    let asked = asking.join().unwrap();
    assert!(output.status.success(), "decode.py failed");
    asked.unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let mut answers: Vec<Json> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let last = answers.pop().unwrap();
    let both = |answer: Json| {
        let Json::Array(both) = answer else { panic!("{answer}") };
        <[Json; 2]>::try_from(both).unwrap()
    };
    (answers.into_iter().map(both).collect(), last)
}

/// Compares both results with the LCM message: names, order, values, integers and others.
#[track_caller]
fn same(topic: &str, answers: &[Json; 2], expected: &Json) {
    for (reader, answer) in ["rosbags", "mcap-ros2-support"].iter().zip(answers) {
        assert_eq!(answer, expected, "{topic}, {reader}");
    }
}

#[test]
fn every_message_of_the_robot_is_decoded_by_independent_readers() {
    let Some(python) = python() else { return };
    let (schema, types, mut translator) = (schema(), Types::new(&schema()), translator());
    let (mut all, mut expected) = (Vec::new(), Vec::new());
    // Of random angles there is hardly a revolution.
    let scan = |revolution| lowlevel::DataScan {
        revolution,
        angle_step: 1.5,
        ranges: vec![1.0, f32::NAN, f32::INFINITY, 0.25],
        intensities: vec![0.5; 4],
        ..Default::default()
    };
    let scans = [1, 2].map(|revolution| {
        let mut data = Vec::new();
        Message::from(scan(revolution)).encode(&mut data).unwrap();
        ("LL_DATA_SCAN".to_owned(), data)
    });
    // Of random states few are OK.
    let mut imu = Vec::new();
    let measured = lowlevel::DataImu { name: "base".into(), orientation: [0.0, 0.0, 0.6, 0.8], ..Default::default() };
    Message::from(measured).encode(&mut imu).unwrap();
    let imu = ("LL_DATA_IMU".to_owned(), imu);
    for (channel, data) in samples(4, 10).into_iter().chain(scans).chain([imu]) {
        for (i, (topic, cdr)) in translate(&mut translator, &channel, &data).unwrap().into_iter().enumerate() {
            // The own type equals the LCM message; the standard ones equal the result of this project's reader, which
            // other tests verify.
            expected.push(if i == 0 { lcm_json(&schema, &types, &data) } else { pairs(&read(&topic, &cdr)) });
            all.push((topic, cdr));
        }
    }
    translator.mark(1, "made by hand", &mut |topic, cdr| {
        expected.push(pairs(&read(topic, cdr)));
        all.push((topic.clone(), cdr.to_vec()));
    });
    let (answers, differing) = decode(&python, &all);
    assert_eq!(answers.len(), all.len());
    for (((topic, _), answers), expected) in all.iter().zip(&answers).zip(&expected) {
        same(&topic.name, answers, expected);
    }
    let standard = [
        "diagnostic_msgs/msg/DiagnosticArray",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "nav_msgs/msg/Odometry",
        "nav_msgs/msg/Path",
        "rcl_interfaces/msg/Log",
        "sensor_msgs/msg/BatteryState",
        "sensor_msgs/msg/Imu",
        "sensor_msgs/msg/LaserScan",
        "sensor_msgs/msg/Range",
        "sensor_msgs/msg/Temperature",
        "tf2_msgs/msg/TFMessage",
        "visualization_msgs/msg/MarkerArray",
    ];
    let of = |name: &str| all.iter().filter(|(topic, _)| *topic.schema_name == *name).count();
    standard.iter().for_each(|name| assert!(of(name) > 0, "{name}"));
    assert_eq!(differing["jazzy"], json!([]));
    let changed_since = ["rcl_interfaces/msg/Log", "sensor_msgs/msg/BatteryState", "sensor_msgs/msg/Range"];
    assert_eq!(differing["humble"], json!([&changed_since[..], &["visualization_msgs/msg/Marker"]].concat()));
}

#[test]
fn foreign_types_are_decoded_by_independent_readers() {
    let Some(python) = python() else { return };
    let folder = root().join("foundation/lcm-gen/tests/vectors/types");
    let mut files = Vec::new();
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        files.push((path.display().to_string(), std::fs::read_to_string(&path).unwrap()));
    }
    files.sort();
    let schema: Schema = build::read(&[folder]).unwrap();
    let (types, mut random) = (Types::new(&schema), Random::new(6));
    let mut translator = Translator::with_types(scene(), &files).unwrap();
    let (mut all, mut expected, mut without) = (Vec::new(), Vec::new(), Vec::new());
    for definition in schema.definitions() {
        let name = definition.name();
        for _ in 0..20 {
            let data = dynamic::message(&schema, &name, &mut random);
            match translate(&mut translator, &name, &data) {
                Ok(told) => {
                    assert_eq!(told.len(), 1);
                    all.extend(told);
                    expected.push(lcm_json(&schema, &types, &data));
                }
                Err(_) => without.push(name.clone()),
            }
        }
    }
    without.dedup();
    assert_eq!(without, ["vec.ping_t", "vec.pong_t", "vec.tree_t", "vec.deep.er.wrapper_t"]);
    assert!(all.len() >= 200, "{}", all.len());
    let (answers, _) = decode(&python, &all);
    for (((topic, _), answers), expected) in all.iter().zip(&answers).zip(&expected) {
        same(&topic.name, answers, expected);
    }
}
