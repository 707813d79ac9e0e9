//! `advee lcm …` as used from the shell, each on a separate bus, against publishers in the test.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::command::Outcome;
use crate::support::{advee, listen, signal, unique_port};
use lcm::live::Lcm;
use messages::{Message, common, lowlevel};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Separate bus.
struct Bench {
    url: String,
    folder: PathBuf,
}

impl Bench {
    fn new() -> Self {
        let (port, pid) = (unique_port(), std::process::id());
        let group = format!("239.255.{}.1", 100 + pid % 100);
        let folder = std::env::temp_dir().join(format!("advee-lcm-tools-{pid}-{port}"));
        std::fs::create_dir_all(&folder).unwrap();
        Self { url: format!("udpm://{group}:{port}?ttl=0"), folder }
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = advee(&self.url, &self.folder);
        command.arg("lcm").args(args).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn run(&self, args: &[&str]) -> Outcome {
        Outcome::of(self.command(args).output().expect("the executable is built"))
    }

    /// Publishes all messages every 10 ms, until dropped.
    fn publish(&self, messages: Vec<(String, Vec<u8>)>) -> Publisher {
        let (url, stop) = (self.url.clone(), Arc::new(AtomicBool::new(false)));
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            let mut lcm = Lcm::new(&lcm::Url::parse(&url).unwrap().0).unwrap();
            while !stopped.load(Ordering::Relaxed) {
                messages.iter().for_each(|(channel, data)| lcm.publish(channel, data).unwrap());
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        Publisher { stop, thread: Some(thread) }
    }

    fn file(&self, name: &str, text: &str) -> String {
        let path = self.folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

struct Publisher {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn state(state: i8) -> Vec<u8> {
    encoded(common::DataState { timestamp: 7, module: "driver".into(), state })
}

fn encoded(message: impl Into<Message>) -> Vec<u8> {
    let mut data = Vec::new();
    message.into().encode(&mut data).unwrap();
    data
}

fn some() -> Vec<(String, Vec<u8>)> {
    vec![
        ("CM_DATA_STATE".into(), state(3)),
        ("LL_DATA_ODO".into(), encoded(lowlevel::DataOdo::default())),
        ("SOMEBODY".into(), state(1)),
        ("\u{1b}[2JX".into(), vec![0xAB; 12]),
        ("SHORT".into(), vec![]),
    ]
}

fn json_lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn list_shows_every_channel_with_type_rate_and_size() {
    let bench = Bench::new();
    let _publisher = bench.publish(some());
    let text = bench.run(&["list", "--for", "1"]).good();
    assert!(!text.contains('\u{1b}'), "a pipe gets no escape sequences, whatever a channel is called:\n{text}");
    let row = |name: &str| {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name}:\n{text}"));
        line.split_whitespace().map(String::from).collect::<Vec<_>>()
    };
    assert_eq!(row("CHANNEL")[..2], ["CHANNEL", "TYPE"]);
    assert_eq!(row("CM_DATA_STATE")[1], "common.data_state_t");
    assert_eq!(row("SOMEBODY")[1], "common.data_state_t");
    assert_eq!(row("\\u{1b}[2JX")[1..3], ["unknown", "abababababababab"]);
    assert_eq!(row("SHORT")[1..3], ["no", "message"]);
    let hz: f64 = row("CM_DATA_STATE")[2].parse().unwrap();
    assert!(hz > 1.0 && hz <= 101.0, "{text}");
    assert!(text.lines().last().unwrap().starts_with("5 channels, "), "{text}");

    let lines = json_lines(&bench.run(&["list", ".*_DATA_.*", "--json", "--for", "0.5"]).good());
    let [state, odo, total] = &lines[..] else { panic!("{lines:?}") };
    assert_eq!((&state["channel"], &odo["channel"]), (&json!("CM_DATA_STATE"), &json!("LL_DATA_ODO")));
    assert_eq!(state["type"], "common.data_state_t");
    assert_eq!(state["bytes"].as_u64().unwrap(), state["messages"].as_u64().unwrap() * self::state(3).len() as u64);
    assert!(state["gap_s"]["min"].as_f64().unwrap() <= state["gap_s"]["max"].as_f64().unwrap());
    assert_eq!((&total["total"]["channels"], &total["total"]["lost"]), (&json!(2), &json!(0)));
    // In addition to the listener itself, which performs a self test.
    let publishers = total["total"]["publishers"].as_array().unwrap();
    assert_eq!(publishers.iter().filter(|publisher| publisher["datagrams"].as_u64().unwrap() > 10).count(), 1);
    let keys: Vec<&str> = state.as_object().unwrap().keys().map(String::as_str).collect();
    let expected =
        ["age_s", "bytes", "bytes_per_s", "channel", "fingerprint", "gap_s", "hz", "messages", "size", "type"];
    assert_eq!(keys, [&expected[..], &["wrong"]].concat());
}

#[test]
fn hz_and_bw_measure_the_channels_asked_for() {
    let bench = Bench::new();
    let _publisher = bench.publish(some());
    let text = bench.run(&["hz", "CM_DATA_STATE", "--for", "1", "--window", "1"]).good();
    let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines[0], ["CHANNEL", "HZ", "MEAN", "ms", "MIN", "ms", "MAX", "ms", "STD", "ms", "COUNT"]);
    let numbers: Vec<f64> = lines[1][1..].iter().map(|cell| cell.parse().unwrap()).collect();
    let [hz, mean, min, max, ..] = numbers[..] else { panic!("{text}") };
    assert!((hz * mean / 1000.0 - 1.0).abs() < 0.01 && min <= mean && mean <= max, "{text}");

    let text = bench.run(&["bw", "CM_DATA_STATE|SHORT", "--for", "1"]).good();
    let row: Vec<&str> = text.lines().nth(1).unwrap().split_whitespace().collect();
    let (size, kb, hz): (f64, f64, f64) = (state(3).len() as f64, row[1].parse().unwrap(), row[2].parse().unwrap());
    assert_eq!(row[3..6], [size.to_string(), size.to_string(), size.to_string()]);
    assert!((kb * 1e3 / hz - size).abs() < 0.05 * size, "{text}");
    assert!(text.contains("\nSHORT"), "{text}");
}

#[test]
fn silence_is_reported_with_the_bus() {
    let bench = Bench::new();
    for args in [&["list"][..], &["hz", "A"], &["bw", "A"], &["echo", "A"], &["list", "--json"]] {
        let Outcome { code, out, err } = bench.run(&[args, &["--for", "0.2"]].concat());
        assert_eq!(code, Some(0));
        assert!(err.contains("is heard on udpm://239.255.") && err.ends_with("is anyone publishing?\n"), "{err}");
        assert!(out.lines().count() <= 2 && (args[0] != "echo" || out.is_empty()), "{out}");
    }
    let error = bench.run(&["echo", "A", "--count", "1", "--for", "0.2"]).refused();
    assert!(error.ends_with("0 of 1 messages came, then the time was over"), "{error}");
    let _publisher = bench.publish(some());
    let outcome = bench.run(&["echo", "SHORT", "--count", "1000000", "--for", "0.3"]);
    assert!(!outcome.out.is_empty());
    let error = outcome.bad();
    assert!(error.ends_with("of 1000000 messages came, then the time was over"), "{error}");
}

#[test]
fn mistakes_on_the_command_line_are_one_line_each() {
    let bench = Bench::new();
    let broken = bench.file("broken/x.lcm", "package p;\nstruct t { int32_t }\n");
    let missing = bench.folder.join("missing").display().to_string();
    let empty = bench.folder.join("empty");
    std::fs::create_dir(&empty).unwrap();
    for (args, says) in [
        (&["echo", "("][..], "channel pattern `(`"),
        (&["list", "A{2"], "channel pattern `A{2`"),
        (&["echo", "A", "--types", &missing], "No such file"),
        (&["list", "--types", &broken], "x.lcm:2:"),
        (&["list", "--types", empty.to_str().unwrap()], "no .lcm file there"),
        (&["hz", "A", "--for", "0"], "expected seconds above 0"),
        (&["pub", "NOBODY", "{}"], "NOBODY is no channel of the robot's; --type says which type it has"),
        (&["pub", "A", "{}", "--type", "p.t"], "p.t: no such type; --types says where it is"),
        (&["pub", "CM_DATA_STATE", "{"], "no JSON: EOF while parsing an object at line 1 column 1"),
        (&["pub", "CM_DATA_STATE", "{}"], "common.data_state_t: timestamp: missing"),
        (&["pub", "CM_DATA_STATE", r#"{"timestamp":0,"module":"","state":200}"#], "state: out of the range of int8_t"),
        (&["pub", "CM_DATA_STATE", r#"{"speed":1}"#], "speed: no such member"),
        (&["pub", "CM_DATA_STATE", "{}", "--rate", "0"], "expected Hz from 0.001 to 100000"),
        (&["pub", &"X".repeat(64), "{}", "--type", "lowlevel.data_odo_t", "--defaults"], "LCM publish"),
    ] {
        let error = bench.run(args).refused();
        assert!(error.starts_with("advee: ") && error.contains(says), "{args:?}: {error}");
    }
}

/// Subscribes like a module to the output of `advee lcm pub`.
fn take(lcm: &mut Lcm, count: usize) -> Vec<(String, Vec<u8>)> {
    let mut taken = Vec::new();
    let begin = std::time::Instant::now();
    while taken.len() < count {
        assert!(begin.elapsed() < Duration::from_secs(20), "{} of {count} messages came", taken.len());
        lcm.wait(Duration::from_millis(200)).unwrap();
        while let Some(message) = lcm.recv().unwrap() {
            taken.push((message.channel.into(), message.payload.into()));
        }
    }
    taken
}

#[test]
fn pub_sends_what_generated_code_would() {
    let bench = Bench::new();
    let mut bus = listen(&bench.url);
    let text = r#"{"timestamp":7,"module":"driver","state":3}"#;
    assert_eq!(bench.run(&["pub", "CM_DATA_STATE", text]).good(), "");
    assert_eq!(take(&mut bus, 1), [("CM_DATA_STATE".to_string(), state(3))]);

    let range = lowlevel::Range { id: 1, x: 0.1, y: -2.5, theta: 0.0, distance: f64::INFINITY, valid: true };
    let text =
        r#"{"timestamp":9007199254740993,"irs":[{"id":1,"x":0.1,"y":-2.5,"theta":0,"distance":"inf","valid":true}]}"#;
    bench.run(&["pub", "MINE", text, "--type", "lowlevel.data_irs_t"]).good();
    let expected = encoded(lowlevel::DataIrs { timestamp: 9_007_199_254_740_993, irs: vec![range] });
    assert_eq!(take(&mut bus, 1), [("MINE".to_string(), expected)]);

    bench.run(&["pub", "CM_DATA_STATE", r#"{"timestamp":"now"}"#, "--defaults", "--count", "3", "--rate", "50"]).good();
    let times: Vec<i64> = take(&mut bus, 3)
        .iter()
        .map(|(_, data)| match Message::decode(messages::Channel::CmDataState, data) {
            Ok(Message::CmDataState(state)) => state.timestamp,
            other => panic!("{other:?}"),
        })
        .collect();
    // Absolute deadlines: two periods of 20 ms lie between the first and the last, whatever delays the one between.
    assert!(times[0] > 1_600_000_000_000_000 && times[2] - times[0] > 20_000, "{times:?}");
    assert!(bus.recv().unwrap().is_none());

    bench.run(&["pub", "CM_DATA_STATE", "{}", "--defaults", "--rate", "100", "--for", "0.3"]).good();
    assert!(take(&mut bus, 2).len() <= 31);
}

#[test]
fn pub_reads_a_message_a_line_and_echo_writes_them() {
    let bench = Bench::new();
    let mut bus = listen(&bench.url);
    let mut publisher = bench.command(&["pub", "CM_DATA_STATE", "-"]).stdin(Stdio::piped()).spawn().unwrap();
    let mut stdin = publisher.stdin.take().unwrap();
    // Half a line is not a message yet, and the last one needs no line end.
    stdin.write_all(b"{\"timestamp\":7,\"module\":\"driver\",\"state\":1}\n\n{\"timestamp\":7,\"module\":").unwrap();
    assert_eq!(take(&mut bus, 1)[0].1, state(1));
    stdin.write_all(b"\"driver\",\"state\":2}\n{\"timestamp\":7,\"module\":\"driver\",\"state\":3}").unwrap();
    drop(stdin);
    assert_eq!(take(&mut bus, 2).into_iter().map(|(_, data)| data).collect::<Vec<_>>(), [state(2), state(3)]);
    Outcome::of(publisher.wait_with_output().unwrap()).good();

    let mut publisher = bench.command(&["pub", "CM_DATA_STATE", "-"]).stdin(Stdio::piped()).spawn().unwrap();
    publisher.stdin.take().unwrap().write_all(b"\n{\"timestamp\":7,\"module\":1}\n").unwrap();
    let error = Outcome::of(publisher.wait_with_output().unwrap()).refused();
    assert_eq!(error, "advee: stdin, line 2: common.data_state_t: state: missing");
}

#[test]
fn pub_ends_on_a_signal_although_stdin_stays_open() {
    let bench = Bench::new();
    let mut timed =
        bench.command(&["pub", "CM_DATA_STATE", "-", "--for", "0.2"]).stdin(Stdio::piped()).spawn().unwrap();
    let _open = timed.stdin.take();
    Outcome::of(timed.wait_with_output().unwrap()).good();

    let mut bus = listen(&bench.url);
    let mut publisher = bench.command(&["pub", "CM_DATA_STATE", "-"]).stdin(Stdio::piped()).spawn().unwrap();
    let mut stdin = publisher.stdin.take().unwrap();
    stdin.write_all(b"{\"timestamp\":7,\"module\":\"driver\",\"state\":1}\n").unwrap();
    assert_eq!(take(&mut bus, 1)[0].1, state(1));
    signal(publisher.id() as i32, "INT");
    Outcome::of(publisher.wait_with_output().unwrap()).good();
}

#[test]
fn echo_shows_messages_on_a_line_on_many_and_as_json() {
    let bench = Bench::new();
    let _publisher = bench.publish(some());
    let compact = bench.run(&["echo", "CM_DATA_STATE", "--count", "2"]).good();
    assert_eq!(compact, "CM_DATA_STATE timestamp=7 module=\"driver\" state=3\n".repeat(2));
    let pretty = bench.run(&["echo", "CM_DATA_STATE", "--count", "1", "--pretty"]).good();
    let (head, rest) = pretty.split_once('\n').unwrap();
    assert!(head.starts_with("CM_DATA_STATE common.data_state_t "), "{pretty}");
    assert_eq!(rest, "  timestamp: 7\n  module: \"driver\"\n  state: 3\n");
    let json = json_lines(&bench.run(&["echo", "CM_DATA_STATE", "--count", "1", "--json"]).good());
    assert_eq!(json[0]["type"], "common.data_state_t");
    assert_eq!(json[0]["message"], json!({"timestamp": 7, "module": "driver", "state": 3}));

    let unknown = bench.run(&["echo", ".*X", "--count", "1"]).good();
    assert_eq!(unknown, "\\u{1b}[2JX: 12 bytes, unknown type 0xabababababababab; --types says where it is\n");
}

#[test]
fn foreign_types_are_read_from_their_files() {
    let bench = Bench::new();
    // A robot's type within a foreign one, and another version of a robot's type.
    bench.file("types/a.lcm", "package theirs; struct scan_t { int32_t n; lowlevel.range_t ranges[n]; byte raw[2]; }");
    bench.file("types/deep/b.lcm", "package common; struct data_state_t { string text; }");
    bench.file("types/README", "no type file");
    let types = bench.folder.join("types").display().to_string();
    let types = types.as_str();
    let mut echo = bench.command(&["echo", "SCAN|CM_DATA_STATE", "--count", "3", "--types", types]).spawn().unwrap();
    let scan = r#"{"raw":"0aff","ranges":[{"id":1,"x":1,"y":0,"theta":0,"distance":null,"valid":1}]}"#;
    let publish = || {
        bench.run(&["pub", "SCAN", scan, "--type", "theirs.scan_t", "--types", types]).good();
        bench.run(&["pub", "CM_DATA_STATE", r#"{"text":"theirs"}"#, "--types", types]).good();
        bench.run(&["pub", "CM_DATA_STATE", r#"{"timestamp":7,"module":"driver","state":3}"#]).good();
    };
    let out = loop {
        publish();
        if echo.try_wait().unwrap().is_some() {
            break Outcome::of(echo.wait_with_output().unwrap()).good();
        }
    };
    for expected in [
        "SCAN ranges=[{id=1 x=1.0 y=0.0 theta=0.0 distance=null valid=true}] raw=[10 255]",
        "CM_DATA_STATE text=\"theirs\"",
        "CM_DATA_STATE timestamp=7 module=\"driver\" state=3",
    ] {
        assert!(out.lines().any(|line| line == expected), "{expected}:\n{out}");
    }
}

#[test]
fn losses_are_reported_by_publisher() {
    let bench = Bench::new();
    let stop = Arc::new(AtomicBool::new(false));
    let (stopped, url) = (stop.clone(), lcm::Url::parse(&bench.url).unwrap().0);
    let lcm::Url::Udpm(url) = url else { panic!("{}", bench.url) };
    // Every third sequence number is missing.
    let thread = std::thread::spawn(move || {
        let socket = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
        socket.set_multicast_ttl_v4(0).unwrap();
        for sequence in (0_u32..).filter(|sequence| sequence % 3 != 2) {
            if stopped.load(Ordering::Relaxed) {
                break;
            }
            let datagram = [&b"LC02"[..], &sequence.to_be_bytes(), b"A\0", &state(3)].concat();
            let _ = socket.send_to(&datagram, (url.group, url.port));
            std::thread::sleep(Duration::from_millis(5));
        }
        socket.local_addr().unwrap().port()
    });
    let text = bench.run(&["list", "--for", "1"]).good();
    let lines = json_lines(&bench.run(&["list", "A", "--json", "--for", "1"]).good());
    stop.store(true, Ordering::Relaxed);
    let port = thread.join().unwrap();
    let summary = text.lines().last().unwrap();
    assert!(summary.contains(" LOST (") && summary.ends_with(&format!(":{port})")), "{text}");
    let total = &lines[1]["total"];
    let (lost, messages) = (total["lost"].as_u64().unwrap(), total["messages"].as_u64().unwrap());
    assert!(lost > 0 && lost.abs_diff(messages / 2) <= 1, "{total}");
    assert_eq!(total["publishers"][0]["lost"], lost);
}

#[test]
fn a_log_is_received_like_a_bus() {
    let bench = Bench::new();
    let path = bench.folder.join("some.log").display().to_string();
    let write = lcm::Url::parse(&format!("file://{path}?mode=w")).unwrap().0;
    let mut log = Lcm::new(&write).unwrap();
    some().iter().for_each(|(channel, data)| log.publish(channel, data).unwrap());
    drop(log);
    let url = format!("file://{path}?speed=0");
    let run = |args: &[&str]| Outcome::of(bench.command(args).args(["--lcm-url", &url]).output().unwrap());
    let text = run(&["echo", "CM_.*"]).good();
    assert_eq!(text, "CM_DATA_STATE timestamp=7 module=\"driver\" state=3\n");
    assert!(run(&["list"]).good().contains("5 channels, "));
    let nobody = run(&["echo", "NOBODY"]);
    assert_eq!((nobody.code, nobody.out.as_str()), (Some(0), ""));
    assert!(nobody.err.starts_with("advee: nothing on NOBODY is heard on file://"), "{}", nobody.err);
}

/// Reads the first line printed by a running command.
fn first_line(child: &mut Child) -> (String, BufReader<ChildStdout>) {
    let mut reader = BufReader::new(child.stdout.take().unwrap());
    let mut line = String::new();
    reader.read_line(&mut line).unwrap();
    (line, reader)
}

#[test]
fn a_closed_pipe_ends_the_command_silently() {
    let bench = Bench::new();
    let _publisher = bench.publish(some());
    let mut echo = bench.command(&["echo", ".*"]).spawn().unwrap();
    let (line, reader) = first_line(&mut echo);
    assert!(!line.is_empty());
    drop(reader);
    let mut error = String::new();
    echo.stderr.take().unwrap().read_to_string(&mut error).unwrap();
    assert_eq!((echo.wait().unwrap().code(), error.as_str()), (Some(0), ""));
}

#[test]
fn ctrl_c_ends_every_command_with_success() {
    let bench = Bench::new();
    let _publisher = bench.publish(some());
    let mut echo = bench.command(&["echo", "CM_DATA_STATE"]).spawn().unwrap();
    let (line, _reader) = first_line(&mut echo);
    assert!(line.starts_with("CM_DATA_STATE "));
    signal(echo.id() as i32, "INT");
    assert_eq!(echo.wait().unwrap().code(), Some(0));

    let mut bus = listen(&bench.url);
    let publish = bench.command(&["pub", "LL_CMD_HOMING", "{}", "--defaults", "--rate", "20"]).spawn().unwrap();
    while !take(&mut bus, 1).iter().any(|(channel, _)| channel == "LL_CMD_HOMING") {}
    signal(publish.id() as i32, "INT");
    Outcome::of(publish.wait_with_output().unwrap()).good();
}
