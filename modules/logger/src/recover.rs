//! Restores the index of a truncated or damaged file.
//!
//! [`seal`] adds the index to a file that was only truncated: its content stays in place. [`recover`] writes a new file
//! with everything intact in any file: each chunk with a right checksum unchanged, attachments, metadata, messages
//! outside chunks. Damage is counted with its position. Definitions lost with a damaged chunk come from the file's
//! summary or are replaced by placeholders ([`Channel::lost`](crate::read::Channel::lost)), so that every reader opens
//! the file.

mod tail;

use crate::read::{Builder, Damage, Found, HEAD, Head, Index, MAGIC, Records, Scanner, fields, op};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Seek, SeekFrom, Write};
use tail::{Out, Summary, message_indexes};

/// Number of bytes copied at a time.
const BLOCK_BYTES: usize = 1 << 20;

/// Callback for the progress: bytes done, bytes in total.
pub type Progress<'a> = &'a mut dyn FnMut(u64, u64);

/// Content of the restored file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Number of intact chunks.
    pub chunks: u64,
    /// Number of messages, in chunks and outside them.
    pub messages: u64,
    /// Number of attached files.
    pub attachments: u64,
    /// Number of metadata records.
    pub metadata: u64,
    /// Bytes of the file that was read.
    pub read: u64,
    /// Bytes of the restored file.
    pub written: u64,
    /// Damage.
    pub damage: Damage,
}

/// Result of [`seal`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Sealed {
    /// The file has its index; nothing was written.
    Whole,
    /// The index was added. The caller truncates the file to [`Report::written`] bytes.
    Sealed(Report),
    /// There is damage inside, which only [`recover`] can leave out; nothing was written.
    Damaged(Damage),
}

/// Writes everything intact in `input` to `output`, with an index. Reads `input` twice.
///
/// # Errors
/// Reading or writing failed.
pub fn recover<R: Read + Seek, W: Write>(mut input: R, output: W, progress: Progress<'_>) -> io::Result<Report> {
    let index = Index::scan(&mut input, &mut |at, size| progress(at / 2, size))?;
    let mut scanner = Scanner::new(input)?;
    let mut copy =
        Copy { index: &index, out: Out::new(output, 0), summary: Summary::default(), known: Known::default() };
    copy.out.put(MAGIC)?;
    let library = if index.library.is_empty() { "advee" } else { &index.library };
    copy.out.record(op::HEADER, &tail::header(&index.profile, library))?;
    let (size, mut told) = (scanner.size(), 0);
    loop {
        let later = match scanner.next()? {
            None => break,
            Some(Found::Record { opcode, offset, content }) => {
                copy.record(opcode, offset, content)?;
                None
            }
            Some(Found::Chunk { head, content, records, .. }) => {
                copy.chunk(&head, content, records)?;
                None
            }
            Some(Found::Attachment(attachment)) => {
                copy.summary.attachment(copy.out.at, &attachment);
                Some((attachment.offset, attachment.length))
            }
            Some(Found::Sealed { offset, head, length }) => {
                copy.summary.chunk(copy.out.at, length, &head, &BTreeMap::new(), 0);
                Some((offset, length))
            }
            Some(Found::Damage { .. } | Found::Cut { .. } | Found::Magic { .. }) => None,
        };
        if let Some((offset, length)) = later {
            copy.raw(scanner.get_mut(), offset, length)?;
        }
        let at = scanner.position();
        if at - told > 1 << 24 {
            told = at;
            progress(size / 2 + at / 2, size);
        }
    }
    copy.summary.write(&index, &mut copy.out)?;
    copy.out.flush()?;
    Ok(report(&copy.summary, size, copy.out.at, index.damage.clone()))
}

