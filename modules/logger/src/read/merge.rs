//! Messages of several files in one order.

use super::chunk::{self, Head, Records, Unpacker};
use super::{Channel, HEAD, Index, Message, Piece, Schema, fields, op};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

/// Maximum size of overlapping chunks held in memory, bytes; beyond it the order is given up.
const HELD_BYTES_MAX: u64 = 512 << 20;
/// Maximum size of memory kept for the next piece, bytes: that of usual chunks.
const SPARE_MAX: usize = 4 << 20;

/// Selection of messages.
pub struct Filter<'a> {
    /// First log time, ns since the epoch.
    pub from: u64,
    /// Last log time, inclusive, ns since the epoch.
    pub to: u64,
    /// Predicate on channels.
    pub wants: &'a dyn Fn(&Channel, Option<&Schema>) -> bool,
}

/// Requested messages and chunks that were not returned. The counts never decrease.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    /// Chunks with a wrong checksum, or not at the indexed offset.
    pub damaged: u64,
    /// Chunks with an unsupported compression.
    pub sealed: u64,
    /// Messages on undefined channels.
    pub nameless: u64,
    /// Messages returned after later ones, because too many chunks overlap or an index is wrong.
    pub unordered: u64,
}

/// Message with its channel and type.
#[derive(Clone, Copy, Debug)]
pub struct Entry<'a> {
    /// Position of the file in the list.
    pub file: usize,
    /// Channel.
    pub channel: &'a Channel,
    /// Type.
    pub schema: Option<&'a Schema>,
    /// Message.
    pub message: Message<'a>,
}

/// Content of a piece, ready for [`Messages`].
#[derive(Debug)]
pub struct Content(Result<(Vec<u8>, usize), Left>);

impl Content {
    /// Size in memory, bytes.
    #[must_use]
    pub fn size(&self) -> u64 {
        self.0.as_ref().map_or(0, |(bytes, _)| bytes.capacity() as u64)
    }
}

/// Why a piece has no content.
#[derive(Debug)]
enum Left {
    Damaged,
    Sealed,
}

/// Reads and unpacks pieces; keeps its memory for the next one.
#[derive(Default)]
pub struct Loader {
    unpacker: Unpacker,
    spare: Vec<u8>,
}

impl Loader {
    /// Reads a piece and unpacks it. `space` is memory that the content may take, such as an earlier content's; what is
    /// in it is lost.
    ///
    /// # Errors
    /// Reading failed.
    pub fn load(&mut self, inner: &mut (impl Read + Seek), piece: &Piece, mut space: Vec<u8>) -> io::Result<Content> {
        if piece.length > super::RECORD_MAX + HEAD {
            return Ok(Content(Err(Left::Damaged)));
        }
        let mut bytes = std::mem::take(&mut self.spare);
        bytes.clear();
        inner.seek(SeekFrom::Start(piece.offset))?;
        bytes.reserve(piece.length as usize);
        inner.take(piece.length).read_to_end(&mut bytes)?;
        if piece.bare {
            return Ok(Content(Ok((bytes, 0))));
        }
        let content = bytes.get(HEAD as usize..).filter(|content| bytes[0] == op::CHUNK && !content.is_empty());
        let head = content.and_then(|content| Head::of(content, content.len() as u64));
        let Some((content, head)) = content.zip(head) else { return Ok(Content(Err(Left::Damaged))) };
        if !head.is_known() {
            return Ok(Content(Err(Left::Sealed)));
        }
        if self.unpacker.unpack(&head, content, &mut space).is_none() {
            return Ok(Content(Err(Left::Damaged)));
        }
        if head.compression.is_empty() {
            return Ok(Content(Ok((bytes, HEAD as usize + head.len))));
        }
        self.spare = bytes;
        Ok(Content(Ok((space, 0))))
    }
}

