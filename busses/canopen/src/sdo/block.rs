//! The two ends of a block transfer's data, the same for client and server: who sends, and who receives, segments.
//!
//! A sub-block is up to 127 numbered segments and one acknowledge of those that came in order. Whatever the
//! acknowledge does not cover is sent again, at the front of the next sub-block, numbered from 1.
//!
//! The receiver acknowledges at the end of a sub-block, not at the first gap: segments on the way would be taken for
//! those of the next one. Only when the end itself is lost it speaks after [`QUIET`], and then waits for number 1.
//! It never asks for a sub-block of which nothing came: its own acknowledge may be what was lost, and the answer would
//! be the sub-block before, twice.

use super::{MAX_LEN, crc};
use crate::wire::sdo::{BlockEnd, BlockSegment};
use crate::{Abort, Payload};
use base::{Duration, Instant};

/// The most segments of a sub-block, and how many are asked for by default.
pub const BLOCK_SIZE: u8 = 127;

/// Silence after which a receiver acknowledges what it has of a sub-block.
const QUIET: Duration = Duration::from_millis(150);

/// Sub-blocks in a row of which nothing arrives, after which the sender gives up.
const FRUITLESS: u8 = 8;

/// The abort code for a block size that is none.
pub(super) fn check_size(blksize: u8) -> Result<u8, Abort> {
    if (1..=127).contains(&blksize) { Ok(blksize) } else { Err(Abort::BLOCK_SIZE) }
}

/// Sends segments, made when they are asked for.
pub(super) struct Sender {
    data: Payload,
    /// Bytes acknowledged: where the sub-block begins.
    at: usize,
    /// Segments sent of this sub-block, of at most `blksize`.
    sent: u8,
    blksize: u8,
    /// Of what is acknowledged; `None`: not wanted.
    crc: Option<u16>,
    fruitless: u8,
    timeout: Duration,
    until: Instant,
    /// Whether segments left since `until` was set.
    moved: bool,
}

impl Sender {
    pub(super) fn new(now: Instant, timeout: Duration, data: Payload, blksize: u8, with_crc: bool) -> Self {
        let (until, crc) = (now + timeout, with_crc.then_some(0));
        Self { data, at: 0, sent: 0, blksize, crc, fruitless: 0, timeout, until, moved: false }
    }

    fn position(&self) -> usize {
        self.at + 7 * usize::from(self.sent)
    }

    /// The next segment; `None` when the sub-block is sent. Without data there is one segment, of no bytes.
    pub(super) fn segment(&mut self) -> Option<[u8; 8]> {
        let from = self.position();
        let ended = self.sent > 0 && from >= self.data.len();
        if ended || self.sent == self.blksize {
            return None;
        }
        let rest = self.data.get(from..).unwrap_or(&[]);
        let len = rest.len().min(7);
        let mut data = [0; 7];
        data[..len].copy_from_slice(&rest[..len]);
        self.sent += 1;
        self.moved = true;
        Some(BlockSegment { last: rest.len() <= 7, seqno: self.sent, data }.encode())
    }

    /// An acknowledge, early ones too: the rest of the sub-block is not sent then. Gives the end when all arrived.
    /// One that covers more than was sent is of an earlier sub-block and changes nothing.
    ///
    /// # Errors
    /// The code to abort with.
    pub(super) fn acknowledge(&mut self, now: Instant, ackseq: u8, blksize: u8) -> Result<Option<BlockEnd>, Abort> {
        if ackseq > BLOCK_SIZE {
            return Err(Abort::SEQUENCE);
        }
        if ackseq > self.sent {
            return Ok(None);
        }
        self.fruitless = if ackseq == 0 { self.fruitless + 1 } else { 0 };
        if self.fruitless == FRUITLESS {
            return Err(Abort::SEQUENCE);
        }
        let reached = self.at + 7 * usize::from(ackseq);
        let arrived = reached.min(self.data.len());
        self.crc = self.crc.map(|crc| crc::update(crc, &self.data[self.at..arrived]));
        self.at = arrived;
        (self.sent, self.until, self.moved) = (0, now + self.timeout, false);
        if ackseq > 0 && reached >= self.data.len() {
            let unused = (reached - self.data.len()) as u8;
            return Ok(Some(BlockEnd { unused, crc: self.crc.unwrap_or(0) }));
        }
        self.blksize = check_size(blksize)?;
        Ok(None)
    }

