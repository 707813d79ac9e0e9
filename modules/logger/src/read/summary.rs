//! Index at the end of a file.

use super::fields::{self, Fields};
use super::{Attachment, HEAD, Index, MAGIC, Metadata, Piece, RECORD_MAX, op};
use crate::read::chunk::{Record, Records};
use std::io::{self, Read, Seek, SeekFrom};

/// Size of the footer with its head, and the last eight bytes.
const TAIL: u64 = HEAD + 20 + 8;

/// Parts of a file: from, to.
type Ranges = Vec<(u64, u64)>;

/// Index from the summary, and the parts of the data that it does not cover; `None` if there is no summary, or it is
/// damaged or incomplete: a scan is then necessary.
pub fn read<R: Read + Seek>(inner: &mut R) -> io::Result<Option<(Index, Ranges)>> {
    let size = inner.seek(SeekFrom::End(0))?;
    let mut begin = [0; 8];
    if size < 8 + TAIL || !read_at(inner, 0, &mut begin)? || begin != *MAGIC {
        return Ok(None);
    }
    let mut tail = [0; TAIL as usize];
    if !read_at(inner, size - TAIL, &mut tail)? {
        return Ok(None);
    }
    let Some((start, crc)) = footer(&tail) else { return Ok(None) };
    let len = (size - TAIL).saturating_sub(start);
    if start < 8 + HEAD || start > size - TAIL || len > RECORD_MAX {
        return Ok(None);
    }
    inner.seek(SeekFrom::Start(start))?;
    let mut bytes = Vec::new();
    inner.take(len).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != len {
        return Ok(None);
    }
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytes);
    // Up to the checksum itself.
    hasher.update(&tail[..(HEAD + 16) as usize]);
    if crc != 0 && crc != hasher.finalize() {
        return Ok(None);
    }
    let Some((mut index, said, indexes)) = parse(&bytes, size) else { return Ok(None) };
    // Counts and content must agree; some writers count nothing.
    let known = |channel: &u16| index.channels.contains_key(channel);
    let complete = index.counts.keys().all(known)
        && index.pieces.iter().all(|piece| piece.channels.iter().flatten().all(known))
        && said.is_some()
        && said == Some(index.counts.values().sum())
        && index
            .channels
            .values()
            .all(|channel| channel.schema_id == 0 || index.schemas.contains_key(&channel.schema_id));
    if !complete {
        return Ok(None);
    }
    let mut head = [0; HEAD as usize];
    let has_header = read_at(inner, 8, &mut head)? && head[0] == op::HEADER;
    let header_len = Fields(&head[1..]).u64().filter(|len| has_header && *len <= 1 << 20 && 8 + HEAD + len <= start);
    let Some(header_len) = header_len else { return Ok(None) };
    let mut header = vec![0; header_len as usize];
    read_at(inner, 8 + HEAD, &mut header)?;
    let Some((profile, library)) = fields::header(&header) else { return Ok(None) };
    (index.profile, index.library, index.size) = (profile, library, size);
    let gaps = gaps(&mut index, &indexes, 8 + HEAD + header_len, start);
    Ok(gaps.map(|gaps| (index, gaps)))
}