/// Adds the index to a truncated file.
///
/// # Errors
/// Reading or writing failed. The previous content of the file is still there; the call can be repeated.
pub fn seal<F: Read + Write + Seek>(mut file: F, progress: Progress<'_>) -> io::Result<Sealed> {
    if Index::read_summary(&mut file)?.is_some() {
        return Ok(Sealed::Whole);
    }
    let mut walk = Walk::default();
    let mut scanner = Scanner::new(&mut file)?;
    let (size, mut told) = (scanner.size(), 0);
    while let Some(found) = scanner.next()? {
        walk.take(&found);
        let at = scanner.position();
        if at - told > 1 << 24 {
            told = at;
            progress(at, size);
        }
    }
    let Walk { builder, chunks, mut summary, end, intact, .. } = walk;
    let index = builder.finish();
    let Damage { sealed, lost_channels, lost_types, redefined, .. } = index.damage;
    if !intact || [sealed, lost_channels, lost_types, redefined] != [0; 4] {
        return Ok(Sealed::Damaged(index.damage));
    }
    drop(scanner);
    file.seek(SeekFrom::Start(end))?;
    let mut out = Out::new(&mut file, end);
    let last = chunks.len().saturating_sub(1);
    for (i, chunk) in chunks.into_iter().enumerate() {
        let (offsets, length) = if i == last && chunk.offset + chunk.length == end {
            let offsets = chunk.expected.iter().map(|(channel, at)| (*channel, end + at)).collect();
            out.put(&chunk.indexes)?;
            (offsets, chunk.indexes.len() as u64)
        } else if chunk.found.keys().eq(chunk.expected.keys()) {
            (chunk.found, chunk.found_len)
        } else {
            (BTreeMap::new(), 0)
        };
        summary.chunk(chunk.offset, chunk.length, &chunk.head, &offsets, length);
    }
    summary.write(&index, &mut out)?;
    out.flush()?;
    Ok(Sealed::Sealed(report(&summary, size, out.at, index.damage)))
}

fn report(summary: &Summary, read: u64, written: u64, damage: Damage) -> Report {
    Report {
        chunks: summary.chunks.into(),
        messages: summary.message_count(),
        attachments: summary.attachments.into(),
        metadata: summary.metadata.into(),
        read,
        written,
        damage,
    }
}

/// Adds a chunk's messages to the summary.
fn count(records: &[u8], summary: &mut Summary) {
    let messages = Records::new(records).flatten().filter(|record| record.opcode == op::MESSAGE);
    for message in messages.filter_map(|record| fields::message(record.content)) {
        summary.messages(message.channel, 1, message.log_time, message.log_time);
    }
}

/// Definitions already in the new file.
#[derive(Default)]
struct Known {
    schemas: BTreeSet<u16>,
    channels: BTreeSet<u16>,
}

/// Copy from one file to another.
struct Copy<'a, W> {
    index: &'a Index,
    out: Out<W>,
    summary: Summary,
    known: Known,
}

impl<W: Write> Copy<'_, W> {
    fn record(&mut self, opcode: u8, offset: u64, content: &[u8]) -> io::Result<()> {
        match opcode {
            op::MESSAGE => {
                let Some(message) = fields::message(content) else { return Ok(()) };
                self.define(message.channel)?;
                self.summary.messages(message.channel, 1, message.log_time, message.log_time);
                self.out.record(opcode, content)
            }
            op::METADATA => {
                if let Some(metadata) = fields::metadata(content, offset) {
                    self.summary.metadata(self.out.at, &metadata);
                }
                self.out.record(opcode, content)
            }
            op::PRIVATE.. => self.out.record(opcode, content),
            // Definitions are written before the records that need them, the others at the end.
            _ => Ok(()),
        }
    }

    /// Writes the chunk unchanged, after any missing definitions and before its message indexes.
    fn chunk(&mut self, head: &Head, content: &[u8], records: &[u8]) -> io::Result<()> {
        let mut here = Known::default();
        for record in Records::new(records).flatten() {
            match record.opcode {
                op::SCHEMA => here.schemas.extend(fields::schema(record.content).map(|(id, _)| id)),
                op::CHANNEL => {
                    let Some((id, channel)) = fields::channel(record.content) else { continue };
                    if channel.schema_id != 0 && !here.schemas.contains(&channel.schema_id) {
                        self.define_schema(channel.schema_id)?;
                    }
                    here.channels.insert(id);
                }
                op::MESSAGE => {
                    let channel = fields::message(record.content).map(|message| message.channel);
                    if let Some(id) = channel.filter(|id| !here.channels.contains(id)) {
                        self.define(id)?;
                    }
                }
                _ => {}
            }
        }
        self.known.schemas.append(&mut here.schemas);
        self.known.channels.append(&mut here.channels);
        let offset = self.out.at;
        self.out.record(op::CHUNK, content)?;
        let (indexes, offsets) = message_indexes(records);
        let offsets = offsets.into_iter().map(|(channel, at)| (channel, self.out.at + at)).collect();
        self.out.put(&indexes)?;
        self.summary.chunk(offset, HEAD + content.len() as u64, head, &offsets, indexes.len() as u64);
        count(records, &mut self.summary);
        Ok(())
    }

    fn define(&mut self, id: u16) -> io::Result<()> {
        if !self.known.channels.insert(id) {
            return Ok(());
        }
        let Some(channel) = self.index.channels.get(&id) else { return Ok(()) };
        if channel.schema_id != 0 {
            self.define_schema(channel.schema_id)?;
        }
        self.out.record(op::CHANNEL, &tail::channel(id, channel))
    }

    fn define_schema(&mut self, id: u16) -> io::Result<()> {
        if !self.known.schemas.insert(id) {
            return Ok(());
        }
        let Some(schema) = self.index.schemas.get(&id) else { return Ok(()) };
        self.out.record(op::SCHEMA, &tail::schema(id, schema))
    }

    fn raw<R: Read + Seek>(&mut self, input: &mut R, offset: u64, length: u64) -> io::Result<()> {
        input.seek(SeekFrom::Start(offset))?;
        let (mut left, mut block) = (length, vec![0; BLOCK_BYTES]);
        while left > 0 {
            let part = usize::try_from(left).unwrap_or(BLOCK_BYTES).min(BLOCK_BYTES);
            input.read_exact(&mut block[..part])?;
            self.out.put(&block[..part])?;
            left -= part as u64;
        }
        Ok(())
    }
}

