//! `advee log …` as used from the shell: on runs made here, on the official library's own log, and with its programs.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::command::Outcome;
use crate::support::{Robot, advee, alone, listen, python, unique_port, workspace};
use lcm::eventlog;
use lcm::live::{Hub, Lcm};
use lcm::tcpq::hub::{Limits, Overflow};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, WriteOptions, Writer};
use messages::{Channel, Message, common, lowlevel};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const OFFICIAL: &str = "foundation/lcm/tests/official.lcmlog";

/// Separate folder and bus.
struct Bench {
    url: String,
    folder: PathBuf,
}

impl Bench {
    fn new() -> Self {
        let (port, pid) = (unique_port(), std::process::id());
        let group = format!("239.255.{}.2", 1 + pid % 100);
        let folder = std::env::temp_dir().join(format!("advee-log-tools-{pid}-{port}"));
        fs::create_dir_all(&folder).unwrap();
        Self { url: format!("udpm://{group}:{port}?ttl=0"), folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = advee(&self.url, &self.folder.join("run"));
        command.arg("log").args(args).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn run(&self, args: &[&str]) -> Outcome {
        Outcome::of(self.command(args).output().unwrap())
    }

    /// Run of the robot in two files.
    fn sample(&self, name: &str) -> String {
        let folder = self.folder.join(name);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("log_000.mcap"), file(&messages()[..60], 0)).unwrap();
        fs::write(folder.join("log_001.mcap"), file(&messages()[60..], 60)).unwrap();
        folder.display().to_string()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Message of the sample: ms after its start, channel, data.
type Line = (u64, String, Vec<u8>);

const START: u64 = 1_700_000_000_000_000_000;

fn encoded(message: impl Into<Message>) -> Vec<u8> {
    let mut data = Vec::new();
    message.into().encode(&mut data).unwrap();
    data
}

/// 100 messages in 0.99 s: states, ranges (one more each time), commands, and one of unknown type.
fn messages() -> Vec<Line> {
    let range = |id| lowlevel::Range { id, x: 0.25, y: -1.0, theta: 0.0, distance: f64::NAN, valid: id > 1 };
    let line = |i: u64| {
        let timestamp = 1_700_000_000_000_000 + 10_000 * i as i64;
        let (channel, data) = match i % 4 {
            0 => ("CM_DATA_STATE", encoded(common::DataState { timestamp, module: "a, \"b\"".into(), state: 3 })),
            1 => (
                "LL_DATA_SRFS",
                encoded(lowlevel::DataSrfs { timestamp, srfs: (0..(i / 20) as i32).map(range).collect() }),
            ),
            2 => ("LL_CMD_MOTION", encoded(lowlevel::CmdMotion { timestamp, speed: 0.5, ..Default::default() })),
            _ => ("FOREIGN", vec![i as u8; 11]),
        };
        (10 * i, channel.to_owned(), data)
    };
    (0..100).map(line).collect()
}

/// Log file of these messages, each also in a ROS 2 form, which here is only a name and some bytes.
fn file(messages: &[Line], first: u32) -> Vec<u8> {
    let options = WriteOptions::new().compression(None).profile("ros2").library("advee test").chunk_size(Some(2000));
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options).unwrap();
    let text = |name: &str| {
        let files =
            messages::LCM_FILES.iter().filter(|(path, _)| path.ends_with(name) || path.ends_with("range_t.lcm"));
        files.map(|(_, text)| *text).collect::<String>()
    };
    let data = Cow::Borrowed(&b"[robot]\n"[..]);
    let (name, media_type) = ("robot.toml".into(), "text/plain".into());
    writer.attach(&Attachment { log_time: START, create_time: 0, name, media_type, data }).unwrap();
    let values = [("time", (START + u64::from(first) * 1000).to_string()), ("text", format!("mark {first}"))];
    let values = values.into_iter().map(|(key, value)| (key.to_string(), value)).collect();
    writer.write_metadata(&Metadata { name: "mark".into(), metadata: values }).unwrap();
    for (i, (ms, channel, data)) in messages.iter().enumerate() {
        let known = Channel::from_name(channel).map(Channel::type_name);
        let schema = known.map_or(0, |name| {
            let (_, short) = name.split_once('.').unwrap();
            writer.add_schema(name, "lcm", text(&format!("{short}.lcm")).as_bytes()).unwrap()
        });
        let none = BTreeMap::new();
        let raw = writer.add_channel(schema, channel, "lcm", &none).unwrap();
        let twin = writer.add_channel(0, &format!("/{channel}"), "cdr", &none).unwrap();
        let (sequence, log_time) = (first + i as u32, START + ms * 1_000_000);
        for (channel_id, data) in [(raw, &data[..]), (twin, b"\0\x01\0\0")] {
            writer
                .write_to_known_channel(&MessageHeader { channel_id, sequence, log_time, publish_time: log_time }, data)
                .unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn events(path: &str) -> Vec<Line> {
    let bytes = fs::read(path).unwrap();
    let mut reader = eventlog::Reader::new(&bytes[..]);
    let mut lines = Vec::new();
    while let Some(event) = reader.next_event().unwrap() {
        assert_eq!(event.number, lines.len() as i64);
        let ms = (event.timestamp_us as u64 * 1000).saturating_sub(START) / 1_000_000;
        lines.push((ms, event.channel.to_owned(), event.payload.to_vec()));
    }
    lines
}

#[test]
fn info_lists_times_channels_rates_attachments_and_marks() {
    let bench = Bench::new();
    let run = bench.sample("run");
    let text = bench.run(&["info", &run]).good();
    assert!(text.contains("from 2023-11-14 22:13:20.000000 to 2023-11-14 22:13:20.990000 UTC, 0.990 s"), "{text}");
    assert!(
        text.contains("200 messages on 8 channels") && text.contains("\n2 attachments, 16 B; --all lists them"),
        "{text}"
    );
    let all = bench.run(&["info", &run, "--all"]).good();
    assert!(all.contains("\nattachment robot.toml, 8 B"), "{all}");
    assert!(text.contains("mark 2023-11-14 22:13:20.000060 mark 60"), "{text}");
    let row = text.lines().find(|line| line.starts_with("LL_DATA_SRFS")).unwrap();
    assert_eq!(
        row.split_whitespace().collect::<Vec<_>>(),
        ["LL_DATA_SRFS", "lowlevel.data_srfs_t", "lcm", "25", "24.2", "-"]
    );
    let lines = bench.run(&["info", &run, "--json", "--check"]).values();
    let srfs = lines.iter().find(|line| line["channel"] == "LL_DATA_SRFS").unwrap();
    let bytes: usize = messages().iter().filter(|line| line.1 == "LL_DATA_SRFS").map(|line| line.2.len()).sum();
    assert_eq!((&srfs["messages"], &srfs["bytes"]), (&json!(25), &json!(bytes)));
    let log = &lines.last().unwrap()["log"];
    assert_eq!((&log["messages"], &log["duration_s"], &log["format"]), (&json!(200), &json!(0.99), &json!("mcap")));
    assert_eq!(log["files"][1]["indexed"], true);
    assert_eq!(log["marks"][1]["text"], "mark 60");

    // For a truncated file it reports so and shows the remaining content.
    let whole = file(&messages(), 0);
    let cut = bench.path("cut.mcap");
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let text = bench.run(&["info", &cut]).good();
    assert!(text.contains("was cut off") && text.contains("bytes of a record that is cut short"), "{text}");
    assert!(text.contains("CM_DATA_STATE"), "{text}");

    let text = bench.run(&["info", workspace().join(OFFICIAL).to_str().unwrap()]).good();
    assert!(text.contains("80 messages") && text.contains("LCM event log"), "{text}");
}

#[test]
fn cat_gives_json_lines_by_the_types_in_the_file() {
    let bench = Bench::new();
    let run = bench.sample("run");
    let lines = bench.run(&["cat", &run]).values();
    let sample = messages();
    assert_eq!(lines.len(), 100);
    for (line, (ms, channel, _)) in lines.iter().zip(&sample) {
        assert_eq!((&line["channel"], &line["log_time"]), (&json!(channel), &json!(START + ms * 1_000_000)));
    }
    assert_eq!(lines[0]["message"]["module"], "a, \"b\"");
    assert_eq!((&lines[99]["type"], &lines[99]["message"]["error"].is_string()), (&Value::Null, &true));
    let args = [
        "cat",
        &run,
        "--channel",
        "LL_.*SRFS",
        "--start",
        "0.5",
        "--end",
        "0.61",
        "--fields",
        "srfs[1].valid,srfs[9],timestamp",
    ];
    let lines = bench.run(&args).values();
    let one = |us: i64| json!({"srfs[1].valid": false, "srfs[9]": null, "timestamp": us});
    let found: Vec<&Value> = lines.iter().map(|line| &line["message"]).collect();
    assert_eq!(found, [53, 57, 61].map(|i| one(1_700_000_000_000_000 + 10_000 * i)).iter().collect::<Vec<_>>());
    let twins = bench.run(&["cat", &run, "--channel", "/FOREIGN", "--count", "1"]).values();
    assert_eq!(twins[0]["message"]["error"], "4 bytes of cdr, which is not decoded");
}

#[test]
fn exported_event_logs_are_read_by_the_official_library() {
    let bench = Bench::new();
    let (run, out) = (bench.sample("run"), bench.path("out.lcmlog"));
    let told = bench.run(&["export", &run, "--format", "lcm", "--out", &out]).good();
    assert_eq!(told, format!("{out}: 100 messages\n"));
    assert!(events(&out) == messages());
    assert!(!Path::new(&format!("{out}.part")).exists());
    let part = bench.path("part.lcmlog");
    bench
        .run(&["export", &run, "--format", "lcm", "--out", &part, "-c", "CM_.*", "-c", "FOREIGN", "--start", "0.9"])
        .good();
    let wanted = messages().into_iter().filter(|line| line.0 >= 900 && !line.1.starts_with("LL_"));
    assert!(events(&part).into_iter().eq(wanted));
    let Some(python) = python() else { return };
    let script = workspace().join("foundation/lcm/tests/it/eventlog/log.py");
    let read = Command::new(python).arg(script).arg("read").arg(&out).stdin(Stdio::null()).output().unwrap();
    let read = String::from_utf8(read.stdout).unwrap();
    let hex = |data: &[u8]| data.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let wanted = messages()
        .into_iter()
        .enumerate()
        .map(|(n, (ms, channel, data))| format!("{n} {} {channel} {}", (START + ms * 1_000_000) / 1000, hex(&data)));
    assert_eq!(read.lines().collect::<Vec<_>>(), wanted.collect::<Vec<_>>());
}

#[test]
fn an_export_replaces_files_alone() {
    let bench = Bench::new();
    let (run, out, link, pipe) = (bench.sample("run"), bench.path("file"), bench.path("link"), bench.path("pipe"));
    let export = |to: &str| bench.run(&["export", &run, "--format", "lcm", "--out", to]);
    export(&out).good();
    let whole = fs::read(&out).unwrap();
    fs::write(&out, "before").unwrap();
    std::os::unix::fs::symlink(&out, &link).unwrap();
    export(&link).good();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink() && fs::read(&out).unwrap() == whole);
    // As a device, a pipe is written to. A rename would put a file in its place, and leave its reader waiting.
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || fs::read(pipe).unwrap()
    });
    export(&pipe).good();
    assert!(!fs::metadata(&pipe).unwrap().is_file());
    assert!(reader.join().unwrap() == whole);
    export(&bench.path("")).bad();
}

#[test]
fn exported_tables_have_a_column_for_each_member_and_element() {
    let bench = Bench::new();
    let (run, out) = (bench.sample("run"), bench.path("tables"));
    let told = bench.run(&["export", &run, "--format", "csv", "--out", &out]);
    assert_eq!((told.code, told.err.as_str()), (Some(0), "advee: FOREIGN: no message can be decoded; left out\n"));
    let table = |name: &str| fs::read_to_string(format!("{out}/{name}.csv")).unwrap();
    let state = table("CM_DATA_STATE");
    let mut lines = state.lines();
    assert_eq!(lines.next(), Some("log_time,timestamp,module,state"));
    assert_eq!(lines.next(), Some("1700000000000000000,1700000000000000,\"a, \"\"b\"\"\",3"));
    assert_eq!(state.lines().count(), 26);
    let srfs = table("LL_DATA_SRFS");
    let rows: Vec<Vec<&str>> = srfs.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(
        rows[0][..8],
        [
            "log_time",
            "timestamp",
            "srfs[0].id",
            "srfs[0].x",
            "srfs[0].y",
            "srfs[0].theta",
            "srfs[0].distance",
            "srfs[0].valid"
        ]
    );
    assert!(rows.iter().all(|row| row.len() == 2 + 4 * 6), "{srfs}");
    assert_eq!(rows[25][8..14], ["1", "0.25", "-1.0", "0.0", "nan", "false"]);
    assert_eq!(rows[1][2..], [""; 24]);
    assert!(!Path::new(&format!("{out}/_CM_DATA_STATE.csv")).exists(), "the twins are no tables");
    let one = bench.run(&["export", &run, "--format", "csv", "--channel", "CM_DATA_STATE"]).good();
    assert_eq!(one, state);
    let error = bench.run(&["export", &run, "--format", "csv", "--channel", ".*DATA.*"]).bad();
    assert!(error.contains("2 channels") && error.contains("--out FOLDER"), "{error}");
    let told = bench.run(&["export", &run, "--format", "csv", "-c", "LL_DATA_SRFS", "--elements", "2"]);
    assert!(told.err.contains("elements beyond 2 of an array were left out"), "{}", told.err);
}

#[test]
fn of_many_channels_without_a_table_some_are_named() {
    let bench = Bench::new();
    let log = bench.path("log.mcap");
    let foreign = (0..23).map(|n| (n, format!("FOREIGN_{n:02}"), vec![7; 11]));
    let lines: Vec<Line> = foreign.chain(messages().into_iter().take(1)).collect();
    fs::write(&log, file(&lines, 0)).unwrap();
    let told = bench.run(&["export", &log, "--format", "csv", "--out", &bench.path("tables")]);
    let named = (0..20).map(|n| format!("advee: FOREIGN_{n:02}: no message can be decoded; left out\n"));
    let all = named.chain(["advee: 3 more channels: no message can be decoded; left out\n".into()]);
    assert_eq!((told.code, told.err), (Some(0), all.collect::<String>()));
}

#[test]
fn a_part_of_a_log_is_a_log_with_both_forms_and_all_attachments() {
    let bench = Bench::new();
    let (run, out) = (bench.sample("run"), bench.path("part.mcap"));
    bench.run(&["export", &run, "--format", "mcap", "--out", &out, "-c", "LL_DATA_SRFS", "--start", "0.5"]).good();
    let bytes = fs::read(&out).unwrap();
    let topics: Vec<String> =
        mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap().channel.topic.clone()).collect();
    assert_eq!(topics.len(), 24);
    assert!(topics.chunks(2).all(|pair| pair == ["LL_DATA_SRFS", "/LL_DATA_SRFS"]));
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.attachment_indexes.len(), 2);
    // All of its parts form the original log again.
    let all = bench.path("all.mcap");
    bench.run(&["export", &run, "--format", "mcap", "--out", &all]).good();
    assert!(bench.run(&["diff", &run, &all, "--times"]).good().starts_with("the same: 100 messages on 4 channels"));
    let read = |path: &str| bench.run(&["cat", path]).good();
    assert_eq!(read(&run), read(&all));
}

