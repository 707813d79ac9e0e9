//! MCAP file, built in memory and taken out in pieces: each piece ends with a whole chunk.

use crate::config::{Compression, Config};
use crate::ros::{Kind, TOPICS_MAX, Topic};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, McapResult, WriteOptions, Writer};
use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io;
use std::rc::Rc;

/// Size at which a chunk is closed, bytes.
pub const CHUNK_BYTES: u64 = 256 << 10;
/// Maximum number of bus channels in a file; messages on others are dropped.
pub const CHANNELS_MAX: usize = 4096;
/// Maximum number of MCAP channels in a file, over all encodings and types.
const IDS_MAX: usize = TOPICS_MAX + 2 * CHANNELS_MAX;
/// Maximum number of channel entries in a file's chunk indexes; each takes about 25 bytes of memory.
const INDEX_ENTRIES_MAX: u64 = 250_000;
/// Maximum number of notes and marks in a file, as its index holds them all.
const NOTES_MAX: u32 = 10_000;
/// Chunk size after which a file ends, bytes: the writer keeps a buffer for its largest chunk.
const LARGE_CHUNK_BYTES: u64 = 16 << 20;
/// Size of a message record beyond the message itself, bytes.
const RECORD_OVERHEAD_BYTES: u64 = 31;

/// Data at the beginning of a file.
#[derive(Clone, Copy, Debug)]
pub struct FileHeader<'a> {
    /// Configuration of the robot, and of the file's content.
    pub config: &'a Config,
    /// Name of the run.
    pub run: &'a str,
    /// Current log time, ns since the UNIX epoch.
    pub time: u64,
    /// Current monotonic time, ns.
    pub monotonic: u64,
}

/// Times and sequence number of a message.
#[derive(Clone, Copy, Debug)]
pub struct Stamp {
    /// Reception, ns since the UNIX epoch.
    pub log_time: u64,
    /// Publication, ns since the UNIX epoch.
    pub publish_time: u64,
    /// Number of the message in the run, in order of the bus.
    pub sequence: u32,
}

/// File being written.
pub struct File {
    writer: Writer<NoSeek<Sink>>,
    sink: Sink,
    channels: BTreeMap<Box<str>, Slot>,
    /// Channel ids by topic number.
    topics: Vec<Option<u16>>,
    ids: usize,
    notes: u32,
    /// Bytes taken out.
    taken: u64,
    /// Uncompressed size of the open chunk, and of the largest so far, bytes.
    chunk: u64,
    largest: u64,
    /// Last chunk of each channel.
    seen: Vec<u64>,
    chunks: u64,
    index: u64,
}

/// Bus channel: its last fingerprint, and its ids by type; `None` is the id without a type.
#[derive(Debug)]
struct Slot {
    last: (u64, u16),
    ids: Vec<(Option<u64>, u16)>,
}

impl File {
    /// Creates a file with everything that precedes its messages.
    ///
    /// # Errors
    /// The format's limits are exceeded.
    pub fn new(header: &FileHeader<'_>) -> McapResult<Self> {
        let FileHeader { config, run, time, monotonic } = *header;
        let sink = Sink::default();
        let options = options(config).profile("ros2").library(format!("advee {}", config.version));
        let mut writer = options.create(NoSeek::new(sink.clone()))?;
        let of_the_run = [
            ("robot", config.robot.clone()),
            ("version", config.version.clone()),
            ("run", run.to_owned()),
            ("clock_offset_ns", (i128::from(time) - i128::from(monotonic)).to_string()),
            ("monotonic_epoch_ns", monotonic.to_string()),
        ];
        writer.write_metadata(&metadata("advee", of_the_run))?;
        let own = config.attachments.iter().map(|own| (&*own.name, &*own.media_type, &*own.data));
        let types = messages::LCM_FILES.iter().map(|(name, text)| (*name, "text/plain", text.as_bytes()));
        for (name, media_type, data) in own.chain(types) {
            writer.attach(&mcap::Attachment {
                log_time: time,
                create_time: time,
                name: name.into(),
                media_type: media_type.into(),
                data: Cow::Borrowed(data),
            })?;
        }
        Ok(Self {
            writer,
            sink,
            channels: BTreeMap::new(),
            topics: Vec::new(),
            ids: 0,
            notes: 0,
            taken: 0,
            chunk: 0,
            largest: 0,
            seen: Vec::new(),
            chunks: 0,
            index: 0,
        })
    }

    /// Writes a bus message unchanged, with its type if known.
    ///
    /// # Errors
    /// The file has no free channel.
    pub fn raw(&mut self, channel: &str, kind: Option<&Kind>, data: &[u8], stamp: Stamp) -> McapResult<()> {
        let fingerprint = data.first_chunk().map_or(0, |bytes| u64::from_be_bytes(*bytes));
        let id = match self.channels.get(channel) {
            Some(slot) if slot.last.0 == fingerprint => slot.last.1,
            _ => self.channel(channel, kind, fingerprint)?,
        };
        self.message(id, data, stamp)
    }