/// Chunk that stays in place.
struct Kept {
    offset: u64,
    length: u64,
    head: Head,
    /// Expected message indexes, and the offset of each channel's; the bytes of the last chunk only.
    indexes: Vec<u8>,
    expected: BTreeMap<u16, u64>,
    /// Offsets of the message indexes found after it.
    found: BTreeMap<u16, u64>,
    found_len: u64,
}

/// Walk over a file whose content stays in place.
#[derive(Default)]
struct Walk {
    builder: Builder,
    chunks: Vec<Kept>,
    summary: Summary,
    /// End of the data.
    end: u64,
    /// True once the end of the data was reached; a summary follows.
    ended: bool,
    /// True if the file begins properly and everything so far can stay.
    intact: bool,
    /// True if the last part was damage, which is acceptable only at the end, where a power cut leaves it.
    damaged: bool,
}

impl Walk {
    fn take(&mut self, found: &Found<'_>) {
        self.builder.take(found);
        if !matches!(found, Found::Damage { .. } | Found::Cut { .. }) {
            self.intact &= !self.damaged;
        }
        match found {
            Found::Magic { offset: 0 } => (self.intact, self.end) = (true, 8),
            Found::Magic { .. } => self.intact &= self.ended,
            Found::Record { opcode, offset, content } => self.record(*opcode, *offset, content),
            Found::Chunk { offset, head, content, records } => {
                self.intact &= !self.ended;
                if let Some(before) = self.chunks.last_mut() {
                    before.indexes = Vec::new();
                }
                let (indexes, expected) = message_indexes(records);
                let (offset, length, found) = (*offset, HEAD + content.len() as u64, BTreeMap::new());
                self.end = offset + length;
                let head = head.clone();
                self.chunks.push(Kept { offset, length, head, indexes, expected, found, found_len: 0 });
                count(records, &mut self.summary);
            }
            Found::Attachment(attachment) => {
                self.intact &= !self.ended;
                self.summary.attachment(attachment.offset, attachment);
                self.end = attachment.offset + attachment.length;
            }
            Found::Damage { .. } => self.damaged |= !self.ended,
            Found::Sealed { .. } | Found::Cut { .. } => {}
        }
    }

    fn record(&mut self, opcode: u8, offset: u64, content: &[u8]) {
        if self.ended {
            return;
        }
        let length = HEAD + content.len() as u64;
        match opcode {
            op::DATA_END => {
                self.ended = true;
                return;
            }
            // The indexes of the last chunk may be incomplete: they are written again.
            op::MESSAGE_INDEX => {
                let channel = fields::Fields(content).u16();
                if let (Some(chunk), Some(channel)) = (self.chunks.last_mut(), channel) {
                    chunk.found.insert(channel, offset);
                    chunk.found_len += length;
                }
                return;
            }
            op::MESSAGE => {
                if let Some(message) = fields::message(content) {
                    self.summary.messages(message.channel, 1, message.log_time, message.log_time);
                }
            }
            op::METADATA => {
                if let Some(metadata) = fields::metadata(content, offset) {
                    self.summary.metadata(offset, &metadata);
                }
            }
            _ => {}
        }
        self.end = offset + length;
    }
}
