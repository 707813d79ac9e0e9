//! Event logs: one that the official logger wrote, and both ways with the official library, logger and player.
#![cfg(feature = "live")]
#![allow(clippy::disallowed_methods, reason = "real files and processes")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use lcm::eventlog::{Event, Reader, Stats, Writer};
use lcm::live::{Hub, Lcm};
use lcm::url::Url;
use std::fs;
use std::io::{Cursor, Write};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use testing::{peer_or_skip, python};

const OFFICIAL: &[u8] = include_bytes!("../official.lcmlog");
/// Whatever has not happened by then does not happen.
const PATIENCE: Duration = Duration::from_secs(20);

/// `number timestamp channel data`, as `log.py` says it.
fn line(event: &Event<'_>) -> String {
    let data: String = event.payload.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("{} {} {} {data}", event.number, event.timestamp_us, event.channel)
}

fn lines(log: &[u8]) -> (Vec<String>, Stats) {
    let mut reader = Reader::new(log);
    let mut lines = Vec::new();
    while let Some(event) = reader.next_event().unwrap() {
        lines.push(line(&event));
    }
    (lines, *reader.stats())
}

/// A log of ours: sizes from nothing to 200 000 bytes, a sync word in the data, a long channel.
fn ours() -> Vec<u8> {
    let mut writer = Writer::new(Vec::new());
    let large: Vec<u8> = (0..200_000).map(|i| (i * 7 + (i >> 8)) as u8).collect();
    let long = "x".repeat(63);
    let sync: &[u8] = &[0xed, 0xa1, 0xda, 0x01, 0, 0, 0, 0];
    for (n, (channel, data)) in [("A", &large[..]), ("EMPTY", b""), ("SYNC", sync), (&long, b"x")].iter().enumerate() {
        writer.write(1_700_000_000_000_000 + 1000 * n as i64, channel, data).unwrap();
    }
    writer.into_inner()
}

#[test]
fn the_official_log_says_what_its_index_says() {
    let mut reader = Reader::new(OFFICIAL);
    for line in include_str!("../official_log.txt").lines().skip(1) {
        let event = reader.next_event().unwrap().unwrap();
        let Event { number, timestamp_us, channel, payload } = event;
        assert_eq!(format!("{number} {timestamp_us} {channel} {}", payload.len()), line);
    }
    assert_eq!(reader.next_event().unwrap(), None);
    assert_eq!(*reader.stats(), Stats { events: 80, ..Stats::default() });
}

#[test]
fn the_official_log_written_again_is_the_same_to_the_byte() {
    let mut reader = Reader::new(OFFICIAL);
    let (mut by_number, mut as_it_was) = (Writer::new(Vec::new()), Writer::new(Vec::new()));
    while let Some(event) = reader.next_event().unwrap() {
        by_number.write(event.timestamp_us, event.channel, event.payload).unwrap();
        as_it_was.write_event(&event).unwrap();
    }
    assert!(by_number.into_inner() == OFFICIAL && as_it_was.into_inner() == OFFICIAL);
}

#[test]
fn the_official_log_is_found_by_time() {
    let (all, _) = lines(OFFICIAL);
    let mut reader = Reader::new(Cursor::new(OFFICIAL));
    for (n, line) in all.iter().enumerate() {
        let timestamp: i64 = line.split(' ').nth(1).unwrap().parse().unwrap();
        for (wanted, number) in [(timestamp - 1, n), (timestamp, n), (timestamp + 1, n + 1)] {
            reader.seek_to_timestamp(wanted).unwrap();
            assert_eq!(reader.next_event().unwrap().map_or(80, |event| event.number), number as i64);
        }
    }
}

/// `log.py` with a role and a file, and what it shall read; what it says.
fn official(python: &Path, role: &str, path: &Path, input: &str) -> Vec<String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/eventlog/log.py");
    let mut command = Command::new(python);
    command.arg(script).arg(role).arg(path).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut process = command.spawn().unwrap();
    process.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = process.wait_with_output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap().lines().map(Into::into).collect()
}

/// A file of this run, gone with the test.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        Self(Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}.lcmlog", std::process::id())))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

#[test]
fn the_official_library_reads_our_log_and_we_read_its() {
    let Some(python) = peer_or_skip(python(&["lcm"])) else { return };
    let (theirs, mine) = (Scratch::new("theirs"), Scratch::new("ours"));
    fs::write(&mine.0, ours()).unwrap();
    let (wanted, _) = lines(&ours());
    assert!(official(&python, "read", &mine.0, "") == wanted);
    official(&python, "write", &theirs.0, &(wanted.join("\n") + "\n"));
    assert!(fs::read(&theirs.0).unwrap() == ours(), "the same to the byte");
}

