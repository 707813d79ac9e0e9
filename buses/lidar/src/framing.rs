//! What a stream of bytes loses when it is not in step with its messages.

use crate::engine::Shared;
use heapless::Vec;

/// Whether a stream is in step with its messages, and what was skipped since it was.
#[derive(Debug, Default)]
pub(crate) struct Framing {
    /// The last byte belonged to a message.
    in_step: bool,
    skipped: usize,
}

impl Framing {
    /// Begins anew.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Takes note of a valid message.
    pub fn found(&mut self) {
        (self.in_step, self.skipped) = (true, 0);
    }

    /// Removes the first byte, and what after it cannot begin a message. Counts one message for each that is damaged,
    /// and one for each `length` of bytes that belong to none.
    pub fn skip<const N: usize>(
        &mut self,
        rx: &mut Vec<u8, N>,
        length: usize,
        may_begin: impl Fn(&[u8]) -> bool,
        shared: &mut Shared,
    ) {
        if self.in_step || self.skipped >= length {
            shared.reject();
            self.skipped = 0;
        }
        self.in_step = false;
        let from = (1..rx.len()).find(|from| may_begin(&rx[*from..])).unwrap_or(rx.len());
        self.skipped += from;
        let left = rx.len() - from;
        rx.copy_within(from.., 0);
        rx.truncate(left);
    }
}
