//! What was heard last, kept for a recording that begins.

use base::{Duration, Instant};
use std::collections::VecDeque;

/// What a message takes beside its name and its bytes.
const OVERHEAD: usize = 96;

/// A message as it was heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When.
    pub at: Instant,
    /// Its channel.
    pub channel: Box<str>,
    /// Its bytes.
    pub data: Box<[u8]>,
}

/// The last messages, of so long and so many bytes.
#[derive(Debug)]
pub struct Ring {
    keep: Duration,
    max_bytes: usize,
    bytes: usize,
    heard: VecDeque<Heard>,
}

impl Ring {
    pub fn new(keep: Duration, max_bytes: usize) -> Self {
        Self { keep, max_bytes, bytes: 0, heard: VecDeque::new() }
    }

    /// Keeps a message; says how many there are no more.
    pub fn push(&mut self, at: Instant, channel: &str, data: &[u8]) -> u64 {
        let size = channel.len() + data.len() + OVERHEAD;
        if size > self.max_bytes {
            return 1;
        }
        self.bytes += size;
        self.heard.push_back(Heard { at, channel: channel.into(), data: data.into() });
        self.age(at)
    }

    /// Drops what is too old or too much; says how many that were.
    fn age(&mut self, now: Instant) -> u64 {
        let mut dropped = 0;
        while let Some(first) = self.heard.front()
            && (self.bytes > self.max_bytes || now.since(first.at) > self.keep)
        {
            self.bytes -= size(first);
            self.heard.pop_front();
            dropped += 1;
        }
        dropped
    }

    /// Takes all of it, and how many of it were too old.
    pub fn take(&mut self, now: Instant) -> (VecDeque<Heard>, u64) {
        let dropped = self.age(now);
        self.bytes = 0;
        (std::mem::take(&mut self.heard), dropped)
    }
}

fn size(heard: &Heard) -> usize {
    heard.channel.len() + heard.data.len() + OVERHEAD
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_old_or_too_much_is_gone() {
        let mut ring = Ring::new(Duration::from_secs(1), 1000);
        let at = Instant::from_millis;
        assert_eq!(ring.push(at(0), "a", &[0; 300]), 0);
        assert_eq!(ring.push(at(10), "b", &[0; 300]), 0);
        assert_eq!(ring.push(at(20), "c", &[0; 300]), 1);
        assert_eq!(ring.push(at(20), "too much by itself", &[0; 1000]), 1);
        assert_eq!(ring.push(at(1015), "d", &[]), 1);
        let (heard, dropped) = ring.take(at(1021));
        assert_eq!(dropped, 1);
        assert_eq!(heard.iter().map(|heard| &*heard.channel).collect::<String>(), "d");
        assert_eq!((ring.take(at(1021)).0.len(), ring.bytes), (0, 0));
    }
}