#[test]
fn what_is_imported_comes_out_again_and_ros_2_reads_it() {
    let bench = Bench::new();
    let (log, run, again) = (bench.path("in.lcmlog"), bench.path("imported"), bench.path("again.lcmlog"));
    let mut writer = eventlog::Writer::new(Vec::new());
    for (ms, channel, data) in messages() {
        writer.write(((START + ms * 1_000_000) / 1000) as i64, &channel, &data).unwrap();
    }
    fs::write(&log, writer.into_inner()).unwrap();
    let told = bench.run(&["import", &log, "--out", &run]).good();
    assert!(told.contains("100 messages in 1 files") && told.contains("25 of them only as they are"), "{told}");
    bench.run(&["export", &run, "--format", "lcm", "--out", &again]).good();
    assert!(events(&again) == messages());
    let info = bench.run(&["info", &run, "--json"]).values();
    let channel =
        |name: &str| info.iter().find(|line| line["channel"] == name).unwrap_or_else(|| panic!("{name}: {info:?}"));
    assert_eq!(
        (&channel("LL_DATA_SRFS")["types"][0], &channel("LL_DATA_SRFS")["encoding"]),
        (&json!("lowlevel.data_srfs_t"), &json!("lcm"))
    );
    assert_eq!(channel("/LL_DATA_SRFS")["types"][0], "lowlevel/msg/DataSrfs");
    assert_eq!(channel("/range/1")["types"][0], "sensor_msgs/msg/Range");
    assert_eq!(channel("FOREIGN")["types"], json!([]));
    let error = bench.run(&["import", &log, "--out", &run]).bad();
    assert!(error.ends_with("is there already and not empty"), "{error}");
    // Log of the official library.
    let (official, out) = (workspace().join(OFFICIAL).display().to_string(), bench.path("official"));
    bench.run(&["import", &official, "--out", &out]).good();
    assert!(bench.run(&["diff", &official, &out, "--times"]).good().starts_with("the same: 80 messages"));
}

