//! What others record of the robot on ROS 2 is what its own log of that run has, and nothing that is reliable is lost.

use crate::ros2_peers::{Peer, courier, domain};
use crate::support::{self, Robot, logs, workspace};
use mcap::MessageStream;
use messages::{common, lowlevel};
use serde_json::Value as Json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn python() -> Option<PathBuf> {
    let needed = ["rclpy", "sensor_msgs", "tf2_msgs", "visualization_msgs", "advee_msgs", "cyclonedds", "mcap"];
    testing::peer_or_skip(testing::python(&needed))
}

/// Topics whose messages the log has as well, and their names there. `/scene` has those of its messages that come at a
/// period of their own at other times; `/tf` in a log is another tree; the others are made for ROS alone.
const SHARED: [(&str, &str); 16] = [
    ("/advee/faults", "/CM_DATA_FAULTS"),
    ("/advee/goal", "/ML_DATA_GOAL"),
    ("/advee/guard", "/LL_DATA_GUARD"),
    ("/advee/holds", "/LL_DATA_HOLD"),
    ("/advee/processes", "/CM_DATA_PROCESSES"),
    ("/advee/state", "/CM_DATA_STATE"),
    ("/amcl_pose", "/pose"),
    ("/battery_state", "/battery/pack"),
    ("/diagnostics", "/diagnostics"),
    ("/imu", "/imu/base"),
    ("/plan", "/plan"),
    ("/range/ir_1", "/range/ir_1"),
    ("/range/sonar_1", "/range/1"),
    ("/rosout", "/rosout"),
    ("/scan", "/scan/top"),
    ("/temperature_case", "/temperature/case"),
];

/// Further topics that are recorded, in the namespace of the robot.
const OTHERS: [&str; 5] = ["/clock", "/joint_states", "/odom", "/scene", "/tf"];

/// Messages of each topic at least, except `/plan`, which comes once a second.
const COUNT: usize = 25;

/// The first and the last part of a recording, ns, within which the order of different senders is not that of the log.
const BORDER: u64 = 500_000_000;

/// A message of a recording or of the log.
struct Recorded {
    /// Time of reception, ns.
    received: u64,
    /// Time of sending, µs.
    sent: u64,
    /// CDR, filled up to words as each sample of RTPS is.
    cdr: Vec<u8>,
}

/// Messages of a topic in the order of their reception.
#[derive(Default)]
struct Topic {
    reliable: bool,
    messages: Vec<Recorded>,
}

/// All messages in a form of ROS in an MCAP file.
fn read(file: &Path) -> BTreeMap<String, Topic> {
    let bytes = std::fs::read(file).expect("the recording can be read");
    let mut topics = BTreeMap::<String, Topic>::new();
    for message in MessageStream::new(&bytes).expect("it is MCAP") {
        let message = message.expect("it is whole");
        let channel = &message.channel;
        if channel.message_encoding != "cdr" {
            continue;
        }
        let topic = topics.entry(channel.topic.clone()).or_default();
        let quality = channel.metadata.get("offered_qos_profiles");
        topic.reliable = quality.is_some_and(|quality| quality.contains(": reliable"));
        let mut cdr = message.data.to_vec();
        cdr.resize(cdr.len().next_multiple_of(4), 0);
        let (received, sent) = (message.log_time, (message.publish_time + 500) / 1000);
        topic.messages.push(Recorded { received, sent, cdr });
    }
    for topic in topics.values_mut() {
        topic.messages.sort_by_key(|message| message.received);
    }
    topics
}

/// A recording of a topic beside the log.
#[derive(Debug, Default)]
struct Compared {
    /// Messages of the recording, and of these such that the log does not have.
    recorded: usize,
    foreign: usize,
    /// Messages of the log from the time of the recording, and of these such that the recording does not have.
    logged: usize,
    missing: usize,
}

