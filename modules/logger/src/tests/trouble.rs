//! Disks that are slow, full, read-only or missing.

use super::rig::{Rig, Store, notes, odo_ticks, raw};
use super::{FIRST, config, noise};
use crate::{Compression, Config};
use base::Fault;
use base::store::Trouble;
use messages::common::CmdLog;
use module::{Input, State};

#[test]
fn a_slow_disk_costs_messages_which_are_counted_and_reported_once() {
    let store = Store { bytes_per_ms: 100, ..Store::default() };
    let limits = Config { buffer_bytes: 1_000_000, compression: Compression::None, ..config() };
    let mut rig = Rig::on(store, limits);
    rig.ms(500);
    let mut heard = 0;
    // 2 MB/s, of which the disk accepts 0.1 MB/s for ten seconds.
    for _ in 0..1000 {
        rig.receive("SOMETHING", &[0; 20_000]);
        heard += 1;
        rig.ms(10);
    }
    assert_eq!(rig.faults(Fault::LogLost), (1, 0));
    assert_eq!(rig.faults(Fault::LogRefused), (0, 0));
    assert_eq!(rig.bench.shell.state(), State::Run);
    rig.store.bytes_per_ms = 100_000;
    rig.ms(10_000);
    rig.receive("SOMETHING", &[1]);
    rig.ms(6000);
    assert_eq!(rig.faults(Fault::LogLost), (1, 1));
    let dropped = rig.told.last().unwrap().dropped as usize;
    rig.command(CmdLog::STOP, "");
    rig.ms(1000);
    let file = rig.file(FIRST);
    let messages = raw(file);
    // The last two are the final odometry message and the command.
    assert_eq!(messages.len() - 2 + dropped, heard);
    assert!(dropped > 800, "{dropped}");
    let gaps = notes(file, "gap");
    let noted: usize = gaps.iter().map(|gap| gap["messages"].parse::<usize>().unwrap()).sum();
    assert_eq!(noted, dropped);
    assert!(gaps.iter().all(|gap| gap["since"].parse::<u64>().unwrap() <= gap["until"].parse().unwrap()));
}

#[test]
fn the_oldest_runs_are_removed_and_other_files_stay() {
    let mut store = Store { capacity: 10_000_000, ..Store::default() };
    store.put("2020_01_01_00_00_00_10/log_000.mcap", 1_000_000);
    store.put("2020_01_01_00_00_00_2/log_000.mcap", 1_000_000);
    store.put("2021_01_01_00_00_00/inputs", 1_000_000);
    store.put("photos/holiday.jpg", 1_000_000);
    let mut rig = Rig::on(store, Config { keep_free_bytes: 6_500_000, keep_runs_bytes: 2_600_000, ..config() });
    rig.ms(100);
    // Three runs are more than may be kept; there is enough space then.
    assert_eq!(rig.store.folders(), ["1970_01_01_00_00_00", "2020_01_01_00_00_00_10", "2021_01_01_00_00_00", "photos"]);
    let mut random = noise(3);
    let mut feed = |rig: &mut Rig, count: usize| {
        for _ in 0..count {
            let data: Vec<u8> = std::iter::repeat_with(|| random() as u8).take(10_000).collect();
            rig.receive("NOISE", &data);
            rig.ms(5);
        }
        rig.ms(300);
    };
    feed(&mut rig, 80);
    assert_eq!(rig.store.folders(), ["1970_01_01_00_00_00", "2021_01_01_00_00_00", "photos"]);
    feed(&mut rig, 100);
    assert_eq!(rig.store.folders(), ["1970_01_01_00_00_00", "photos"]);
    assert_eq!(rig.faults(Fault::LogRefused), (0, 0));
    // Then only this run is left, and its file ends properly with the limit of free space intact.
    feed(&mut rig, 200);
    assert_eq!(rig.faults(Fault::LogRefused), (1, 0));
    assert_eq!(rig.bench.shell.state(), State::Error);
    assert!(!rig.told.last().unwrap().recording);
    assert!(rig.store.free() > 6_000_000, "{}", rig.store.free());
    assert!(mcap::Summary::read(rig.file(FIRST)).unwrap().is_some());
    // Space is freed by others.
    rig.store.capacity = 20_000_000;
    rig.ms(6000);
    assert_eq!(rig.faults(Fault::LogRefused), (1, 1));
    assert_eq!(rig.bench.shell.state(), State::Run);
    rig.odo(7);
    rig.ms(300);
    let next = "1970_01_01_00_00_00/log_001.mcap";
    assert_eq!(odo_ticks(&raw(rig.file(next)).last().unwrap().data), 7);
}

