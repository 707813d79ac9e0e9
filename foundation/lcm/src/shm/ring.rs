//! The ring: one publisher writes, any number of readers follow, and neither waits for the other.
//! Records are contiguous in `data`. A position counts grains of 8 bytes since the ring was made, and is at `position %
//! capacity`; a lap is one turn of the ring. Before the writer touches a word it stores the position up to which it
//! will write ([`INTENT`]), and afterwards the position up to which readers may go ([`TAIL`]). A reader copies and then
//! checks if INTENT has reached the copied part again: then the copy is dropped, and the reader continues with the
//! oldest valid record. A writer that dies in between leaves an INTENT beyond its TAIL, which is harmless.
//!
//! ```text
//! record   0 sequence u32, 4 payload length u32, 8 time i64, 16 count of its bucket u32,
//!          20 channel length and kind, 21 bucket, 22 check u16, 24 channel, payload; both padded to 8
//! ```
//!
//! Every word is an atomic: a seqlock without a data race. The `loom` test runs this very file.
//!
//! The writer may go to the next lap before the end of this one: positions only grow, so the rule above holds. It
//! does so while all readers have nothing left to read, which keeps a small working set in the cache and the memory
//! of a slow publisher small, and gives a busy one the whole ring.

use super::sync::{Ordering, Value, Word, fence, load_all, store_all};

/// Bytes of the unit of positions and of the alignment of records.
pub const GRAIN: usize = 8;
/// Words of control that a ring needs, from the start of a cache line.
pub const CONTROL: usize = MARKS + SECTORS;
/// Messages are counted for each bucket of channels, so that losses can be attributed.
pub const BUCKETS: usize = 256;

const WORD: usize = size_of::<Value>();
/// The position before which the writer may be writing.
const INTENT: usize = 0;
/// The position before which everything is written.
const TAIL: usize = 1;
/// For each sector of the ring the position of the first record of the latest lap that started there.
const MARKS: usize = 2;
const SECTORS: usize = 16;
const HEADER: usize = 24;
const HEADER_GRAINS: Value = (HEADER / GRAIN) as Value;
/// Remaining size from which the writer starts a new lap once all readers have caught up.
const EARLY: Value = (64 << 10) / GRAIN as Value;
const CHANNEL_MAX: usize = 63;

/// The bucket of a channel, and a hash whose other bits are independent of it (FNV-1a).
pub fn bucket(channel: &str) -> (usize, u32) {
    let hash = channel.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    ((hash ^ hash >> 24) as usize % BUCKETS, hash >> 8)
}

/// The shared words of a ring.
#[derive(Clone, Copy)]
pub struct Ring<'a> {
    /// At least [`CONTROL`] of them.
    pub control: &'a [Word],
    /// A power of two of bytes.
    pub data: &'a [Word],
}

impl Ring<'_> {
    /// Grains of a lap.
    fn capacity(&self) -> Value {
        (self.data.len() * WORD / GRAIN) as Value
    }

    /// Index of the words of a position.
    fn at(&self, position: Value) -> usize {
        (position & (self.capacity() - 1)) as usize * (GRAIN / WORD)
    }

    /// Grains from a position to the end of its lap.
    fn left(&self, position: Value) -> Value {
        self.capacity() - (position & (self.capacity() - 1))
    }

    fn sector(&self, position: Value) -> usize {
        self.at(position) * SECTORS / self.data.len()
    }

    fn store(&self, at: usize, bytes: &[u8]) {
        let whole = bytes.len() / WORD;
        let words = &self.data[at..at + bytes.len().div_ceil(WORD)];
        let (chunks, rest) = bytes.as_chunks::<WORD>();
        store_all(&words[..whole], chunks);
        if !rest.is_empty() {
            let mut last = [0; WORD];
            last[..rest.len()].copy_from_slice(rest);
            words[whole].store(Value::from_ne_bytes(last), Ordering::Relaxed);
        }
    }

    fn load(&self, at: usize, bytes: &mut [u8]) {
        let whole = bytes.len() / WORD;
        let words = &self.data[at..at + bytes.len().div_ceil(WORD)];
        let (chunks, rest) = bytes.as_chunks_mut::<WORD>();
        load_all(&words[..whole], chunks);
        if !rest.is_empty() {
            let last = words[whole].load(Ordering::Relaxed).to_ne_bytes();
            rest.copy_from_slice(&last[..rest.len()]);
        }
    }

    /// Position up to which everything is written.
    pub fn tail(&self) -> Value {
        self.control[TAIL].load(Ordering::Acquire)
    }

    /// True if the writer may have come around to `position`. What was read before is good if it has not.
    fn overtaken(&self, position: Value) -> bool {
        fence(Ordering::Acquire);
        self.control[INTENT].load(Ordering::Relaxed).wrapping_sub(position) > self.capacity()
    }
}