    /// The receiver is ready: the time for its acknowledge begins.
    pub(super) fn start(&mut self, now: Instant) {
        self.until = now + self.timeout;
    }

    /// When to call [`Self::expired`].
    pub(super) fn due(&self) -> Instant {
        self.until
    }

    /// Whether no acknowledge came in time, counted from when the sub-block was last seen to move.
    pub(super) fn expired(&mut self, now: Instant) -> bool {
        let expired = self.until <= now;
        if expired && self.moved {
            (self.until, self.moved) = (now + self.timeout, false);
            return false;
        }
        expired
    }
}

/// What time did to a receiver.
pub(super) enum Expired {
    /// The end of the sub-block is lost: acknowledge this segment.
    Quiet(u8),
    /// Nothing new came in time.
    Silent,
}

/// Takes segments.
pub(super) struct Receiver {
    /// All taken segments but the last of the transfer, which waits in `frame` to be told its length.
    data: Payload,
    size: Option<u32>,
    crc: Option<u16>,
    blksize: u8,
    /// Segments of this sub-block taken.
    seq: u8,
    /// The last segment of the transfer was taken.
    complete: bool,
    /// The last frame taken, at first the one that began the transfer. A frame can come twice.
    frame: [u8; 8],
    /// Acknowledged before its end, the rest of the last sub-block may still come.
    leftovers: bool,
    timeout: Duration,
    until: Instant,
    /// When to acknowledge what is there of the sub-block, if anything is.
    quiet: Option<Instant>,
}

impl Receiver {
    /// `frame` began the transfer.
    ///
    /// # Errors
    /// The code to abort with: more than [`MAX_LEN`].
    pub(super) fn new(
        now: Instant,
        timeout: Duration,
        (size, blksize, with_crc): (Option<u32>, u8, bool),
        frame: [u8; 8],
    ) -> Result<Self, Abort> {
        if size.is_some_and(|size| size as usize > MAX_LEN) {
            return Err(Abort::OUT_OF_MEMORY);
        }
        Ok(Self {
            data: Payload::EMPTY,
            size,
            crc: with_crc.then_some(0),
            blksize,
            seq: 0,
            complete: false,
            frame,
            leftovers: false,
            timeout,
            until: now + timeout,
            quiet: None,
        })
    }

    /// Whether all segments came and the end is awaited.
    pub(super) fn is_complete(&self) -> bool {
        self.complete
    }

    /// Bytes taken so far, when nobody said how many will come.
    pub(super) fn unannounced(&self) -> Option<usize> {
        self.size.is_none().then_some(self.data.len())
    }

    /// Whether `frame` is the last one taken, come twice.
    pub(super) fn repeats(&self, frame: [u8; 8]) -> bool {
        frame == self.frame
    }

    /// The number of the segment that is awaited.
    pub(super) fn awaited(&self) -> u8 {
        self.seq + 1
    }

    /// A segment. Gives what to acknowledge when the sub-block ended.
    ///
    /// # Errors
    /// The code to abort with.
    pub(super) fn take(&mut self, now: Instant, frame: [u8; 8]) -> Result<Option<u8>, Abort> {
        let segment = BlockSegment::decode(frame);
        if segment.seqno == self.seq + 1 {
            self.store(now, frame, segment)?;
        } else if frame == self.frame || self.leftovers || frame[0] == 0x80 {
            // 0x80: an abort, but not of this transfer.
            return Ok(None);
        } else if segment.seqno == 0 || segment.seqno > self.blksize {
            return Err(Abort::SEQUENCE);
        }
        let ended = segment.last || segment.seqno == self.blksize;
        Ok(ended.then(|| self.acknowledged()))
    }

