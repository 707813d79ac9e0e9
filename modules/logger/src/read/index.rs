//! Content of a file.

use super::chunk::{Head, Records};
use super::{Attachment, Channel, Found, HEAD, Metadata, Scanner, Schema, fields, op, summary};
use std::collections::BTreeMap;
use std::io::{self, Read, Seek};

/// Maximum number of damaged regions whose position is kept; all are counted.
const REGIONS_MAX: usize = 1000;
/// Maximum size of messages outside chunks that are joined to one piece, bytes.
const BARE_BYTES_MAX: u64 = 1 << 20;

/// Content of a file, with offsets.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Index {
    /// Profile of the file, such as `ros2`.
    pub profile: String,
    /// Library that wrote the file.
    pub library: String,
    /// Types by number.
    pub schemas: BTreeMap<u16, Schema>,
    /// Channels by number. A channel whose definition is lost is present as [`Channel::lost`].
    pub channels: BTreeMap<u16, Channel>,
    /// Number of messages by channel.
    pub counts: BTreeMap<u16, u64>,
    /// Chunks and messages outside chunks, in order of the file.
    pub pieces: Vec<Piece>,
    /// Attached files.
    pub attachments: Vec<Attachment>,
    /// Metadata records.
    pub metadata: Vec<Metadata>,
    /// Size of the file, bytes.
    pub size: u64,
    /// True if the file's own index was used. A file without one was truncated, or is still being written.
    pub indexed: bool,
    /// Damage, as far as the index shows; with [`Index::indexed`] no chunk was read.
    pub damage: Damage,
}

/// Chunk, or consecutive messages outside chunks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Offset of its record.
    pub offset: u64,
    /// Total length, bytes.
    pub length: u64,
    /// First log time, ns since the epoch.
    pub start: u64,
    /// Last log time, ns since the epoch.
    pub end: u64,
    /// Channels of its messages, ascending; `None` if unknown without reading it.
    pub channels: Option<Vec<u16>>,
    /// True for messages outside chunks.
    pub bare: bool,
    /// Compression; empty if uncompressed.
    pub compression: String,
    /// Uncompressed size of its records, bytes.
    pub expanded: u64,
}

/// Damage of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// Number of unparseable regions and of chunks with a wrong checksum.
    pub regions: u64,
    /// Their total size, bytes.
    pub bytes: u64,
    /// First damaged regions: offset and length.
    pub places: Vec<(u64, u64)>,
    /// Bytes of a last record that the end of the file truncates.
    pub cut: u64,
    /// Number of chunks with an unsupported compression.
    pub sealed: u64,
    /// Number of channels that are used but not defined.
    pub lost_channels: u64,
    /// Number of types that are used but not defined.
    pub lost_types: u64,
    /// Number of channels and types with a second, different definition; the first one is used.
    pub redefined: u64,
}

impl Damage {
    /// True if the file is intact.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    pub(crate) fn add(&mut self, offset: u64, length: u64) {
        self.regions += 1;
        self.bytes += length;
        if self.places.len() < REGIONS_MAX {
            self.places.push((offset, length));
        }
    }
}

impl Index {
    /// Reads the index of a file. `progress` is called with the bytes scanned and the total, if a scan is necessary.
    ///
    /// # Errors
    /// Reading failed.
    pub fn read<R: Read + Seek>(mut inner: R, progress: &mut dyn FnMut(u64, u64)) -> io::Result<Self> {
        match Self::read_summary(&mut inner)? {
            Some(index) => Ok(index),
            None => Self::scan(inner, progress),
        }
    }

    /// Reads the index from the file's summary; `None` without an intact summary.
    ///
    /// # Errors
    /// Reading failed.
    pub fn read_summary<R: Read + Seek>(mut inner: R) -> io::Result<Option<Self>> {
        let Some((mut index, gaps)) = summary::read(&mut inner)? else { return Ok(None) };
        let counts = std::mem::take(&mut index.counts);
        let mut builder = Builder { index, ..Builder::default() };
        let mut scanner = Scanner::new(&mut inner)?;
        // The parts that the summary leaves out are scanned.
        for (from, to) in gaps {
            scanner.range(from, to);
            while let Some(found) = scanner.next()? {
                builder.take(&found);
            }
        }
        let mut index = builder.index;
        (index.indexed, index.counts) = (true, counts);
        index.pieces.sort_by_key(|piece| piece.offset);
        Ok(Some(index))
    }

    /// Scans the whole file and verifies all checksums, whatever index it has.
    ///
    /// # Errors
    /// Reading failed.
    pub fn scan<R: Read + Seek>(inner: R, progress: &mut dyn FnMut(u64, u64)) -> io::Result<Self> {
        let mut scanner = Scanner::new(inner)?;
        let (size, mut told) = (scanner.size(), 0);
        let mut builder = Builder::default();
        builder.index.size = size;
        while let Some(found) = scanner.next()? {
            builder.take(&found);
            let at = scanner.position();
            if at - told > 1 << 24 {
                told = at;
                progress(at, size);
            }
        }
        Ok(builder.finish())
    }

    /// First and last log time of all messages, ns since the epoch.
    #[must_use]
    pub fn span(&self) -> Option<(u64, u64)> {
        let holding = || self.pieces.iter().filter(|piece| piece.expanded > 0 && piece.has_messages());
        Some((holding().map(|piece| piece.start).min()?, holding().map(|piece| piece.end).max()?))
    }