/// Header of a record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// The publisher's number of the message: LCM's.
    pub sequence: u32,
    /// Payload bytes.
    pub len: u32,
    /// Time of publication, ns of the monotonic clock.
    pub at: i64,
    /// Number of messages of its bucket published before it.
    count: u32,
    channel_len: usize,
    kind: Kind,
    bucket: u8,
}

/// Kind of a record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// A message.
    #[default]
    Message,
    /// A message whose payload lies in a file of its own.
    Aside,
    /// Empty: the writer went on to the next lap.
    Lap,
}

impl Header {
    fn encode(self, position: Value) -> [u8; HEADER] {
        let mut bytes = [0; HEADER];
        bytes[..4].copy_from_slice(&self.sequence.to_ne_bytes());
        bytes[4..8].copy_from_slice(&self.len.to_ne_bytes());
        bytes[8..16].copy_from_slice(&self.at.to_ne_bytes());
        bytes[16..20].copy_from_slice(&self.count.to_ne_bytes());
        bytes[20] = self.channel_len as u8 | (self.kind as u8) << 6;
        bytes[21] = self.bucket;
        bytes[22..].copy_from_slice(&check(position).to_ne_bytes());
        bytes
    }

    /// `None`: there is no record here.
    fn decode(bytes: &[u8; HEADER], position: Value) -> Option<Self> {
        let &[s0, s1, s2, s3, l0, l1, l2, l3, a0, a1, a2, a3, a4, a5, a6, a7, c0, c1, c2, c3, kind, bucket, k0, k1] =
            bytes;
        let channel_len = usize::from(kind & 63);
        let kind = match kind >> 6 {
            0 => Kind::Message,
            1 => Kind::Aside,
            2 => Kind::Lap,
            _ => return None,
        };
        (u16::from_ne_bytes([k0, k1]) == check(position)).then_some(Self {
            sequence: u32::from_ne_bytes([s0, s1, s2, s3]),
            len: u32::from_ne_bytes([l0, l1, l2, l3]),
            at: i64::from_ne_bytes([a0, a1, a2, a3, a4, a5, a6, a7]),
            count: u32::from_ne_bytes([c0, c1, c2, c3]),
            channel_len,
            kind,
            bucket,
        })
    }

    /// Grains of the whole record.
    fn grains(&self) -> Value {
        let payload = if self.kind == Kind::Message { self.len as usize } else { 0 };
        HEADER_GRAINS + grains(self.channel_len) + grains(payload)
    }
}

/// Check word that distinguishes a record's start from other bytes, in case of a wrong position: positions of 32 bits
/// wrap after 32 GiB.
fn check(position: Value) -> u16 {
    (position ^ position >> 16) as u16 ^ 0x4c43
}

fn grains(len: usize) -> Value {
    len.div_ceil(GRAIN) as Value
}

/// The writing end: what only the publisher knows.
#[derive(Debug)]
pub struct Writer {
    tail: Value,
    /// Grains of the latest record.
    latest: Value,
    /// The sector and lap that have their mark.
    marked: Value,
    counts: Box<[u32; BUCKETS]>,
    /// Grains of a lap that are used; less than its capacity where there is no memory for more.
    limit: Value,
}

/// A place for a record, found by [`Writer::place`].
#[derive(Clone, Copy, Debug)]
pub struct Place {
    start: Value,
    end: Value,
    /// Number of bytes from the start of the ring that it needs, the header of an end of the lap after it among them.
    pub reach: usize,
}

impl Writer {
    /// Writer of a ring whose words are all 0.
    pub fn new(ring: Ring<'_>) -> Self {
        let counts = Box::new([0; BUCKETS]);
        Self { tail: 0, latest: 0, marked: Value::MAX, counts, limit: ring.capacity() }
    }

