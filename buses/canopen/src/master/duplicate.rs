//! Signs that two nodes have the same id. Each alone has an innocent cause, a frame doubled or late; many at once have
//! not.

use base::{Duration, Instant};

/// Number of answers that are considered.
const ANSWER_WINDOW: u8 = 16;
/// Number of duplicates among them that prove two nodes.
const DUPLICATES_MIN: u8 = 8;
/// Heartbeats above the rate permitted, from which two nodes send them; what a queue held back is less.
const HEARTBEATS_MAX: u32 = 16;
/// Fill of the bucket by one heartbeat. It loses [`BEAT_LEAK`] in each period, so that four heartbeats in ten may
/// be doubled.
const BEAT: u32 = 1000;
const BEAT_LEAK: u32 = 1400;

/// Evidence of two nodes with one id.
#[derive(Default)]
pub(super) struct DuplicateIdDetector {
    answers: u8,
    twice: u8,
    ignored: u32,
    /// Leaky bucket of heartbeats, in units of [`BEAT`] per heartbeat.
    beats: u32,
    last: Instant,
}

impl DuplicateIdDetector {
    /// A request was answered in time; `ignored` answers so far were to nothing. True: two nodes answer.
    pub(super) fn answered(&mut self, ignored: u32) -> bool {
        self.answers += 1;
        self.twice += u8::from(ignored != self.ignored);
        self.ignored = ignored;
        let two = self.twice >= DUPLICATES_MIN;
        if two || self.answers >= ANSWER_WINDOW {
            (self.answers, self.twice) = (0, 0);
        }
        two
    }

    /// Answers to nothing have another cause now: they are late, or another client asks this node.
    pub(super) fn forgive(&mut self, ignored: u32) {
        (self.answers, self.twice, self.ignored) = (0, 0, ignored);
    }

    /// Counts a heartbeat of a node with this `period`. Returns true if they arrive too often for long, whatever the
    /// phases and the period of the second node. Heartbeats that waited in a queue and arrive together fill the bucket
    /// no more than those that arrive in time.
    pub(super) fn beat(&mut self, now: Instant, period: Duration) -> bool {
        let passed = now.since(self.last);
        self.last = self.last.max(now);
        let leaked = passed.as_nanos().saturating_mul(u128::from(BEAT_LEAK)) / period.as_nanos().max(1);
        self.beats = self.beats.saturating_sub(u32::try_from(leaked).unwrap_or(u32::MAX)) + BEAT;
        let two = self.beats >= HEARTBEATS_MAX * BEAT;
        if two {
            self.beats = 0;
        }
        two
    }

    /// Resets after a restart of the node.
    pub(super) fn clear(&mut self, ignored: u32) {
        *self = Self { ignored, ..Self::default() };
    }
}