#[test]
fn the_official_library_reads_on_in_a_log_that_we_appended_to() {
    let Some(python) = peer_or_skip(python(&["lcm"])) else { return };
    let log = Scratch::new("appended");
    fs::write(&log.0, &OFFICIAL[..OFFICIAL.len() - 3]).unwrap();
    let url = Url::parse(&format!("file://{}?mode=a", log.0.display())).unwrap().0;
    Lcm::new(&url).unwrap().publish("AFTER", b"x").unwrap();
    Lcm::new(&url).unwrap().publish("AFTER", b"y").unwrap();
    let read = official(&python, "read", &log.0, "");
    assert_eq!(read[..79], lines(OFFICIAL).0[..79]);
    let number_and_data = |line: &String| line.split(' ').step_by(3).collect::<Vec<_>>().join(" ");
    assert_eq!(read[79..].iter().map(number_and_data).collect::<Vec<_>>(), ["79 78", "80 79"]);
}

/// An official program, ended with the test.
struct Tool(Child);

impl Tool {
    fn start(python: &Path, name: &str, url: &Url, more: &[&str], log: &Path) -> Self {
        let mut command = Command::new(python.with_file_name(name));
        command.args(["-l", &url.to_string()]).args(more).arg(log);
        Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Tool {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A hub, and a client of it that is connected and knows `subscriptions`; over TCP nothing gets lost between programs.
fn bus(subscriptions: &[&str]) -> (Hub, Lcm, Url) {
    let mut hub = Hub::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    let SocketAddr::V4(address) = hub.address().unwrap() else { panic!("an IPv4 address") };
    let mut lcm = Lcm::new(&Url::Tcpq(address)).unwrap();
    for pattern in subscriptions {
        lcm.subscribe(pattern).unwrap();
    }
    let until = Instant::now() + PATIENCE;
    while !hub.clients().any(|(_, _, client)| client.subscriptions == subscriptions.len())
        || !lcm.tcpq().unwrap().is_connected()
    {
        hub.wait(Duration::from_millis(10)).unwrap();
        hub.serve_once().unwrap();
        assert_eq!(lcm.recv().unwrap(), None);
        assert!(Instant::now() < until);
    }
    (hub, lcm, Url::Tcpq(address))
}

#[test]
fn the_official_player_plays_our_log() {
    let Some(python) = peer_or_skip(python(&["lcm"])) else { return };
    let log = Scratch::new("played");
    fs::write(&log.0, ours()).unwrap();
    let (mut hub, mut lcm, url) = bus(&[".*"]);
    let _player = Tool::start(&python, "lcm-logplayer", &url, &["-s", "100"], &log.0);
    let (wanted, _) = lines(&ours());
    let until = Instant::now() + PATIENCE;
    for wanted in wanted {
        let mut words = wanted.split(' ').skip(2);
        let got = loop {
            assert!(Instant::now() < until);
            hub.wait(Duration::from_millis(10)).unwrap();
            hub.serve_once().unwrap();
            if let Some(message) = lcm.recv().unwrap() {
                break line(&Event { number: 0, timestamp_us: 0, channel: message.channel, payload: message.payload });
            }
        };
        let mut got = got.split(' ').skip(2);
        assert!(got.next() == words.next() && got.next() == words.next(), "{wanted:.60}");
    }
}

#[test]
fn what_the_official_logger_records_from_our_hub_we_read() {
    let Some(python) = peer_or_skip(python(&["lcm"])) else { return };
    let log = Scratch::new("recorded");
    let (mut hub, mut lcm, url) = bus(&[]);
    let logger = Tool::start(&python, "lcm-logger", &url, &["-q", "-f"], &log.0);
    let until = Instant::now() + PATIENCE;
    let serve = |hub: &mut Hub| {
        assert!(Instant::now() < until);
        hub.wait(Duration::from_millis(10)).unwrap();
        hub.serve_once().unwrap();
    };
    while !hub.clients().any(|(_, _, client)| client.subscriptions == 1) {
        serve(&mut hub);
    }
    let (source, _) = lines(OFFICIAL);
    let mut reader = Reader::new(OFFICIAL);
    while let Some(event) = reader.next_event().unwrap() {
        lcm.publish(event.channel, event.payload).unwrap();
    }
    // It writes what it has when the next one comes, so others follow until all of these are in the file.
    while fs::metadata(&log.0).map_or(0, |file| file.len()) < OFFICIAL.len() as u64 {
        lcm.publish("AFTER", b"").unwrap();
        serve(&mut hub);
    }
    drop(logger);
    let (recorded, stats) = lines(&fs::read(&log.0).unwrap());
    for (n, (recorded, source)) in recorded.iter().zip(&source).enumerate() {
        let but_time = |line: &str| line.splitn(3, ' ').step_by(2).map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(but_time(recorded), but_time(source), "{n}");
    }
    assert!(recorded.len() >= source.len());
    assert_eq!((stats.skipped, stats.unusable), (0, 0));
}