    /// Position for a record; `drained`: all readers have caught up. `None`: it is too large for the ring.
    pub fn place(&self, ring: Ring<'_>, channel: &str, len: usize, drained: impl FnOnce() -> bool) -> Option<Place> {
        let need = HEADER_GRAINS + grains(channel.len()) + grains(len);
        // A quarter, so that a reader has time to copy one while the next is written.
        if need > self.limit / 4 {
            return None;
        }
        let used = ring.capacity() - ring.left(self.tail);
        // The reader that is just about to read the latest record must find it.
        let early = used >= EARLY.min(self.limit / 4) && used - self.latest >= need && drained();
        // A lap that ends before the ring does leaves room for the header that says so.
        let room = if self.limit < ring.capacity() { self.limit.saturating_sub(HEADER_GRAINS) } else { self.limit };
        let lap = used + need > room || early;
        let start = if lap { self.tail.wrapping_add(ring.left(self.tail)) } else { self.tail };
        let end = ring.capacity() - ring.left(start) + need;
        let reach = (end + HEADER_GRAINS).min(ring.capacity()) as usize * GRAIN;
        Some(Place { start, end: start.wrapping_add(need), reach })
    }

    /// Limits the usable size to `bytes` from now on.
    pub fn limit(&mut self, bytes: usize) {
        self.limit = self.limit.min((bytes / GRAIN) as Value);
    }

    /// Writes a record to a place that [`Writer::place`] found for this channel and, for [`Kind::Message`], payload.
    pub fn write(&mut self, ring: Ring<'_>, place: Place, message: &Message<'_>) {
        let (bucket, _) = bucket(message.channel);
        let header = Header {
            sequence: message.sequence,
            len: message.payload.len() as u32,
            at: message.at,
            count: self.counts[bucket],
            channel_len: message.channel.len(),
            kind: message.kind,
            bucket: bucket as u8,
        };
        self.counts[bucket] = header.count.wrapping_add(1);
        ring.control[INTENT].store(place.end, Ordering::Relaxed);
        // Who sees any of the words that follow also sees INTENT.
        fence(Ordering::Release);
        if place.start != self.tail && ring.left(self.tail) >= HEADER_GRAINS {
            let lap = Header { kind: Kind::Lap, ..Header::default() };
            ring.store(ring.at(self.tail), &lap.encode(self.tail));
        }
        let at = ring.at(place.start);
        ring.store(at, &header.encode(place.start));
        ring.store(at + HEADER / WORD, message.channel.as_bytes());
        if message.kind == Kind::Message {
            let payload = HEADER_GRAINS + grains(message.channel.len());
            ring.store(at + payload as usize * (GRAIN / WORD), message.payload);
        }
        // Its start is the first one in this sector since the sector before.
        let sector = ring.sector(place.start);
        if self.marked != sector as Value || place.start != self.tail {
            self.marked = sector as Value;
            ring.control[MARKS + sector].store(place.start, Ordering::Relaxed);
        }
        ring.control[TAIL].store(place.end, Ordering::Release);
        self.latest = place.end.wrapping_sub(place.start);
        self.tail = place.end;
    }

    /// True if any record was written.
    pub fn used(&self) -> bool {
        self.tail != 0
    }
}

/// Record to be written.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// The publisher's number of the message.
    pub sequence: u32,
    /// Time of publication, ns of the monotonic clock.
    pub at: i64,
    /// 1 to 63 bytes.
    pub channel: &'a str,
    /// Payload.
    pub payload: &'a [u8],
    /// Kind, except [`Kind::Lap`].
    pub kind: Kind,
}

/// A reader's copy of a message; its memory is used again for the next.
#[derive(Debug)]
pub struct Copy {
    channel: [u8; CHANNEL_MAX],
    channel_len: usize,
    /// The payload; longer than the message where an earlier one was.
    pub payload: Vec<u8>,
    /// Header.
    pub header: Header,
}

impl Default for Copy {
    fn default() -> Self {
        Self { channel: [0; CHANNEL_MAX], channel_len: 0, payload: Vec::new(), header: Header::default() }
    }
}

impl Copy {
    /// The channel.
    pub fn channel(&self) -> &str {
        core::str::from_utf8(&self.channel[..self.channel_len]).unwrap_or_default()
    }
}

/// Result of [`Reader::read`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// A message, in the [`Copy`]; of [`Kind::Aside`] without its payload.
    Message(Kind),
    /// Something, but nothing that is wanted.
    Passed,
    /// Nothing new.
    Empty,
}