    pub(crate) fn define_schema(&mut self, id: u16, schema: Schema) {
        match self.schemas.get(&id) {
            None => drop(self.schemas.insert(id, schema)),
            Some(known) => self.damage.redefined += u64::from(*known != schema),
        }
    }

    pub(crate) fn define_channel(&mut self, id: u16, channel: Channel) {
        match self.channels.get(&id) {
            None => drop(self.channels.insert(id, channel)),
            Some(known) => self.damage.redefined += u64::from(*known != channel),
        }
    }
}

impl Piece {
    /// True unless the piece is known to be without messages.
    #[must_use]
    pub fn has_messages(&self) -> bool {
        self.channels.as_ref().is_none_or(|channels| !channels.is_empty())
    }
}

/// Index built from the results of a scanner.
#[derive(Default)]
pub(crate) struct Builder {
    pub index: Index,
    /// Number of messages by channel in the current chunk.
    counts: BTreeMap<u16, u64>,
}

impl Builder {
    pub fn take(&mut self, found: &Found<'_>) {
        match found {
            Found::Record { opcode, offset, content } => self.record(*opcode, *offset, content),
            Found::Chunk { offset, head, content, records } => {
                self.chunk(*offset, head, HEAD + content.len() as u64, records);
            }
            Found::Sealed { .. } => self.index.damage.sealed += 1,
            Found::Attachment(attachment) => self.index.attachments.push(attachment.clone()),
            Found::Damage { offset, length } => self.index.damage.add(*offset, *length),
            Found::Cut { length } => self.index.damage.cut += length,
            Found::Magic { .. } => {}
        }
    }

    fn record(&mut self, opcode: u8, offset: u64, content: &[u8]) {
        match opcode {
            op::HEADER if self.index.library.is_empty() => {
                (self.index.profile, self.index.library) = fields::header(content).unwrap_or_default();
            }
            op::METADATA => self.index.metadata.extend(fields::metadata(content, offset)),
            op::MESSAGE => self.bare(offset, content),
            _ => self.definition(opcode, content),
        }
    }

    fn definition(&mut self, opcode: u8, content: &[u8]) {
        match opcode {
            op::SCHEMA => {
                if let Some((id, schema)) = fields::schema(content) {
                    self.index.define_schema(id, schema);
                }
            }
            op::CHANNEL => {
                if let Some((id, channel)) = fields::channel(content) {
                    self.index.define_channel(id, channel);
                }
            }
            _ => {}
        }
    }

    /// Joins a message outside chunks to the previous one.
    fn bare(&mut self, offset: u64, content: &[u8]) {
        let Some(message) = fields::message(content) else { return };
        let (length, time) = (HEAD + content.len() as u64, message.log_time);
        *self.index.counts.entry(message.channel).or_default() += 1;
        if let Some(piece) = self.index.pieces.last_mut()
            && piece.bare
            && piece.offset + piece.length == offset
            && piece.length + length <= BARE_BYTES_MAX
        {
            (piece.length, piece.expanded) = (piece.length + length, piece.expanded + length);
            (piece.start, piece.end) = (piece.start.min(time), piece.end.max(time));
            return;
        }
        let (start, end, compression) = (time, time, String::new());
        let piece = Piece { offset, length, start, end, channels: None, bare: true, compression, expanded: length };
        self.index.pieces.push(piece);
    }

    fn chunk(&mut self, offset: u64, head: &Head, length: u64, records: &[u8]) {
        self.counts.clear();
        let (mut start, mut end) = (u64::MAX, 0);
        let mut last: Option<(u16, u64)> = None;
        for record in Records::new(records).flatten() {
            if record.opcode != op::MESSAGE {
                self.definition(record.opcode, record.content);
                continue;
            }
            let Some(message) = fields::message(record.content) else { continue };
            (start, end) = (start.min(message.log_time), end.max(message.log_time));
            last = match last {
                Some((channel, count)) if channel == message.channel => Some((channel, count + 1)),
                other => {
                    if let Some((channel, count)) = other {
                        *self.counts.entry(channel).or_default() += count;
                    }
                    Some((message.channel, 1))
                }
            };
        }
        if let Some((channel, count)) = last {
            *self.counts.entry(channel).or_default() += count;
        }
        for (channel, count) in &self.counts {
            *self.index.counts.entry(*channel).or_default() += count;
        }
        let channels: Vec<u16> = self.counts.keys().copied().collect();
        if channels.is_empty() {
            (start, end) = (0, 0);
        }
        let (compression, expanded) = (head.compression.clone(), head.size);
        let channels = Some(channels);
        self.index.pieces.push(Piece { offset, length, start, end, channels, bare: false, compression, expanded });
    }

    pub fn finish(mut self) -> Index {
        for id in self.index.counts.keys() {
            if !self.index.channels.contains_key(id) {
                self.index.channels.insert(*id, Channel::lost(*id));
                self.index.damage.lost_channels += 1;
            }
        }
        for channel in self.index.channels.values() {
            if channel.schema_id != 0 && !self.index.schemas.contains_key(&channel.schema_id) {
                self.index.schemas.insert(channel.schema_id, Schema::lost(channel.schema_id));
                self.index.damage.lost_types += 1;
            }
        }
        self.index
    }
}
