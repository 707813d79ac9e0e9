//! The logger's process, as it is run: what it records, what killing it costs, and what it does on a disk that is full or
//! read-only, among too many channels, beside a huge message and in a flood.
//!
//! A step of the wall clock cannot be made here without stepping everybody's; the module's own tests have it.

use crate::log::{self, Rig, publish};
use crate::support;
use messages::{Message, common, lowlevel};
use nix::sched::{CloneFlags, unshare};
use std::collections::BTreeMap;
use std::fs;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

fn encoded(message: impl Into<Message>) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.into().encode(&mut bytes).expect("encodable");
    bytes
}

fn wall() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970").as_nanos() as u64
}

#[test]
fn everything_that_was_said_is_in_the_file_once_and_in_order() {
    let mut rig = Rig::new();
    let logger = rig.start(&[]);
    let begun = wall();
    let mut said = Vec::new();
    for n in 0..500i32 {
        let odo = encoded(lowlevel::DataOdo { ticks_left: n, ..Default::default() });
        let stop = encoded(lowlevel::EventStop { source: format!("button {n}"), ..Default::default() });
        let large = vec![n as u8; 300 * n as usize];
        for (channel, data) in [("LL_DATA_ODO", odo), ("LL_EVENT_STOP", stop), ("SOMEBODY_ELSES", large)] {
            rig.publish(channel, &data);
            said.push((channel.to_string(), data));
        }
        thread::sleep(Duration::from_millis(1));
    }
    thread::sleep(Duration::from_millis(100));
    assert_eq!(logger.stop(), 0);
    let recorded = rig.raw();
    let ours = |topic: &str| ["LL_DATA_ODO", "LL_EVENT_STOP", "SOMEBODY_ELSES"].contains(&topic);
    let heard: Vec<_> = recorded.iter().filter(|message| ours(&message.topic)).collect();
    assert!(heard.iter().all(|message| (begun..wall()).contains(&message.log_time)));
    let heard: Vec<(String, Vec<u8>)> =
        heard.into_iter().map(|message| (message.topic.clone(), message.data.clone())).collect();
    assert_eq!(heard.len(), said.len());
    assert!(heard == said, "the same bytes in the same order");
    assert!(recorded.iter().enumerate().all(|(n, message)| message.sequence == n as u32), "no number is left out");
    let bytes = fs::read(&rig.files()[0]).expect("a file");
    let summary = mcap::Summary::read(&bytes).expect("a whole file").expect("with an index");
    let twins = summary.channels.values().filter(|channel| channel.message_encoding == "cdr");
    assert!(twins.map(|channel| channel.topic.as_str()).any(|topic| topic == "/LL_DATA_ODO"));
}

#[test]
fn a_kill_costs_little_and_the_next_start_gives_the_file_its_index() {
    const KILLS: u64 = 40;
    let mut rig = Rig::new();
    let mut lost = Vec::new();
    for kill in 0..KILLS {
        lost.push(log_cut(&mut rig, kill));
    }
    lost.sort_unstable();
    let worst = lost[lost.len() - 1];
    println!("lost by {KILLS} kills: median {} ms, worst {worst} ms", lost[lost.len() / 2]);
    // 250 ms, and one write with its synchronization on a machine that does other things, too.
    assert!(worst <= 500, "{worst} ms");
    let counts: BTreeMap<_, _> = rig.files().into_iter().map(|file| (file.clone(), log::raw(&file).len())).collect();
    assert!(counts.len() as u64 >= KILLS);
    let logger = rig.start(&[]);
    rig.until("all files have an index", 60.0, |rig| {
        let repaired = rig.said().matches("index added").count() + rig.said().matches("removed:").count();
        repaired as u64 >= KILLS
    });
    assert_eq!(logger.stop(), 0);
    for (file, count) in counts.into_iter().filter(|(file, _)| file.exists()) {
        let bytes = fs::read(&file).expect("a file");
        let summary = mcap::Summary::read(&bytes).expect("a whole file").expect("with an index");
        assert!(summary.stats.is_some() && log::raw(&file).len() == count, "{}", file.display());
    }
}

/// Kills a logger at a moment that `seed` says, while somebody counts; ms that the file ends before that.
fn log_cut(rig: &mut Rig, seed: u64) -> u64 {
    log::cut(rig, Duration::from_millis(300 + seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) % 700))
}

