//! Logger on a disk that the test controls.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod cuts;
mod rig;
mod trouble;

use crate::{Attachment, Compression, Config};
use base::{Epoch, Fault, Instant};
use messages::Channel;
use messages::common::CmdLog;
use module::{Actions, Event, State};
use rig::{Rig, Store, notes, odo_ticks, raw, read};

const FIRST: &str = "1970_01_01_00_00_00/log_000.mcap";

fn config() -> Config {
    Config { robot: "advee".into(), version: "1.2.3".into(), keep_free_bytes: 0, ..Config::default() }
}

#[test]
fn received_messages_are_in_the_file_with_their_types() {
    let attachment = Attachment { name: "robot.toml".into(), media_type: "text/plain".into(), data: b"[robot]".into() };
    let mut rig = Rig::new(Config { attachments: vec![attachment], ..config() });
    rig.odo(1);
    rig.ms(3);
    rig.receive("SOMETHING_ELSE", b"not of LCM");
    rig.ms(300);
    rig.odo(2);
    rig.command(CmdLog::STOP, "");
    rig.ms(50);
    assert_eq!(rig.names(), [FIRST]);
    let file = rig.file(FIRST);
    let messages = raw(file);
    let topics: Vec<&str> = messages.iter().map(|message| message.topic.as_str()).collect();
    assert_eq!(topics, ["LL_DATA_ODO", "SOMETHING_ELSE", "LL_DATA_ODO", "CM_CMD_LOG"]);
    assert_eq!(messages.iter().map(|message| message.sequence).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert_eq!(messages[0].schema, Some(("lowlevel.data_odo_t".into(), String::new())));
    assert_eq!(messages[1].schema, None);
    assert_eq!(messages[1].data, b"not of LCM");
    assert_eq!(odo_ticks(&messages[2].data), 2);
    assert_eq!(messages[0].publish_time, messages[0].log_time);
    assert_eq!(messages[1].log_time - messages[0].log_time, 3_000_000);
    let advee = &notes(file, "advee")[0];
    assert_eq!((&*advee["robot"], &*advee["version"], &*advee["run"]), ("advee", "1.2.3", "1970_01_01_00_00_00"));
    let summary = mcap::Summary::read(file).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count, read(file).len() as u64);
    let attached: Vec<&str> = summary.attachment_indexes.iter().map(|index| index.name.as_str()).collect();
    assert!(attached.contains(&"robot.toml"));
    assert!(messages::LCM_FILES.iter().all(|(name, _)| attached.contains(name)));
}

#[test]
fn a_second_run_of_one_second_has_a_name_of_its_own() {
    let mut store = Store::default();
    store.put(FIRST, 1);
    let mut rig = Rig::on(store, config());
    rig.ms(300);
    assert_eq!(rig.names(), [FIRST, "1970_01_01_00_00_00_2/log_000.mcap"]);
}

#[test]
fn a_folder_that_the_run_has_is_used_once() {
    let shared = Config { run: Some("2026_11_22_10_00_00".into()), ..config() };
    let mut rig = Rig::new(shared.clone());
    rig.ms(300);
    assert_eq!(rig.names(), ["2026_11_22_10_00_00/log_000.mcap"]);
    // A restarted logger finds its own file there.
    let mut rig = Rig::on(rig.store, shared);
    rig.odo(5);
    rig.ms(2000);
    assert_eq!(rig.names(), ["1970_01_01_00_00_01/log_000.mcap", "2026_11_22_10_00_00/log_000.mcap"]);
    assert_eq!(raw(rig.file("1970_01_01_00_00_01/log_000.mcap")).len(), 1);
}

#[test]
fn the_last_seconds_come_first_when_a_mark_is_made() {
    let mut rig = Rig::new(Config { start: false, ..config() });
    for ticks in 0..200 {
        rig.odo(ticks);
        rig.ms(100);
    }
    assert!(rig.names().is_empty() && !rig.told.iter().any(|told| told.recording));
    rig.command(CmdLog::MARK, "there it was");
    rig.ms(30);
    let told = rig.told.last().unwrap();
    assert!(told.recording && told.run == "1970_01_01_00_00_20" && told.dropped == 0);
    rig.odo(200);
    rig.ms(1000);
    rig.command(CmdLog::STOP, "");
    rig.ms(50);
    let name = "1970_01_01_00_00_20/log_000.mcap";
    let messages = raw(rig.file(name));
    let ticks: Vec<i32> =
        messages.iter().filter(|message| message.topic == "LL_DATA_ODO").map(|m| odo_ticks(&m.data)).collect();
    assert_eq!(ticks, (101..=200).collect::<Vec<_>>());
    let marks: Vec<_> = read(rig.file(name)).into_iter().filter(|message| message.topic == "/marks").collect();
    assert_eq!(marks.len(), 1);
    assert_eq!(marks[0].schema, Some(("rcl_interfaces/msg/Log".into(), "ros2msg".into())));
    assert!(marks[0].data.windows(13).any(|bytes| bytes == b"there it was\0"));
    assert_eq!(marks[0].publish_time, 20_020_000_000);
    assert_eq!(notes(rig.file(name), "mark")[0]["text"], "there it was");
    assert_eq!(notes(rig.file(name), "mark")[0]["time"], "20020000000");
    assert_eq!(rig.told.last().unwrap().run, "");
}

