//! Translation to ROS 2, verified by a reader of this project; `ros_peers.rs` verifies it with those of others.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::translated::{lcm_json, pairs, read, samples, scene, schema, told, translate, translator};
use lcm_gen::Schema;
use lcm_gen::cdr::ConvertError;
use lcm_gen::dynamic::{DecodeError, Types};
use logger::ros::{RobotScene, STANDARD_MAX, TOPICS_MAX, Translator, Untranslated};
use messages::common::{CmdLog, DataFaults, DataProcesses, DataState, Error, EventText, Fault, Process};
use messages::lowlevel::{
    self, DataGuard, DataIrs, DataOdo, DataPower, DataRanges, DataSrfs, DataTemperature, Reading, Temperature,
};
use messages::middlelevel::{DataEstimate, DataObstacles, DataPersons, DataPlan, TrackedPerson};
use messages::{Channel, Message};
use serde_json::{Value as Json, json};
use testing::Random;

/// 2011-11-21 11:20:00.123456 UTC.
const NOW: i64 = 1_321_874_400_123_456;

fn stamp() -> Json {
    json!({ "sec": 1_321_874_400, "nanosec": 123_456_000 })
}

fn header(frame: &str) -> Json {
    json!({ "stamp": stamp(), "frame_id": frame })
}

/// Numbers of a JSON array, or members of an object in the order of the names.
fn numbers(value: &Json, names: &[&str]) -> Vec<f64> {
    names.iter().map(|name| value[name].as_f64().unwrap()).collect()
}

#[track_caller]
fn near(found: &[f64], expected: &[f64]) {
    let same = found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(same, "{found:?} and {expected:?}");
}

#[test]
fn every_message_of_the_robot_is_the_same_in_lcm_and_in_ros() {
    let (schema, types, mut translator) = (schema(), Types::new(&schema()), translator());
    for (channel, data) in samples(1, 30) {
        let kind = translator.kind(&channel, &data).unwrap().clone();
        let all = translate(&mut translator, &channel, &data).unwrap();
        let (topic, cdr) = &all[0];
        assert_eq!(*topic.name, format!("/{channel}"));
        let listed = Channel::from_name(&channel).unwrap();
        assert_eq!(*kind.name, *listed.type_name());
        let (package, _) = kind.name.split_once('.').unwrap();
        assert!(topic.schema_name.starts_with(&format!("{package}/msg/")), "{}", topic.schema_name);
        let value = read(topic, cdr);
        assert_eq!(pairs(&value), lcm_json(&schema, &types, &data), "{channel}");
        let timestamp = value.get("timestamp").cloned();
        assert_eq!(timestamp, kind.timestamp(&data).map(lcm_gen::dynamic::Value::Int), "{channel}");
        all.iter().for_each(|(topic, cdr)| drop(read(topic, cdr)));
    }
    for (id, topic) in translator.topics().iter().enumerate() {
        assert_eq!(usize::from(topic.id), id);
    }
    let names =
        |name: &str| translator.topics().iter().find(|topic| &*topic.name == name).unwrap().schema_name.to_string();
    assert_eq!(names("/LL_DATA_ODO"), "lowlevel/msg/DataOdo");
    assert_eq!(names("/CM_EVENT_ERROR"), "common/msg/Error");
    assert_eq!(names("/LL_DATA_RAW_MAIN"), "lowlevel/msg/DataRaw");
}

#[test]
fn a_kind_carries_the_files_that_define_it() {
    let translator = translator();
    let mut bytes = Vec::new();
    Message::from(DataSrfs::default()).encode(&mut bytes).unwrap();
    let kind = translator.kind("LL_DATA_SRFS", &bytes).unwrap();
    assert_eq!(&*kind.name, "lowlevel.data_srfs_t");
    assert!(kind.lcm.contains("struct data_srfs_t") && kind.lcm.contains("struct range_t"));
    let alone = Schema::new(&[("srfs", &*kind.lcm)]).unwrap();
    assert_eq!(alone.fingerprint(&kind.name), schema().fingerprint(&kind.name));
    assert_eq!(translator.kind("LL_DATA_SRFS", &bytes[..7]).map(|kind| kind.name.clone()), None);
}

