//! Signs that two nodes have the same id. Each alone has an innocent cause, a frame doubled or late; many at once have
//! not.

use base::{Duration, Instant};

/// Of so many answers …
const ANSWERS: u8 = 16;
/// … so many came twice.
const TWICE: u8 = 8;
/// So many heartbeats …
const BEATS: u32 = 32;

/// What speaks for two nodes.
#[derive(Default)]
pub(super) struct Doubt {
    answers: u8,
    twice: u8,
    ignored: u32,
    beats: u32,
    since: Instant,
    last: Instant,
}

impl Doubt {
    /// A request was answered in time; `ignored` answers so far were to nothing. True: two nodes answer.
    pub(super) fn answered(&mut self, ignored: u32) -> bool {
        self.answers += 1;
        self.twice += u8::from(ignored != self.ignored);
        self.ignored = ignored;
        let two = self.twice >= TWICE;
        if two || self.answers >= ANSWERS {
            (self.answers, self.twice) = (0, 0);
        }
        two
    }

    /// Answers to nothing have another cause now: they are late, or another client asks this node.
    pub(super) fn forgive(&mut self, ignored: u32) {
        (self.answers, self.twice, self.ignored) = (0, 0, ignored);
    }

    /// A heartbeat that should come each `period`. True: they come much too often, over a long time.
    pub(super) fn beat(&mut self, now: Instant, period: Duration) -> bool {
        // Heartbeats that lay in a queue arrive together and say nothing about their sender.
        let queued = now.since(self.last) < period / 20;
        self.last = now;
        if self.beats == 0 || queued {
            (self.beats, self.since) = (1, now);
            return false;
        }
        self.beats += 1;
        if self.beats <= BEATS {
            return false;
        }
        // … within less than two thirds of the time that they take.
        let two = now.since(self.since) < period * (BEATS * 2 / 3);
        (self.beats, self.since) = (1, now);
        two
    }

    /// The node begins anew.
    pub(super) fn clear(&mut self, ignored: u32) {
        *self = Self { ignored, ..Self::default() };
    }
}