#[test]
fn recover_restores_the_index_in_place_or_in_a_copy_and_reports_losses() {
    let bench = Bench::new();
    let whole = file(&messages(), 0);
    let (log, beside) = (bench.path("log.mcap"), bench.path("log.recovered.mcap"));
    fs::write(&log, &whole[..whole.len() * 2 / 3]).unwrap();
    let told = bench.run(&["recover", &log]).good();
    assert!(told.starts_with(&beside) && told.contains("cut short"), "{told}");
    assert_eq!(fs::read(&log).unwrap().len(), whole.len() * 2 / 3, "the file itself is as it was");
    let error = bench.run(&["recover", &log]).bad();
    assert!(error.contains("is there already"), "{error}");
    bench.run(&["recover", &log, "--in-place"]).good();
    assert!(bench.run(&["diff", &log, &beside, "--times"]).good().starts_with("the same"));
    assert!(mcap::Summary::read(&fs::read(&log).unwrap()).unwrap().unwrap().stats.unwrap().message_count > 50);
    assert_eq!(bench.run(&["recover", &log, "--in-place"]).good(), format!("{log}: is whole\n"));

    let mut bad = whole.clone();
    let chunk = mcap::Summary::read(&whole).unwrap().unwrap().chunk_indexes[2].clone();
    bad[(chunk.chunk_start_offset + chunk.chunk_length - 1) as usize] ^= 1;
    fs::write(&log, bad).unwrap();
    let lines = bench.run(&["recover", &log, "--in-place", "--json"]).values();
    assert_eq!(lines[0]["damaged_regions"], 1);
    assert_eq!(lines[0]["places"], json!([[chunk.chunk_start_offset, chunk.chunk_length]]));
    assert!(!Path::new(&bench.path("log.recovering")).exists());
    fs::write(&log, b"nothing of a log at all").unwrap();
    assert!(bench.run(&["recover", &log, "--in-place"]).bad().contains("there is no whole chunk in it"));
    assert_eq!(fs::read(&log).unwrap(), b"nothing of a log at all");
}