    /// Id of a channel whose message type has changed.
    fn channel(&mut self, channel: &str, kind: Option<&Kind>, fingerprint: u64) -> McapResult<u16> {
        let key = kind.map(|_| fingerprint);
        let known = self.channels.get_mut(channel).and_then(|slot| {
            let (_, id) = slot.ids.iter().find(|(of, _)| *of == key)?;
            slot.last = (fingerprint, *id);
            Some(*id)
        });
        if let Some(id) = known {
            return Ok(id);
        }
        if !self.channels.contains_key(channel) && self.channels.len() >= CHANNELS_MAX {
            return Err(McapError::TooManyChannels);
        }
        self.room()?;
        let schema = match kind {
            Some(kind) => self.writer.add_schema(&kind.name, "", &[])?,
            None => 0,
        };
        let id = self.writer.add_channel(schema, channel, "lcm", &types(kind))?;
        let fresh = || Slot { last: (fingerprint, id), ids: Vec::new() };
        let slot = self.channels.entry(channel.into()).or_insert_with(fresh);
        slot.last = (fingerprint, id);
        slot.ids.push((key, id));
        self.ids += 1;
        Ok(id)
    }

    fn room(&self) -> McapResult<()> {
        if self.ids < IDS_MAX { Ok(()) } else { Err(McapError::TooManyChannels) }
    }

    /// Writes a message in its ROS 2 form.
    ///
    /// # Errors
    /// The file has no free channel.
    pub fn ros(&mut self, topic: &Topic, data: &[u8], stamp: Stamp) -> McapResult<()> {
        let place = usize::from(topic.id);
        if self.topics.len() <= place {
            self.topics.resize(place + 1, None);
        }
        let id = match self.topics[place] {
            Some(id) => id,
            None => {
                self.room()?;
                let schema = self.writer.add_schema(&topic.schema_name, "ros2msg", topic.schema_text.as_bytes())?;
                let id = self.writer.add_channel(schema, &topic.name, "cdr", &BTreeMap::new())?;
                self.ids += 1;
                self.topics[place] = Some(id);
                id
            }
        };
        self.message(id, data, stamp)
    }

    fn message(&mut self, channel_id: u16, data: &[u8], stamp: Stamp) -> McapResult<()> {
        let Stamp { log_time, publish_time, sequence } = stamp;
        self.writer.write_to_known_channel(&MessageHeader { channel_id, sequence, log_time, publish_time }, data)?;
        self.chunk += data.len() as u64 + RECORD_OVERHEAD_BYTES;
        let place = usize::from(channel_id);
        if self.seen.len() <= place {
            self.seen.resize(place + 1, 0);
        }
        if self.seen[place] != self.chunks + 1 {
            self.seen[place] = self.chunks + 1;
            self.index += 1;
        }
        Ok(())
    }

    /// Adds a note to the metadata; beyond the maximum number it is left out.
    ///
    /// # Errors
    /// Not expected: the file is in memory.
    pub fn note<const N: usize>(&mut self, name: &str, entries: [(&str, String); N]) -> McapResult<()> {
        if self.notes < NOTES_MAX {
            self.notes += 1;
            // The writer closes the chunk for it.
            self.end_chunk();
            self.writer.write_metadata(&metadata(name, entries))?;
        }
        Ok(())
    }

    /// True if the open chunk has reached its size.
    pub fn chunk_is_full(&self) -> bool {
        self.chunk >= CHUNK_BYTES
    }

    /// True if the file has reached its size.
    pub fn is_full(&self, max_bytes: u64) -> bool {
        self.taken >= max_bytes || self.index >= INDEX_ENTRIES_MAX || self.largest >= LARGE_CHUNK_BYTES
    }

    fn end_chunk(&mut self) {
        self.chunks += 1;
        self.largest = self.largest.max(self.chunk);
        self.chunk = 0;
    }

    /// Closes the chunk and takes the bytes not taken yet.
    ///
    /// # Errors
    /// Not expected: the file is in memory.
    pub fn take(&mut self) -> McapResult<Vec<u8>> {
        self.end_chunk();
        self.writer.flush()?;
        let bytes = self.sink.take();
        self.taken += bytes.len() as u64;
        Ok(bytes)
    }

    /// Ends the file with its summary and takes the remaining bytes.
    ///
    /// # Errors
    /// Not expected: the file is in memory.
    pub fn finish(mut self) -> McapResult<Vec<u8>> {
        self.writer.finish()?;
        Ok(self.sink.take())
    }
}

fn options(config: &Config) -> WriteOptions {
    let compression = match config.compression {
        Compression::None => None,
        Compression::Lz4 => Some(mcap::Compression::Lz4),
        Compression::Zstd => Some(mcap::Compression::Zstd),
    };
    // Only the host starts threads.
    let options = WriteOptions::new().compression(compression).compression_threads(0).compression_level(1);
    options.chunk_size(Some(2 * CHUNK_BYTES)).disable_seeking(true)
}

fn metadata<const N: usize>(name: &str, entries: [(&str, String); N]) -> Metadata {
    let metadata = entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    Metadata { name: name.into(), metadata }
}

/// Bytes written by the writer and not taken yet.
#[derive(Clone, Debug, Default)]
struct Sink(Rc<RefCell<Vec<u8>>>);

impl Sink {
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.borrow_mut())
    }
}

impl io::Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Text of a raw channel's type, as its channel's metadata contains it. Not a schema: readers for ROS 2 only, such as
/// `rosbags`, reject a file with a schema in an unknown language.
#[must_use]
pub fn types(kind: Option<&Kind>) -> BTreeMap<String, String> {
    kind.map(|kind| (TYPES.into(), kind.lcm.to_string())).into_iter().collect()
}

/// Key of the type's text in a channel's metadata.
pub const TYPES: &str = "lcm";
