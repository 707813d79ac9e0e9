//! Ring of the last messages, for a recording that begins.

use base::{Duration, Instant};
use std::collections::VecDeque;

/// Memory of a message beyond its name and its bytes.
const MESSAGE_OVERHEAD_BYTES: usize = 96;

/// Received message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RingMessage {
    /// Reception.
    pub at: Instant,
    /// Channel.
    pub channel: Box<str>,
    /// Encoded message.
    pub data: Box<[u8]>,
}

/// Last messages, within a duration and a number of bytes.
#[derive(Debug)]
pub struct Ring {
    keep: Duration,
    max_bytes: usize,
    bytes: usize,
    messages: VecDeque<RingMessage>,
}

impl Ring {
    pub fn new(keep: Duration, max_bytes: usize) -> Self {
        Self { keep, max_bytes, bytes: 0, messages: VecDeque::new() }
    }

    /// Adds a message; returns the number of messages dropped.
    pub fn push(&mut self, at: Instant, channel: &str, data: &[u8]) -> u64 {
        let size = channel.len() + data.len() + MESSAGE_OVERHEAD_BYTES;
        if size > self.max_bytes {
            return 1;
        }
        self.bytes += size;
        self.messages.push_back(RingMessage { at, channel: channel.into(), data: data.into() });
        self.age(at)
    }

    /// Drops messages beyond the limits; returns their number.
    fn age(&mut self, now: Instant) -> u64 {
        let mut dropped = 0;
        while let Some(first) = self.messages.front()
            && (self.bytes > self.max_bytes || now.since(first.at) > self.keep)
        {
            self.bytes -= size(first);
            self.messages.pop_front();
            dropped += 1;
        }
        dropped
    }

    /// Takes all messages, with the number dropped as too old.
    pub fn take(&mut self, now: Instant) -> (VecDeque<RingMessage>, u64) {
        let dropped = self.age(now);
        self.bytes = 0;
        (std::mem::take(&mut self.messages), dropped)
    }
}

fn size(message: &RingMessage) -> usize {
    message.channel.len() + message.data.len() + MESSAGE_OVERHEAD_BYTES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_beyond_the_limits_are_dropped() {
        let mut ring = Ring::new(Duration::from_secs(1), 1000);
        let at = Instant::from_millis;
        assert_eq!(ring.push(at(0), "a", &[0; 300]), 0);
        assert_eq!(ring.push(at(10), "b", &[0; 300]), 0);
        assert_eq!(ring.push(at(20), "c", &[0; 300]), 1);
        assert_eq!(ring.push(at(20), "too much by itself", &[0; 1000]), 1);
        assert_eq!(ring.push(at(1015), "d", &[]), 1);
        let (messages, dropped) = ring.take(at(1021));
        assert_eq!(dropped, 1);
        assert_eq!(messages.iter().map(|message| &*message.channel).collect::<String>(), "d");
        assert_eq!((ring.take(at(1021)).0.len(), ring.bytes), (0, 0));
    }
}