#[test]
fn diff_finds_the_first_message_that_differs() {
    let bench = Bench::new();
    let (a, b) = (bench.path("a.mcap"), bench.path("b.mcap"));
    let mut changed = messages();
    fs::write(&a, file(&changed, 0)).unwrap();
    let timestamp = 1_700_000_000_000_000;
    changed[8].2 = encoded(common::DataState { timestamp, module: "other".into(), state: 3 });
    changed.pop();
    changed[1].0 += 1;
    fs::write(&b, file(&changed, 0)).unwrap();
    let told = bench.run(&["diff", &a, &b]);
    assert_eq!((told.code, told.err.as_str()), (Some(1), "advee: 2 of 4 channels differ\n"));
    assert!(told.out.contains("CM_DATA_STATE: 25 messages, number 2 is the first that differs"), "{}", told.out);
    assert!(told.out.contains("\"module\":\"other\""), "{}", told.out);
    assert!(told.out.contains("FOREIGN: 25 messages, 24 in the other, the same as far as both go"), "{}", told.out);
    let told = bench.run(&["diff", &a, &b, "--times", "--json"]);
    let lines: Vec<Value> = told.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.iter().map(|line| &line["first"]).collect::<Vec<_>>(), [&json!(2), &Value::Null, &json!(0)]);
}