/// Pieces that somebody else loads, such as threads, in the order of [`Messages::pending`].
pub trait Ahead: Send {
    /// Waits for the next piece: the place of its file in the list, and its own in the index. Takes memory of an
    /// earlier one back.
    ///
    /// # Errors
    /// Reading failed.
    fn next(&mut self, file: usize, piece: usize, space: Vec<u8>) -> io::Result<Content>;
}

/// Messages of files by log time, then by sequence number, then by position.
pub struct Messages<R> {
    files: Vec<File<R>>,
    /// Pieces that are not open yet, the next one last: start, file, piece.
    pending: Vec<(u64, usize, usize)>,
    open: Vec<Open>,
    /// Next message of each open piece: log time, sequence number, age of the piece, its index.
    heap: BinaryHeap<Reverse<(u64, u32, u64, usize)>>,
    free: Vec<usize>,
    loader: Loader,
    ahead: Option<Box<dyn Ahead>>,
    from: u64,
    to: u64,
    held: u64,
    opened: u64,
    read: u64,
    last: u64,
    skipped: Skipped,
}

struct File<R> {
    inner: R,
    index: Arc<Index>,
    /// By number of the channel.
    wanted: Vec<bool>,
}

/// Piece whose messages are being returned.
#[derive(Default)]
struct Open {
    file: usize,
    age: u64,
    bytes: Vec<u8>,
    /// Offset of the records in `bytes`.
    records: usize,
    /// Log time, sequence number, offset in the records; the next one last.
    entries: Vec<(u64, u32, u32)>,
}

impl<R: Read + Seek> Messages<R> {
    /// Creates an iterator over these files, each with its index.
    pub fn new(files: Vec<(R, Arc<Index>)>, filter: &Filter<'_>) -> Self {
        let with_wanted = |(inner, index): (R, Arc<Index>)| {
            let mut wanted = vec![false; index.channels.keys().next_back().map_or(0, |id| usize::from(*id) + 1)];
            for (id, channel) in &index.channels {
                wanted[usize::from(*id)] = (filter.wants)(channel, index.schemas.get(&channel.schema_id));
            }
            File { inner, index, wanted }
        };
        let files: Vec<File<R>> = files.into_iter().map(with_wanted).collect();
        let mut pending = Vec::new();
        for (f, file) in files.iter().enumerate() {
            for (p, piece) in file.index.pieces.iter().enumerate() {
                let wanted = |id: &u16| file.wanted.get(usize::from(*id)).copied().unwrap_or(true);
                if piece.start <= filter.to
                    && piece.end >= filter.from
                    && piece.channels.as_ref().is_none_or(|channels| channels.iter().any(wanted))
                {
                    pending.push((piece.start, f, p));
                }
            }
        }
        pending.sort_unstable_by_key(|key| Reverse(*key));
        Self {
            files,
            pending,
            open: Vec::new(),
            heap: BinaryHeap::new(),
            free: Vec::new(),
            loader: Loader::default(),
            ahead: None,
            from: filter.from,
            to: filter.to,
            held: 0,
            opened: 0,
            read: 0,
            last: 0,
            skipped: Skipped::default(),
        }
    }

