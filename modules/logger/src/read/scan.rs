//! Scan of a file, record by record, that continues after damage.
//!
//! A chunk is accepted if its checksum is right, any other record if its lengths are plausible and a record may follow
//! it. Otherwise the next chunk is searched by the lengths in its head, which must be consistent.

use super::chunk::{HEAD_MAX, Head, Records, Unpacker};
use super::fields::{self, Fields};
use super::{Attachment, HEAD, MAGIC, RECORD_MAX, op};
use std::io::{self, Read, Seek, SeekFrom};

/// Minimum number of bytes per read.
const BLOCK_BYTES: u64 = 1 << 20;
/// Maximum size of an attachment's names, bytes.
const NAMES_BYTES_MAX: u64 = 64 << 10;

/// Part of a file.
pub enum Found<'a> {
    /// Whole record other than those below.
    Record { opcode: u8, offset: u64, content: &'a [u8] },
    /// Chunk with a right checksum: content of its record, and the records in it.
    Chunk { offset: u64, head: Head, content: &'a [u8], records: &'a [u8] },
    /// Chunk with an unsupported compression.
    Sealed { offset: u64, head: Head, length: u64 },
    /// Attachment with a right checksum.
    Attachment(Attachment),
    /// Unparseable bytes.
    Damage { offset: u64, length: u64 },
    /// Last record, truncated by the end of the file.
    Cut { length: u64 },
    /// Eight bytes with which a file begins and ends.
    Magic { offset: u64 },
}

/// [`Found`] without its content.
enum Step {
    Record { opcode: u8, offset: u64, len: u64 },
    Chunk { offset: u64, len: u64, head: Head },
    Sealed { offset: u64, head: Head, length: u64 },
    Attachment(Attachment),
    Damage { offset: u64, length: u64 },
    Cut { length: u64 },
    Magic { offset: u64 },
}

/// Iterator over the parts of a file.
pub struct Scanner<R> {
    inner: R,
    at: u64,
    end: u64,
    /// Buffered bytes, and their offset in the file.
    window: Vec<u8>,
    base: u64,
    space: Vec<u8>,
    unpacker: Unpacker,
    /// Bytes spent on invalid chunks.
    wasted: u64,
    size: u64,
}

impl<R: Read + Seek> Scanner<R> {
    /// Creates a scanner over a whole file.
    pub fn new(mut inner: R) -> io::Result<Self> {
        let size = inner.seek(SeekFrom::End(0))?;
        let (window, space, unpacker) = (Vec::new(), Vec::new(), Unpacker::default());
        Ok(Self { inner, at: 0, end: size, window, base: 0, space, unpacker, wasted: 0, size })
    }

    /// Size of the file, bytes.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Current offset.
    pub fn position(&self) -> u64 {
        self.at
    }

    /// Restricts the scan to `from..to`.
    pub fn range(&mut self, from: u64, to: u64) {
        (self.at, self.end) = (from.min(self.size), to.min(self.size));
    }

    /// Underlying reader.
    pub fn get_mut(&mut self) -> &mut R {
        &mut self.inner
    }

