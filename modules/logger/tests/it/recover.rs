//! Truncated and damaged files, and files with foreign bytes in front: everything intact is there afterwards, for every
//! reader.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::files::{Line, Random, log, options, ours, theirs};
use logger::recover::{Report, Sealed, recover, seal};
use mcap::records::MessageHeader;
use mcap::{Compression, Writer};
use std::collections::BTreeMap;
use std::io::Cursor;

fn recovered(file: &[u8]) -> (Vec<u8>, Report) {
    let mut out = Vec::new();
    let report = recover(Cursor::new(file), &mut out, &mut |_, _| {}).unwrap();
    assert_eq!(report.written, out.len() as u64);
    (out, report)
}

/// File with its index added in place, as a caller does it.
fn sealed(file: &[u8]) -> (Vec<u8>, Sealed) {
    let mut inner = Cursor::new(file.to_vec());
    let sealed = seal(&mut inner, &mut |_, _| {}).unwrap();
    let mut bytes = inner.into_inner();
    if let Sealed::Sealed(report) = &sealed {
        bytes.truncate(report.written as usize);
    }
    (bytes, sealed)
}

/// Number of messages in whole chunks before each byte.
fn chunk_ends(file: &[u8]) -> Vec<(u64, usize)> {
    let summary = mcap::Summary::read(file).unwrap().unwrap();
    let mut ends = vec![(0, 0)];
    for chunk in &summary.chunk_indexes {
        let messages = summary.stream_chunk(file, chunk).unwrap().count();
        let before = ends.last().unwrap().1;
        ends.push((chunk.chunk_start_offset + chunk.chunk_length, before + messages));
    }
    ends
}

/// Messages that this reader finds by the file's own index.
fn indexed(file: &[u8]) -> Vec<Line> {
    let (index, lines) = ours(file);
    assert!(index.indexed && index.damage.is_none());
    lines
}

fn kept(ends: &[(u64, usize)], len: usize) -> usize {
    ends.iter().filter(|(end, _)| *end <= len as u64).map(|(_, messages)| *messages).max().unwrap_or(0)
}

/// A power cut also leaves zeros in place of data. Zeros that the file has at that place anyway count as written: they
/// may complete a chunk.
fn zeros_behind_a_cut_change_nothing(file: &[u8], len: usize) {
    let written = len + file[len..].iter().take_while(|byte| **byte == 0).count();
    let (cut, zeros) = (&file[..written], [&file[..len], &[0; 5000]].concat());
    assert!(recovered(&zeros).0 == recovered(cut).0, "{len}");
    assert!(len < 50 || sealed(&zeros).0 == sealed(cut).0, "{len}");
}

#[test]
fn zeros_that_are_the_end_of_a_chunk_complete_it() {
    let (file, lines) = log(options(None, 2000), 2000);
    let ends = chunk_ends(&file);
    let ends_with_zero = |(end, _): &&(u64, usize)| *end > 0 && file[*end as usize - 1] == 0;
    let (end, messages) = *ends.iter().find(ends_with_zero).expect("a chunk that ends with a zero");
    let cut = end as usize - 1;
    zeros_behind_a_cut_change_nothing(&file, cut);
    let zeros = [&file[..cut], &[0; 5000]].concat();
    assert!(indexed(&recovered(&zeros).0) == lines[..messages] && messages > kept(&ends, cut));
}

#[test]
fn cut_at_2000_random_bytes_everything_in_whole_chunks_is_kept() {
    for compression in [None, Some(Compression::Zstd)] {
        let (file, lines) = log(options(compression, 2000), 2000);
        let ends = chunk_ends(&file);
        let mut random = Random(7);
        for round in 0..1000 {
            let len = random.below(file.len() as u64) as usize;
            let cut = &file[..len];
            let whole = &lines[..kept(&ends, len)];
            let (index, read) = ours(cut);
            assert!(!index.indexed && read == whole, "{len}");
            let (out, report) = recovered(cut);
            assert_eq!(report.messages, whole.len() as u64);
            assert!(indexed(&out) == whole, "{len}");
            // In place the result is the same, as soon as the beginning of a file exists.
            let (bytes, outcome) = sealed(cut);
            match outcome {
                Sealed::Sealed(report) => {
                    assert!(indexed(&bytes) == whole && report.messages == whole.len() as u64, "{len}");
                    assert!(matches!(sealed(&bytes).1, Sealed::Whole));
                    assert_eq!(bytes[..len.min(39)], file[..len.min(39)]);
                }
                other => assert!(len < 50, "{len}: {other:?}"),
            }
            if round % 20 == 0 {
                assert!(theirs(&out) == whole && (len < 50 || theirs(&sealed(cut).0) == whole), "{len}");
                zeros_behind_a_cut_change_nothing(&file, len);
            }
        }
    }
}

