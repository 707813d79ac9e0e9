//! The two ends of a block transfer's data, the same for client and server: who sends, and who receives, segments.
//! A sub-block is up to 127 numbered segments and one acknowledge of those that arrived in order. Segments that the
//! acknowledge does not cover are sent again, at the front of the next sub-block, numbered from 1.
//!
//! The receiver acknowledges at the end of a sub-block, not at the first gap: segments on the way would be taken for
//! those of the next one. Only when the end itself is lost it speaks after a silence, and then waits for number 1.
//! It never asks for a sub-block of which nothing came: its own acknowledge may be what was lost, and the answer would
//! be the sub-block before, twice.

mod receiver;
mod sender;

pub(super) use receiver::{Expired, Receiver};
pub(super) use sender::Sender;

use crate::Abort;
use crate::wire::sdo::BlockSegment;
use base::Instant;

/// Maximum number of segments of a sub-block, and the number requested by default.
pub const BLOCK_SIZE: u8 = 127;

/// Checks a block size.
pub(super) fn check_size(blksize: u8) -> Result<u8, Abort> {
    if (1..=127).contains(&blksize) { Ok(blksize) } else { Err(Abort::BLOCK_SIZE) }
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

    /// True if a frame is one of them.
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
