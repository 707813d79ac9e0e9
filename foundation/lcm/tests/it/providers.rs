//! The providers without a network: `memq` and `file`.
#![cfg(feature = "live")]
#![allow(clippy::disallowed_methods, reason = "real files in real time")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use lcm::eventlog::{Reader, Writer};
use lcm::live::{Lcm, PublishError};
use lcm::subscription::Queue;
use lcm::url::Url;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(20);

fn open(url: &str) -> Lcm {
    let (url, warnings) = Url::parse(url).unwrap();
    assert_eq!(warnings, []);
    Lcm::new(&url).unwrap()
}

/// All that can be received now: `A text` is a message on channel A.
fn take(lcm: &mut Lcm) -> Vec<String> {
    let mut taken = Vec::new();
    while let Some(message) = lcm.recv().unwrap() {
        taken.push(format!("{} {}", message.channel, str::from_utf8(message.payload).unwrap()));
    }
    taken
}

fn readable(lcm: &Lcm) -> bool {
    lcm.wait(Duration::ZERO).unwrap()
}

#[test]
fn memq_hands_out_in_order_what_was_published_and_wanted() {
    let mut lcm = open("memq://");
    lcm.publish("A", b"nobody").unwrap();
    let id = lcm.subscribe("A.*").unwrap();
    lcm.subscribe("AB").unwrap();
    assert!(!readable(&lcm));
    assert_eq!(take(&mut lcm), [""; 0]);
    for (channel, payload) in [("A", "1"), ("AB", "2"), ("B", "3"), ("A", "4")] {
        lcm.publish(channel, payload.as_bytes()).unwrap();
        assert!(readable(&lcm));
    }
    let first = lcm.recv().unwrap().unwrap();
    assert_eq!((first.channel, first.payload), ("A", &b"1"[..]));
    assert!(readable(&lcm), "more is there");
    assert_eq!(take(&mut lcm), ["AB 2", "A 4"]);
    assert!(!readable(&lcm));
    let stats = lcm.stats();
    assert_eq!((stats.sent, stats.received, stats.unwanted, stats.queue_dropped), (5, 3, 2, 0));
    lcm.publish("A", b"5").unwrap();
    assert!(lcm.unsubscribe(id) && !lcm.unsubscribe(id));
    assert_eq!(take(&mut lcm), [""; 0], "what waited for a subscription ends with it");
    assert!(matches!(lcm.publish("", b""), Err(PublishError::Encode(_))));
}

#[test]
fn memq_keeps_within_the_limits_of_subscriptions_and_its_own() {
    let mut lcm = open("memq://");
    let newest = lcm.subscribe_with("A", Queue::Newest(2)).unwrap();
    for n in 0..5 {
        lcm.publish("A", n.to_string().as_bytes()).unwrap();
    }
    assert_eq!(take(&mut lcm), ["A 3", "A 4"]);
    assert_eq!((lcm.dropped(newest), lcm.stats().queue_dropped), (Some(3), 3));
    let all = lcm.subscribe("B").unwrap();
    let large = vec![0; 1 << 20];
    for _ in 0..100 {
        lcm.publish("B", &large).unwrap();
    }
    assert!(lcm.dropped(all).unwrap() >= 80, "what nobody takes costs 16 MiB, no more");
    assert_eq!(take(&mut lcm).len() as u64 + lcm.dropped(all).unwrap(), 100);
}

/// A log of this run, gone with the test.
struct Log(PathBuf);