#[test]
fn a_file_that_is_long_enough_is_followed_by_the_next() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let mut rig = Rig::new(Config { file_max_bytes: 1_000_000, compression, ..config() });
        let mut random = noise(1);
        for _ in 0..300 {
            let data: Vec<u8> = std::iter::repeat_with(|| random() as u8).take(10_000).collect();
            rig.receive("NOISE", &data);
            rig.ms(2);
        }
        rig.command(CmdLog::STOP, "");
        rig.ms(50);
        let names: Vec<String> = rig.names().into_iter().map(String::from).collect();
        assert_eq!(names.len(), 3, "{names:?}");
        let mut sequence = 0;
        for name in &names {
            let bytes = rig.file(name);
            assert!(bytes.len() < 1_600_000);
            let summary = mcap::Summary::read(bytes).unwrap().unwrap();
            assert!(summary.attachment_indexes.len() == messages::LCM_FILES.len());
            for message in raw(bytes) {
                assert_eq!(message.sequence, sequence);
                sequence += 1;
            }
        }
        assert_eq!(sequence, 301);
        assert_eq!(rig.told.last().unwrap().dropped, 0);
    }
}

#[test]
fn log_times_never_go_back_and_the_order_is_that_of_the_bus() {
    let mut rig = Rig::new(config());
    rig.ms(100);
    for at in [100, 90, 95, 110] {
        rig.bench.event(Event::RawMessage { at: Instant::from_millis(at), channel: "A", data: b"" });
    }
    rig.command(CmdLog::STOP, "");
    rig.ms(50);
    let times: Vec<u64> = raw(rig.file(FIRST)).iter().map(|message| message.log_time / 1_000_000).collect();
    assert_eq!(times, [100, 100, 100, 110, 120]);
}

#[test]
fn a_channel_whose_type_changes_has_both() {
    let mut rig = Rig::new(config());
    let data = |channel: Channel| channel.fingerprint().to_be_bytes();
    for _ in 0..2 {
        rig.receive("X", &data(Channel::LlDataOdo));
        rig.receive("X", &data(Channel::LlDataSrfs));
        rig.receive("X", &[7; 8]);
        rig.receive("X", &[]);
    }
    rig.command(CmdLog::STOP, "");
    rig.ms(50);
    let summary = mcap::Summary::read(rig.file(FIRST)).unwrap().unwrap();
    let raw: Vec<_> = summary.channels.values().filter(|channel| channel.topic == "X").collect();
    assert_eq!(raw.len(), 3);
    let messages = rig::raw(rig.file(FIRST));
    let names: Vec<_> = messages.iter().map(|m| m.schema.as_ref().map(|(name, _)| name.as_str())).collect();
    let one = [Some("lowlevel.data_odo_t"), Some("lowlevel.data_srfs_t"), None, None];
    assert_eq!(names, [&one[..], &one, &[Some("common.cmd_log_t")]].concat());
}

#[test]
fn a_hundred_thousand_channels_are_too_many_and_reported_once() {
    let mut rig = Rig::new(config());
    for number in 0..100_000 {
        rig.receive(&format!("CHANNEL_{number}"), &[1; 16]);
        if number % 1000 == 0 {
            rig.ms(10);
        }
    }
    rig.odo(1);
    assert_eq!(rig.faults(Fault::LogCrowded), (1, 0));
    rig.command(CmdLog::STOP, "");
    rig.ms(1100);
    assert_eq!(raw(rig.file(FIRST)).len(), 4096);
    let dropped = rig.told.iter().map(|told| told.dropped).max().unwrap();
    assert!(dropped > 90_000, "{dropped}");
    // The next file has room.
    rig.command(CmdLog::START, "");
    rig.ms(50);
    assert_eq!(rig.faults(Fault::LogCrowded), (1, 1));
}

/// What grows under a flood of channels is the index, about 25 bytes for each channel of a chunk: at 5 chunks a second
/// and 260 channels half a megabyte in 15 s. It ends with the file.
#[test]
fn a_file_ends_when_its_index_is_full_however_few_bytes_it_has() {
    let mut rig = Rig::new(config());
    let channels: Vec<String> = (0..2000).map(|number| format!("FOREIGN_{number}")).collect();
    for _ in 0..130 {
        channels.iter().for_each(|channel| rig.receive(channel, &[0; 8]));
        // A chunk of its own.
        rig.ms(200);
    }
    // 250 000 entries are 125 chunks.
    assert_eq!(rig.names().len(), 2);
    assert!(rig.told.iter().all(|told| told.dropped == 0));
}

#[test]
fn a_message_of_a_hundred_megabytes_fits_and_its_memory_is_released() {
    let mut rig = Rig::new(config());
    let large = vec![3; 100_000_000];
    rig.receive("LARGE", &large);
    rig.odo(1);
    rig.ms(3000);
    rig.command(CmdLog::STOP, "");
    rig.ms(100);
    let names: Vec<String> = rig.names().into_iter().map(String::from).collect();
    assert_eq!(names.len(), 2, "the file ended after it: {names:?}");
    let messages = raw(rig.file(&names[0]));
    assert_eq!((messages.len(), &messages[0].data), (1, &large));
    assert_eq!(raw(rig.file(&names[1])).len(), 2);
}

#[test]
fn it_ends_when_everything_is_on_the_disk() {
    let mut rig = Rig::new(config());
    rig.odo(1);
    let now = rig.bench.now();
    let mut out = Actions::new(Epoch::default());
    rig.bench.shell.terminate(now, &mut out);
    for action in out.drain() {
        if let module::Action::Send(rig::PORT, module::Output::Store(request)) = action {
            rig.store.send_now(now, request);
        }
    }
    assert!(!rig.ended);
    rig.ms(200);
    assert!(rig.ended);
    let (bytes, durable) = &rig.store.files[FIRST];
    assert_eq!(bytes.len(), *durable);
    assert!(mcap::Summary::read(bytes).unwrap().is_some());
    assert_eq!(rig.bench.shell.state(), State::Terminate);
}

/// Random numbers.
fn noise(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }
}