    /// Next part; `None` at the end.
    pub fn next(&mut self) -> io::Result<Option<Found<'_>>> {
        let Some(step) = self.step()? else { return Ok(None) };
        Ok(Some(match step {
            Step::Record { opcode, offset, len } => {
                Found::Record { opcode, offset, content: self.get(offset + HEAD, len)?.unwrap_or_default() }
            }
            Step::Chunk { offset, len, head } => {
                self.fill(offset + HEAD, len)?;
                let from = (offset + HEAD - self.base) as usize;
                let content = &self.window[from..from + len as usize];
                let records = if head.compression.is_empty() { &content[head.len..] } else { &self.space[..] };
                Found::Chunk { offset, head, content, records }
            }
            Step::Sealed { offset, head, length } => Found::Sealed { offset, head, length },
            Step::Attachment(attachment) => Found::Attachment(attachment),
            Step::Damage { offset, length } => Found::Damage { offset, length },
            Step::Cut { length } => Found::Cut { length },
            Step::Magic { offset } => Found::Magic { offset },
        }))
    }

    fn step(&mut self) -> io::Result<Option<Step>> {
        let (offset, left) = (self.at, self.end.saturating_sub(self.at));
        if left == 0 {
            return Ok(None);
        }
        if self.get(offset, left.min(8))?.is_some_and(|bytes| bytes == MAGIC) {
            self.at += 8;
            return Ok(Some(Step::Magic { offset }));
        }
        if offset == 0 {
            return self.resync(0).map(Some);
        }
        let Some((opcode, len)) = self.head(offset)? else {
            self.at = self.end;
            return Ok(Some(Step::Cut { length: left }));
        };
        if len > left - HEAD {
            return self.resync(offset).map(Some);
        }
        let step = match opcode {
            op::CHUNK => return self.chunk(offset, len).map(Some),
            op::ATTACHMENT => self.attachment(offset, len)?.map(Step::Attachment),
            _ => self.plain(opcode, offset, len)?,
        };
        match step {
            Some(step) => {
                self.at = offset + HEAD + len;
                Ok(Some(step))
            }
            None => self.resync(offset).map(Some),
        }
    }

    fn head(&mut self, offset: u64) -> io::Result<Option<(u8, u64)>> {
        let head = self.get(offset, HEAD)?;
        Ok(head.and_then(|head| Some((head[0], Fields(&head[1..]).u64()?))))
    }

    fn plain(&mut self, opcode: u8, offset: u64, len: u64) -> io::Result<Option<Step>> {
        let known = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= op::PRIVATE;
        if !known || len > RECORD_MAX || !self.may_be_record(offset + HEAD + len)? {
            return Ok(None);
        }
        let content = self.get(offset + HEAD, len)?.unwrap_or_default();
        let holds = match opcode {
            op::HEADER => fields::header(content).is_some(),
            op::SCHEMA => fields::schema(content).is_some(),
            op::CHANNEL => fields::channel(content).is_some(),
            op::MESSAGE => fields::message(content).is_some(),
            op::METADATA => fields::metadata(content, offset).is_some(),
            op::FOOTER => len == 20,
            op::DATA_END => len == 4,
            _ => true,
        };
        Ok(holds.then_some(Step::Record { opcode, offset, len }))
    }

    /// True if a record may begin there, or the file ends.
    fn may_be_record(&mut self, offset: u64) -> io::Result<bool> {
        let left = self.end.saturating_sub(offset);
        if left < HEAD {
            return Ok(left != 8 || self.get(offset, 8)?.is_some_and(|bytes| bytes == MAGIC));
        }
        if self.get(offset, 8)?.is_some_and(|bytes| bytes == MAGIC) {
            return Ok(true);
        }
        let head = self.head(offset)?;
        Ok(head.is_some_and(|(opcode, len)| {
            ((op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= op::PRIVATE) && len < 1 << 40
        }))
    }

    fn chunk(&mut self, offset: u64, len: u64) -> io::Result<Step> {
        let head = self.get(offset + HEAD, len.min(HEAD_MAX as u64))?.and_then(|content| Head::of(content, len));
        let Some(head) = head.filter(|_| len <= RECORD_MAX) else { return self.resync(offset) };
        let after = offset + HEAD + len;
        if !head.is_known() {
            if !self.may_be_record(after)? {
                return self.resync(offset);
            }
            self.at = after;
            return Ok(Step::Sealed { offset, head, length: HEAD + len });
        }
        self.fill(offset + HEAD, len)?;
        let from = (offset + HEAD - self.base) as usize;
        let content = &self.window[from..from + len as usize];
        let records = self.unpacker.unpack(&head, content, &mut self.space);
        if records.is_some_and(|records| Records::new(records).all(|record| record.is_some())) {
            self.at = after;
            return Ok(Step::Chunk { offset, len, head });
        }
        // Its length may be right although its content is damaged. The time for a search within it is limited.
        self.wasted += len;
        if self.wasted > self.size || self.may_be_record(after)? {
            self.at = after;
            return Ok(Step::Damage { offset, length: HEAD + len });
        }
        self.resync(offset)
    }

    fn attachment(&mut self, offset: u64, len: u64) -> io::Result<Option<Attachment>> {
        let head = self.get(offset + HEAD, len.min(NAMES_BYTES_MAX))?;
        let Some(attachment) = head.and_then(|head| fields::attachment(head, offset, len)) else { return Ok(None) };
        let mut hasher = crc32fast::Hasher::new();
        let (mut at, end) = (offset + HEAD, offset + HEAD + len - 4);
        while at < end {
            let part = (end - at).min(BLOCK_BYTES);
            hasher.update(self.get(at, part)?.unwrap_or_default());
            at += part;
        }
        let crc = self.get(end, 4)?.and_then(|bytes| Fields(bytes).u32());
        Ok(Some(attachment).filter(|_| crc == Some(0) || crc == Some(hasher.finalize())))
    }

    /// Continues at the next offset after `offset` at which a chunk, or a file, seems to begin.
    fn resync(&mut self, offset: u64) -> io::Result<Step> {
        let need = HEAD + HEAD_MAX as u64;
        let mut at = offset + 1;
        loop {
            let len = (self.end.saturating_sub(at)).min(BLOCK_BYTES);
            let end = self.end;
            let Some(bytes) = self.get(at, len)?.filter(|bytes| !bytes.is_empty()) else { break };
            // The last bytes are searched again with those that follow, unless the file ends there.
            let last = at + len == end;
            let until = if last { bytes.len() } else { bytes.len() - need as usize };
            let begins = (0..until).find(|&i| match bytes[i] {
                op::CHUNK => begins_chunk(&bytes[i..], end - at - i as u64),
                0x89 => bytes[i..].starts_with(MAGIC),
                _ => false,
            });
            if let Some(i) = begins {
                self.at = at + i as u64;
                return Ok(Step::Damage { offset, length: self.at - offset });
            }
            if last {
                break;
            }
            at += until as u64;
        }
        self.at = self.end;
        let length = self.end - offset;
        let cut = self.head(offset)?.is_some_and(|(opcode, _)| (op::HEADER..=op::DATA_END).contains(&opcode));
        Ok(if cut && offset > 0 { Step::Cut { length } } else { Step::Damage { offset, length } })
    }

    /// `len` bytes from `offset`; `None` if the file is shorter.
    fn get(&mut self, offset: u64, len: u64) -> io::Result<Option<&[u8]>> {
        if len > self.end.saturating_sub(offset) {
            return Ok(None);
        }
        self.fill(offset, len)?;
        let from = (offset - self.base) as usize;
        Ok(Some(&self.window[from..from + len as usize]))
    }

    /// Buffers `len` bytes from `offset`, which are within the file.
    fn fill(&mut self, offset: u64, len: u64) -> io::Result<()> {
        let buffered = self.base..self.base + self.window.len() as u64;
        if buffered.contains(&offset) && offset + len <= buffered.end || len == 0 && offset == buffered.end {
            return Ok(());
        }
        let wanted = len.max(BLOCK_BYTES.min(self.end.saturating_sub(offset)));
        self.window.clear();
        self.base = offset;
        self.inner.seek(SeekFrom::Start(offset))?;
        self.window.reserve(wanted as usize);
        let read = Read::by_ref(&mut self.inner).take(wanted).read_to_end(&mut self.window)?;
        if (read as u64) < len {
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the file became shorter while it was read"));
        }
        Ok(())
    }
}

/// True if a chunk seems to begin there, with `left` bytes left in the file.
fn begins_chunk(bytes: &[u8], left: u64) -> bool {
    let Some((head, rest)) = bytes.split_at_checked(HEAD as usize) else { return false };
    let Some(len) = Fields(&head[1..]).u64() else { return false };
    len <= left.saturating_sub(HEAD) && Head::of(&rest[..rest.len().min(HEAD_MAX)], len).is_some()
}