#[test]
fn module_states_errors_and_processes_are_diagnostics() {
    let mut translator = translator();
    let state = DataState { timestamp: NOW, module: "estimator".into(), state: DataState::PAUSE };
    let status = |value: &Json| value["/diagnostics"]["status"].as_array().unwrap().clone();
    let all = told(&mut translator, state);
    assert_eq!(all["/diagnostics"]["header"], header(""));
    assert_eq!(
        status(&json!(all)),
        [json!({ "level": 1, "name": "estimator/state", "message": "PAUSE", "hardware_id": "advee",
                 "values": [{ "key": "state", "value": "6" }] })]
    );
    let error = Error {
        timestamp: NOW,
        module: "driver_canbus".into(),
        number: 0x0201,
        message: "epos: heartbeat missing".into(),
        severity: Error::ERROR,
        r#type: Error::DEVICE,
        file: "axis.rs".into(),
        line: 7,
        ..Error::default()
    };
    let all = status(&json!(told(&mut translator, error.clone())));
    let (level, name) = (&all[0]["level"], &all[0]["name"]);
    assert_eq!((level, name), (&json!(2), &json!("driver_canbus/DriveLost")));
    assert_eq!(all[0]["message"], "epos: heartbeat missing");
    assert_eq!(all[0]["values"][3], json!({ "key": "source", "value": "axis.rs:7" }));
    let cleared = Error { severity: Error::NOTICE, number: 0xBEEF, ..error };
    let all = status(&json!(told(&mut translator, cleared)));
    assert_eq!((&all[0]["level"], &all[0]["name"]), (&json!(0), &json!("driver_canbus/0xBEEF")));

    let hold = |code, latched| lowlevel::Hold { code, subject: "web".into(), latched, since: 0 };
    let list = |holds| lowlevel::DataHold { timestamp: NOW, module: "driver_canbus".into(), holds };
    let all = status(&json!(told(&mut translator, list(vec![hold(201, false), hold(405, true)]))));
    let values = json!([
        { "key": "BusDown", "value": "web is down (201)" },
        { "key": "NotReleased", "value": "web must send zero first: the robot was stopped (405, until a person acts)" },
    ]);
    assert_eq!(
        all,
        [json!({ "level": 1, "name": "driver_canbus/hold", "message": "web is down", "hardware_id": "advee",
                 "values": values })]
    );
    for (holds, level, message) in [
        (vec![], 0, "acts"),
        (vec![hold(401, false)], 0, "nobody commands the motion"),
        (vec![hold(999, false)], 1, ""),
    ] {
        let all = status(&json!(told(&mut translator, list(holds))));
        assert_eq!(all[0]["level"], level);
        assert!(all[0]["message"].as_str().unwrap().starts_with(message), "{all:?}");
    }

    let process = |phase, wanted| Process { module: "planner".into(), phase, wanted, pid: 77, ..Process::default() };
    let processes = vec![
        process(Process::RUNNING, DataState::RUN),
        process(Process::TERMINATED, DataState::RUN),
        process(Process::TERMINATED, DataState::TERMINATE),
        process(Process::TERMINATING, DataState::RUN),
        process(9, 9),
    ];
    let all = status(&json!(told(&mut translator, DataProcesses { timestamp: NOW, processes })));
    assert_eq!(all.iter().map(|status| status["level"].as_u64().unwrap()).collect::<Vec<_>>(), [0, 2, 0, 1, 3]);
    assert!(all.iter().all(|status| status["name"] == "planner/process"));
    assert_eq!(all[0]["values"][0], json!({ "key": "pid", "value": "77" }));
}

#[test]
fn each_fault_and_subject_has_a_status_of_its_own() {
    let mut translator = translator();
    let fault = |subject: &str| Fault {
        number: 0x0102,
        subject: subject.into(),
        severity: Error::WARNING,
        since: NOW - 5,
        message: format!("{subject} is lost"),
    };
    let list =
        |faults: &[Fault]| DataFaults { timestamp: NOW, module: "driver_rs485a".into(), faults: faults.to_vec() };
    let mut statuses = |message: Message| {
        let all = told(&mut translator, message);
        let statuses = all.get("/diagnostics").map(|array| array["status"].as_array().unwrap().clone());
        let status = |status: &Json| (status["level"].as_u64().unwrap(), status["name"].as_str().unwrap().to_owned());
        (statuses.unwrap_or_default().iter().map(status).collect::<Vec<_>>(), all)
    };
    let (front, rear) = ("driver_rs485a/BoardLost/sd1_front", "driver_rs485a/BoardLost/sd1_rear");
    let of = |expected: &[(u64, &str)]| {
        expected.iter().map(|(level, name)| (*level, (*name).to_owned())).collect::<Vec<_>>()
    };
    assert_eq!(statuses(list(&[]).into()).0, of(&[]), "nothing to say");
    let (all, messages) = statuses(list(&[fault("sd1_front"), fault("sd1_rear")]).into());
    assert_eq!(all, of(&[(1, front), (1, rear)]));
    let status = &messages["/diagnostics"]["status"][0];
    assert_eq!(
        (&status["message"], &status["values"][1]),
        (&json!("sd1_front is lost"), &json!({ "key": "subject", "value": "sd1_front" }))
    );
    // One board returns: its status is OK once, and the other's is unaffected.
    assert_eq!(statuses(list(&[fault("sd1_rear")]).into()).0, of(&[(1, rear), (0, front)]));
    let over = Error { timestamp: NOW, module: "driver_rs485a".into(), number: 0x0102, ..Error::default() };
    let (all, messages) = statuses(over.into());
    assert_eq!((all, &messages["/rosout"]["level"]), (of(&[]), &json!(20)));
    assert_eq!(statuses(list(&[fault("sd1_rear")]).into()).0, of(&[(1, rear)]));
    // The module dies: its faults are stale until it is back.
    let down = Fault { number: 0x0307, subject: "driver_rs485a".into(), severity: Error::ERROR, ..Fault::default() };
    for _ in 0..2 {
        assert_eq!(
            statuses(list(std::slice::from_ref(&down)).into()).0,
            of(&[(2, "driver_rs485a/ModuleDown"), (3, rear)])
        );
    }
    assert_eq!(statuses(list(&[]).into()).0, of(&[(0, rear), (0, "driver_rs485a/ModuleDown")]));
    // A sender invents modules.
    for n in 0..300 {
        told(&mut translator, DataFaults { module: format!("m{n}"), ..DataFaults::default() });
    }
    assert_eq!(translator.left_out(), 101);
}

#[test]
fn texts_and_reports_are_lines_of_a_log() {
    let mut translator = translator();
    let mut line = |level| {
        let text = EventText { timestamp: NOW, module: "planner".into(), level, text: "it turns".into() };
        told(&mut translator, text).remove("/rosout").unwrap()
    };
    let expected = json!({ "stamp": stamp(), "level": 20, "name": "planner", "msg": "it turns", "file": "", "function": "", "line": 0 });
    assert_eq!(line(EventText::INFO), expected);
    assert_eq!([0, 2, 3, 99].map(|level| line(level)["level"].as_u64().unwrap()), [10, 30, 40, 40]);
    let error = Error { severity: Error::ERROR, fatal: true, file: "a.rs".into(), line: 7, ..Error::default() };
    let line = told(&mut translator, error).remove("/rosout").unwrap();
    assert_eq!((&line["level"], &line["file"], &line["line"]), (&json!(50), &json!("a.rs"), &json!(7)));
}

