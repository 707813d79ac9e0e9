//! Who sends the data of a block transfer.

use super::{BLOCK_SIZE, check_size};
use crate::sdo::crc;
use crate::wire::sdo::{BlockEnd, BlockSegment};
use crate::{Abort, Payload};
use base::{Duration, Instant};

/// Sub-blocks in a row of which nothing arrives, after which the sender gives up.
const FRUITLESS: u8 = 8;

/// Sends segments, made on request.
pub(in crate::sdo) struct Sender {
    data: Payload,
    /// Bytes acknowledged: where the sub-block begins.
    at: usize,
    /// Segments sent of this sub-block, of at most `blksize`.
    sent: u8,
    blksize: u8,
    /// CRC of the acknowledged data; `None`: not requested.
    crc: Option<u16>,
    fruitless: u8,
    timeout: Duration,
    until: Instant,
    /// True if segments left since `until` was set.
    moved: bool,
}

impl Sender {
    pub(in crate::sdo) fn new(now: Instant, timeout: Duration, data: Payload, blksize: u8, with_crc: bool) -> Self {
        let (until, crc) = (now + timeout, with_crc.then_some(0));
        Self { data, at: 0, sent: 0, blksize, crc, fruitless: 0, timeout, until, moved: false }
    }

    fn position(&self) -> usize {
        self.at + 7 * usize::from(self.sent)
    }

    /// The next segment; `None` when the sub-block is sent. Without data there is one segment, of no bytes.
    pub(in crate::sdo) fn segment(&mut self) -> Option<[u8; 8]> {
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
    pub(in crate::sdo) fn acknowledge(
        &mut self,
        now: Instant,
        ackseq: u8,
        blksize: u8,
    ) -> Result<Option<BlockEnd>, Abort> {
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
    pub(in crate::sdo) fn start(&mut self, now: Instant) {
        self.until = now + self.timeout;
    }

    /// Instant of the next [`Self::expired`].
    pub(in crate::sdo) fn due(&self) -> Instant {
        self.until
    }

    /// True if no acknowledge came in time, counted from when the sub-block was last seen to move.
    pub(in crate::sdo) fn expired(&mut self, now: Instant) -> bool {
        let expired = self.until <= now;
        if expired && self.moved {
            (self.until, self.moved) = (now + self.timeout, false);
            return false;
        }
        expired
    }
}
