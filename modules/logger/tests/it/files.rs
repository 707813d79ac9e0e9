//! Logs as others write them, and the content of a file according to both readers.
#![allow(dead_code, reason = "each test binary uses its part")]

use logger::read::{Channel, Filter, Index, Messages};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

/// Message: topic, sequence number, log time, data.
pub type Line = (String, u32, u64, Vec<u8>);

/// Deterministic pseudo-random numbers.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }

    pub fn bytes(&mut self, len: usize) -> Vec<u8> {
        (0..len).map(|_| self.next() as u8).collect()
    }
}

pub fn options(compression: Option<Compression>, chunk: u64) -> WriteOptions {
    WriteOptions::new().compression(compression).profile("ros2").library("advee test").chunk_size(Some(chunk))
}

/// Log of `count` messages on three channels, with an attachment and a metadata record in the middle.
pub fn log(options: WriteOptions, count: u32) -> (Vec<u8>, Vec<Line>) {
    let mut writer = Writer::with_options(Cursor::new(Vec::new()), options).unwrap();
    let schema = writer.add_schema("p.a_t", "lcm", b"package p; struct a_t { int8_t x; }").unwrap();
    let mut random = Random(88_172_645_463_325_252);
    let mut lines = Vec::new();
    let topics = [("A", schema, "lcm"), ("/A", 0, "cdr"), ("B", 0, "lcm")];
    for sequence in 0..count {
        let (topic, schema, encoding) = topics[random.below(3) as usize];
        let channel = writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap();
        let len = random.below(120) as usize;
        let (log_time, data) = (1_000_000 + u64::from(sequence) * 10, random.bytes(len));
        let header = MessageHeader { channel_id: channel, sequence, log_time, publish_time: log_time - 5 };
        writer.write_to_known_channel(&header, &data).unwrap();
        lines.push((topic.into(), sequence, log_time, data));
        if sequence == count / 2 {
            let data = Cow::Borrowed(&b"[robot]\nname = \"advee\"\n"[..]);
            let (name, media_type) = ("robot.toml".into(), "text/plain".into());
            writer.attach(&Attachment { log_time, create_time: 0, name, media_type, data }).unwrap();
            let values = BTreeMap::from([("robot".into(), "advee".into())]);
            writer.write_metadata(&Metadata { name: "advee".into(), metadata: values }).unwrap();
        }
    }
    writer.finish().unwrap();
    (writer.into_inner().into_inner(), lines)
}

/// All messages as returned by `logger::read`.
pub fn ours(file: &[u8]) -> (Index, Vec<Line>) {
    let index = Index::read(Cursor::new(file), &mut |_, _| {}).unwrap();
    let all = |_: &Channel, _: Option<&logger::read::Schema>| true;
    let filter = Filter { from: 0, to: u64::MAX, wants: &all };
    let mut messages = Messages::new(vec![(Cursor::new(file), Arc::new(index.clone()))], &filter);
    let mut lines = Vec::new();
    while let Some(entry) = messages.next_entry().unwrap() {
        let message = entry.message;
        lines.push((entry.channel.topic.clone(), message.sequence, message.log_time, message.data.to_vec()));
    }
    (index, lines)
}

/// All messages as returned by the format's own library: in file order, and by the index.
pub fn theirs(file: &[u8]) -> Vec<Line> {
    let line = |message: mcap::Message<'_>| {
        (message.channel.topic.clone(), message.sequence, message.log_time, message.data.to_vec())
    };
    let streamed: Vec<Line> = mcap::MessageStream::new(file).unwrap().map(|message| line(message.unwrap())).collect();
    let summary = mcap::Summary::read(file).unwrap().unwrap();
    let mut indexed: Vec<Line> = Vec::new();
    for chunk in &summary.chunk_indexes {
        let stored = summary.stream_chunk(file, chunk).unwrap().count();
        let entries = summary.read_message_indexes(file, chunk).unwrap();
        let entries: Vec<_> = entries.into_values().flatten().collect();
        assert_eq!(stored, entries.len());
        for entry in &entries {
            indexed.push(line(summary.seek_message(file, chunk, entry).unwrap()));
        }
    }
    let statistics = summary.stats.unwrap();
    assert_eq!(statistics.message_count, streamed.len() as u64);
    let (mut sorted, chunked) = (streamed.clone(), !indexed.is_empty());
    sorted.sort();
    indexed.sort();
    assert!(!chunked || sorted == indexed, "the index leads to all messages");
    for index in &summary.attachment_indexes {
        mcap::read::attachment(file, index).unwrap();
    }
    for index in &summary.metadata_indexes {
        mcap::read::metadata(file, index).unwrap();
    }
    streamed
}