#[test]
fn odometry_is_integrated_and_survives_a_restart_of_the_driver() {
    let mut translator = translator();
    let mut at = NOW;
    let mut tell = |path: f64, heading: f64| {
        at += 50_000;
        let odo = DataOdo { timestamp: at, path, heading, translation: 0.5, rotation: 0.1, ..DataOdo::default() };
        told(&mut translator, odo).remove("/odometry").unwrap()
    };
    let place = |odometry: &Json| {
        let pose = &odometry["pose"]["pose"];
        let [z, w] = numbers(&pose["orientation"], &["z", "w"])[..] else { panic!("two") };
        [numbers(&pose["position"], &["x", "y"]), vec![2.0 * libm::atan2(z, w)]].concat()
    };
    let first = tell(100.0, 3.0);
    assert_eq!((&first["header"]["frame_id"], &first["child_frame_id"]), (&json!("odom"), &json!("base_link")));
    assert_eq!(first["twist"]["twist"]["linear"], json!({ "x": 0.5, "y": 0.0, "z": 0.0 }));
    assert_eq!(first["twist"]["twist"]["angular"]["z"], 0.1);
    near(&place(&first), &[0.0, 0.0, 0.0]);
    near(&place(&tell(101.0, 3.0)), &[1.0, 0.0, 0.0]);
    // Quarter turn in many steps: a circle of radius 1 from (1, 0), left.
    let quarter = std::f64::consts::FRAC_PI_2;
    let last =
        (1..=1000).map(|i| f64::from(i) / 1000.0 * quarter).map(|way| tell(101.0 + way, 3.0 + way)).last().unwrap();
    let [x, y, theta] = place(&last)[..] else { panic!("three") };
    assert!((x - 2.0).abs() < 1e-5 && (y - 1.0).abs() < 1e-5 && (theta - quarter).abs() < 1e-9, "{x} {y} {theta}");
    // The driver restarts with zeros: no step, then on from here.
    near(&place(&tell(0.0, 0.0))[2..], &[quarter]);
    let [_, on, _] = place(&tell(1.0, 0.0))[..] else { panic!("three") };
    assert!((on - y - 1.0).abs() < 1e-9, "{on}");
    near(&place(&tell(f64::NAN, 0.0))[1..], &[on, quarter]);
}

#[test]
fn an_estimate_is_a_pose_a_transform_and_an_ellipse() {
    let mut translator = translator();
    let mut estimate =
        DataEstimate { timestamp: NOW, x: 3.0, y: 6.0, theta: std::f64::consts::PI, ..DataEstimate::default() };
    estimate.covariance = [[0.04, 0.0, 0.001], [0.0, 0.01, 0.002], [0.001, 0.002, 0.09]];
    let all = told(&mut translator, estimate.clone());
    let pose = &all["/pose"];
    assert_eq!(pose["header"], header("map"));
    assert_eq!(pose["pose"]["pose"]["position"], json!({ "x": 3.0, "y": 6.0, "z": 0.0 }));
    near(&numbers(&pose["pose"]["pose"]["orientation"], &["x", "y", "z", "w"]), &[0.0, 0.0, 1.0, 0.0]);
    let covariance = &pose["pose"]["covariance"];
    let mut expected = [0.0; 36];
    for (place, value) in [(0, 0.04), (5, 0.001), (7, 0.01), (11, 0.002), (30, 0.001), (31, 0.002), (35, 0.09)] {
        expected[place] = value;
    }
    assert_eq!(*covariance, json!(expected.to_vec()));
    let transform = &all["/tf"]["transforms"][0];
    assert_eq!((&transform["header"], &transform["child_frame_id"]), (&header("map"), &json!("base_link")));
    assert_eq!(transform["transform"]["translation"], json!({ "x": 3.0, "y": 6.0, "z": 0.0 }));

    let markers = all["/scene"]["markers"].as_array().unwrap();
    let names: Vec<&str> = markers.iter().map(|marker| marker["ns"].as_str().unwrap()).collect();
    assert_eq!(names, ["estimate", "outline", "beacons", "beacon_numbers"]);
    near(&numbers(&markers[0]["scale"], &["x", "y"]), &[0.8, 0.4]);
    assert_eq!(markers[1]["header"]["frame_id"], "base_link");
    assert_eq!(markers[1]["points"].as_array().unwrap().len(), 5);
    assert_eq!((&markers[2]["id"], &markers[3]["text"]), (&json!(4), &json!("4")));
    // The ellipse is sent each time, the rest once a second.
    estimate.timestamp += 999_999;
    estimate.covariance = [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0; 3]];
    let all = told(&mut translator, estimate.clone());
    assert_eq!(all["/scene"]["markers"].as_array().unwrap().len(), 1);
    let [z, w] = numbers(&all["/scene"]["markers"][0]["pose"]["orientation"], &["z", "w"])[..] else { panic!("two") };
    near(&[2.0 * libm::atan2(z, w)], &[std::f64::consts::FRAC_PI_4]);
    estimate.timestamp += 1;
    estimate.x = f64::NAN;
    let all = told(&mut translator, estimate);
    assert!(!all.contains_key("/tf") && all.contains_key("/pose"));
    assert_eq!(all["/scene"]["markers"].as_array().unwrap().len(), 4);
    assert_eq!(all["/scene"]["markers"][0]["action"], 2);
}

