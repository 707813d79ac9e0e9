//! Reading files of the format's own library: intact ones, other compressions, messages outside chunks, order.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::files::{Line, log, options, ours};
use logger::read::{Channel, Filter, Index, Messages, Schema};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::sync::Arc;

#[test]
fn a_whole_file_is_read_by_its_index_whatever_its_compression() {
    for compression in [None, Some(Compression::Zstd), Some(Compression::Lz4)] {
        let (file, lines) = log(options(compression, 4096), 1000);
        let (index, read) = ours(&file);
        assert!(index.indexed && index.damage.is_none());
        assert!(read == lines, "{compression:?}");
        assert_eq!((index.profile.as_str(), index.library.as_str()), ("ros2", "advee test"));
        assert_eq!(index.counts.values().sum::<u64>(), 1000);
        assert_eq!(index.span(), Some((1_000_000, 1_009_990)));
        let attachment = &index.attachments[0];
        let from = attachment.data_offset as usize;
        assert_eq!(&file[from..from + attachment.data_len as usize], b"[robot]\nname = \"advee\"\n");
        assert_eq!(index.metadata[0].values["robot"], "advee");
        // A scan has the same result, except for chunks that contain only definitions.
        let scanned = Index::scan(Cursor::new(&file), &mut |_, _| {}).unwrap();
        assert!(!scanned.indexed && scanned.damage.is_none());
        assert_eq!((scanned.counts, scanned.channels), (index.counts, index.channels));
        assert_eq!((scanned.pieces, scanned.attachments), (index.pieces, index.attachments));
        assert_eq!(scanned.metadata, index.metadata);
    }
}

#[test]
fn messages_outside_of_chunks_are_read_too() {
    let options = WriteOptions::new().use_chunks(false).compression(None);
    let (file, lines) = log(options, 500);
    let (index, read) = ours(&file);
    assert!(index.indexed && read == lines);
    assert_eq!(index.counts.values().sum::<u64>(), 500);
}

#[test]
fn a_file_without_message_indexes_or_without_a_summary_is_read() {
    for options in [
        options(None, 1000).emit_message_indexes(false),
        options(None, 1000).emit_summary_records(false).emit_summary_offsets(false),
        options(None, 1000).repeat_channels(false),
        options(None, 1000).emit_statistics(false),
    ] {
        let (file, lines) = log(options, 300);
        let (index, read) = ours(&file);
        assert!(read == lines && index.damage.is_none());
        assert_eq!(index.counts.values().sum::<u64>(), 300);
    }
}