/// Takes `count` messages with the kernel's receive times.
fn take(bus: &mut Lcm, count: usize) -> Vec<(u64, String, Vec<u8>)> {
    let (mut taken, begin) = (Vec::new(), Instant::now());
    while taken.len() < count {
        assert!(begin.elapsed() < Duration::from_secs(30), "{} of {count} messages came", taken.len());
        bus.wait(Duration::from_millis(100)).unwrap();
        while let Some(message) = bus.recv().unwrap() {
            taken.push((message.at.0 as u64, message.channel.to_owned(), message.payload.to_vec()));
        }
    }
    taken
}

/// Number of 100 sleeps of 10 ms that end more than 1 ms late.
fn late_sleeps() -> usize {
    let late = |_: &i32| {
        let begin = Instant::now();
        std::thread::sleep(Duration::from_millis(10));
        begin.elapsed() > Duration::from_millis(11)
    };
    (0..100).filter(late).count()
}

#[test]
fn play_is_exact_in_order_and_in_time() {
    let _alone = alone();
    let bench = Bench::new();
    let run = bench.sample("run");
    let mut bus = listen(&bench.url);
    for (args, speed) in [(&["--commands"][..], 1.0), (&["--commands", "--speed", "4"], 4.0)] {
        let player = bench.command(&[&["play", &run, "--json"], args].concat()).spawn().unwrap();
        let machine = std::thread::spawn(late_sleeps);
        let taken = take(&mut bus, 100);
        let told = Outcome::of(player.wait_with_output().unwrap()).values();
        assert_eq!((&told[0]["messages"], &told[0]["channels"]), (&json!(100), &json!(4)));
        let sample = messages();
        assert!(
            taken
                .iter()
                .map(|(_, channel, data)| (channel, data))
                .eq(sample.iter().map(|(_, channel, data)| (channel, data)))
        );
        // Relative to the message that was earliest for its time: a delay of one message delays no other.
        let ahead = |(at, _, _): &Line, (ms, _, _): &Line| *at as i64 - (*ms as f64 * 1e6 / speed) as i64;
        let delays: Vec<i64> = taken.iter().zip(&sample).map(|(got, wanted)| ahead(got, wanted)).collect();
        let least = *delays.iter().min().unwrap();
        let is_late = |delay: &i64| *delay - least > 1_000_000;
        let late = delays.iter().filter(|delay| is_late(delay)).count();
        // Where the machine was busy in the same second, messages are late, but their delays do not add up: some are
        // on time in each quarter.
        let theirs = machine.join().unwrap();
        assert!(late <= 10 || theirs > 0, "{late} of 100 more than 1 ms late: {delays:?}");
        for quarter in delays.chunks(25) {
            assert!(!quarter.iter().all(is_late), "none of 25 within 1 ms: {delays:?}");
        }
    }
}