#[test]
fn range_finders_have_topics_frames_and_transforms() {
    let mut translator = translator();
    let range = |id, x, distance, valid| lowlevel::Range { id, x, y: 0.1, theta: 0.0, distance, valid };
    let srfs = vec![range(2, 0.75, 1.5, true), range(12, -0.15, f64::NAN, false)];
    let mut srfs = DataSrfs { timestamp: NOW, srfs };
    let all = told(&mut translator, srfs.clone());
    assert_eq!(all["/range/2"]["header"], header("sonar_2"));
    let f = |number: f64| f64::from(number as f32);
    assert_eq!(
        numbers(&all["/range/2"], &["radiation_type", "field_of_view", "min_range", "max_range", "range"]),
        [0.0, f(0.96), f(0.03), 6.0, 1.5]
    );
    assert_eq!(all["/range/12"]["range"], "inf");
    let transforms = all["/tf"]["transforms"].as_array().unwrap();
    assert_eq!(transforms.len(), 2);
    assert_eq!(
        (&transforms[1]["header"], &transforms[1]["child_frame_id"]),
        (&header("base_link"), &json!("sonar_12"))
    );
    assert_eq!(transforms[1]["transform"]["translation"]["x"], -0.15);
    srfs.timestamp += 250_000;
    assert!(!told(&mut translator, srfs.clone()).contains_key("/tf"));
    srfs.timestamp += 750_000;
    assert!(told(&mut translator, srfs).contains_key("/tf"));
    let irs = told(&mut translator, DataIrs { timestamp: NOW, irs: vec![range(2, 0.7, 0.12, true)] });
    assert_eq!((&irs["/range/ir_2"]["header"], &irs["/range/ir_2"]["radiation_type"]), (&header("ir_2"), &json!(1)));
    assert_eq!(irs["/tf"]["transforms"][0]["child_frame_id"], "ir_2");

    // A sender invents sensors: the first 64 have topics, the messages of the others are left out and counted.
    let many = |from: i32| (from..from + 100).map(|id| range(id, 0.0, 1.0, true)).collect();
    let all = told(&mut translator, DataSrfs { timestamp: NOW, srfs: many(1000) });
    assert_eq!(all.keys().filter(|topic| topic.starts_with("/range/")).count(), 62);
    assert_eq!(translator.left_out(), 38);
}

#[test]
fn readings_have_their_own_stamps_and_unknown_is_nan() {
    let mut translator = translator();
    let reading = |kind, id, age: i64, status, distance| Reading {
        timestamp: NOW - age,
        id,
        kind,
        status,
        distance,
        x: 0.75,
        beam: 0.5,
        ..Default::default()
    };
    let measured = reading(Reading::SONAR, 2, 175_000, Reading::MEASURED, 1.5);
    let readings = vec![
        measured.clone(),
        reading(Reading::SONAR, 3, 105_000, Reading::SILENT, f64::NAN),
        reading(Reading::SONAR, 4, NOW, Reading::UNKNOWN, f64::NAN),
        reading(Reading::INFRARED, 2, 20_000, Reading::MEASURED, 0.12),
        reading(Reading::OTHER, 2, 20_000, Reading::MEASURED, 3.0),
    ];
    let all = told(&mut translator, DataRanges { timestamp: NOW, readings });
    let ranges = ["/range/2", "/range/3", "/range/4", "/range/ir_2", "/range/other_2"].map(|topic| &all[topic]);
    let nanos = |range: &Json| {
        let stamp = &range["header"]["stamp"];
        stamp["sec"].as_i64().unwrap() * 1_000_000 + stamp["nanosec"].as_i64().unwrap() / 1000
    };
    assert_eq!(ranges.map(nanos), [NOW - 175_000, NOW - 105_000, NOW, NOW - 20_000, NOW - 20_000]);
    assert_eq!(
        (&ranges[0]["range"], &ranges[1]["range"], &ranges[2]["range"]),
        (&json!(1.5), &json!("inf"), &json!("nan"))
    );
    assert_eq!((&ranges[0]["field_of_view"], &ranges[0]["max_range"]), (&json!(0.5), &json!(6.0)));
    // A repeated reading is not a new measurement; and the view of 2011 is ignored while this one arrives.
    let again = told(&mut translator, DataRanges { timestamp: NOW + 100_000, readings: vec![measured] });
    assert!(!again.keys().any(|topic| topic.starts_with("/range/")), "{again:?}");
    let range = lowlevel::Range { id: 2, distance: 1.0, valid: true, ..Default::default() };
    let old = |timestamp| DataSrfs { timestamp, srfs: vec![range.clone()] };
    assert!(!told(&mut translator, old(NOW + 200_000)).contains_key("/range/2"));
    assert_eq!(told(&mut translator, old(NOW + 2_000_000))["/range/2"]["range"], 1.0);
}

#[test]
fn a_revolution_of_a_lidar_is_one_scan_in_the_order_in_which_it_was_measured() {
    for sign in [1.0, -1.0] {
        let mut translator = translator();
        let step = sign * std::f64::consts::TAU / 8.0;
        // Two sectors of four beams; the second one follows the first.
        let sector = |revolution: i64, half: usize, ranges: [f32; 4]| lowlevel::DataScan {
            timestamp: NOW + 100_000 * revolution + 50_000 * half as i64,
            name: "front left".into(),
            revolution,
            x: 0.3,
            angle_min: 1.0 + 4.0 * step * half as f64,
            angle_step: step,
            beam_time: 0.0125,
            range_min: 0.02,
            range_max: 12.0,
            ranges: ranges.into(),
            intensities: vec![7.0; 4],
            ..Default::default()
        };
        let topic = "/scan/front_left";
        let begun = told(&mut translator, sector(5, 0, [1.0, 2.0, f32::INFINITY, f32::NAN]));
        assert!(!begun.contains_key(topic), "it is not whole yet");
        assert_eq!(begun["/tf"]["transforms"][0]["child_frame_id"], "lidar_front_left");
        told(&mut translator, sector(5, 1, [5.0, 6.0, 7.0, 8.0]));
        let scan = told(&mut translator, sector(6, 0, [1.0; 4])).remove(topic).unwrap();
        assert_eq!(scan["ranges"], json!([1.0, 2.0, "inf", "nan", 5.0, 6.0, 7.0, 8.0]));
        assert_eq!(scan["intensities"].as_array().unwrap().len(), 8);
        assert_eq!(scan["header"]["frame_id"], "lidar_front_left");
        let number = |name: &str| scan[name].as_f64().unwrap();
        let near = |name: &str, expected: f64| assert!((number(name) - expected).abs() < 1e-6, "{name}: {scan}");
        near("angle_min", 1.0);
        near("angle_max", 1.0 + 7.0 * step);
        near("angle_increment", step);
        near("time_increment", 0.0125);
        near("scan_time", 0.1);
    }
    // Angles that are none, and lidars without end, are left out.
    let mut translator = translator();
    for odd in [0.0, f64::NAN, f64::INFINITY, 1e-9] {
        for revolution in 0..2 {
            let odd = lowlevel::DataScan { revolution, angle_step: odd, ranges: vec![1.0; 3], ..Default::default() };
            assert!(!told(&mut translator, odd).keys().any(|topic| topic.starts_with("/scan")));
        }
    }
}