    /// Next message; `None` at the end.
    ///
    /// # Errors
    /// Reading failed; a further call continues without the current chunk.
    pub fn next_entry(&mut self) -> io::Result<Option<Entry<'_>>> {
        while let Some(&(start, f, p)) = self.pending.last() {
            let due = self.heap.peek().is_none_or(|Reverse((time, ..))| start <= *time);
            if !due || self.held > HELD_BYTES_MAX && !self.heap.is_empty() {
                break;
            }
            self.pending.pop();
            self.load(f, p)?;
        }
        let Some(mut first) = self.heap.peek_mut() else { return Ok(None) };
        let place = first.0.3;
        let open = &mut self.open[place];
        let Some((time, _, at)) = open.entries.pop() else { return Ok(None) };
        match open.entries.last() {
            Some(&(time, sequence, _)) => *first = Reverse((time, sequence, open.age, place)),
            None => {
                std::collections::binary_heap::PeekMut::pop(first);
                self.held -= open.bytes.len() as u64;
                self.free.push(place);
            }
        }
        self.skipped.unordered += u64::from(time < self.last);
        self.last = time;
        let open = &self.open[place];
        let file = &self.files[open.file];
        // Both were verified when the piece was opened.
        let message = chunk::message_at(&open.bytes[open.records..], at as usize);
        let found = message.and_then(|message| Some((message, file.index.channels.get(&message.channel)?)));
        Ok(found.map(|(message, channel)| Entry {
            file: open.file,
            channel,
            schema: file.index.schemas.get(&channel.schema_id),
            message,
        }))
    }

    /// Pieces to be loaded, in order: the place of the file in the list, and the piece's in the index.
    #[must_use]
    pub fn pending(&self) -> Vec<(usize, usize)> {
        self.pending.iter().rev().map(|&(_, f, p)| (f, p)).collect()
    }

    /// Takes all further pieces from there; the files themselves are not read any more.
    pub fn set_ahead(&mut self, ahead: Box<dyn Ahead>) {
        self.ahead = Some(ahead);
    }

    /// Messages and chunks left out so far.
    #[must_use]
    pub fn skipped(&self) -> Skipped {
        self.skipped
    }

    /// Bytes of the files read so far, and in total.
    #[must_use]
    pub fn progress(&self) -> (u64, u64) {
        let left: u64 = self.pending.iter().map(|(_, f, p)| self.files[*f].index.pieces[*p].length).sum();
        (self.read, self.read + left)
    }

    fn load(&mut self, f: usize, p: usize) -> io::Result<()> {
        let file = &mut self.files[f];
        let index = file.index.clone();
        let piece = &index.pieces[p];
        self.read += piece.length;
        let space = self.free.last().and_then(|place| self.open.get_mut(*place));
        let space = space.map(|open| std::mem::take(&mut open.bytes)).filter(|space| space.capacity() <= SPARE_MAX);
        let space = space.unwrap_or_default();
        let content = match &mut self.ahead {
            Some(ahead) => ahead.next(f, p, space)?,
            None => self.loader.load(&mut file.inner, piece, space)?,
        };
        let (bytes, records) = match content.0 {
            Ok(content) => content,
            Err(left) => {
                match left {
                    Left::Damaged => self.skipped.damaged += 1,
                    Left::Sealed => self.skipped.sealed += 1,
                }
                return Ok(());
            }
        };
        let place = self.free.pop().unwrap_or_else(|| {
            self.open.push(Open::default());
            self.open.len() - 1
        });
        let open = &mut self.open[place];
        (open.bytes, open.file, open.age, open.records) = (bytes, f, self.opened, records);
        self.opened += 1;
        open.entries.clear();
        let mut sorted = true;
        for record in Records::new(&open.bytes[records..]) {
            let Some(record) = record else {
                self.skipped.damaged += 1;
                break;
            };
            let Some(message) = fields::message(record.content).filter(|_| record.opcode == op::MESSAGE) else {
                continue;
            };
            match file.wanted.get(usize::from(message.channel)) {
                Some(true) if (self.from..=self.to).contains(&message.log_time) => {
                    let entry = (message.log_time, message.sequence, record.offset as u32);
                    sorted &= open.entries.last().is_none_or(|last| *last <= entry);
                    open.entries.push(entry);
                }
                Some(_) if index.channels.contains_key(&message.channel) => {}
                _ => self.skipped.nameless += 1,
            }
        }
        if !sorted {
            open.entries.sort_unstable();
        }
        open.entries.reverse();
        match open.entries.last() {
            Some(&(time, sequence, _)) => {
                self.held += open.bytes.len() as u64;
                self.heap.push(Reverse((time, sequence, open.age, place)));
            }
            None => self.free.push(place),
        }
        Ok(())
    }
}