#[test]
fn play_takes_parts_renames_and_leaves_commands_out() {
    let bench = Bench::new();
    let run = bench.sample("run");
    let mut bus = listen(&bench.url);
    let args = ["play", &run, "--speed", "20", "--start", "0.5", "--rename", "FOREIGN=OTHER"];
    let told = bench.run(&args).good();
    assert!(told.starts_with("37 messages on 3 channels in "), "{told}");
    let taken = take(&mut bus, 37);
    assert!(taken.iter().any(|line| line.1 == "OTHER"));
    assert!(taken.iter().all(|line| line.1 != "LL_CMD_MOTION" && line.1 != "FOREIGN"));
    // An event log, repeated until the time is over.
    let log = bench.path("log.lcmlog");
    bench.run(&["export", &run, "--format", "lcm", "--out", &log, "-c", "FOREIGN"]).good();
    let told = bench.run(&["play", &log, "--speed", "50", "--loop", "--for", "1", "--json"]).values();
    assert!(told[0]["messages"].as_u64().unwrap() > 50, "{told:?}");
    // Logs that cannot be played or do not exist.
    let options = WriteOptions::new().compression(None);
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options).unwrap();
    let channel_id = writer.add_channel(0, "/imu", "cdr", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 0 };
    writer.write_to_known_channel(&header, b"").unwrap();
    writer.finish().unwrap();
    let bag = bench.path("bag.mcap");
    fs::write(&bag, writer.into_inner().into_inner()).unwrap();
    let error = bench.run(&["play", &bag]).bad();
    assert!(error.ends_with("has cdr and no messages of LCM; it cannot be played"), "{error}");
    assert!(bench.run(&["info", &bag]).good().contains("/imu"));
    for (args, says) in [
        (&["play", "/nowhere"][..], "No such file"),
        (&["play", &run, "--speed=-1"], "expected 0, or a factor from 0.01 to 1000"),
        (&["play", &run, "--start", "2", "--end", "1"], "--from is after --to"),
        (&["cat", &run, "--channel", "("], "channel pattern `(`"),
        (&["info", bench.folder.to_str().unwrap()], "no log there"),
        (&["export", &run, "--format", "lcm"], "--out"),
    ] {
        let error = bench.run(args).bad();
        assert!(error.starts_with("advee: ") && error.contains(says), "{args:?}: {error}");
    }
}

#[test]
fn beside_a_robot_a_log_is_played_by_force_alone_and_without_what_modules_decide_by() {
    const LINES: u64 = 60;
    let bench = Bench::new();
    let mut robot = Robot::ready(&[]);
    let line = |ms, message: Message| (ms, message.channel_name().into_owned(), encoded(message));
    let lines = (0..LINES).flat_map(|n| {
        // A robot that stands at a stop button, with modules that do not run, and a guard that permits nothing.
        let source = "button".into();
        [
            line(50 * n, lowlevel::EventStop { timestamp: 0, engaged: true, source }.into()),
            line(50 * n, common::DataProcesses::default().into()),
            line(50 * n, lowlevel::DataGuard::default().into()),
            line(50 * n, lowlevel::CmdMotion { speed: 9.0, ..Default::default() }.into()),
            (50 * n, "FOREIGN".to_owned(), vec![7; 11]),
        ]
    });
    let log = bench.path("robot.mcap");
    fs::write(&log, file(&lines.collect::<Vec<_>>(), 0)).unwrap();

    let refused = Outcome::of(robot.advee(&["log", "play", &log])).bad();
    assert!(refused.contains("the log is not played: a robot is on the bus"), "{refused}");
    robot.drive(0.4, 0.3, 1.5);
    let mut bus = Lcm::new(&lcm::Url::parse(&robot.url).unwrap().0).unwrap();
    bus.subscribe("LL_DATA_GUARD|CM_DATA_PROCESSES").unwrap();
    let mut player = robot.spawn(&["log", "play", &log, "--force"]);
    let mut slowest = f64::INFINITY;
    while player.try_wait().unwrap().is_none() {
        robot.drive(0.4, 0.3, 0.1);
        slowest = slowest.min(robot.view.speed());
        while let Some(received) = bus.recv().unwrap() {
            let played = [encoded(lowlevel::DataGuard::default()), encoded(common::DataProcesses::default())];
            assert!(!played.iter().any(|data| data == received.payload), "{} is played", received.channel);
        }
    }
    assert!(player.wait().unwrap().success());
    assert_eq!(robot.view.seen.get("FOREIGN"), Some(&(LINES as u32)));
    assert!(slowest > 0.35, "{slowest} m/s: {}", robot.view.reason());
    let told = |fault: base::Fault| robot.view.errors.iter().any(|error| error.number == fault as i32);
    assert!(!told(base::Fault::SecondRobot) && !told(base::Fault::MotionRefused));
}