#[test]
fn revolutions_with_a_beam_more_or_less_have_the_same_directions() {
    let mut translator = translator();
    let revolution = |revolution: i64, beams: usize, angle_min: f64| lowlevel::DataScan {
        timestamp: NOW + 100_000 * revolution,
        name: "top".into(),
        revolution,
        angle_min,
        angle_step: -std::f64::consts::TAU / beams as f64,
        ranges: vec![1.0; beams],
        ..Default::default()
    };
    told(&mut translator, revolution(1, 100, 0.8));
    let mut next = |number, beams, angle_min| {
        told(&mut translator, revolution(number, beams, angle_min)).remove("/scan/top").unwrap()
    };
    let scans = [next(2, 99, 0.79), next(3, 101, 0.82), next(4, 100, 0.8)];
    for scan in &scans {
        let ranges = scan["ranges"].as_array().unwrap();
        let missing = ranges.iter().filter(|range| **range != json!(1.0)).count();
        assert!(ranges.len() == 100 && missing <= 1, "{} beams, {missing} missing", ranges.len());
        for name in ["angle_min", "angle_max", "angle_increment"] {
            assert_eq!(scan[name], scans[0][name], "{name}");
        }
    }
    // Those of another speed are others.
    next(5, 80, 0.8);
    assert_eq!(next(6, 80, 0.8)["ranges"].as_array().unwrap().len(), 80);
}

#[test]
fn a_lidar_with_a_fault_shows_nothing_as_free() {
    use lowlevel::DataScan;
    for status in [DataScan::OK, DataScan::BLOCKED, DataScan::SLOW, DataScan::FAULT] {
        let mut translator = translator();
        let revolution = |revolution: i64| DataScan {
            timestamp: NOW + 100_000 * revolution,
            name: "top".into(),
            revolution,
            status,
            angle_step: std::f64::consts::TAU / 4.0,
            ranges: vec![f32::INFINITY, 2.0, f32::NEG_INFINITY, f32::NAN],
            ..Default::default()
        };
        told(&mut translator, revolution(1));
        let scan = told(&mut translator, revolution(2)).remove("/scan/top").unwrap();
        let nothing = if status == DataScan::OK { "inf" } else { "nan" };
        assert_eq!(scan["ranges"], json!([nothing, 2.0, "-inf", "nan"]));
    }
}

#[test]
fn an_inertial_unit_that_works_is_an_imu_in_the_robot_s_frame() {
    let mut translator = translator();
    let measured = lowlevel::DataImu {
        timestamp: NOW,
        name: "base left".into(),
        acceleration: [0.5, -0.25, 9.81],
        rotation: [0.125, 0.0, -1.0],
        orientation: [0.0, 0.0, 0.6, 0.8],
        oriented: true,
        ..Default::default()
    };
    let imu = told(&mut translator, measured.clone()).remove("/imu/base_left").unwrap();
    assert_eq!(imu["header"]["frame_id"], "base_link");
    assert_eq!(imu["orientation"], json!({"x": 0.0, "y": 0.0, "z": 0.6, "w": 0.8}));
    assert_eq!(imu["angular_velocity"], json!({"x": 0.125, "y": 0.0, "z": -1.0}));
    assert_eq!(imu["linear_acceleration"], json!({"x": 0.5, "y": -0.25, "z": 9.81}));
    assert_eq!(imu["orientation_covariance"][0], 0.0);
    let without = lowlevel::DataImu { oriented: false, ..measured.clone() };
    assert_eq!(told(&mut translator, without).remove("/imu/base_left").unwrap()["orientation_covariance"][0], -1.0);
    // What nothing may go by has no place in a message that cannot say so.
    for status in [lowlevel::DataImu::UNCALIBRATED, lowlevel::DataImu::IMPLAUSIBLE, lowlevel::DataImu::FAULT] {
        let other = lowlevel::DataImu { status, ..measured.clone() };
        assert!(!told(&mut translator, other).contains_key("/imu/base_left"), "{status}");
    }
}

#[test]
fn a_battery_of_signals_is_a_battery_state_and_what_is_not_known_is_nan() {
    let mut translator = translator();
    let known = lowlevel::DataBattery {
        timestamp: NOW,
        name: "pack 1".into(),
        voltage: 25.5,
        current: -2.0,
        charge: 0.75,
        health: f64::NAN,
        temperature: f64::NAN,
        charging: true,
        cells: vec![3.5, 3.25],
    };
    let state = told(&mut translator, known.clone()).remove("/battery/pack_1").unwrap();
    assert_eq!(
        (&state["voltage"], &state["current"], &state["percentage"]),
        (&json!(25.5), &json!(-2.0), &json!(0.75))
    );
    assert_eq!((&state["cell_voltage"], &state["power_supply_status"]), (&json!([3.5, 3.25]), &json!(1)));
    assert_eq!((&state["location"], &state["temperature"]), (&json!("pack 1"), &state["charge"]));
    let idle = lowlevel::DataBattery { charging: false, ..known };
    assert_eq!(told(&mut translator, idle).remove("/battery/pack_1").unwrap()["power_supply_status"], 0);
}