fn compare(recorded: &[Recorded], logged: &[Recorded]) -> Compared {
    let mut places = BTreeMap::<&[u8], Vec<usize>>::new();
    for (place, message) in logged.iter().enumerate().rev() {
        places.entry(message.cdr.as_slice()).or_default().push(place);
    }
    let place_of = |message: &Recorded| places.get_mut(message.cdr.as_slice())?.pop();
    let found: BTreeSet<usize> = recorded.iter().filter_map(place_of).collect();
    let at = |place: Option<&usize>| place.map_or(0, |place| logged[*place].received);
    let within = (at(found.first()) + BORDER)..at(found.last()).saturating_sub(BORDER);
    let inside = (0..logged.len()).filter(|place| within.contains(&logged[*place].received));
    let (there, missing): (Vec<usize>, Vec<usize>) = inside.partition(|place| found.contains(place));
    Compared {
        recorded: recorded.len(),
        foreign: recorded.len() - found.len(),
        logged: there.len() + missing.len(),
        missing: missing.len(),
    }
}

/// Number of messages of the common time of two recordings; each has the same ones, in the same order.
#[track_caller]
fn agree(name: &str, one: &[Recorded], other: &[Recorded]) -> usize {
    let first = |messages: &[Recorded]| messages.first().map_or(u64::MAX, |message| message.sent);
    let last = |messages: &[Recorded]| messages.last().map_or(0, |message| message.sent);
    let common = first(one).max(first(other))..=last(one).min(last(other));
    let cut = |messages: &[Recorded]| -> Vec<(u64, Vec<u8>)> {
        let inside = messages.iter().filter(|message| common.contains(&message.sent));
        inside.map(|message| (message.sent, message.cdr.clone())).collect()
    };
    let (one, other) = (cut(one), cut(other));
    assert!(one == other, "{name}: {} and {} messages, or others", one.len(), other.len());
    one.len()
}

/// Publishes for the `n`th time what further sensors of such a robot would.
pub(crate) fn sense(robot: &mut Robot, n: i64) {
    let timestamp = 1_000_000 + 50_000 * n;
    let acceleration = [0.0, 0.0, 9.81];
    robot.publish(lowlevel::DataImu { timestamp, name: "base".into(), acceleration, ..Default::default() });
    let cells = vec![3.2, 3.3];
    robot.publish(lowlevel::DataBattery { timestamp, name: "pack".into(), cells, ..Default::default() });
    let temperatures = vec![lowlevel::Temperature { name: "case".into(), value: 31.5, over: false }];
    robot.publish(lowlevel::DataTemperature { timestamp, temperatures, ..Default::default() });
    let reading =
        |kind| lowlevel::Reading { timestamp, id: 1, kind, status: lowlevel::Reading::SILENT, ..Default::default() };
    let readings = [lowlevel::Reading::SONAR, lowlevel::Reading::INFRARED].map(reading).to_vec();
    robot.publish(lowlevel::DataRanges { timestamp, readings });
    let text = format!("text {n}, and letters beyond ASCII: größer");
    robot.publish(common::EventText { timestamp, module: "peer".into(), level: common::EventText::INFO, text });
}

/// The log of a robot that has ended, as the command line exports it.
fn exported(robot: &Robot) -> BTreeMap<String, Topic> {
    let folder = logs(&robot.run_dir);
    let mut entries = std::fs::read_dir(&folder).expect("the log folder").map(|entry| entry.expect("an entry").path());
    let run = entries.find(|path| path.is_dir()).expect("a run");
    let file = folder.join("exported.mcap");
    let (run, out) = (run.display().to_string(), file.display().to_string());
    let export = robot.advee(&["log", "export", &run, "--format", "mcap", "--out", &out]);
    assert!(export.status.success(), "{}", String::from_utf8_lossy(&export.stderr));
    read(&file)
}