/// External program, ended with the test.
struct Tool(Child);

impl Drop for Tool {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_official_logger_records_what_is_played() {
    let Some(python) = python() else { return };
    let bench = Bench::new();
    let (run, recorded) = (bench.sample("run"), bench.path("recorded.lcmlog"));
    let mut hub = Hub::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    let SocketAddr::V4(address) = hub.address().unwrap() else { panic!("an IPv4 address") };
    let url = lcm::Url::Tcpq(address).to_string();
    let mut logger = Command::new(python.with_file_name("lcm-logger"));
    logger.args(["-q", "-f", "-l", &url, "--flush-interval=100"]).arg(&recorded);
    let _logger = Tool(logger.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
    let until = Instant::now() + Duration::from_secs(20);
    while !hub.clients().any(|(_, _, client)| client.subscriptions == 1) {
        assert!(Instant::now() < until, "the logger does not come");
        hub.wait(Duration::from_millis(10)).unwrap();
        hub.serve_once().unwrap();
    }
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = stop.clone();
    let server = std::thread::spawn(move || {
        while !stopped.load(Ordering::Relaxed) {
            hub.wait(Duration::from_millis(10)).unwrap();
            hub.serve_once().unwrap();
        }
    });
    let mut player = advee(&url, &bench.folder.join("run"));
    player.args(["log", "play", &run, "--commands", "--loop", "--for", "3"]).stdin(Stdio::null());
    assert!(player.output().unwrap().status.success());
    stop.store(true, Ordering::Relaxed);
    server.join().unwrap();
    let bytes = fs::read(&recorded).unwrap();
    let mut reader = eventlog::Reader::new(&bytes[..]);
    let mut got = Vec::new();
    while let Some(event) = reader.next_event().unwrap() {
        got.push((event.timestamp_us, event.channel.to_owned(), event.payload.to_vec()));
    }
    let sample = messages();
    assert!(got.len() >= 100, "{}", got.len());
    for (got, wanted) in got.iter().zip(&sample) {
        assert!(got.1 == wanted.1 && got.2 == wanted.2);
    }
    // As recorded by the logger: 0.99 s from the first to the last.
    let took = (got[99].0 - got[0].0) as f64 / 1e6;
    assert!((took - 0.99).abs() < 0.05, "{took}");
}

/// As fast as the slowest takes it: of two clients one does not read before the hub has stopped reading for its sake.
#[test]
fn without_pace_nothing_is_lost_over_a_hub_that_waits() {
    const COUNT: u64 = 30_000;
    let Some(python) = python() else { return };
    let bench = Bench::new();
    let (log, recorded) = (bench.path("long.lcmlog"), bench.path("recorded.lcmlog"));
    let mut writer = eventlog::Writer::new(Vec::new());
    for n in 0..COUNT {
        // A message an hour: nobody waits for that.
        writer.write(n as i64 * 3_600_000_000, "LONG", &[n.to_be_bytes(); 125].concat()).unwrap();
    }
    fs::write(&log, writer.into_inner()).unwrap();
    let limits = Limits { queue: 64 << 10, overflow: Overflow::Wait, ..Limits::default() };
    let mut hub = Hub::with_limits(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0), limits).unwrap();
    let SocketAddr::V4(address) = hub.address().unwrap() else { panic!("an IPv4 address") };
    let url = lcm::Url::Tcpq(address);
    let mut logger = Command::new(python.with_file_name("lcm-logger"));
    logger.args(["-q", "-f", "-l", &url.to_string(), "--flush-interval=100"]).arg(&recorded);
    let _logger = Tool(logger.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
    let mut slow = Lcm::new(&url).unwrap();
    slow.subscribe("LONG").unwrap();
    let until = Instant::now() + Duration::from_secs(60);
    while hub.clients().filter(|(_, _, client)| client.subscriptions == 1).count() < 2 {
        assert!(Instant::now() < until, "not all clients come");
        slow.recv().unwrap();
        hub.wait(Duration::from_millis(10)).unwrap();
        hub.serve_once().unwrap();
    }
    let (held, stop) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    let (holds, stopped) = (held.clone(), stop.clone());
    let server = std::thread::spawn(move || {
        while !stopped.load(Ordering::Relaxed) {
            hub.wait(Duration::from_millis(10)).unwrap();
            hub.serve_once().unwrap();
            holds.fetch_or(hub.holds(), Ordering::Relaxed);
        }
        hub.stats()
    });
    let mut player = advee(&url.to_string(), &bench.folder.join("run"));
    player.args(["log", "play", &log, "--speed", "0", "--json"]).stdin(Stdio::null()).stdout(Stdio::piped());
    let player = player.spawn().unwrap();
    while !held.load(Ordering::Relaxed) {
        assert!(Instant::now() < until, "the hub never waits");
        std::thread::sleep(Duration::from_millis(1));
    }
    for n in 0..COUNT {
        let message = loop {
            assert!(Instant::now() < until, "{n} came");
            if let Some(message) = slow.recv_timeout(Duration::from_millis(100)).unwrap() {
                break message.payload[..8].to_vec();
            }
        };
        assert_eq!(message, n.to_be_bytes());
    }
    let told = player.wait_with_output().unwrap();
    let told: Value = serde_json::from_slice(&told.stdout).unwrap();
    assert_eq!((&told["messages"], &told["refused"]), (&json!(COUNT), &json!(0)));
    // The logger writes the last ones when a later one comes.
    let events = || {
        let bytes = fs::read(&recorded).unwrap();
        let mut reader = eventlog::Reader::new(&bytes[..]);
        let number = || {
            let event = reader.next_event().ok()??;
            (event.channel == "LONG").then(|| event.payload[..8].to_vec())
        };
        std::iter::from_fn(number).collect::<Vec<_>>()
    };
    while events().len() < COUNT as usize {
        assert!(Instant::now() < until, "{} in the official log", events().len());
        slow.publish("LATER", b"").unwrap();
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(events().into_iter().eq((0..COUNT).map(|n| n.to_be_bytes().to_vec())));
    stop.store(true, Ordering::Relaxed);
    let stats = server.join().unwrap();
    assert!(stats.published > COUNT && stats.delivered > 2 * COUNT && stats.dropped == 0, "{stats:?}");
}

#[test]
fn a_mark_reaches_the_logger_and_its_answer_is_printed() {
    let bench = Bench::new();
    let mut bus = listen(&bench.url);
    let mark = bench.command(&["mark", "the dog crossed"]).spawn().unwrap();
    let heard = take(&mut bus, 1).remove(0);
    let Some(Ok(Message::CmCmdLog(command))) = Message::receive(&heard.1, &heard.2) else { panic!("{heard:?}") };
    assert_eq!((command.action, command.text.as_str()), (common::CmdLog::MARK, "the dog crossed"));
    let status = common::DataLog { recording: true, run: "2026_01_02_03_04_05".into(), ..Default::default() };
    bus.publish("CM_DATA_LOG", &encoded(status)).unwrap();
    assert_eq!(Outcome::of(mark.wait_with_output().unwrap()).good(), "marked in 2026_01_02_03_04_05\n");
    let alone = bench.run(&["mark", "x"]);
    assert!(alone.code == Some(0) && alone.err.contains("no logger is heard"), "{alone:?}");
    assert!(bench.run(&["mark", ""]).bad().contains("1 to 1000 bytes"));
}

#[test]
fn a_run_is_begun_and_ended_by_command_once_the_logger_confirms_it() {
    let run = "2026_01_02_03_04_05";
    let (begun, ended) = (format!("records in {run}\n"), String::from("the run has ended\n"));
    for (verb, action, printed) in [("start", common::CmdLog::START, begun), ("stop", common::CmdLog::STOP, ended)] {
        let bench = Bench::new();
        let mut bus = listen(&bench.url);
        let tool = bench.command(&[verb]).spawn().unwrap();
        let heard = take(&mut bus, 1).remove(0);
        let Some(Ok(Message::CmCmdLog(command))) = Message::receive(&heard.1, &heard.2) else { panic!("{heard:?}") };
        assert_eq!(command.action, action);
        // The state before the command is no confirmation.
        let begins = verb == "start";
        for recording in [!begins, begins] {
            let status = common::DataLog { recording, run: run.into(), ..Default::default() };
            bus.publish("CM_DATA_LOG", &encoded(status)).unwrap();
        }
        assert_eq!(Outcome::of(tool.wait_with_output().unwrap()).good(), printed);
        assert!(bench.run(&[verb]).bad().contains("no logger is heard"));
    }
}