#[test]
fn the_guard_s_fields_are_outlines_in_the_robot_s_frame_and_filled_while_something_is_in_them() {
    let mut translator = translator();
    let (x, y) = (vec![0.75, 1.5, 1.5, 0.75], vec![-0.3, -0.3, 0.3, 0.3]);
    let field = |kind, occupied| lowlevel::Field { kind, occupied, x: x.clone(), y: y.clone() };
    let fields = vec![field(lowlevel::Field::PROTECTIVE, false), field(lowlevel::Field::WARNING, true)];
    let mut guard = DataGuard { timestamp: NOW, fields, ..DataGuard::default() };
    let mut markers =
        |guard: &DataGuard| told(&mut translator, guard.clone()).get("/scene").map(|all| all["markers"].clone());
    let all = markers(&guard).unwrap();
    let row = |n: usize| (all[n]["ns"].as_str().unwrap(), all[n]["type"].clone(), all[n]["action"].clone());
    assert_eq!(row(0), ("protective_field", json!(4), json!(0)));
    assert_eq!(row(1), ("protective_field", json!(11), json!(2)), "nothing is in it");
    assert_eq!(row(2), ("warning_field", json!(4), json!(0)));
    assert_eq!(row(3), ("warning_field", json!(11), json!(0)), "something is in it");
    for n in 0..4 {
        assert_eq!((&all[n]["header"], &all[n]["id"]), (&header("base_link"), &json!(n % 2)));
    }
    let point = |x: f64, y: f64| json!({ "x": x, "y": y, "z": 0.0 });
    let corners = [point(0.75, -0.3), point(1.5, -0.3), point(1.5, 0.3), point(0.75, 0.3)];
    let [a, b, c, d] = corners;
    assert_eq!(all[0]["points"], json!([a, b, c, d, a]), "closed");
    assert_eq!(all[3]["points"], json!([a, b, c, a, c, d]), "two triangles");
    // Five times a second, although it is published at 20 Hz.
    guard.timestamp += 150_000;
    assert!(markers(&guard).is_none());
    guard.timestamp += 50_000;
    // What is no polygon is deleted.
    guard.fields[0].x[1] = f64::NAN;
    (guard.fields[1].x, guard.fields[1].y) = (vec![0.0; 65], vec![0.0; 65]);
    let all = markers(&guard).unwrap();
    assert!((0..4).all(|n| all[n]["action"] == 2 && all[n]["points"] == json!([])), "{all}");
}

#[test]
fn each_field_of_a_kind_is_shown_and_deleted_when_it_is_gone_and_a_notch_is_not_filled() {
    let mut translator = translator();
    let field = |x: &[f64], y: &[f64]| lowlevel::Field {
        kind: lowlevel::Field::PROTECTIVE,
        occupied: true,
        x: x.to_vec(),
        y: y.to_vec(),
    };
    // The last corner but one is a notch.
    let notched = field(&[0.0, 2.0, 2.0, 1.0, 0.0], &[0.0, 0.0, 2.0, 0.5, 2.0]);
    let fields = vec![field(&[0.0, 1.0, 1.0], &[0.0, 0.0, 1.0]), notched];
    let mut guard = DataGuard { timestamp: NOW, fields, ..DataGuard::default() };
    let mut markers =
        |guard: &DataGuard| told(&mut translator, guard.clone()).get("/scene").map(|all| all["markers"].clone());
    let all = markers(&guard).unwrap();
    let rows = |all: &Json| -> Vec<(String, Json, Json)> {
        let row = |row: &Json| (row["ns"].as_str().unwrap().to_owned(), row["id"].clone(), row["action"].clone());
        all.as_array().unwrap().iter().map(row).collect()
    };
    let of = |ns: &str, id: i32, action: i32| (ns.to_owned(), json!(id), json!(action));
    let warning = [of("warning_field", 0, 2), of("warning_field", 1, 2)];
    let both: Vec<_> = (0..4).map(|id| of("protective_field", id, 0)).chain(warning.clone()).collect();
    assert_eq!(rows(&all), both);
    let corner = |point: &Json| [point["x"].as_f64().unwrap(), point["y"].as_f64().unwrap()];
    let points: Vec<[f64; 2]> = all[3]["points"].as_array().unwrap().iter().map(corner).collect();
    let area = |t: &[[f64; 2]]| (t[1][0] - t[0][0]) * (t[2][1] - t[0][1]) - (t[1][1] - t[0][1]) * (t[2][0] - t[0][0]);
    let areas: Vec<f64> = points.chunks(3).map(|triangle| area(triangle) / 2.0).collect();
    assert!(areas.len() == 3 && areas.iter().all(|area| *area > 0.0), "{points:?}");
    assert!((areas.iter().sum::<f64>() - 2.5).abs() < 1e-9, "{areas:?}");
    guard.timestamp += 250_000;
    guard.fields.pop();
    let gone: Vec<_> =
        (0..4).map(|id| of("protective_field", id, if id < 2 { 0 } else { 2 })).chain(warning.clone()).collect();
    assert_eq!(rows(&markers(&guard).unwrap()), gone);
    guard.timestamp += 250_000;
    assert_eq!(rows(&markers(&guard).unwrap()).len(), 4);
}