#[test]
fn an_intact_file_is_unchanged_and_its_copy_has_the_same_content() {
    for compression in [None, Some(Compression::Zstd), Some(Compression::Lz4)] {
        let (file, lines) = log(options(compression, 3000), 1500);
        let (bytes, outcome) = sealed(&file);
        assert!(bytes == file && outcome == Sealed::Whole);
        let (out, report) = recovered(&file);
        assert!(theirs(&out) == lines && report.damage.is_none());
        assert_eq!((report.messages, report.attachments, report.metadata), (1500, 1, 1));
        let (index, read) = ours(&out);
        assert!(index.indexed && read == lines);
        assert_eq!((index.attachments.len(), index.metadata[0].values["robot"].as_str()), (1, "advee"));
    }
}

#[test]
fn random_damage_costs_the_chunks_it_hits_and_no_more() {
    let (file, lines) = log(options(None, 2000), 3000);
    let ends = chunk_ends(&file);
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let mut random = Random(3);
    for round in 0..300 {
        let mut bad = file.clone();
        let hits = 1 + random.below(5);
        let mut lost = std::collections::BTreeSet::new();
        for _ in 0..hits {
            let at = random.below(file.len() as u64) as usize;
            let len = 1 + random.below(300) as usize;
            for byte in bad.iter_mut().skip(at).take(len) {
                *byte ^= 1 + random.below(255) as u8;
            }
            for (i, chunk) in summary.chunk_indexes.iter().enumerate() {
                let (from, to) = (chunk.chunk_start_offset as usize, ends[i + 1].0 as usize);
                if at < to && at + len > from {
                    lost.insert(i);
                }
            }
        }
        let (out, report) = recovered(&bad);
        let there: Vec<Line> = theirs(&out);
        let by_number: Vec<u32> = there.iter().map(|line| line.1).collect();
        for (i, pair) in ends.windows(2).enumerate() {
            if !lost.contains(&i) {
                let numbers = pair[0].1 as u32..pair[1].1 as u32;
                assert!(
                    numbers.clone().all(|n| by_number.binary_search(&n).is_ok()),
                    "round {round}: chunk {i} of {lost:?}"
                );
            }
        }
        assert!(there.iter().all(|line| lines[line.1 as usize].3 == line.3), "what is kept is right");
        assert!(lost.is_empty() || !report.damage.is_none(), "and what is lost is told");
    }
}

#[test]
fn a_channel_defined_in_a_lost_chunk_is_taken_from_the_summary_or_replaced() {
    let (file, lines) = log(options(None, 2000), 300);
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let first = &summary.chunk_indexes[0];
    let mut bad = file.clone();
    bad[(first.chunk_start_offset + first.chunk_length - 1) as usize] ^= 1;
    let lost = chunk_ends(&file)[1].1;
    let (out, report) = recovered(&bad);
    assert!(theirs(&out) == lines[lost..] && report.damage.lost_channels == 0);
    // The same without the summary.
    let last = summary.chunk_indexes.last().unwrap();
    bad.truncate((last.chunk_start_offset + last.chunk_length) as usize);
    let (out, report) = recovered(&bad);
    let there = theirs(&out);
    assert_eq!(report.damage.lost_channels, 3);
    assert!(there.iter().map(|line| &line.3).eq(lines[lost..].iter().map(|line| &line.3)));
    assert!(there.iter().all(|line| line.0.starts_with("lost_")));
    assert!(matches!(sealed(&bad).1, Sealed::Damaged(_)));
}

