//! Records of a file's index.

use crate::read::{Attachment, Channel, HEAD, Head, Index, MAGIC, Metadata, Records, Schema, fields, op};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Writer that counts its bytes.
pub struct Out<W> {
    inner: W,
    /// Offset in the file.
    pub at: u64,
}

impl<W: Write> Out<W> {
    /// Continues at byte `at` of a file.
    pub fn new(inner: W, at: u64) -> Self {
        Self { inner, at }
    }

    pub fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.inner.write_all(bytes)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    pub fn record(&mut self, opcode: u8, content: &[u8]) -> io::Result<()> {
        self.put(&head(opcode, content.len()))?;
        self.put(content)
    }

    pub fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

fn head(opcode: u8, len: usize) -> [u8; HEAD as usize] {
    let mut head = [opcode; HEAD as usize];
    head[1..].copy_from_slice(&(len as u64).to_le_bytes());
    head
}

fn record(out: &mut Vec<u8>, opcode: u8, content: &[u8]) {
    out.extend_from_slice(&head(opcode, content.len()));
    out.extend_from_slice(content);
}

fn block(out: &mut Vec<u8>, bytes: &[u8]) {
    out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
    out.extend_from_slice(bytes);
}

macro_rules! numbers {
    ($out:expr, $($number:expr),+) => { $($out.extend_from_slice(&$number.to_le_bytes());)+ };
}

pub fn header(profile: &str, library: &str) -> Vec<u8> {
    let mut out = Vec::new();
    block(&mut out, profile.as_bytes());
    block(&mut out, library.as_bytes());
    out
}

pub fn schema(id: u16, schema: &Schema) -> Vec<u8> {
    let mut out = id.to_le_bytes().to_vec();
    block(&mut out, schema.name.as_bytes());
    block(&mut out, schema.encoding.as_bytes());
    block(&mut out, &schema.data);
    out
}

pub fn channel(id: u16, channel: &Channel) -> Vec<u8> {
    let mut out = id.to_le_bytes().to_vec();
    numbers!(out, channel.schema_id);
    block(&mut out, channel.topic.as_bytes());
    block(&mut out, channel.encoding.as_bytes());
    let mut texts = Vec::new();
    for (key, value) in &channel.metadata {
        block(&mut texts, key.as_bytes());
        block(&mut texts, value.as_bytes());
    }
    block(&mut out, &texts);
    out
}

/// Message indexes of a chunk: whole records, and the offset of each channel's.
pub fn message_indexes(records: &[u8]) -> (Vec<u8>, BTreeMap<u16, u64>) {
    let mut entries: BTreeMap<u16, Vec<u8>> = BTreeMap::new();
    for found in Records::new(records).flatten().filter(|found| found.opcode == op::MESSAGE) {
        if let Some(message) = fields::message(found.content) {
            let entry = entries.entry(message.channel).or_default();
            numbers!(entry, message.log_time, (found.offset as u64));
        }
    }
    let (mut out, mut offsets) = (Vec::new(), BTreeMap::new());
    for (channel, entries) in &entries {
        offsets.insert(*channel, out.len() as u64);
        let mut content = channel.to_le_bytes().to_vec();
        block(&mut content, entries);
        record(&mut out, op::MESSAGE_INDEX, &content);
    }
    (out, offsets)
}

/// Content of the summary.
#[derive(Default)]
pub struct Summary {
    chunk_indexes: Vec<u8>,
    attachment_indexes: Vec<u8>,
    metadata_indexes: Vec<u8>,
    pub chunks: u32,
    pub attachments: u32,
    pub metadata: u32,
    span: Option<(u64, u64)>,
    counts: BTreeMap<u16, u64>,
}

impl Summary {
    /// Adds a chunk. `offsets` are relative to the file.
    pub fn chunk(&mut self, offset: u64, length: u64, head: &Head, offsets: &BTreeMap<u16, u64>, indexes: u64) {
        let mut content = Vec::new();
        numbers!(content, head.start, head.end, offset, length);
        let mut map = Vec::new();
        for (channel, at) in offsets {
            numbers!(map, channel, at);
        }
        block(&mut content, &map);
        numbers!(content, indexes);
        block(&mut content, head.compression.as_bytes());
        numbers!(content, head.compressed, head.size);
        record(&mut self.chunk_indexes, op::CHUNK_INDEX, &content);
        self.chunks += 1;
    }