/// The reading end: what one reader knows of one ring.
#[derive(Debug)]
pub struct Reader {
    position: Value,
    /// The count that the next message of each bucket has.
    expected: Box<[Option<u32>; BUCKETS]>,
    /// Messages of wanted buckets that were gone before they were read.
    pub lost: u64,
    /// Records that were none.
    pub corrupt: u64,
}

impl Reader {
    /// Reads what is written from now on.
    pub fn from_now(ring: Ring<'_>) -> Self {
        match ring.tail() {
            0 => Self::from_start(),
            position => Self { position, expected: Box::new([None; BUCKETS]), lost: 0, corrupt: 0 },
        }
    }

    /// Reads from the ring's first message on.
    pub fn from_start() -> Self {
        Self { position: 0, expected: Box::new([Some(0); BUCKETS]), lost: 0, corrupt: 0 }
    }

    /// Restarts the count of losses of a bucket whose channels are subscribed again.
    pub fn forget(&mut self, bucket: usize) {
        self.expected[bucket] = None;
    }

    /// True if there is something to read.
    pub fn pending(&self, ring: Ring<'_>) -> bool {
        ring.tail() != self.position
    }

    /// Takes the next record if it is wanted, by its bucket first and then by its name. Never waits; the writer may be
    /// anywhere, or dead.
    pub fn read(
        &mut self,
        ring: Ring<'_>,
        copy: &mut Copy,
        buckets: impl Fn(usize) -> bool,
        wants: impl FnOnce(&str) -> bool,
    ) -> Read {
        let available = ring.tail().wrapping_sub(self.position);
        if available == 0 {
            return Read::Empty;
        }
        if available > ring.capacity() {
            return self.resume(ring);
        }
        if ring.left(self.position) < HEADER_GRAINS {
            return self.next_lap(ring, available);
        }
        let start = self.position;
        let at = ring.at(start);
        let mut header = [0; HEADER];
        ring.load(at, &mut header);
        if ring.overtaken(start) {
            return self.resume(ring);
        }
        let Some(header) = Header::decode(&header, start) else { return self.give_up(ring) };
        if header.kind == Kind::Lap {
            return self.next_lap(ring, available);
        }
        let size = header.grains();
        if size > available || size > ring.left(start) {
            return self.give_up(ring);
        }
        let bucket = usize::from(header.bucket);
        if !buckets(bucket) {
            self.position = start.wrapping_add(size);
            return Read::Passed;
        }
        let channel = &mut copy.channel[..header.channel_len];
        ring.load(at + HEADER / WORD, channel);
        if ring.overtaken(start) {
            return self.resume(ring);
        }
        let wanted = core::str::from_utf8(channel).is_ok_and(wants);
        if wanted && header.kind == Kind::Message {
            let len = header.len as usize;
            if copy.payload.len() < len {
                copy.payload.resize(len, 0);
            }
            let payload = HEADER_GRAINS + grains(header.channel_len);
            ring.load(at + payload as usize * (GRAIN / WORD), &mut copy.payload[..len]);
            if ring.overtaken(start) {
                return self.resume(ring);
            }
        }
        self.position = start.wrapping_add(size);
        let expected = &mut self.expected[bucket];
        self.lost += expected.map_or(0, |expected| u64::from(header.count.wrapping_sub(expected)));
        *expected = Some(header.count.wrapping_add(1));
        if !wanted {
            return Read::Passed;
        }
        (copy.channel_len, copy.header) = (header.channel_len, header);
        Read::Message(header.kind)
    }

    fn next_lap(&mut self, ring: Ring<'_>, available: Value) -> Read {
        let left = ring.left(self.position);
        if left > available {
            return self.give_up(ring);
        }
        self.position = self.position.wrapping_add(left);
        Read::Passed
    }

    /// Continues, after the writer has overtaken, with the oldest record that stays valid for a while.
    fn resume(&mut self, ring: Ring<'_>) -> Read {
        let tail = ring.tail();
        let marks = ring.control[MARKS..CONTROL].iter().map(|mark| mark.load(Ordering::Relaxed));
        let stands = |&back: &Value| back <= ring.capacity() / 8 * 7 && back < tail.wrapping_sub(self.position);
        let back = marks.map(|mark| tail.wrapping_sub(mark)).filter(stands).max().unwrap_or(0);
        self.position = tail.wrapping_sub(back);
        Read::Passed
    }

    /// Gives up on bytes that are no record.
    fn give_up(&mut self, ring: Ring<'_>) -> Read {
        self.corrupt += 1;
        self.position = ring.tail();
        Read::Passed
    }
}
