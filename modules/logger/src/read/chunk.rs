//! Content of a chunk.

use super::fields::{self, Fields};
use super::{HEAD, Message, RECORD_MAX, op};
use lz4_flex::frame::FrameDecoder as Lz4;
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};
use std::io::Read;

/// Bytes of a chunk's content before its records, without the name of the compression.
const FIXED: u64 = 8 + 8 + 8 + 4 + 4 + 8;
/// Longest name of a compression.
const COMPRESSION_MAX: u64 = 16;
/// Maximum size of a chunk's head, bytes.
pub const HEAD_MAX: usize = (FIXED + COMPRESSION_MAX) as usize;

/// Up to this ratio of the sizes the memory for a chunk is reserved at once.
const USUAL_RATIO: usize = 16;

/// Head of a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Head {
    /// First and last log time of its messages, ns since the epoch.
    pub start: u64,
    pub end: u64,
    /// Size of its records, bytes, and their CRC-32; 0 if unknown.
    pub size: u64,
    pub crc: u32,
    pub compression: String,
    pub compressed: u64,
    /// Size of the head, bytes.
    pub len: usize,
}

impl Head {
    /// Parses the head of a chunk whose content is `length` bytes long and begins with `content`; `None` unless all
    /// lengths are consistent.
    pub fn of(content: &[u8], length: u64) -> Option<Self> {
        let mut fields = Fields(content);
        let (start, end, size, crc) = (fields.u64()?, fields.u64()?, fields.u64()?, fields.u32()?);
        let name = fields.u32().filter(|len| u64::from(*len) <= COMPRESSION_MAX)?;
        let compression = str::from_utf8(fields.bytes(name as usize)?).ok()?;
        let compressed = fields.u64()?;
        let fits = FIXED + u64::from(name) + compressed.min(RECORD_MAX) == length
            && size <= RECORD_MAX
            && (!compression.is_empty() || size == compressed)
            && (start <= end || size == 0)
            && compression.bytes().all(|byte| byte.is_ascii_graphic());
        let len = content.len() - fields.0.len();
        fits.then(|| Self { start, end, size, crc, compression: compression.to_owned(), compressed, len })
    }

    /// True if the compression is supported.
    pub fn is_known(&self) -> bool {
        matches!(self.compression.as_str(), "" | "zstd" | "lz4")
    }
}

/// Unpacks chunks, and keeps its memory for the next one.
#[derive(Default)]
pub struct Unpacker {
    zstd: FrameDecoder,
}

impl Unpacker {
    /// Unpacks the records of a chunk, into `space` if they are compressed; `None` if it is damaged.
    pub fn unpack<'a>(&mut self, head: &Head, content: &'a [u8], space: &'a mut Vec<u8>) -> Option<&'a [u8]> {
        let packed = content.get(head.len..)?;
        let size = usize::try_from(head.size).ok()?;
        let records = match head.compression.as_str() {
            "" => packed,
            "zstd" => {
                prepare(space, packed, size);
                let mut rest = packed;
                while !rest.is_empty() {
                    self.frame(&mut rest, size, space)?;
                }
                space
            }
            "lz4" => {
                prepare(space, packed, size);
                let room = size as u64 + 1;
                Lz4::new(packed).take(room).read_to_end(space).ok()?;
                space
            }
            _ => return None,
        };
        let holds = records.len() == size && (head.crc == 0 || crc32fast::hash(records) == head.crc);
        holds.then_some(records)
    }

    /// Appends the content of a zstd frame: at most `size` bytes in all, whatever the compressed data announces.
    fn frame(&mut self, rest: &mut &[u8], size: usize, space: &mut Vec<u8>) -> Option<()> {
        self.zstd.reset(&mut *rest).ok()?;
        while !self.zstd.is_finished() {
            self.zstd.decode_blocks(&mut *rest, BlockDecodingStrategy::UptoBlocks(1)).ok()?;
            if self.zstd.can_collect() > size - space.len() {
                return None;
            }
            self.zstd.collect_to_writer(&mut *space).ok()?;
        }
        Some(())
    }
}

/// Empties the space, and reserves what a chunk may need; more only as its bytes are produced.
fn prepare(space: &mut Vec<u8>, packed: &[u8], size: usize) {
    space.clear();
    space.reserve(size.min(packed.len().saturating_mul(USUAL_RATIO)) + 1);
}

/// Record in a chunk.
pub struct Record<'a> {
    pub opcode: u8,
    /// Offset in the chunk's records.
    pub offset: usize,
    pub content: &'a [u8],
}

/// Iterator over the records of a chunk; the last item is `None` if they end within a record.
pub struct Records<'a> {
    all: &'a [u8],
    at: usize,
}

impl<'a> Records<'a> {
    pub fn new(all: &'a [u8]) -> Self {
        Self { all, at: 0 }
    }
}

impl<'a> Iterator for Records<'a> {
    type Item = Option<Record<'a>>;

    fn next(&mut self) -> Option<Self::Item> {
        let rest = &self.all[self.at..];
        if rest.is_empty() {
            return None;
        }
        let offset = self.at;
        self.at = self.all.len();
        let whole = || {
            let (head, rest) = rest.split_at_checked(HEAD as usize)?;
            let len = usize::try_from(Fields(&head[1..]).u64()?).ok()?;
            Some((head[0], rest.get(..len)?))
        };
        let Some((opcode, content)) = whole() else { return Some(None) };
        self.at = offset + HEAD as usize + content.len();
        Some(Some(Record { opcode, offset, content }))
    }
}

/// Message whose record begins at `offset` of validated records.
pub fn message_at(records: &[u8], offset: usize) -> Option<Message<'_>> {
    match Records::new(records.get(offset..)?).next()?? {
        Record { opcode: op::MESSAGE, content, .. } => fields::message(content),
        _ => None,
    }
}