/// Runs a test with a rig on a disk of `megabytes` that nobody else sees; skips where this machine mounts none.
fn on_a_small_disk(megabytes: u32, test: impl FnOnce(&mut Rig) + Send + 'static) {
    // A mount namespace of this thread and those that it starts; it goes with them.
    let tested = thread::spawn(move || {
        let port = support::can_port();
        let root = std::env::temp_dir().join(format!("advee-disk-{}-{port}", std::process::id()));
        fs::create_dir_all(&root).expect("the folder can be made");
        let size = format!("size={megabytes}m");
        let mounted = unshare(CloneFlags::CLONE_NEWNS).is_ok()
            && mount(&["--make-rprivate", "/"])
            && mount(&["-t", "tmpfs", "-o", &size, "tmpfs", &root.to_string_lossy()]);
        if mounted {
            test(&mut Rig::at(port, root.clone()));
        }
        let _ = fs::remove_dir(&root);
        if mounted { Ok(()) } else { Err("no disk may be mounted here".to_string()) }
    });
    testing::machine_or_skip(tested.join().expect("no panic"));
}

fn mount(args: &[&str]) -> bool {
    Command::new("mount").args(args).status().is_ok_and(|status| status.success())
}

#[test]
fn a_full_disk_ends_recording_and_nothing_else_and_room_begins_it_again() {
    on_a_small_disk(24, |rig| {
        let mut logger = rig.start(&["log.keep_free_bytes=4e6"]);
        let mut noise = 0x9E37_79B9u32;
        let mut block = || -> Vec<u8> {
            let random = std::iter::from_fn(|| {
                noise ^= noise << 13;
                noise ^= noise >> 17;
                noise ^= noise << 5;
                Some(noise as u8)
            });
            random.take(100_000).collect()
        };
        let begin = Instant::now();
        while rig.last.as_ref().is_none_or(|log| log.recording) {
            assert!(begin.elapsed() < Duration::from_secs(60), "{}", rig.said());
            rig.publish("NOISE", &block());
            thread::sleep(Duration::from_millis(5));
            rig.listen();
        }
        assert!(logger.runs());
        rig.until("it says so", 10.0, |rig| rig.errors.iter().any(|error| error.message.contains("full")));
        for file in rig.files() {
            fs::remove_file(file).expect("a file");
        }
        rig.last = None;
        rig.until("it records again", 30.0, |rig| rig.last.as_ref().is_some_and(|log| log.recording));
        rig.publish("AFTERWARDS", b"here");
        thread::sleep(Duration::from_millis(100));
        assert_eq!(logger.stop(), 0);
        assert!(rig.raw().iter().any(|message| message.topic == "AFTERWARDS"));
    });
}

#[test]
fn a_read_only_disk_is_told_and_waited_for() {
    on_a_small_disk(24, |rig| {
        assert!(mount(&["-o", "remount,ro", &rig.root.to_string_lossy()]));
        let mut logger = rig.spawn(&["log.keep_free_bytes=1e6"]);
        rig.until("it says so", 20.0, |rig| {
            rig.errors.iter().any(|error| error.message.contains("may not be written"))
        });
        assert!(logger.runs() && rig.last.as_ref().is_none_or(|log| !log.recording));
        assert!(mount(&["-o", "remount,rw", &rig.root.to_string_lossy()]));
        rig.until("it records", 30.0, |rig| rig.last.as_ref().is_some_and(|log| log.recording));
        assert_eq!(logger.stop(), 0);
    });
}

#[test]
fn a_hundred_thousand_channels_are_bounded_and_told_once() {
    let _alone = support::alone();
    let mut rig = Rig::new();
    let mut logger = rig.start(&[]);
    let odo = encoded(lowlevel::DataOdo { ticks_left: 7, ..Default::default() });
    for n in 0..100_000 {
        rig.publish(&format!("CHANNEL_{n}"), b"x");
        if n % 100 == 0 {
            rig.publish("LL_DATA_ODO", &odo);
            rig.listen();
            thread::sleep(Duration::from_millis(1));
        }
    }
    rig.last = None;
    rig.until("it goes on", 10.0, |rig| rig.last.is_some());
    assert!(logger.runs());
    let pss = logger.pss();
    println!("100 000 channels: {:.1} MB PSS", pss as f64 / 1e6);
    assert!(pss < 200_000_000, "{pss}");
    let crowded = rig.errors.iter().filter(|error| error.message.contains("more channels")).count();
    assert!(crowded <= 1, "{crowded}");
    rig.publish("LL_DATA_ODO", &encoded(lowlevel::DataOdo { ticks_left: 8, ..Default::default() }));
    thread::sleep(Duration::from_millis(100));
    assert_eq!(logger.stop(), 0);
    let recorded = rig.raw();
    let last = recorded.iter().rfind(|message| message.topic == "LL_DATA_ODO").expect("known channels go on");
    assert_eq!(last.data, encoded(lowlevel::DataOdo { ticks_left: 8, ..Default::default() }));
    let channels = recorded.iter().filter(|message| message.topic.starts_with("CHANNEL_")).count();
    println!("{channels} of them are in the file");
    assert!(channels == 100_000 || crowded == 1, "what is left out is told: {channels}");
}

