//! The shared-memory bus between processes: they come, are killed at any instant, and plain listeners come and go.
#![cfg(feature = "shm")]
#![allow(clippy::disallowed_methods, reason = "real sockets and processes")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::common;
use lcm::live::Lcm;
use lcm::origin::Origin;
use lcm::url::{Shm, Udpm};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use std::{fs, thread};
use testing::{Random, machine_or_skip, peer_or_skip, python};

const PATIENCE: Duration = Duration::from_secs(20);

fn url() -> Udpm {
    Udpm { shm: Shm::Auto, ..common::url() }
}

fn open(url: &Udpm) -> Lcm {
    let lcm = Lcm::new(&url.clone().into()).unwrap();
    assert!(lcm.udpm().unwrap().shares_memory(), "/dev/shm can be used");
    lcm
}

/// The folder of a bus; taken away at the end.
struct Folder(PathBuf);

impl Folder {
    fn of(url: &Udpm) -> Self {
        let end = format!("-{}-{}", url.group, url.port);
        let mut entries = fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path());
        Self(entries.find(|path| path.to_str().unwrap().ends_with(&end)).unwrap())
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

// A numbered message: who, which, and bytes that follow from both.

fn fill(buffer: &mut Vec<u8>, who: u64, number: u64, len: usize) {
    buffer.clear();
    buffer.extend([who, number, len as u64].map(u64::to_le_bytes).as_flattened());
    let seed = who.wrapping_mul(31).wrapping_add(number);
    buffer.extend((0..len as u64).map(|i| (seed.wrapping_add(i).wrapping_mul(0x9e37_79b9) >> 8) as u8));
}

/// What a reader has seen of each publisher.
#[derive(Default)]
struct Seen {
    last: BTreeMap<u64, u64>,
    scratch: Vec<u8>,
    count: u64,
}

impl Seen {
    /// Panics if a message is torn, comes twice, or after a later one.
    fn check(&mut self, payload: &[u8]) -> (u64, u64) {
        let word = |at: usize| u64::from_le_bytes(*payload[8 * at..].first_chunk().unwrap());
        let (who, number) = (word(0), word(1));
        fill(&mut self.scratch, who, number, payload.len() - 24);
        assert!(self.scratch == payload, "torn: {who:x} {number}, {} bytes", payload.len());
        let before = self.last.insert(who, number);
        assert!(before.is_none_or(|before| before < number), "{who:x}: {number} after {before:?}");
        self.count += 1;
        (who, number)
    }
}

/// A process of this very program in a role, ended with this value.
struct Actor(Child);

impl Actor {
    fn start(role: &str, url: &Udpm) -> Self {
        Self::start_as(role, url, None)
    }

    /// As another user of a group.
    fn start_as(role: &str, url: &Udpm, user: Option<(u32, u32)>) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["shm::an_actor_of_another_test", "--exact", "--nocapture"]);
        command.env("LCM_SHM_ROLE", role).env("LCM_SHM_URL", url.to_string());
        if let Some((user, group)) = user {
            command.uid(user).gid(group);
        }
        Self(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
    }

    /// Waits until it prints a line of a role.
    fn says(&mut self, what: &str) {
        let mut line = String::new();
        let mut output = BufReader::new(self.0.stdout.as_mut().unwrap());
        while line.trim_end() != what {
            line.clear();
            assert!(output.read_line(&mut line).unwrap() > 0, "it ended before {what:?}");
        }
    }