#[test]
fn plan_obstacles_battery_temperatures_and_marks() {
    let mut translator = translator();
    let plan = DataPlan { timestamp: NOW, x: vec![0.0, 1.0, 1.0], y: vec![0.0, 0.0, 2.0] };
    let all = told(&mut translator, plan);
    let poses = all["/plan"]["poses"].as_array().unwrap();
    assert_eq!((poses.len(), &poses[2]["header"]), (3, &header("map")));
    let theta = |pose: &Json| {
        let [z, w] = numbers(&pose["pose"]["orientation"], &["z", "w"])[..] else { panic!("two") };
        2.0 * libm::atan2(z, w)
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    near(&poses.iter().map(theta).collect::<Vec<_>>(), &[0.0, quarter, quarter]);
    assert_eq!(poses[2]["pose"]["position"], json!({ "x": 1.0, "y": 2.0, "z": 0.0 }));

    let mut obstacles = DataObstacles { timestamp: NOW, size: 0.1, x: vec![1.0, 2.0], y: vec![3.0, 4.0] };
    let marker = told(&mut translator, obstacles.clone())["/scene"]["markers"][0].clone();
    assert_eq!((&marker["type"], &marker["action"], &marker["scale"]["x"]), (&json!(6), &json!(0), &json!(0.1)));
    assert_eq!(marker["points"][1], json!({ "x": 2.0, "y": 4.0, "z": 0.0 }));
    (obstacles.x, obstacles.y) = (vec![], vec![]);
    assert_eq!(told(&mut translator, obstacles)["/scene"]["markers"][0]["action"], 2);

    let person = |x| TrackedPerson { id: 4, x, y: 3.0, vx: 0.5, vy: -1.0, sigma: 0.1, velocity_sigma: 0.2 };
    let mut persons = DataPersons { timestamp: NOW, persons: vec![person(1.0), person(f64::NAN)] };
    let markers = told(&mut translator, persons.clone())["/scene"]["markers"].clone();
    let [spheres, ways] = &markers.as_array().unwrap()[..] else { panic!("{markers}") };
    assert_eq!((&spheres["ns"], &spheres["header"], &spheres["type"]), (&json!("persons"), &header("map"), &json!(7)));
    assert_eq!(spheres["points"], json!([{ "x": 1.0, "y": 3.0, "z": 0.0 }]));
    assert_eq!((&ways["type"], &ways["points"][1]), (&json!(5), &json!({ "x": 1.5, "y": 2.0, "z": 0.0 })));
    persons.persons.clear();
    let none = told(&mut translator, persons)["/scene"]["markers"].clone();
    assert_eq!((&none[0]["action"], &none[1]["action"]), (&json!(2), &json!(2)));

    let channel = |current| lowlevel::Channel { current, ..lowlevel::Channel::default() };
    let power = DataPower {
        timestamp: NOW,
        voltage: 25.5,
        charge: 0.75,
        channels: vec![channel(1.5), channel(2.0)],
        ..DataPower::default()
    };
    let battery = &told(&mut translator, power)["/battery"];
    assert_eq!(numbers(battery, &["voltage", "current", "percentage"]), [25.5, -3.5, 0.75]);
    assert_eq!((&battery["capacity"], &battery["present"]), (&json!("nan"), &json!(true)));

    let thermometer = |name: &str, value| Temperature { name: name.into(), value, over: false };
    let long = "x".repeat(65);
    let temperatures = vec![thermometer("motor left", 41.5), thermometer("cpu", f64::NAN), thermometer(&long, 1.0)];
    let all = told(&mut translator, DataTemperature { timestamp: NOW, temperatures, fans: vec![] });
    assert_eq!(
        (&all["/temperature/motor_left"]["temperature"], &all["/temperature/cpu"]["temperature"]),
        (&json!(41.5), &json!("nan"))
    );
    assert_eq!((all.len(), translator.left_out()), (3, 1));

    let command = CmdLog { timestamp: NOW, action: CmdLog::MARK, text: "it hit the table".into() };
    let all = told(&mut translator, command.clone());
    let expected = json!({ "stamp": stamp(), "level": 20, "name": "advee", "msg": "it hit the table", "file": "", "function": "", "line": 0 });
    assert_eq!(all["/marks"], expected);
    assert_eq!(told(&mut translator, CmdLog { action: CmdLog::START, ..command }).len(), 1);
    let mut marks = Vec::new();
    translator.mark(i64::MAX, "late", &mut |topic, cdr| marks.push(crate::translated::named(&read(topic, cdr))));
    translator.mark(-1, "early", &mut |topic, cdr| marks.push(crate::translated::named(&read(topic, cdr))));
    assert_eq!(marks[0]["stamp"], json!({ "sec": i32::MAX, "nanosec": 999_999_999 }));
    assert_eq!(marks[1]["stamp"], json!({ "sec": -1, "nanosec": 999_999_000 }));
}

const FOREIGN: &[(&str, &str)] = &[
    ("a.lcm", "package other; struct data_odo_t { double way; }"),
    ("b.lcm", "package other; struct tree_t { int8_t n; tree_t below[n]; }"),
    // The same members as lowlevel.cmd_homing_t.
    ("c.lcm", "package other; struct wheel_t { int64_t timestamp; string axis; }"),
    (
        "d.lcm",
        "package other; struct late_t { wheel_t a; int8_t b[3]; int64_t timestamp; } struct soon_t { byte b[2][2]; \
         data_odo_t o; int64_t timestamp; }",
    ),
];

/// Message of a foreign type, filled with zeros.
fn foreign(name: &str) -> Vec<u8> {
    let types = Types::new(&Schema::new(FOREIGN).unwrap());
    let mut out = Vec::new();
    let empty = lcm_gen::dynamic::Value::Struct(vec![]);
    types.get(name).unwrap().encode(&empty, lcm_gen::dynamic::Missing::Zero, &mut out).unwrap();
    out
}

#[test]
fn a_topic_keeps_its_type_whatever_the_channel_carries() {
    let mut translator = Translator::with_types(scene(), FOREIGN).unwrap();
    let mut topics = |channel: &str, data: &[u8]| {
        let all = translate(&mut translator, channel, data)?;
        Ok::<_, Untranslated>(
            all.iter().map(|(topic, _)| format!("{} {}", topic.name, topic.schema_name)).collect::<Vec<_>>(),
        )
    };
    let (odo, wheel) = (foreign("other.data_odo_t"), foreign("other.wheel_t"));
    // On a channel of the table another type gets its own topic, even if it is received first.
    assert_eq!(topics("LL_DATA_ODO", &odo).unwrap(), ["/LL_DATA_ODO/other/DataOdo other/msg/DataOdo"]);
    assert_eq!(topics("LL_CMD_HOMING", &wheel).unwrap(), ["/LL_CMD_HOMING lowlevel/msg/CmdHoming"]);
    // Elsewhere the first type has it; of two matching types the foreign one, since the robot's have their channels.
    assert_eq!(topics("WHEELS", &wheel).unwrap(), ["/WHEELS other/msg/Wheel"]);
    assert_eq!(topics("WHEELS", &odo).unwrap(), ["/WHEELS/other/DataOdo other/msg/DataOdo"]);
    assert_eq!(topics("WHEELS", &wheel).unwrap(), ["/WHEELS other/msg/Wheel"]);
    assert_eq!(topics("WHEELS/other/DataOdo", &wheel).unwrap(), ["/WHEELS/other/DataOdo/other/Wheel other/msg/Wheel"]);
    // Names of standard topics are reserved.
    assert_eq!(topics("pose", &wheel).unwrap(), ["/lcm/pose other/msg/Wheel"]);
    assert_eq!(topics("range/1", &wheel).unwrap(), ["/lcm/range/1 other/msg/Wheel"]);
    assert_eq!(topics("lcm/pose", &odo).unwrap(), ["/lcm/pose/other/DataOdo other/msg/DataOdo"]);
    let tree = topics("TREE", &foreign("other.tree_t")).unwrap_err();
    assert_eq!(tree.to_string(), "ROS 2 has no types like other.tree_t");
    assert_eq!(topics("ANY", &[1; 8]), Err(Untranslated::Unknown));
    assert_eq!(topics("ANY", &[1; 7]), Err(Untranslated::Unknown));
    let left_over = Untranslated::Malformed(ConvertError::Message(DecodeError::LeftOver { extra: 1 }));
    assert_eq!(topics("NEW", &[&odo[..], &[0]].concat()), Err(left_over));
    assert!(translator.topics().iter().all(|topic| !topic.name.contains("NEW")), "nothing was said on it");
    assert!(Translator::with_types(scene(), &[("x.lcm", "struct x { y z; }")]).is_err());
}

#[test]
fn a_timestamp_is_found_at_a_fixed_offset() {
    let translator = Translator::with_types(RobotScene::default(), FOREIGN).unwrap();
    let timestamp = |name: &str| {
        let mut data = foreign(name);
        let end = data.len();
        data[end - 1] = 7;
        translator.kind("ANY", &data).unwrap().timestamp(&data)
    };
    assert_eq!((timestamp("other.late_t"), timestamp("other.soon_t")), (None, Some(7)));
    let cut = &foreign("other.soon_t")[..20];
    assert_eq!(translator.kind("ANY", cut).unwrap().timestamp(cut), None);
}

#[test]
fn any_number_of_channels_takes_bounded_memory() {
    let mut translator = Translator::with_types(scene(), FOREIGN).unwrap();
    let wheel = foreign("other.wheel_t");
    let mut refused = 0;
    for i in 0..20_000 {
        match translate(&mut translator, &format!("C{i}"), &wheel) {
            Ok(all) => assert_eq!(all.len(), 1),
            Err(error) => {
                assert_eq!(error, Untranslated::TooManyTopics);
                refused += 1;
            }
        }
    }
    assert_eq!((translator.topics().len(), refused), (TOPICS_MAX, 20_000 - TOPICS_MAX));
    // Known topics continue; new ones of a standard type are counted.
    assert!(translate(&mut translator, "C7", &wheel).is_ok());
    translator.mark(0, "no place", &mut |_, _| panic!("there is none"));
    assert_eq!(translator.left_out(), 1);
}

#[test]
fn a_long_message_has_one_form_only() {
    let mut translator = translator();
    let mut topics = |count| {
        let (plan, mut data) = (DataPlan { timestamp: NOW, x: vec![1.0; count], y: vec![2.0; count] }, Vec::new());
        Message::from(plan).encode(&mut data).unwrap();
        let all = translate(&mut translator, "ML_DATA_PLAN", &data).unwrap();
        all.iter().map(|(topic, _)| topic.name.to_string()).collect::<Vec<_>>()
    };
    assert_eq!(topics(STANDARD_MAX / 16 - 10), ["/ML_DATA_PLAN", "/plan"]);
    assert_eq!(topics(STANDARD_MAX / 16), ["/ML_DATA_PLAN"]);
    assert_eq!(translator.left_out(), 1);
    // 100 MB, in one form only.
    let raw = lowlevel::DataRaw { data: vec![9; 100_000_000], ..lowlevel::DataRaw::default() };
    let mut data = Vec::new();
    Message::from(messages::Raw { bus: "A".into(), frame: raw }).encode(&mut data).unwrap();
    let mut size = 0;
    translator.translate("LL_DATA_RAW_A", &data, &mut |_, cdr| size += cdr.len()).unwrap();
    assert_eq!((size, translator.left_out()), (4 + 8 + 1 + 3 + 4 + 4 + 4 + 4 + 100_000_000, 1));
}

#[test]
fn no_bytes_on_any_channel_make_it_panic() {
    let (types, mut translator) = (Types::new(&schema()), translator());
    let mut random = Random::new(9);
    let mut refused = 0;
    for (channel, mut data) in samples(2, 200) {
        for _ in 0..random.index(4) {
            let at = random.index(data.len());
            data[at] = [0, 1, 0x7F, 0x80, 0xFF, random.next() as u8][random.index(6)];
        }
        data.truncate(data.len() - random.index(data.len()) * usize::from(random.index(4) == 0));
        let known = types.decode(&data).is_some_and(|message| message.is_ok());
        let done = translate(&mut translator, &channel, &data);
        assert_eq!(done.is_ok(), known, "{channel}: {data:02x?}");
        refused += usize::from(!known);
        done.iter().flatten().for_each(|(topic, cdr)| drop(read(topic, cdr)));
    }
    assert!(refused > 1000, "{refused}");
}
