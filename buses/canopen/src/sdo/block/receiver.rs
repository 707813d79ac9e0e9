//! Who receives the data of a block transfer.

use crate::sdo::{MAX_LEN, crc};
use crate::wire::sdo::{BlockEnd, BlockSegment};
use crate::{Abort, Payload};
use base::{Duration, Instant};

/// Silence after which a receiver acknowledges what it has of a sub-block.
const QUIET: Duration = Duration::from_millis(150);

/// Result of a timeout of a receiver.
pub(in crate::sdo) enum Expired {
    /// The end of the sub-block is lost: acknowledge this segment.
    Quiet(u8),
    /// Nothing new in time.
    Silent,
}

/// Takes segments.
pub(in crate::sdo) struct Receiver {
    /// All segments taken, except the last one of the transfer, which waits in `frame` for its length.
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
    /// Instant at which the received part of the sub-block is acknowledged, if there is any.
    quiet: Option<Instant>,
}

impl Receiver {
    /// `frame` began the transfer.
    ///
    /// # Errors
    /// The code to abort with: more than [`MAX_LEN`].
    pub(in crate::sdo) fn new(
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

    /// True if all segments came and the end is awaited.
    pub(in crate::sdo) fn is_complete(&self) -> bool {
        self.complete
    }

    /// Number of bytes taken so far, of a transfer without an announced size.
    pub(in crate::sdo) fn unannounced(&self) -> Option<usize> {
        self.size.is_none().then_some(self.data.len())
    }

    /// True if `frame` is the last one taken, come twice.
    pub(in crate::sdo) fn repeats(&self, frame: [u8; 8]) -> bool {
        frame == self.frame
    }

    /// The number of the segment that is awaited.
    pub(in crate::sdo) fn awaited(&self) -> u8 {
        self.seq + 1
    }

    /// A segment. Gives what to acknowledge when the sub-block ended.
    ///
    /// # Errors
    /// The code to abort with.
    pub(in crate::sdo) fn take(&mut self, now: Instant, frame: [u8; 8]) -> Result<Option<u8>, Abort> {
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

    /// All data, if `end` fits them; `frame` is the frame of `end`. `None`: the last segment was repeated.
    ///
    /// # Errors
    /// The code to abort with.
    pub(in crate::sdo) fn finish(&mut self, end: BlockEnd, frame: [u8; 8]) -> Option<Result<Payload, Abort>> {
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

    /// Number of bytes of the last segment count.
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

    /// Instant at which the transfer is aborted unless something new arrives.
    pub(in crate::sdo) fn until(&self) -> Instant {
        self.until
    }

    /// Instant of the next [`Self::expired`].
    pub(in crate::sdo) fn due(&self) -> Instant {
        self.quiet.map_or(self.until, |quiet| quiet.min(self.until))
    }

    /// Timeout due at `now`.
    pub(in crate::sdo) fn expired(&mut self, now: Instant) -> Option<Expired> {
        if self.until <= now {
            return Some(Expired::Silent);
        }
        self.quiet.take_if(|quiet| *quiet <= now)?;
        self.leftovers = true;
        Some(Expired::Quiet(self.acknowledged()))
    }
}