/// Log of messages `(log time, number)` on one channel, one chunk for each row.
fn chunks(rows: &[&[(u64, u32)]]) -> Vec<u8> {
    let options = WriteOptions::new().compression(None).chunk_size(None);
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options).unwrap();
    for row in rows {
        let channel_id = writer.add_channel(0, "A", "lcm", &BTreeMap::new()).unwrap();
        for &(log_time, sequence) in *row {
            let header = MessageHeader { channel_id, sequence, log_time, publish_time: 0 };
            writer.write_to_known_channel(&header, b"x").unwrap();
        }
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn merged(files: &[Vec<u8>], from: u64, to: u64) -> (Vec<(u64, u32)>, u64) {
    let all = |_: &Channel, _: Option<&Schema>| true;
    let opened = files.iter().map(|file| {
        let index = Index::read(Cursor::new(&file[..]), &mut |_, _| {}).unwrap();
        (Cursor::new(&file[..]), Arc::new(index))
    });
    let mut messages = Messages::new(opened.collect(), &Filter { from, to, wants: &all });
    let mut order = Vec::new();
    while let Some(entry) = messages.next_entry().unwrap() {
        order.push((entry.message.log_time, entry.message.sequence));
    }
    (order, messages.skipped().unordered)
}

#[test]
fn messages_come_by_time_then_number_over_chunks_and_files() {
    let files = [
        chunks(&[&[(5, 1), (3, 0), (9, 4)], &[(4, 9), (6, 2)], &[(20, 7)]]),
        chunks(&[&[(5, 0), (5, 3)], &[(1, 8), (30, 1)]]),
    ];
    let all = [(1, 8), (3, 0), (4, 9), (5, 0), (5, 1), (5, 3), (6, 2), (9, 4), (20, 7), (30, 1)];
    assert_eq!(merged(&files, 0, u64::MAX), (all.to_vec(), 0));
    assert_eq!(merged(&files, 5, 9).0, all[3..8]);
    assert_eq!(merged(&files, 10, 19).0, []);
}

#[test]
fn only_what_is_wanted_is_read() {
    struct Counting<'a>(Cursor<&'a [u8]>, &'a std::cell::Cell<u64>);
    impl Read for Counting<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let read = self.0.read(buffer)?;
            self.1.set(self.1.get() + read as u64);
            Ok(read)
        }
    }
    impl Seek for Counting<'_> {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }
    let (file, lines) = log(options(None, 64 << 10), 100_000);
    let read = std::cell::Cell::new(0);
    let index = Index::read(Counting(Cursor::new(&file), &read), &mut |_, _| {}).unwrap();
    assert!(read.get() < file.len() as u64 / 10, "the index alone: {} of {}", read.get(), file.len());
    read.set(0);
    let wants = |channel: &Channel, _: Option<&Schema>| channel.topic == "B";
    let (from, to) = (1_500_000, 1_510_000);
    let filter = Filter { from, to, wants: &wants };
    let mut messages = Messages::new(vec![(Counting(Cursor::new(&file), &read), Arc::new(index))], &filter);
    let wanted: Vec<&Line> = lines.iter().filter(|line| line.0 == "B" && (from..=to).contains(&line.2)).collect();
    for line in wanted {
        let entry = messages.next_entry().unwrap().unwrap();
        assert_eq!((entry.message.log_time, entry.message.data), (line.2, &line.3[..]));
    }
    assert!(messages.next_entry().unwrap().is_none());
    assert!(read.get() < 512 << 10, "{}", read.get());
}

#[test]
fn a_channel_whose_type_changes_and_100_000_channels_are_read() {
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options(None, 1 << 20)).unwrap();
    let types = ["struct a_t { int8_t x; }", "struct a_t { int16_t x; }"];
    for (i, text) in types.iter().enumerate() {
        let schema = writer.add_schema("a_t", "lcm", text.as_bytes()).unwrap();
        let channel_id = writer.add_channel(schema, "A", "lcm", &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id, sequence: i as u32, log_time: i as u64, publish_time: 0 };
        writer.write_to_known_channel(&header, b"").unwrap();
    }
    writer.finish().unwrap();
    let (index, read) = ours(&writer.into_inner().into_inner());
    let known: Vec<&[u8]> = index.schemas.values().map(|schema| &schema.data[..]).collect();
    assert_eq!(known, [types[0].as_bytes(), types[1].as_bytes()]);
    assert_eq!(read.iter().map(|line| line.0.as_str()).collect::<Vec<_>>(), ["A", "A"]);

    // A file has at most 65 535 channels, so there are two files.
    let many = |from: u32| {
        let mut writer = Writer::with_options(Cursor::new(Vec::new()), options(None, 1 << 18)).unwrap();
        for i in from..from + 50_000 {
            let channel_id = writer.add_channel(0, &format!("C{i}"), "lcm", &BTreeMap::new()).unwrap();
            let header = MessageHeader { channel_id, sequence: i, log_time: u64::from(i), publish_time: 0 };
            writer.write_to_known_channel(&header, b"x").unwrap();
        }
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    };
    let (order, unordered) = merged(&[many(0), many(50_000)], 0, u64::MAX);
    assert_eq!((order.len(), unordered), (100_000, 0));
    assert!(order.iter().enumerate().all(|(i, line)| line.1 == i as u32));
}