#[test]
fn foreign_bytes_in_front_and_behind_and_two_files_in_one() {
    let (file, lines) = log(options(None, 2000), 500);
    let mut random = Random(11);
    for len in [1, 8, 9, 100, 1 << 20, (1 << 20) - 20, 3 << 20] {
        let garbage = random.bytes(len);
        let (out, report) = recovered(&[&garbage[..], &file].concat());
        assert!(theirs(&out) == lines && report.damage.bytes == len as u64, "{len}");
        let (out, report) = recovered(&[&file[..], &garbage].concat());
        assert!(theirs(&out) == lines && !report.damage.is_none(), "{len}");
    }
    let (out, _) = recovered(&[&file[..], &file].concat());
    assert_eq!(theirs(&out).len(), 1000);
}

#[test]
fn a_file_in_the_data_of_a_message_is_data() {
    let (inner, _) = log(options(None, 2000), 100);
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options(None, 1000)).unwrap();
    let channel_id = writer.add_channel(0, "LOG", "lcm", &BTreeMap::new()).unwrap();
    for sequence in 0..3 {
        let header = MessageHeader { channel_id, sequence, log_time: 1, publish_time: 0 };
        writer.write_to_known_channel(&header, &inner).unwrap();
    }
    writer.finish().unwrap();
    let mut file = writer.into_inner().into_inner();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    // The middle chunk is damaged; its content is not mistaken for chunks of this file.
    let chunk = &summary.chunk_indexes[1];
    file[(chunk.chunk_start_offset + chunk.chunk_length - 1) as usize] ^= 1;
    let (out, report) = recovered(&file);
    assert_eq!(theirs(&out).iter().map(|line| line.1).collect::<Vec<_>>(), [0, 2]);
    assert_eq!((report.damage.regions, report.damage.bytes), (1, chunk.chunk_length));
}

#[test]
fn a_message_of_100_mb_is_kept() {
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options(None, 1 << 18)).unwrap();
    let channel_id = writer.add_channel(0, "BIG", "lcm", &BTreeMap::new()).unwrap();
    for (sequence, len) in [10, 100_000_000, 10].into_iter().enumerate() {
        let header = MessageHeader { channel_id, sequence: sequence as u32, log_time: 1, publish_time: 0 };
        writer.write_to_known_channel(&header, &vec![7; len]).unwrap();
    }
    writer.flush().unwrap();
    let file = writer.into_inner().into_inner();
    let (bytes, outcome) = sealed(&file);
    assert!(matches!(outcome, Sealed::Sealed(Report { messages: 3, .. })), "{outcome:?}");
    assert_eq!(theirs(&bytes).iter().map(|line| line.3.len()).collect::<Vec<_>>(), [10, 100_000_000, 10]);
}

#[test]
fn heads_of_chunks_that_each_claim_the_rest_take_linear_time() {
    // 300 000 heads with consistent lengths, each over all the following bytes: verifying each would take hours.
    let (each, count) = (60u64, 300_000u64);
    let mut hostile = b"\x89MCAP0\r\n".to_vec();
    let total = 8 + each * count;
    while (hostile.len() as u64) < total {
        let left = total - hostile.len() as u64;
        let packed = left.saturating_sub(9 + 40);
        hostile.push(6);
        hostile.extend((packed + 40).to_le_bytes());
        hostile.extend([0; 16]);
        hostile.extend(packed.to_le_bytes());
        hostile.extend(1u32.to_le_bytes());
        hostile.extend(0u32.to_le_bytes());
        hostile.extend(packed.to_le_bytes());
        hostile.resize(hostile.len() + (each as usize - 49), 0);
    }
    let (out, report) = recovered(&hostile);
    assert_eq!(report.messages, 0);
    assert!(theirs(&out).is_empty());
    // A chunk that expands without end is abandoned.
    let bomb = mcap_bomb();
    assert_eq!(recovered(&bomb).1.messages, 0);
}

/// Chunk that declares 100 bytes and expands to 64 MiB.
fn mcap_bomb() -> Vec<u8> {
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options(Some(Compression::Zstd), 1 << 30)).unwrap();
    let channel_id = writer.add_channel(0, "BIG", "lcm", &BTreeMap::new()).unwrap();
    let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 0 };
    writer.write_to_known_channel(&header, &vec![0; 64 << 20]).unwrap();
    writer.finish().unwrap();
    let mut file = writer.into_inner().into_inner();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let at = summary.chunk_indexes[0].chunk_start_offset as usize + 9 + 16;
    file[at..at + 8].copy_from_slice(&100u64.to_le_bytes());
    file
}