impl Log {
    fn new(name: &str, events: &[(i64, &str, &str)]) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}.lcmlog", std::process::id()));
        let mut writer = Writer::new(fs::File::create(&path).unwrap());
        for (timestamp_us, channel, payload) in events {
            writer.write(*timestamp_us, channel, payload.as_bytes()).unwrap();
        }
        Self(path)
    }

    fn open(&self, options: &str) -> Lcm {
        open(&format!("file://{}?{options}", self.0.display()))
    }

    /// `number channel payload`, and the timestamps.
    fn read(&self) -> (Vec<String>, Vec<i64>) {
        let mut reader = Reader::new(fs::File::open(&self.0).unwrap());
        let (mut events, mut timestamps) = (Vec::new(), Vec::new());
        while let Some(event) = reader.next_event().unwrap() {
            events.push(format!("{} {} {}", event.number, event.channel, str::from_utf8(event.payload).unwrap()));
            timestamps.push(event.timestamp_us);
        }
        (events, timestamps)
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// All of a log until its end: channel, and when it was received after the first, in µs.
fn play(lcm: &mut Lcm) -> Vec<(String, i64)> {
    let (mut played, mut first) = (Vec::new(), None);
    let until = Instant::now() + PATIENCE;
    loop {
        assert!(Instant::now() < until);
        lcm.wait(PATIENCE).unwrap();
        match lcm.recv() {
            Ok(Some(message)) => {
                let first = *first.get_or_insert(message.at.0);
                played.push((message.channel.to_string(), (message.at.0 - first) / 1000));
            }
            Ok(None) => {}
            Err(error) => {
                assert_eq!(error.kind(), ErrorKind::UnexpectedEof, "{error}");
                assert_eq!(lcm.recv().unwrap_err().kind(), ErrorKind::UnexpectedEof, "the end stays the end");
                return played;
            }
        }
    }
}

const EVENTS: &[(i64, &str, &str)] = &[
    (5_000_000, "A", "1"),
    (5_030_000, "B", "2"),
    (5_030_000, "A", "3"),
    (5_050_000, "A", "4"),
    (5_040_000, "B", "5"),
];

fn at(times: [i64; 5]) -> Vec<(String, i64)> {
    EVENTS.iter().zip(times).map(|(event, time)| (event.1.to_string(), time)).collect()
}

#[test]
fn a_log_is_played_at_its_pace_or_another() {
    let log = Log::new("pace", EVENTS);
    for (options, times) in
        [("", [0, 30_000, 30_000, 50_000, 40_000]), ("speed=2", [0, 15_000, 15_000, 25_000, 20_000])]
    {
        let mut lcm = log.open(options);
        lcm.subscribe(".*").unwrap();
        let start = Instant::now();
        // The last one is older than the one before: it comes behind it, with its own time.
        assert_eq!(play(&mut lcm), at(times));
        assert!(start.elapsed() >= Duration::from_micros(times[3] as u64));
    }
}

#[test]
fn without_a_speed_a_log_is_played_at_once() {
    let log = Log::new("at-once", &[(0, "A", ""), (3_600_000_000, "B", ""), (7_200_000_000, "A", "")]);
    let mut lcm = log.open("speed=0");
    lcm.subscribe("A").unwrap();
    let played: Vec<String> = play(&mut lcm).into_iter().map(|(channel, _)| channel).collect();
    assert_eq!(played, ["A", "A"]);
    assert_eq!((lcm.stats().received, lcm.stats().unwanted), (2, 1));
}

#[test]
fn between_two_events_there_is_nothing_to_do() {
    let log = Log::new("between", &[(0, "A", ""), (3_600_000_000, "A", "")]);
    let mut lcm = log.open("speed=1");
    lcm.subscribe("A").unwrap();
    assert!(readable(&lcm) && lcm.recv().unwrap().is_some());
    assert_eq!(lcm.recv().unwrap(), None);
    assert!(!readable(&lcm));
    assert!(matches!(lcm.publish("A", b""), Err(PublishError::Io(error)) if error.kind() == ErrorKind::Unsupported));
}

#[test]
fn playback_starts_where_it_is_told_to() {
    let log = Log::new("start", EVENTS);
    let mut lcm = log.open("speed=0&start_timestamp=5000001");
    lcm.subscribe(".*").unwrap();
    assert_eq!(play(&mut lcm).len(), 4);
}

#[test]
fn what_is_published_is_recorded_and_plays_again() {
    let log = Log::new("record", EVENTS);
    let before = Log::now_us();
    let mut lcm = log.open("mode=w");
    lcm.subscribe(".*").unwrap();
    lcm.publish("A", b"one").unwrap();
    lcm.publish("B", b"").unwrap();
    assert!(matches!(lcm.publish("", b""), Err(PublishError::Encode(_))));
    assert_eq!(lcm.recv().unwrap(), None);
    assert_eq!(lcm.stats().sent, 2);
    drop(lcm);
    let mut lcm = log.open("mode=a");
    lcm.publish("C", b"more").unwrap();
    let (events, timestamps) = log.read();
    assert_eq!(events, ["0 A one", "1 B ", "2 C more"]);
    assert!(timestamps.iter().all(|time| (before..=Log::now_us()).contains(time)), "{timestamps:?}");
    let mut lcm = log.open("speed=0");
    lcm.subscribe(".*").unwrap();
    let played: Vec<String> = play(&mut lcm).into_iter().map(|(channel, _)| channel).collect();
    assert_eq!(played, ["A", "B", "C"]);
}

impl Log {
    fn now_us() -> i64 {
        std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_micros() as i64
    }
}

#[test]
fn a_crash_while_recording_costs_the_last_event_alone() {
    let log = Log::new("crash", EVENTS);
    let bytes = fs::read(&log.0).unwrap();
    fs::write(&log.0, &bytes[..bytes.len() - 1]).unwrap();
    log.open("mode=a").publish("B", b"again").unwrap();
    assert_eq!(log.read().0, ["0 A 1", "1 B 2", "2 A 3", "3 A 4", "4 B again"]);
}

#[test]
fn a_file_that_is_none_or_no_log_is_said() {
    let url = Url::parse("file:///nowhere/at/all").unwrap().0;
    let error = Lcm::new(&url).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotFound);
    assert!(error.to_string().starts_with("/nowhere/at/all: "), "{error}");
    let log = Log::new("letter", &[]);
    fs::write(&log.0, "a letter to someone, not to be cut off").unwrap();
    let url = Url::parse(&format!("file://{}?mode=a", log.0.display())).unwrap().0;
    assert_eq!(Lcm::new(&url).unwrap_err().kind(), ErrorKind::InvalidData);
    assert_eq!(fs::read(&log.0).unwrap(), b"a letter to someone, not to be cut off");
    let mut lcm = log.open("speed=1");
    assert_eq!(lcm.recv().unwrap_err().kind(), ErrorKind::UnexpectedEof, "a log of nothing but garbage is at its end");
}
