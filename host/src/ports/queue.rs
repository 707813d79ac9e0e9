//! Frames that wait for room: few, in order, and not for long.
//!
//! What a dead bus does not take must not be sent when it is back: a drive would obey an old command. So once nothing
//! has left for [`AGE`], what has waited that long is dropped.

use base::can::Frame;
use base::{Duration, Instant};
use std::collections::VecDeque;

/// One SDO block of 127 segments fits, which an engine hands over at once.
const FRAMES: usize = 128;
/// On a slow bus a full queue takes longer; but then frames leave.
const AGE: Duration = Duration::from_millis(50);

/// The queue.
#[derive(Debug)]
pub struct Queue {
    frames: VecDeque<(Instant, Frame)>,
    /// Time when the last frame left.
    left: Instant,
}

impl Default for Queue {
    fn default() -> Self {
        Self { frames: VecDeque::with_capacity(FRAMES), left: Instant::ZERO }
    }
}

impl Queue {
    /// True if nothing waits.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Takes a frame; false when there is no room.
    pub fn push(&mut self, now: Instant, frame: Frame) -> bool {
        let room = self.frames.len() < FRAMES;
        if room {
            self.frames.push_back((now, frame));
        }
        room
    }

    /// The frame that is next.
    pub fn front(&self) -> Option<&Frame> {
        self.frames.front().map(|(_, frame)| frame)
    }

    /// The first one has left.
    pub fn pop(&mut self, now: Instant) {
        self.frames.pop_front();
        self.left = now;
    }

    /// A frame has left that did not have to wait.
    pub fn passed(&mut self, now: Instant) {
        self.left = now;
    }

    /// Drops what is old; whether there was any.
    pub fn drop_old(&mut self, now: Instant) -> bool {
        let before = self.frames.len();
        if now.since(self.left) > AGE {
            self.frames.retain(|(since, _)| now.since(*since) <= AGE);
        }
        self.frames.len() < before
    }

    /// Drops everything.
    pub fn clear(&mut self) {
        self.frames.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_waits_keeps_its_order_is_bounded_and_does_not_get_old() {
        let mut queue = Queue::default();
        let frame = |n: u8| Frame::standard(0x600, &[n]);
        for n in 0..200 {
            let at = Instant::from_millis(u64::from(n) / 10);
            assert_eq!(queue.push(at, frame(n)), n < 128);
        }
        assert_eq!(queue.front(), Some(&frame(0)));
        queue.pop(Instant::from_millis(40));
        assert_eq!(queue.front(), Some(&frame(1)));
        // The next has waited 90 ms, but one left 50 ms ago.
        assert!(!queue.drop_old(Instant::from_millis(90)));
        assert!(queue.push(Instant::from_millis(50), frame(200)));
        assert!(queue.drop_old(Instant::from_millis(91)));
        assert_eq!(queue.front(), Some(&frame(200)));
        assert!(queue.drop_old(Instant::from_millis(101)) && queue.is_empty());
    }
}