#[test]
fn what_fast_dds_and_cyclone_dds_record_is_what_the_robot_logs() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &[]);
        let start = robot.view.truth.clone().expect("it is simulated");
        let config = workspace().join("conf/courier").display().to_string();
        let sent = robot.advee(&["--config", &config, "goal", "--route", "patrol", "--when-ready"]);
        assert!(sent.status.success(), "{}", String::from_utf8_lossy(&sent.stderr));

        robot.until("it has a plan", 30.0, |view| view.plan.as_ref().is_some_and(|plan| plan.x.len() > 10));

        let shared = SHARED.iter().map(|(topic, _)| *topic).filter(|topic| *topic != "/plan");
        let needed: Vec<&str> = shared.chain(OTHERS).collect();
        let (number, count) = (domain.to_string(), COUNT.to_string());
        let scripts = [("Fast DDS", "ros2_record.py"), ("Cyclone DDS", "ros2_record_cyclone.py")];
        let peers = scripts.map(|(name, script)| {
            let file = logs(&robot.run_dir).join(script).with_extension("mcap");
            let path = file.display().to_string();
            let args = [&[number.as_str(), &path, &count][..], &needed[..]].concat();
            (name, file, Peer::start(&python, script, &args))
        });
        let mut n = 0;
        let recordings = peers.map(|(name, file, peer)| {
            let said = peer.finish(&mut robot, |robot| {
                n += 1;
                sense(robot, n);
            });
            println!("{name}: {said}");
            (name, read(&file))
        });
        let end = robot.view.truth.clone().expect("it is simulated");
        assert!((end.x - start.x).hypot(end.y - start.y) > 0.5, "it did not drive: {}", robot.view.reason());
        assert_eq!(robot.stop(), 0);

        let log = exported(&robot);
        for (name, recording) in &recordings {
            let mut all = Compared::default();
            for (topic, in_log) in SHARED {
                let (recorded, logged) = (&recording[topic], &log[in_log]);
                let one = compare(&recorded.messages, &logged.messages);
                assert!(one.foreign == 0 && (one.missing == 0 || !recorded.reliable), "{name}, {topic}: {one:?}");
                all.recorded += one.recorded;
                all.logged += one.logged;
                all.missing += one.missing;
            }
            println!("{name}, topics that the log has as well: {all:?}");
        }
        // A plan that was driven, and not only empty ones.
        let [(_, fast), (_, cyclone)] = &recordings;
        assert!(fast["/plan"].messages.iter().any(|plan| plan.cdr.len() > 200));
        let reliable = fast.iter().filter(|(_, topic)| topic.reliable);
        let both = reliable.filter_map(|(name, topic)| Some((name, topic, cyclone.get(name)?)));
        let same: usize = both.map(|(name, one, other)| agree(name, &one.messages, &other.messages)).sum();
        println!("reliable messages of the common time in both recordings: {same}");
        assert!(same > COUNT);
    });
}

#[test]
fn nothing_reliable_is_lost_and_who_comes_late_gets_what_lasts() {
    let Some(python) = python() else { return };
    support::undisturbed(|| {
        let (domain, _held) = domain();
        let mut robot = courier(domain, &[]);
        let peer = Peer::start(&python, "ros2_long.py", &[&domain.to_string(), "6"]);
        let seen = peer.finish(&mut robot, |_| ());
        println!("{seen}");
        assert_eq!((&seen["lost"], &seen["again"]), (&Json::from(0), &Json::from(0)), "{seen}");
        // At 20 and at 10 Hz.
        let rates = [("/odom", 90), ("/tf", 180), ("/amcl_pose", 90), ("/diagnostics", 90), ("/advee/holds", 40)];
        for (topic, least) in rates {
            assert!(seen["topics"][topic]["count"].as_u64().is_some_and(|count| count > least), "{topic}: {seen}");
        }
        assert_eq!(seen["joins"].as_array().map(Vec::len), Some(1), "{seen}");
    });
}