fn read_at<R: Read + Seek>(inner: &mut R, offset: u64, bytes: &mut [u8]) -> io::Result<bool> {
    inner.seek(SeekFrom::Start(offset))?;
    match inner.read_exact(bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

/// Offset of the summary, and its checksum.
fn footer(tail: &[u8; TAIL as usize]) -> Option<(u64, u32)> {
    let mut fields = Fields(tail);
    let head = fields.bytes(HEAD as usize)?;
    let fits = head[0] == op::FOOTER && Fields(&head[1..]).u64() == Some(20);
    let (start, _offsets, crc) = (fields.u64()?, fields.u64()?, fields.u32()?);
    (fits && fields.0 == MAGIC && start != 0).then_some((start, crc))
}

/// Index, its number of messages, and the length of the message indexes after each chunk.
fn parse(bytes: &[u8], size: u64) -> Option<(Index, Option<u64>, Vec<u64>)> {
    let mut index = Index::default();
    let (mut said, mut indexes) = (None, Vec::new());
    for record in Records::new(bytes) {
        let Record { opcode, content, .. } = record?;
        match opcode {
            op::SCHEMA => {
                let (id, schema) = fields::schema(content)?;
                index.define_schema(id, schema);
            }
            op::CHANNEL => {
                let (id, channel) = fields::channel(content)?;
                index.define_channel(id, channel);
            }
            op::CHUNK_INDEX => {
                let (piece, length) = piece(content)?;
                index.pieces.push(piece);
                indexes.push(length);
            }
            op::ATTACHMENT_INDEX => index.attachments.push(attachment(content)?),
            op::METADATA_INDEX => index.metadata.push(metadata(content)?),
            op::STATISTICS => said = Some(statistics(content, &mut index)?),
            _ => {}
        }
    }
    index.damage = super::Damage::default();
    let inside = |offset: u64, length: u64| offset.checked_add(length).is_some_and(|end| end <= size);
    let with_indexes = |(piece, length): (&Piece, &u64)| inside(piece.offset, piece.length.saturating_add(*length));
    let fits = index.pieces.iter().zip(&indexes).all(with_indexes)
        && index.attachments.iter().all(|attachment| inside(attachment.offset, attachment.length));
    fits.then_some((index, said, indexes))
}

/// Chunk from its index record, and the length of the message indexes after it.
fn piece(content: &[u8]) -> Option<(Piece, u64)> {
    let mut fields = Fields(content);
    let (start, end, offset, length) = (fields.u64()?, fields.u64()?, fields.u64()?, fields.u64()?);
    let mut offsets = Fields(fields.block()?);
    let mut channels = Vec::new();
    while !offsets.0.is_empty() {
        let (channel, _at) = (offsets.u16()?, offsets.u64()?);
        channels.push(channel);
    }
    let indexes = fields.u64()?;
    let compression = fields.text()?.to_owned();
    let (_compressed, expanded) = (fields.u64()?, fields.u64()?);
    channels.sort_unstable();
    channels.dedup();
    // A writer without message indexes leaves the list empty.
    let channels = (indexes > 0 || expanded == 0).then_some(channels);
    let piece = Piece { offset, length, start, end, channels, bare: false, compression, expanded };
    (length >= HEAD && start <= end).then_some((piece, indexes))
}

fn attachment(content: &[u8]) -> Option<Attachment> {
    let mut fields = Fields(content);
    let (offset, length, log_time) = (fields.u64()?, fields.u64()?, fields.u64()?);
    let (create_time, data_len) = (fields.u64()?, fields.u64()?);
    let (name, media_type) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    let before = HEAD + 8 + 8 + 4 + name.len() as u64 + 4 + media_type.len() as u64 + 8;
    let fits = before.checked_add(data_len)?.checked_add(4)? == length;
    let data_offset = offset.checked_add(before)?;
    fits.then_some(Attachment { log_time, create_time, name, media_type, offset, length, data_offset, data_len })
}

/// Its texts are in the data and are read like a gap.
fn metadata(content: &[u8]) -> Option<Metadata> {
    let mut fields = Fields(content);
    let (offset, length) = (fields.u64()?, fields.u64()?);
    Some(Metadata { name: fields.text()?.to_owned(), values: std::collections::BTreeMap::new(), offset, length })
}

fn statistics(content: &[u8], index: &mut Index) -> Option<u64> {
    let mut fields = Fields(content);
    let messages = fields.u64()?;
    // Schemas, channels, attachments, metadata, chunks; first and last time.
    fields.bytes(2 + 4 + 4 + 4 + 4 + 8 + 8)?;
    let mut counts = Fields(fields.block()?);
    while !counts.0.is_empty() {
        let (channel, count) = (counts.u16()?, counts.u64()?);
        if count > 0 {
            index.counts.insert(channel, count);
        }
    }
    Some(messages)
}

/// Parts of the data outside chunks, their message indexes, and attachments; `None` if these overlap. Metadata,
/// definitions and messages outside chunks are there.
fn gaps(index: &mut Index, indexes: &[u64], from: u64, to: u64) -> Option<Ranges> {
    let pieces = index.pieces.iter().zip(indexes);
    let mut taken: Ranges = pieces.map(|(piece, length)| (piece.offset, piece.length + length)).collect();
    taken.extend(index.attachments.iter().map(|attachment| (attachment.offset, attachment.length)));
    taken.sort_unstable();
    index.metadata.clear();
    let (mut gaps, mut at) = (Vec::new(), from);
    for (offset, length) in taken {
        if offset < at || offset + length > to {
            return None;
        }
        if offset > at {
            gaps.push((at, offset));
        }
        at = offset + length;
    }
    if at < to {
        gaps.push((at, to));
    }
    Some(gaps)
}
