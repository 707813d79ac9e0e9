//! Signs that two nodes have the same id. Each alone has an innocent cause, a frame doubled or late; many at once have
//! not.

use base::{Duration, Instant};

/// Number of answers that are considered.
const ANSWER_WINDOW: u8 = 16;
/// Number of duplicates among them that prove two nodes.
const DUPLICATES_MIN: u8 = 8;
/// Number of heartbeats that are considered.
const HEARTBEAT_WINDOW: u32 = 32;

/// Evidence of two nodes with one id.
#[derive(Default)]
pub(super) struct DuplicateIdDetector {
    answers: u8,
    twice: u8,
    ignored: u32,
    beats: u32,
    since: Instant,
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

    /// Counts a heartbeat of a node with this `period`. Returns true if they arrive much too often for long.
    pub(super) fn beat(&mut self, now: Instant, period: Duration) -> bool {
        // Heartbeats that waited in a queue arrive together: no evidence about their sender.
        let queued = now.since(self.last) < period / 20;
        self.last = now;
        if self.beats == 0 || queued {
            (self.beats, self.since) = (1, now);
            return false;
        }
        self.beats += 1;
        if self.beats <= HEARTBEAT_WINDOW {
            return false;
        }
        // … within less than two thirds of the time that they take.
        let two = now.since(self.since) < period * (HEARTBEAT_WINDOW * 2 / 3);
        (self.beats, self.since) = (1, now);
        two
    }

    /// Resets after a restart of the node.
    pub(super) fn clear(&mut self, ignored: u32) {
        *self = Self { ignored, ..Self::default() };
    }
}