    /// Kills it; panics if it had ended by itself.
    fn kill(&mut self) {
        if let Some(status) = self.0.try_wait().unwrap() {
            let mut text = String::new();
            self.0.stderr.take().unwrap().read_to_string(&mut text).unwrap();
            panic!("{status}: {text}");
        }
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Actor {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn an_actor_of_another_test() {
    let Ok(role) = std::env::var("LCM_SHM_ROLE") else { return };
    let (lcm::Url::Udpm(url), _) = lcm::Url::parse(&std::env::var("LCM_SHM_URL").unwrap()).unwrap() else { return };
    if role == "alone" {
        assert!(!Lcm::new(&url.into()).unwrap().udpm().unwrap().shares_memory());
        return println!("alone");
    }
    let mut lcm = open(&url);
    if let Some(user) = role.strip_prefix("meets ") {
        return meet(&mut lcm, user.parse().unwrap());
    }
    let mut seen = Seen::default();
    let mut random = Random::new(u64::from(std::process::id()) << 20 | 1);
    let mut message = Vec::new();
    if role != "writer" {
        lcm.subscribe("STORM_.*").unwrap();
    }
    for number in 0.. {
        if role != "reader" {
            let len = match random.below(1000) {
                0 => 2 << 20,
                1..10 => random.below(300_000),
                _ => random.below(2000),
            };
            fill(&mut message, u64::from(std::process::id()), number, len as usize);
            // A full socket is no matter here.
            let _ = lcm.publish(["STORM_A", "STORM_B"][number as usize % 2], &message);
        }
        if role != "writer" {
            let patience = if role == "reader" { Duration::from_millis(100) } else { Duration::ZERO };
            while let Some(received) = lcm.recv_timeout(patience).unwrap() {
                seen.check(received.payload);
            }
        } else if random.below(8) == 0 {
            thread::sleep(Duration::from_micros(random.below(300)));
        }
    }
}

/// Publishes, and says so each time when it has received a thousand messages of another user through shared memory, or
/// one as a datagram.
fn meet(lcm: &mut Lcm, user: u32) {
    lcm.subscribe("MEET").unwrap();
    let mut count = 0;
    for number in 0_u64.. {
        let _ = lcm.publish("MEET", &number.to_le_bytes());
        while let Some(received) = lcm.recv_timeout(Duration::from_micros(200)).unwrap() {
            match received.origin {
                Origin::Memory(process) if process.uid == user => count += 1,
                Origin::Host(Some(process)) if process.uid == user => println!("datagram"),
                _ => {}
            }
            if count == 1000 {
                count = 0;
                println!("met");
            }
        }
    }
}

#[test]
fn users_of_a_group_share_memory_and_none_changes_what_another_made() {
    if machine_or_skip(testing::users()).is_none() {
        return;
    }
    let ([owner, member, stranger], group) = (testing::USERS, testing::GROUP);
    let url = Udpm { shm: Shm::Of(owner), ..common::url() };
    let mut ours = Actor::start_as(&format!("meets {member}"), &url, Some((owner, group)));
    let begin = Instant::now();
    while !stations().any(|(_, uid)| uid == owner) {
        assert!(begin.elapsed() < PATIENCE, "the owner does not come");
        thread::sleep(Duration::from_millis(5));
    }
    let folder = Folder::of(&url);
    let mut theirs = Actor::start_as(&format!("meets {owner}"), &url, Some((member, group)));
    ours.says("met");
    theirs.says("met");
    // Of another group, and of the owner's user without it.
    Actor::start_as("alone", &url, Some((stranger, stranger))).says("alone");
    let found = fs::metadata(&folder.0).unwrap();
    assert_eq!((found.mode() & 0o7777, found.uid(), found.gid()), (0o1770, owner, group));
    for (path, uid) in stations().filter(|(path, _)| path.starts_with(&folder.0)) {
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o640);
        if uid == owner {
            let text = path.display();
            for harm in [format!("truncate -s 0 {text}"), format!("rm -f {text}"), format!("echo x >>{text}")] {
                let done = Command::new("sh").args(["-c", &harm]).uid(member).gid(group).output().unwrap();
                assert!(!done.status.success(), "{harm}");
            }
        }
    }
    // A truncated station harms its owner alone, whose messages are received as datagrams now.
    for (path, _) in stations().filter(|(path, uid)| path.starts_with(&folder.0) && *uid == member) {
        cut(&path, 0);
    }
    ours.says("datagram");
    let mut late = Actor::start_as(&format!("meets {owner}"), &url, Some((member, group)));
    late.says("met");
    // Of the dead nothing is left, though they are another user's.
    theirs.kill();
    late.kill();
    let begin = Instant::now();
    while stations().any(|(path, uid)| path.starts_with(&folder.0) && uid == member) {
        assert!(begin.elapsed() < PATIENCE, "what the dead left stays");
        thread::sleep(Duration::from_millis(20));
    }
    ours.kill();
}

/// Stations of all buses, with their owners.
fn stations() -> impl Iterator<Item = (PathBuf, u32)> {
    let folders = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let files = folders.filter_map(|folder| fs::read_dir(folder).ok()).flatten().flatten().map(|entry| entry.path());
    let stations = files.filter(|path| path.extension().is_some_and(|kind| kind == "station"));
    stations.filter_map(|path| Some((path.clone(), fs::metadata(path).ok()?.uid())))
}

#[test]
fn whoever_is_killed_whenever_no_reader_blocks_and_no_message_is_torn_or_twice() {
    let kills = std::env::var("LCM_SHM_KILLS").map_or(150, |kills| kills.parse().unwrap());
    let url = url();
    let mut survivor = open(&url);
    survivor.subscribe("STORM_.*").unwrap();
    let folder = Folder::of(&url);
    let mut seen = Seen::default();
    let mut random = Random::new(u64::from(std::process::id()) << 20 | 3);
    let roles = ["writer", "reader", "both", "writer", "reader"];
    let mut actors: Vec<Actor> = roles.iter().map(|role| Actor::start(role, &url)).collect();
    let mut killed = 0;
    while killed < kills {
        let until = Instant::now() + Duration::from_micros(random.below(20_000));
        loop {
            while let Some(received) = survivor.recv().unwrap() {
                seen.check(received.payload);
                if Instant::now() > until {
                    break;
                }
            }
            if Instant::now() > until {
                break;
            }
            survivor.wait(Duration::from_millis(1)).unwrap();
        }
        let which = random.below(roles.len() as u64) as usize;
        actors[which].kill();
        actors[which] = Actor::start(roles[which], &url);
        killed += 1;
    }
    // Whoever comes now is heard, and the reader is woken for it.
    actors.iter_mut().for_each(Actor::kill);
    let mut last = open(&url);
    let mut message = Vec::new();
    fill(&mut message, u64::MAX, 7, 100);
    let begin = Instant::now();
    while survivor.recv().unwrap().is_some() {}
    last.publish("STORM_A", &message).unwrap();
    loop {
        assert!(survivor.wait(PATIENCE).unwrap(), "blocked");
        if let Some(received) = survivor.recv().unwrap()
            && seen.check(received.payload) == (u64::MAX, 7)
        {
            break;
        }
        assert!(begin.elapsed() < PATIENCE, "not heard");
    }
    println!("{killed} killed, {} messages, {} lost", seen.count, survivor.stats().lost);
    while survivor.recv().unwrap().is_some() {}
    drop((last, survivor));
    drop(open(&url));
    assert!(!folder.0.exists(), "nothing is left of {killed}");
}

/// Publishes numbers while a native reader listens and official ones come and go.
/// Ends the threads of a test that fails.
struct Ending<'a>(&'a AtomicBool);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

#[test]
fn an_official_subscriber_that_comes_late_misses_nothing_and_nobody_hears_twice() {
    let Some(python) = peer_or_skip(python(&["lcm"])) else { return };
    let url = url();
    let plain = Udpm { shm: Shm::Off, ..url.clone() };
    let mut reader = open(&url);
    reader.subscribe("NUMBERS").unwrap();
    let _folder = Folder::of(&url);
    let (published, end) = (AtomicUsize::new(0), AtomicBool::new(false));
    thread::scope(|scope| {
        let publisher = scope.spawn(|| {
            let mut lcm = open(&url);
            let mut number: usize = 0;
            while !end.load(Ordering::SeqCst) {
                lcm.publish("NUMBERS", &(number as u64).to_le_bytes()).unwrap();
                published.store(number, Ordering::SeqCst);
                number += 1;
                thread::sleep(Duration::from_micros(200));
            }
            number
        });
        let listener = scope.spawn(|| {
            let mut next: usize = 0;
            while !end.load(Ordering::SeqCst) || next <= published.load(Ordering::SeqCst) {
                let Some(received) = reader.recv_timeout(Duration::from_millis(100)).unwrap() else { continue };
                let number = u64::from_le_bytes(received.payload.try_into().unwrap()) as usize;
                assert_eq!(number, next, "each once, in order, none missing");
                next += 1;
            }
            next
        });
        let _ending = Ending(&end);
        let mut heard = 0;
        for _ in 0..3 {
            let mut command = Command::new(&python);
            command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/numbers.py"));
            command.args([plain.to_string(), "NUMBERS".into()]).stdin(Stdio::piped()).stdout(Stdio::piped());
            let mut official = Actor(command.spawn().unwrap());
            let mut lines = BufReader::new(official.0.stdout.take().unwrap()).lines().map(Result::unwrap);
            assert_eq!(lines.next().as_deref(), Some("ready"));
            let from = published.load(Ordering::SeqCst) + 1;
            while published.load(Ordering::SeqCst) < from + 500 {
                thread::sleep(Duration::from_millis(5));
            }
            drop(official.0.stdin.take());
            let numbers: Vec<usize> = lines.map(|line| line.parse().unwrap()).collect();
            assert!(official.0.wait().unwrap().success());
            let first = numbers.iter().position(|&number| number >= from).unwrap();
            assert_eq!(numbers[first], from, "all from the moment that its subscription was up");
            assert!(numbers.is_sorted_by(|a, b| b - a == 1), "none twice, none missing");
            heard += numbers.len();
            // Until the datagrams have stopped.
            thread::sleep(Duration::from_millis(2500));
        }
        end.store(true, Ordering::SeqCst);
        let count = publisher.join().unwrap();
        assert_eq!(listener.join().unwrap(), count);
        assert!(heard < count);
    });
    assert_eq!(reader.stats().lost, 0);
}

#[test]
fn an_event_loop_that_polls_the_descriptor_hears_both_paths() {
    let url = url();
    let mut reader = open(&url);
    reader.subscribe("A").unwrap();
    let _folder = Folder::of(&url);
    let mut native = open(&url);
    let mut plain = Lcm::new(&Udpm { shm: Shm::Off, ..url.clone() }.into()).unwrap();
    for round in 0..200_u32 {
        let publisher = if round % 2 == 0 { &mut native } else { &mut plain };
        publisher.publish("A", &round.to_le_bytes()).unwrap();
        let begin = Instant::now();
        let got = loop {
            assert!(reader.wait(PATIENCE).unwrap() && begin.elapsed() < PATIENCE);
            if let Some(received) = reader.recv().unwrap() {
                break received.payload.to_vec();
            }
        };
        assert_eq!(got, round.to_le_bytes());
        while reader.recv().unwrap().is_some() {}
    }
    assert_eq!(reader.stats().received, 200);
}

/// The publisher sends as fast as it can, but at most a window more than the reader has acknowledged.
#[test]
fn a_flood_with_credit_loses_nothing() {
    const WINDOW: u64 = 4000;
    let (url, count) = (url(), 200_000_u64);
    let (mut publisher, mut reader) = (open(&url), open(&url));
    publisher.subscribe("CREDIT").unwrap();
    reader.subscribe("FLOOD").unwrap();
    let reading = thread::spawn(move || {
        let deadline = Instant::now() + PATIENCE;
        let (mut seen, mut buffer) = (Seen::default(), Vec::new());
        while seen.count < count {
            assert!(Instant::now() < deadline, "{} of {count}, {:?}", seen.count, reader.stats());
            let Some(message) = reader.recv_timeout(PATIENCE).unwrap() else { continue };
            let (_, number) = seen.check(message.payload);
            if number % (WINDOW / 4) == 0 {
                fill(&mut buffer, 2, number, 8);
                reader.publish("CREDIT", &buffer).unwrap();
            }
        }
        *reader.stats()
    });
    let (mut acknowledged, mut buffer) = (0, Vec::new());
    for number in 1..=count {
        fill(&mut buffer, 1, number, 64 + (number % 512) as usize);
        publisher.publish("FLOOD", &buffer).unwrap();
        while number - acknowledged >= WINDOW {
            assert!(!reading.is_finished(), "the reader has given up");
            let Some(message) = publisher.recv_timeout(Duration::from_millis(100)).unwrap() else { continue };
            acknowledged = u64::from_le_bytes(*message.payload[8..].first_chunk().unwrap());
        }
    }
    let stats = reading.join().unwrap();
    assert_eq!((stats.received, stats.lost, stats.kernel_dropped), (count, 0, 0));
    assert_eq!(publisher.stats().lost, 0);
}

#[test]
fn a_descriptor_is_not_readable_after_all_was_received() {
    let url = url();
    let (mut publisher, mut reader) = (open(&url), open(&url));
    reader.subscribe("A").unwrap();
    for round in 0..20 {
        while reader.recv().unwrap().is_some() {}
        publisher.publish("A", b"").unwrap();
        publisher.publish("A", b"").unwrap();
        assert!(reader.wait(PATIENCE).unwrap());
        let mut count = 0;
        while match round % 2 {
            0 => reader.recv().unwrap(),
            _ => reader.recv_timeout(Duration::ZERO).unwrap(),
        }
        .is_some()
        {
            count += 1;
            assert!(count > 1 || reader.wait(Duration::ZERO).unwrap(), "one is left");
        }
        assert_eq!(count, 2);
        assert!(!reader.wait(Duration::ZERO).unwrap(), "round {round}");
    }
}

/// Whoever mixes the ways to wait misses nothing.
#[test]
fn all_ways_to_wait_are_woken_by_shared_memory() {
    const ROUNDS: u64 = 3000;
    let url = url();
    let (mut ping, mut pong) = (open(&url), open(&url));
    ping.subscribe("PONG").unwrap();
    pong.subscribe("PING").unwrap();
    let echo = thread::spawn(move || {
        let mut answered = 0;
        while answered < ROUNDS {
            let message = pong.recv_timeout(Duration::MAX).unwrap().map(|message| message.payload.to_vec());
            let Some(message) = message else { continue };
            pong.publish("PONG", &message).unwrap();
            answered += 1;
        }
    });
    let (mut random, deadline) = (Random::new(1), Instant::now() + PATIENCE);
    for round in 0..ROUNDS {
        ping.publish("PING", &round.to_le_bytes()).unwrap();
        let mut heard = false;
        while !heard {
            assert!(Instant::now() < deadline, "round {round}: {:?}", ping.stats());
            let message = match random.index(4) {
                0 => ping.recv_timeout(PATIENCE).unwrap(),
                1 => ping.recv_timeout(Duration::MAX).unwrap(),
                2 => {
                    assert!(ping.wait(PATIENCE).unwrap(), "round {round}");
                    ping.recv().unwrap()
                }
                _ => ping.recv().unwrap(),
            };
            heard = message.is_some_and(|message| message.payload == round.to_le_bytes());
        }
    }
    echo.join().unwrap();
}

/// Files of a bus: its stations and its board.
fn shared(folder: &Folder) -> Vec<PathBuf> {
    let entries = fs::read_dir(&folder.0).into_iter().flatten().map(|entry| entry.unwrap().path());
    let is_shared = |path: &PathBuf| path.ends_with("board") || path.extension().is_some_and(|end| end == "station");
    entries.filter(is_shared).collect()
}

fn cut(path: &Path, len: u64) {
    // It may have left meanwhile.
    if let Ok(file) = fs::OpenOptions::new().write(true).open(path) {
        file.set_len(len).unwrap();
    }
}

#[test]
fn files_that_are_cut_short_end_no_process() {
    let url = url();
    let mut random = Random::new(u64::from(std::process::id()) << 20 | 5);
    let mut survivor = open(&url);
    survivor.subscribe("STORM_.*").unwrap();
    let folder = Folder::of(&url);
    let roles = ["writer", "both", "reader"];
    let mut actors: Vec<Actor> = roles.iter().map(|role| Actor::start(role, &url)).collect();
    let next = |survivor: &mut Lcm, what: &str| {
        let before = survivor.stats().received;
        let begin = Instant::now();
        while survivor.stats().received < before + 100 {
            assert!(begin.elapsed() < PATIENCE, "nothing is received after {what}");
            survivor.recv_timeout(Duration::from_millis(10)).unwrap();
        }
    };
    for round in 0..12 {
        next(&mut survivor, "a start");
        let files = shared(&folder);
        let path = &files[random.below(files.len() as u64) as usize];
        let len = [0, 4096, random.below(5 << 20)][round % 3];
        cut(path, len.min(fs::metadata(path).map_or(0, |found| found.len())));
        next(&mut survivor, &format!("{} was cut to {len} bytes", path.display()));
        let which = random.below(roles.len() as u64) as usize;
        // Panics if it had ended by itself.
        actors[which].kill();
        actors[which] = Actor::start(roles[which], &url);
    }
    shared(&folder).iter().for_each(|path| cut(path, 0));
    next(&mut survivor, "all were cut");
    actors.iter_mut().for_each(Actor::kill);
}

#[test]
fn a_publisher_whose_station_is_cut_is_heard_by_datagrams_and_the_others_as_before() {
    let url = url();
    let mut reader = open(&url);
    reader.subscribe("A").unwrap();
    let folder = Folder::of(&url);
    let before = shared(&folder);
    let mut owner = open(&url);
    let theirs: Vec<PathBuf> = shared(&folder).into_iter().filter(|path| !before.contains(path)).collect();
    let mut other = open(&url);
    let process = lcm::origin::Process { pid: std::process::id(), uid: fs::metadata(&folder.0).unwrap().uid() };
    let mut say = |lcm: &mut Lcm, what: &[u8]| {
        lcm.publish("A", what).unwrap();
        let begin = Instant::now();
        loop {
            if let Some(received) = reader.recv_timeout(Duration::from_millis(100)).unwrap() {
                assert_eq!(received.payload, what);
                return received.origin;
            }
            assert!(begin.elapsed() < PATIENCE, "not received");
        }
    };
    assert_eq!(say(&mut owner, b"whole"), Origin::Memory(process));
    theirs.iter().for_each(|path| cut(path, 0));
    for round in 0..20_u8 {
        assert_eq!(say(&mut owner, &[round]), Origin::Host(Some(process)), "its datagrams are known to be its own");
        assert_eq!(say(&mut other, &[round, round]), Origin::Memory(process));
    }
}
