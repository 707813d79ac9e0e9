//! What waits to be written to one connection.

use std::collections::VecDeque;
use std::sync::Arc;

/// Least overhead of an entry, bytes, so that many small ones are bounded too.
const OVERHEAD: usize = 64;

/// Whole messages in order, the first of which may be partly written.
#[derive(Debug, Default)]
pub struct Outbox {
    entries: VecDeque<Entry>,
    /// Bytes of the first entry already written.
    written: usize,
    cost: usize,
}

#[derive(Debug)]
struct Entry {
    bytes: Arc<[u8]>,
    /// A hello or a subscription: never dropped, and not counted.
    control: bool,
}

impl Entry {
    fn cost(&self) -> usize {
        self.bytes.len() + OVERHEAD
    }
}

impl Outbox {
    /// True if all is written.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Cost in bytes of memory.
    #[must_use]
    pub fn cost(&self) -> usize {
        self.cost
    }

    /// Number of published messages that wait.
    #[must_use]
    pub fn messages(&self) -> usize {
        self.entries.iter().filter(|entry| !entry.control).count()
    }

    /// Adds what is not a published message: it is never dropped.
    pub fn push_control(&mut self, bytes: &[u8]) {
        self.add(Entry { bytes: bytes.into(), control: true });
    }

    /// Adds a published message, of which `written` bytes are already; not 0 in an empty outbox only.
    pub fn push(&mut self, bytes: Arc<[u8]>, written: usize) {
        self.add(Entry { bytes, control: false });
        self.written += written;
    }

    /// Makes room for `bytes`, so that all together cost no more than `max`: drops the oldest messages of which
    /// nothing is written. Returns how many.
    pub fn make_room(&mut self, bytes: usize, max: usize) -> u64 {
        let mut dropped = 0;
        while self.cost + bytes + OVERHEAD > max {
            // The first entry stays if it has been begun; control messages come before all others, or are few.
            let begun = usize::from(self.written > 0);
            let Some(index) = (begun..self.entries.len()).find(|&index| !self.entries[index].control) else {
                break;
            };
            if let Some(entry) = self.entries.remove(index) {
                self.cost -= entry.cost();
                dropped += 1;
            }
        }
        dropped
    }

    /// Output waiting, in order.
    pub fn slices(&self) -> impl Iterator<Item = &[u8]> {
        self.entries.iter().enumerate().map(|(index, entry)| match index {
            0 => &entry.bytes[self.written..],
            _ => &entry.bytes[..],
        })
    }

    /// Removes this number of written bytes; returns the number of published messages completed by it. Excess bytes are
    /// ignored.
    pub fn written(&mut self, bytes: usize) -> u64 {
        let mut ended = 0;
        self.written += bytes;
        while let Some(first) = self.entries.front()
            && self.written >= first.bytes.len()
        {
            self.written -= first.bytes.len();
            self.cost -= first.cost();
            ended += u64::from(!first.control);
            self.entries.pop_front();
        }
        if self.entries.is_empty() {
            self.written = 0;
        }
        ended
    }

    fn add(&mut self, entry: Entry) {
        self.cost += entry.cost();
        self.entries.push_back(entry);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(outbox: &Outbox) -> Vec<u8> {
        outbox.slices().collect::<Vec<_>>().concat()
    }

    #[test]
    fn what_is_written_in_part_goes_on_where_it_stopped() {
        let mut outbox = Outbox::default();
        outbox.push_control(b"hello");
        outbox.push(Arc::from(*b"one"), 0);
        outbox.push(Arc::from(*b"two"), 0);
        assert_eq!(outbox.written(6), 0);
        assert_eq!(bytes(&outbox), b"netwo");
        assert_eq!(outbox.written(3), 1);
        assert_eq!((outbox.written(2), outbox.is_empty(), outbox.cost()), (1, true, 0));
        outbox.push(Arc::from(*b"three"), 2);
        assert_eq!(bytes(&outbox), b"ree");
    }

    #[test]
    fn the_oldest_whole_message_makes_room_but_neither_a_hello_nor_one_that_has_begun() {
        let mut outbox = Outbox::default();
        outbox.push_control(b"hello");
        for message in [b"one", b"two", b"six"] {
            outbox.push(Arc::from(*message), 0);
        }
        let full = outbox.cost();
        assert_eq!(outbox.make_room(3, full), 1);
        assert_eq!(bytes(&outbox), b"hellotwosix");
        assert_eq!(outbox.written(6), 0);
        outbox.push(Arc::from(*b"ten"), 0);
        assert_eq!(outbox.make_room(3, full - 69), 1);
        assert_eq!(bytes(&outbox), b"woten");
        assert_eq!(outbox.make_room(1000, 100), 1, "what does not fit at all empties it");
        assert_eq!(bytes(&outbox), b"wo");
        assert_eq!(outbox.messages(), 1);
    }
}