#[test]
fn one_message_of_a_hundred_megabytes_fits() {
    let _alone = support::alone();
    let mut rig = Rig::new();
    let mut logger = rig.start(&[]);
    let large: Vec<u8> = (0..100_000_000u32).map(|n| (n.wrapping_mul(0x9E37_79B9) >> 24) as u8).collect();
    let mut sent = 0;
    // LCM does not send again what a receiver had no room for.
    let begin = Instant::now();
    while rig.last.as_ref().is_none_or(|log| log.bytes < 20_000_000) {
        assert!(begin.elapsed() < Duration::from_secs(120), "sent {sent} times\n{}", rig.said());
        rig.publish("LARGE", &large);
        sent += 1;
        let until = Instant::now() + Duration::from_secs(3);
        while Instant::now() < until && rig.last.as_ref().is_none_or(|log| log.bytes < 20_000_000) {
            rig.bus.wait(Duration::from_millis(20)).expect("the bus can be waited for");
            rig.listen();
        }
    }
    println!("sent {sent} times; {:.1} MB PSS", logger.pss() as f64 / 1e6);
    rig.publish("AFTERWARDS", b"here");
    thread::sleep(Duration::from_millis(300));
    assert!(logger.runs());
    assert_eq!(logger.stop(), 0);
    let recorded = rig.raw();
    assert!(recorded.iter().any(|message| message.topic == "LARGE" && message.data == large));
    assert!(recorded.iter().any(|message| message.topic == "AFTERWARDS"));
}

#[test]
fn a_flood_is_survived_and_what_it_cost_is_told() {
    let _alone = support::alone();
    let mut rig = Rig::new();
    let mut logger = rig.start(&[]);
    let over = Arc::new(AtomicBool::new(false));
    let floods: Vec<_> = (0..2)
        .map(|n| {
            let (over, mut bus) = (over.clone(), support::listen(&rig.url));
            thread::spawn(move || {
                let mut sent = 0u64;
                while !over.load(Ordering::Relaxed) {
                    publish(&mut bus, &format!("FLOOD_{n}"), &[0xA5; 200]);
                    sent += 1;
                }
                sent
            })
        })
        .collect();
    let begin = Instant::now();
    let (mut heard, mut longest) = (Instant::now(), Duration::ZERO);
    while begin.elapsed() < Duration::from_secs(4) {
        rig.last = None;
        rig.bus.wait(Duration::from_millis(20)).expect("the bus can be waited for");
        rig.listen();
        if rig.last.is_some() {
            longest = longest.max(heard.elapsed());
            heard = Instant::now();
        }
    }
    over.store(true, Ordering::Relaxed);
    let sent: u64 = floods.into_iter().map(|flood| flood.join().expect("no panic")).sum();
    assert!(longest > Duration::ZERO && longest < Duration::from_millis(2500), "{longest:?}");
    rig.publish("AFTERWARDS", b"here");
    thread::sleep(Duration::from_millis(500));
    let pss = logger.pss();
    assert!(logger.runs() && pss < 200_000_000, "{pss}");
    assert_eq!(logger.stop(), 0);
    let recorded = rig.raw();
    let kept = recorded.iter().filter(|message| message.topic.starts_with("FLOOD_")).count() as u64;
    println!("{kept} of {sent} messages in 4 s, {:.1} MB PSS, announced every {longest:?}", pss as f64 / 1e6);
    let told = rig.said().contains("messages are lost");
    assert!(kept == sent || (kept < sent && told), "{kept} of {sent}");
    assert!(recorded.iter().any(|message| message.topic == "AFTERWARDS"));
}

#[test]
fn marks_and_pauses_are_obeyed() {
    let mut rig = Rig::new();
    let logger = rig.start(&[]);
    let command = |action| encoded(common::CmdLog { action, text: "here it was".into(), ..Default::default() });
    rig.publish("CM_CMD_LOG", &command(common::CmdLog::MARK));
    rig.publish("CM_CMD_LOG", &command(common::CmdLog::STOP));
    rig.until("it stops", 5.0, |rig| rig.last.as_ref().is_some_and(|log| !log.recording));
    rig.publish("MEANWHILE", b"kept");
    rig.publish("CM_CMD_LOG", &command(common::CmdLog::START));
    rig.until("it records again", 5.0, |rig| rig.last.as_ref().is_some_and(|log| log.recording));
    assert_eq!(logger.stop(), 0);
    let recorded = rig.raw();
    assert!(recorded.iter().any(|message| message.topic == "MEANWHILE"), "what came before it began");
    let all: Vec<u8> = rig.files().iter().flat_map(|file| fs::read(file).expect("a file")).collect();
    assert!(all.windows(11).any(|bytes| bytes == b"here it was"));
}
