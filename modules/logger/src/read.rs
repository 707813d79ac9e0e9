//! Reader for MCAP files: of this logger and of others, truncated or damaged.
//!
//! [`Index`] lists the content of a file, from its summary if that is intact, else by a scan. [`Messages`] returns the
//! messages of one or several files in order of time; it holds as many chunks as overlap. Damage is skipped, counted
//! and reported: only a failure of the underlying reader is an error.
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
pub use merge::{Ahead, Content, Entry, Filter, Loader, Messages, Skipped};
pub(crate) use scan::{Found, Scanner};

use std::collections::BTreeMap;

/// First and last eight bytes of a file.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Bytes of a record before its content: opcode and length.
pub(crate) const HEAD: u64 = 9;
/// Longest plausible record, and longest content of a chunk: two forms of the longest LCM message.
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
    /// First opcode of private records.
    pub const PRIVATE: u8 = 0x80;
}

/// Message type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// Name, such as `lowlevel.data_odo_t` or `sensor_msgs/msg/Range`.
    pub name: String,
    /// Language of `data`: `lcm`, `ros2msg`, `jsonschema`, …
    pub encoding: String,
    /// Definition.
    pub data: Vec<u8>,
}

impl Schema {
    /// Placeholder for a type whose definition is lost.
    #[must_use]
    pub fn lost(id: u16) -> Self {
        Self { name: format!("lost_{id}"), encoding: String::new(), data: Vec::new() }
    }
}

/// Channel of messages of one type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Id of its [`Schema`]; 0 without one.
    pub schema_id: u16,
    /// Name.
    pub topic: String,
    /// Encoding of the messages: `lcm`, `cdr`, `json`, …
    pub encoding: String,
    /// Additional metadata.
    pub metadata: BTreeMap<String, String>,
}

impl Channel {
    /// Placeholder for a channel whose definition is lost: its messages have no name and no type.
    #[must_use]
    pub fn lost(id: u16) -> Self {
        Self { schema_id: 0, topic: format!("lost_{id}"), encoding: String::new(), metadata: BTreeMap::new() }
    }
}

/// File attached to a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Log time, ns since the epoch.
    pub log_time: u64,
    /// Creation, ns since the epoch; 0 if unknown.
    pub create_time: u64,
    /// Name of the file.
    pub name: String,
    /// Media type: `text/plain`, …
    pub media_type: String,
    /// Offset and length of the whole record.
    pub(crate) offset: u64,
    pub(crate) length: u64,
    /// Offset of the content.
    pub data_offset: u64,
    /// Length of the content, bytes.
    pub data_len: u64,
}

/// Named set of texts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Metadata {
    /// Name of the set.
    pub name: String,
    /// Texts.
    pub values: BTreeMap<String, String>,
    pub(crate) offset: u64,
    pub(crate) length: u64,
}

/// Message as stored in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message<'a> {
    /// Number of its channel in this file.
    pub channel: u16,
    /// Sequence number; in logs of this project over all raw messages of the run.
    pub sequence: u32,
    /// Reception, ns since the epoch.
    pub log_time: u64,
    /// Publication, ns since the epoch.
    pub publish_time: u64,
    /// Encoded message.
    pub data: &'a [u8],
}
