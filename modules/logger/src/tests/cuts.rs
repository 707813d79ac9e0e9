//! Power cuts, and truncated files.

use super::rig::{Rig, Store, raw, read};
use super::{FIRST, config, noise};
use crate::recover::recover;
use crate::{Compression, Config};
use base::{Duration, Instant};
use messages::common::CmdLog;
use std::io::Cursor;

/// Maximum loss in a power cut, besides one synchronization with the data written with it.
const COST: Duration = Duration::from_millis(250);

#[test]
fn five_hundred_power_cuts_cost_a_quarter_of_a_second_and_one_synchronization() {
    let mut random = noise(7);
    let mut below = |n: u64| random() % n;
    let mut worst = Duration::ZERO;
    for number in 0..500 {
        let sync = Duration::from_millis(1 + below(40));
        let compression = [Compression::None, Compression::Lz4, Compression::Zstd][number % 3];
        let store = Store { sync, bytes_per_ms: 10_000 + below(100_000) as usize, ..Store::default() };
        let mut rig = Rig::on(store, Config { compression, file_max_bytes: 300_000, ..config() });
        let (burst, size) = (1 + below(4), 8 * (1 + below(500) as usize));
        let end = Instant::from_millis(300 + below(1500));
        let mut heard = Vec::new();
        let mut data = vec![0; size];
        while rig.bench.now() < end {
            for _ in 0..burst {
                data.chunks_exact_mut(8).for_each(|bytes| bytes.copy_from_slice(&below(1 << 40).to_le_bytes()));
                heard.push(rig.bench.now());
                rig.receive("SOMETHING", &data);
            }
            rig.pass(Duration::from_micros(100 + below(30_000)));
        }
        let cut = rig.bench.now();
        let mut survived = 0;
        for (bytes, durable) in rig.store.files.values() {
            let left = &bytes[..*durable];
            // A file that was just created does not even have a beginning.
            let mut recovered = Vec::new();
            let report = recover(Cursor::new(left), &mut recovered, &mut |_, _| {}).unwrap();
            assert_eq!(report.messages, read(left).len() as u64, "cut {number}");
            assert!(mcap::Summary::read(&recovered).unwrap().is_some(), "cut {number}");
            for message in raw(&recovered) {
                assert_eq!(message.sequence as usize, survived, "cut {number}: nothing is missing in between");
                survived += 1;
            }
        }
        if let Some(lost) = heard.get(survived) {
            let cost = cut.since(*lost);
            // The data written with the synchronization may be lost, and so may the data being written at that moment.
            let writing = Duration::from_millis(2 * (1 << 20) / rig.store.bytes_per_ms as u64 + 1);
            assert!(cost <= COST + sync + writing, "cut {number}: {cost:?} are lost, a sync takes {sync:?}");
            worst = worst.max(cost.saturating_sub(sync));
        }
    }
    println!("the worst of 500 cuts cost {worst:?} beside one synchronization");
    assert!(worst > Duration::from_millis(100), "what is not lost was not cut: {worst:?}");
}

#[test]
fn of_two_thousand_files_cut_anywhere_every_whole_chunk_is_read() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let mut rig = Rig::new(Config { compression, ..config() });
        for ticks in 0..200 {
            rig.odo(ticks);
            rig.receive("SOMETHING", &[ticks as u8; 40]);
            rig.ms(10);
        }
        rig.command(CmdLog::STOP, "");
        rig.ms(50);
        let file = rig.file(FIRST);
        let summary = mcap::Summary::read(file).unwrap().unwrap();
        assert!(summary.chunk_indexes.len() >= 10, "{}", summary.chunk_indexes.len());
        // End of each chunk, and number of messages up to there.
        let end = |index: &mcap::records::ChunkIndex| (index.chunk_start_offset + index.chunk_length) as usize;
        let ends: Vec<usize> = summary.chunk_indexes.iter().map(end).collect();
        let whole: Vec<(usize, usize)> = ends.into_iter().map(|end| (end, read(&file[..end]).len())).collect();
        assert_eq!(whole.last().unwrap().1, read(file).len());
        let mut random = noise(11);
        for _ in 0..2000 / 3 + 1 {
            let cut = (random() % file.len() as u64) as usize;
            let least = whole.iter().rev().find(|(end, _)| *end <= cut).map_or(0, |(_, messages)| *messages);
            let messages = read(&file[..cut]).len();
            assert!(messages >= least, "cut at {cut}: {messages} of {least} messages");
        }
    }
}

#[test]
fn a_fast_bus_is_not_synchronized_for_each_chunk() {
    let mut rig = Rig::on(
        Store { bytes_per_ms: 120_000, ..Store::default() },
        Config { compression: Compression::None, ..config() },
    );
    rig.ms(20);
    let data = vec![1; 50_000];
    let before = rig.store.syncs;
    for _ in 0..1000 {
        rig.receive("FAST", &data);
        rig.ms(1);
    }
    let syncs = rig.store.syncs - before;
    assert!((5..=8).contains(&syncs), "{syncs} synchronizations in a second");
    assert!(rig.store.appends > 50, "{}", rig.store.appends);
    assert_eq!(rig.told.last().unwrap().dropped, 0);
    // When the bus falls silent, the remainder is synchronized.
    rig.ms(250);
    let (bytes, durable) = rig.store.files.values().next_back().unwrap();
    assert_eq!(bytes.len(), *durable);
}