    fn store(&mut self, now: Instant, frame: [u8; 8], segment: BlockSegment) -> Result<(), Abort> {
        (self.frame, self.seq, self.leftovers) = (frame, segment.seqno, false);
        (self.until, self.quiet) = (now + self.timeout, Some(now + QUIET.min(self.timeout / 4)));
        self.complete = segment.last;
        if self.complete {
            return Ok(());
        }
        self.data.extend(&segment.data);
        self.crc = self.crc.map(|crc| crc::update(crc, &segment.data));
        match self.size {
            Some(size) if self.data.len() > size as usize => Err(Abort::TOO_LONG),
            None if self.data.len() > MAX_LEN => Err(Abort::OUT_OF_MEMORY),
            _ => Ok(()),
        }
    }

    fn acknowledged(&mut self) -> u8 {
        self.quiet = None;
        core::mem::take(&mut self.seq)
    }

    /// All data, when `end` fits it; `frame` is the one it came in. `None`: it was the last segment, once more.
    ///
    /// # Errors
    /// The code to abort with.
    pub(super) fn finish(&mut self, end: BlockEnd, frame: [u8; 8]) -> Option<Result<Payload, Abort>> {
        // A last segment may look like an end, and be one, byte for byte (455 zeros): what fits is taken for it.
        let repeated = frame == self.frame;
        match self.check(end) {
            Err(_) if repeated => None,
            Ok(_) if repeated && self.size.is_none() && self.crc.is_none() => None,
            Ok(tail) => {
                let mut data = core::mem::replace(&mut self.data, Payload::EMPTY);
                data.extend(&self.frame[1..=tail]);
                Some(Ok(data))
            }
            Err(code) => Some(Err(code)),
        }
    }

    /// How many bytes of the last segment count.
    fn check(&self, end: BlockEnd) -> Result<usize, Abort> {
        let tail = 7 - usize::from(end.unused);
        let len = self.data.len() + tail;
        match self.size {
            Some(size) if len > size as usize => return Err(Abort::TOO_LONG),
            Some(size) if len < size as usize => return Err(Abort::TOO_SHORT),
            None if len > MAX_LEN => return Err(Abort::OUT_OF_MEMORY),
            _ => {}
        }
        match self.crc {
            Some(crc) if crc::update(crc, &self.frame[1..=tail]) != end.crc => Err(Abort::CRC),
            _ => Ok(tail),
        }
    }

    /// When the transfer is given up if nothing new comes.
    pub(super) fn until(&self) -> Instant {
        self.until
    }

    /// When to call [`Self::expired`].
    pub(super) fn due(&self) -> Instant {
        self.quiet.map_or(self.until, |quiet| quiet.min(self.until))
    }

    /// What is due at `now`.
    pub(super) fn expired(&mut self, now: Instant) -> Option<Expired> {
        if self.until <= now {
            return Some(Expired::Silent);
        }
        self.quiet.take_if(|quiet| *quiet <= now)?;
        self.leftovers = true;
        Some(Expired::Quiet(self.acknowledged()))
    }
}

/// The rest of a sub-block that was broken off here while its sender goes on: segments that look like commands, and
/// must not be obeyed.
#[derive(Default)]
pub(super) struct Strays {
    /// The number of the next one; 0: none is expected.
    next: u8,
    until: Instant,
}

impl Strays {
    /// Segments from number `next` on may come until then.
    pub(super) fn expect(&mut self, next: u8, until: Instant) {
        *self = Self { next: if next > BLOCK_SIZE { 0 } else { next }, until };
    }

    /// Segments behind this one may come until then.
    pub(super) fn follow(&mut self, frame: [u8; 8], until: Instant) {
        let segment = BlockSegment::decode(frame);
        self.expect(if segment.last { 0 } else { segment.seqno + 1 }, until);
    }

    /// Whether a frame is one of them.
    pub(super) fn swallow(&mut self, now: Instant, frame: [u8; 8]) -> bool {
        let stray = self.next != 0 && now < self.until && frame[0] & 0x7F == self.next;
        if stray {
            self.follow(frame, self.until);
        } else {
            self.next = 0;
        }
        stray
    }
}
