//! Reading MCAP files: ours, cut or damaged ones, and those of others.
//!
//! [`Index`] says what is in a file, from its summary where that holds, else by going through all of it.
//! [`Messages`] gives the messages of one or several files in order of time, holding as many chunks as overlap.
//! What is wrong in a file is skipped, counted and told: only the reader's own failure is an error.
//!
//! Source: MCAP format specification, version 0. Chunks without compression, with zstd and with lz4.

mod chunk;
pub(crate) mod fields;
mod index;
mod merge;
mod scan;
mod summary;

pub(crate) use chunk::{Head, Records};
pub(crate) use index::Builder;
pub use index::{Damage, Index, Piece};
pub use merge::{Entry, Filter, Messages, Skipped};
pub(crate) use scan::{Found, Scanner};

use std::collections::BTreeMap;

/// First and last eight bytes of a file.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Bytes of a record before its content: opcode and length.
pub(crate) const HEAD: u64 = 9;
/// Longest record, and longest content of a chunk, that is taken for one: two forms of the longest LCM message.
pub const RECORD_MAX: u64 = 1 << 30;

pub(crate) mod op {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const ATTACHMENT: u8 = 0x09;
    pub const ATTACHMENT_INDEX: u8 = 0x0A;
    pub const STATISTICS: u8 = 0x0B;
    pub const METADATA: u8 = 0x0C;
    pub const METADATA_INDEX: u8 = 0x0D;
    pub const SUMMARY_OFFSET: u8 = 0x0E;
    pub const DATA_END: u8 = 0x0F;
    /// From here on records are anybody's.
    pub const PRIVATE: u8 = 0x80;
}

/// A message type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// `lowlevel.data_odo_t`, `sensor_msgs/msg/Range`.
    pub name: String,
    /// How `data` says it: `lcm`, `ros2msg`, `jsonschema`, …
    pub encoding: String,
    /// The definition.
    pub data: Vec<u8>,
}

impl Schema {
    /// Stands for a type whose definition is lost.
    #[must_use]
    pub fn lost(id: u16) -> Self {
        Self { name: format!("lost_{id}"), encoding: String::new(), data: Vec::new() }
    }
}

/// A channel of messages of one type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Of its [`Schema`]; 0: none.
    pub schema_id: u16,
    /// Its name.
    pub topic: String,
    /// How messages are encoded: `lcm`, `cdr`, `json`, …
    pub encoding: String,
    /// Anything.
    pub metadata: BTreeMap<String, String>,
}

impl Channel {
    /// Stands for a channel whose definition is lost: its messages have no name and no type.
    #[must_use]
    pub fn lost(id: u16) -> Self {
        Self { schema_id: 0, topic: format!("lost_{id}"), encoding: String::new(), metadata: BTreeMap::new() }
    }
}

/// A file in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Nanoseconds since the epoch.
    pub log_time: u64,
    /// Nanoseconds since the epoch; 0: not known.
    pub create_time: u64,
    /// Its name.
    pub name: String,
    /// `text/plain`, …
    pub media_type: String,
    /// Where its record begins, and the whole record's bytes.
    pub(crate) offset: u64,
    pub(crate) length: u64,
    /// Where its content begins.
    pub data_offset: u64,
    /// Bytes of its content.
    pub data_len: u64,
}

/// Named texts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Metadata {
    /// What they are about.
    pub name: String,
    /// The texts.
    pub values: BTreeMap<String, String>,
    pub(crate) offset: u64,
    pub(crate) length: u64,
}

/// A message as it stands in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// The number of its channel in this file.
    pub channel: u16,
    /// Its number; in our logs of all raw messages of the run.
    pub sequence: u32,
    /// When it was received, ns since the epoch.
    pub log_time: u64,
    /// When it was made, ns since the epoch.
    pub publish_time: u64,
    /// What it says.
    pub data: &'a [u8],
}