    pub fn attachment(&mut self, offset: u64, attachment: &Attachment) {
        let mut content = Vec::new();
        numbers!(content, offset, attachment.length, attachment.log_time, attachment.create_time, attachment.data_len);
        block(&mut content, attachment.name.as_bytes());
        block(&mut content, attachment.media_type.as_bytes());
        record(&mut self.attachment_indexes, op::ATTACHMENT_INDEX, &content);
        self.attachments += 1;
    }

    pub fn metadata(&mut self, offset: u64, metadata: &Metadata) {
        let mut content = Vec::new();
        numbers!(content, offset, metadata.length);
        block(&mut content, metadata.name.as_bytes());
        record(&mut self.metadata_indexes, op::METADATA_INDEX, &content);
        self.metadata += 1;
    }

    /// Adds `count` messages of a channel, received between these log times.
    pub fn messages(&mut self, channel: u16, count: u64, first: u64, last: u64) {
        *self.counts.entry(channel).or_default() += count;
        self.span = Some(self.span.map_or((first, last), |(start, end)| (start.min(first), end.max(last))));
    }

    pub fn message_count(&self) -> u64 {
        self.counts.values().sum()
    }

    fn statistics(&self, index: &Index) -> Vec<u8> {
        let mut content = Vec::new();
        let (start, end) = self.span.unwrap_or_default();
        numbers!(content, self.message_count(), (index.schemas.len() as u16), (index.channels.len() as u32));
        numbers!(content, self.attachments, self.metadata, self.chunks, start, end);
        let mut counts = Vec::new();
        for (channel, count) in &self.counts {
            numbers!(counts, channel, count);
        }
        block(&mut content, &counts);
        content
    }

    /// Ends a file: end of the data, summary, footer.
    pub fn write<W: Write>(&self, index: &Index, out: &mut Out<W>) -> io::Result<()> {
        out.record(op::DATA_END, &0u32.to_le_bytes())?;
        let start = out.at;
        let mut summary = Vec::new();
        let mut groups: Vec<(u8, usize, usize)> = Vec::new();
        let mut group = |opcode: u8, summary: &mut Vec<u8>, write: &dyn Fn(&mut Vec<u8>)| {
            let begin = summary.len();
            write(summary);
            if summary.len() > begin {
                groups.push((opcode, begin, summary.len() - begin));
            }
        };
        group(op::SCHEMA, &mut summary, &|out| {
            index.schemas.iter().for_each(|(id, it)| record(out, op::SCHEMA, &schema(*id, it)));
        });
        group(op::CHANNEL, &mut summary, &|out| {
            index.channels.iter().for_each(|(id, it)| record(out, op::CHANNEL, &channel(*id, it)));
        });
        group(op::STATISTICS, &mut summary, &|out| record(out, op::STATISTICS, &self.statistics(index)));
        group(op::CHUNK_INDEX, &mut summary, &|out| out.extend_from_slice(&self.chunk_indexes));
        group(op::ATTACHMENT_INDEX, &mut summary, &|out| out.extend_from_slice(&self.attachment_indexes));
        group(op::METADATA_INDEX, &mut summary, &|out| out.extend_from_slice(&self.metadata_indexes));
        let offsets = start + summary.len() as u64;
        for (opcode, begin, len) in groups {
            let mut content = vec![opcode];
            numbers!(content, (start + begin as u64), (len as u64));
            record(&mut summary, op::SUMMARY_OFFSET, &content);
        }
        summary.extend_from_slice(&head(op::FOOTER, 20));
        numbers!(summary, start, offsets);
        let crc = crc32fast::hash(&summary);
        numbers!(summary, crc);
        summary.extend_from_slice(MAGIC);
        out.put(&summary)
    }
}
