//! Queue of CAN frames for a device that is not writable: bounded in number and in age.
//!
//! Frames that a dead bus did not take must not be sent when it is back: a drive would obey an old command. So if no
//! frame has left for [`AGE`], frames that have waited that long are dropped.

use base::can::Frame;
use base::{Duration, Instant};
use std::collections::VecDeque;

/// Capacity, frames: an SDO block of 127 segments fits, which an engine outputs at once.
const FRAMES: usize = 128;
/// Maximum age. A full queue may take longer on a slow bus, but then frames leave.
const AGE: Duration = Duration::from_millis(50);

/// Frames in order.
#[derive(Debug)]
pub struct Queue {
    frames: VecDeque<(Instant, Frame)>,
    /// Time at which the last frame left.
    left: Instant,
}

impl Default for Queue {
    fn default() -> Self {
        Self { frames: VecDeque::with_capacity(FRAMES), left: Instant::ZERO }
    }
}

impl Queue {
    /// True if no frame is pending.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Adds a frame; false if the queue is full.
    pub fn push(&mut self, now: Instant, frame: Frame) -> bool {
        let room = self.frames.len() < FRAMES;
        if room {
            self.frames.push_back((now, frame));
        }
        room
    }

    /// Next frame.
    pub fn front(&self) -> Option<&Frame> {
        self.frames.front().map(|(_, frame)| frame)
    }

    /// Removes the first frame, which has left.
    pub fn pop(&mut self, now: Instant) {
        self.frames.pop_front();
        self.left = now;
    }

    /// Notes that a frame left without having been queued.
    pub fn passed(&mut self, now: Instant) {
        self.left = now;
    }

    /// Drops frames that are too old; true if there were any.
    pub fn drop_old(&mut self, now: Instant) -> bool {
        let before = self.frames.len();
        if now.since(self.left) > AGE {
            self.frames.retain(|(since, _)| now.since(*since) <= AGE);
        }
        self.frames.len() < before
    }

    /// Drops all frames.
    pub fn clear(&mut self) {
        self.frames.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_queue_is_ordered_and_bounded_in_number_and_age() {
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