#[test]
fn a_disk_filled_by_others_is_retried() {
    let mut rig = Rig::new(config());
    rig.ms(300);
    rig.store.put("photos/holiday.jpg", 0);
    rig.store.capacity = rig.file(FIRST).len() + 100;
    rig.odo(1);
    rig.ms(1000);
    assert_eq!(rig.faults(Fault::LogRefused), (1, 0));
    assert_eq!(rig.faults(Fault::LogLost), (1, 0));
    assert!(rig.told.last().unwrap().dropped >= 1);
    rig.store.capacity = 1 << 30;
    rig.odo(2);
    rig.ms(6000);
    assert_eq!(rig.faults(Fault::LogRefused), (1, 1));
    let next = rig.file("1970_01_01_00_00_00/log_001.mcap");
    // The messages received meanwhile were kept.
    assert_eq!(odo_ticks(&raw(next)[0].data), 2);
    rig.command(CmdLog::STOP, "");
    rig.ms(100);
    assert_eq!(notes(rig.file("1970_01_01_00_00_00/log_001.mcap"), "gap")[0]["messages"], "1");
}

#[test]
fn refused_data_is_written_when_the_disk_accepts_it_again() {
    for trouble in [Trouble::ReadOnly, Trouble::Other("it is wet".into())] {
        let mut rig = Rig::new(config());
        rig.ms(300);
        rig.store.trouble = Some(trouble);
        rig.odo(1);
        rig.ms(1500);
        assert_eq!((rig.faults(Fault::LogRefused), rig.bench.shell.state()), ((1, 0), State::Error));
        rig.store.trouble = None;
        rig.odo(2);
        rig.ms(3000);
        assert_eq!((rig.faults(Fault::LogRefused), rig.bench.shell.state()), ((1, 1), State::Run));
        assert_eq!(rig.faults(Fault::LogLost), (0, 0));
        let ticks: Vec<i32> = raw(rig.file(FIRST)).iter().map(|message| odo_ticks(&message.data)).collect();
        assert_eq!(ticks, [1, 2]);
    }
}

#[test]
fn a_file_that_accepts_no_more_data_is_followed_by_another() {
    let mut rig = Rig::new(config());
    rig.ms(300);
    rig.store.open = None;
    rig.odo(1);
    rig.ms(10_000);
    rig.odo(2);
    rig.ms(1000);
    let next = raw(rig.file("1970_01_01_00_00_00/log_001.mcap"));
    assert_eq!(odo_ticks(&next[0].data), 2);
    assert_eq!(rig.faults(Fault::LogLost), (1, 1));
    assert_eq!(rig.faults(Fault::LogRefused), (1, 1));
}

#[test]
fn a_read_only_folder_is_reported_and_the_last_seconds_are_kept() {
    let mut rig = Rig::on(Store { trouble: Some(Trouble::ReadOnly), ..Store::default() }, config());
    for ticks in 0..200 {
        rig.odo(ticks);
        rig.ms(100);
    }
    assert_eq!((rig.faults(Fault::LogRefused), rig.bench.shell.state()), ((1, 0), State::Error));
    assert_eq!(rig.faults(Fault::LogLost), (1, 0));
    assert!(rig.told.last().unwrap().dropped > 50);
    rig.store.trouble = None;
    rig.ms(2000);
    assert_eq!((rig.faults(Fault::LogRefused), rig.bench.shell.state()), ((1, 1), State::Run));
    assert_eq!(rig.names().len(), 1);
    let name = rig.names()[0].to_owned();
    let messages = raw(rig.file(&name));
    assert_eq!(odo_ticks(&messages.last().unwrap().data), 199);
    assert!((80..=101).contains(&messages.len()), "{}", messages.len());
}

#[test]
fn after_the_loss_of_the_folder_the_run_continues_in_another_file() {
    let mut rig = Rig::new(config());
    rig.ms(300);
    rig.odo(1);
    rig.store.forget();
    rig.port(Input::Down("the card is out"));
    rig.ms(1000);
    assert_eq!((rig.faults(Fault::PortDown), rig.bench.shell.state()), ((1, 0), State::Error));
    rig.odo(2);
    rig.port(Input::Up);
    rig.ms(1000);
    assert_eq!((rig.faults(Fault::PortDown), rig.bench.shell.state()), ((1, 1), State::Run));
    let next = raw(rig.file("1970_01_01_00_00_00/log_001.mcap"));
    assert_eq!(odo_ticks(&next[0].data), 2);
    assert_eq!(rig.faults(Fault::LogLost), (1, 0));
}

#[test]
fn in_stop_the_file_is_closed_and_in_pause_recording_continues() {
    let mut rig = Rig::new(config());
    let state = |state: State| messages::common::CmdState {
        timestamp: 0,
        module: "logger".into(),
        state: state as i8,
        manual: true,
        source: "test".into(),
    };
    rig.receive_message(state(State::Pause));
    rig.odo(1);
    rig.receive_message(state(State::Stop));
    rig.ms(100);
    assert!(mcap::Summary::read(rig.file(FIRST)).unwrap().is_some());
    assert_eq!(raw(rig.file(FIRST)).len(), 3);
    assert!(!rig.told.last().unwrap().recording);
    rig.odo(2);
    rig.ms(2000);
    assert_eq!(rig.names().len(), 1);
    rig.receive_message(state(State::Run));
    rig.ms(500);
    // The messages received meanwhile were kept, as without recording.
    let name = rig.names()[1].to_owned();
    assert_eq!(odo_ticks(&raw(rig.file(&name))[0].data), 2);
}
