//! Frames to send, in order: heartbeat, NMT, SYNC, TIME and PDOs first come first served; SDO frames after them, node
//! by node in turn, limited to what the wire takes at once. So a block download delays a set-point by at most that
//! time.

use crate::wire::Service;
use base::can::{Frame, INTERMISSION, frame_bits};
use base::{Duration, Instant, Queue};

/// SDO frames may lie this long in the queues below, or that many bits where the bus is slow: four frames.
const AHEAD: Duration = Duration::from_millis(1);
const AHEAD_BITS: u64 = 4 * 135;

/// Bits of a frame without stuff bits, whose number depends on its content.
fn plain_bits(frame: &Frame) -> u32 {
    44 + 8 * u32::from(frame.dlc()) + INTERMISSION
}

pub(super) struct Outbox {
    frames: Queue<Frame, 256>,
    /// One bit for each node whose SDO channel may have a frame to send.
    talkative: u128,
    /// The node that had its turn last.
    turn: u32,
    bit_rate: u64,
    ahead: Duration,
    /// Time when what was handed out will have crossed the wire.
    free: Instant,
    now: Instant,
}

impl Outbox {
    pub(super) fn new(bit_rate: u32) -> Self {
        let mut outbox = Self {
            frames: Queue::new(),
            talkative: 0,
            turn: 0,
            bit_rate: u64::from(bit_rate.max(1)),
            ahead: AHEAD,
            free: Instant::ZERO,
            now: Instant::ZERO,
        };
        outbox.ahead = AHEAD.max(outbox.time(AHEAD_BITS));
        outbox
    }

    fn time(&self, bits: u64) -> Duration {
        Duration::from_nanos(bits * 1_000_000_000 / self.bit_rate)
    }

    /// Sets the present; every call of the master begins with it.
    pub(super) fn at(&mut self, now: Instant) {
        self.now = self.now.max(now);
    }

    /// Queues a frame before all SDO frames; false if the queue is full.
    pub(super) fn push(&mut self, frame: Frame) -> bool {
        self.frames.push(frame)
    }

    pub(super) fn pop(&mut self) -> Option<Frame> {
        let frame = self.frames.pop()?;
        self.crosses(plain_bits(&frame));
        Some(frame)
    }

    /// Marks the SDO channel of `node` as possibly having a frame to send.
    pub(super) fn mark(&mut self, node: u8) {
        self.talkative |= 1 << (node & 0x7F);
    }

    /// Removes the mark.
    pub(super) fn unmark(&mut self, node: u8) {
        self.talkative &= !(1 << (node & 0x7F));
    }

    /// Next node whose SDO channel may send now.
    pub(super) fn turn(&mut self) -> Option<u8> {
        if self.talkative == 0 || self.free > self.now + self.ahead {
            return None;
        }
        let after = self.turn + 1;
        self.turn = (self.talkative.rotate_right(after).trailing_zeros() + after) & 0x7F;
        Some(self.turn as u8)
    }

    /// An SDO frame was handed out.
    pub(super) fn said(&mut self, frame: &Frame) {
        self.crosses(frame_bits(frame) + INTERMISSION);
    }

    /// Accounts for a foreign frame that crossed the wire before the frames that wait.
    pub(super) fn crossed(&mut self, frame: &Frame) {
        if self.free > self.now {
            self.crosses(plain_bits(frame));
        }
    }

    fn crosses(&mut self, bits: u32) {
        self.free = self.free.max(self.now) + self.time(u64::from(bits));
    }

    /// Instant at which the next SDO frame may be sent.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        (self.talkative != 0).then(|| self.free - self.ahead / 2)
    }

    /// Throws away what waits, all of it.
    pub(super) fn clear(&mut self) {
        self.frames.clear();
        self.talkative = 0;
        self.free = self.now;
    }

    /// Drops PDOs, so that no stale command reaches a drive that comes back (yarp-devices #246, #251).
    pub(super) fn drop_pdos(&mut self, node: u8) {
        for _ in 0..self.frames.len() {
            let Some(frame) = self.frames.pop() else { break };
            let ours = matches!(Service::of(&frame), Some(Service::Rpdo { node: to, .. }) if to == node);
            if !ours {
                self.frames.push(frame);
            }
        }
    }

    pub(super) fn dropped(&self) -> u32 {
        self.frames.dropped()
    }
}
