//! Messages that wait to be taken, within the limits of the subscriptions that want them.
//!
//! One line for all subscriptions, in order of arrival. A message belongs to every subscription that matched it and
//! stays as long as one of them holds it; it is taken once. Each subscription counts what its limit cost.

use crate::origin::{Origin, Provenance};
use crate::subscription::{Queue, SubscriptionId, Subscriptions};
use std::collections::VecDeque;
use std::mem;

/// Maximum number of empty messages kept for reuse.
const SPARE_MAX: usize = 64;
/// Larger ones are given back to the system.
const SPARE_SIZE: usize = 4096;
/// Maximum number of channels [`Queue::Last`] follows: a new name costs a publisher one datagram.
pub const LAST_MAX: usize = 1024;

/// A message that waits, or has just been taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Waiting {
    /// Channel.
    pub channel: String,
    /// Payload.
    pub payload: Vec<u8>,
    /// When and from where it came.
    pub provenance: Provenance,
    holders: Vec<SubscriptionId>,
}

impl Default for Waiting {
    fn default() -> Self {
        let provenance = Provenance { at: 0, published: None, origin: Origin::Host(None) };
        Self { channel: String::new(), payload: Vec::new(), provenance, holders: Vec::new() }
    }
}

impl Waiting {
    /// Approximate cost of a message beside its payload, bytes.
    const OVERHEAD: usize = 128;

    fn cost(&self) -> usize {
        Self::OVERHEAD + self.payload.len()
    }
}

/// The line.
#[derive(Debug)]
pub struct Line {
    entries: VecDeque<Waiting>,
    /// Total cost, bytes.
    bytes: usize,
    bytes_max: usize,
    dropped: u64,
    spare: Vec<Waiting>,
    taken: Waiting,
}

impl Line {
    /// A line in which messages of subscriptions with [`Queue::Transport`] wait as long as all together hold fewer
    /// than `bytes_max` bytes, some for each message itself among them.
    #[must_use]
    pub fn new(bytes_max: usize) -> Self {
        Self { entries: VecDeque::new(), bytes: 0, bytes_max, dropped: 0, spare: Vec::new(), taken: Waiting::default() }
    }

    /// Number of messages that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Number of messages the limits have cost, all subscriptions together.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// True if none does.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Appends a message, if a subscription wants it and has room; makes that room by its limit. False if no
    /// subscription wants it.
    pub fn push(&mut self, subscriptions: &mut Subscriptions, channel: &str, payload: &[u8], from: Provenance) -> bool {
        let mut entry = self.spare.pop().unwrap_or_default();
        entry.holders.clear();
        let mut wanted = false;
        for subscription in subscriptions.matching(channel) {
            wanted = true;
            if payload.len() > subscription.size_max {
                subscription.dropped += 1;
                self.dropped += 1;
                continue;
            }
            let id = subscription.id();
            let holds = match subscription.queue {
                Queue::Transport => self.bytes < self.bytes_max,
                Queue::Oldest(limit) => subscription.waiting < limit,
                Queue::Newest(limit) => {
                    if limit > 0 && subscription.waiting >= limit {
                        self.release(id, |_| true);
                        subscription.waiting -= 1;
                        subscription.dropped += 1;
                        self.dropped += 1;
                    }
                    limit > 0
                }
                Queue::Last => {
                    let known = self.release(id, |waiting| waiting.channel == channel);
                    if known || (subscription.waiting >= LAST_MAX && self.release(id, |_| true)) {
                        subscription.waiting -= 1;
                        subscription.dropped += 1;
                        self.dropped += 1;
                    }
                    true
                }
            };
            if holds {
                subscription.waiting += 1;
                entry.holders.push(id);
            } else {
                subscription.dropped += 1;
                self.dropped += 1;
            }
        }
        if entry.holders.is_empty() {
            self.keep(entry);
            return wanted;
        }
        entry.channel.clear();
        entry.channel.push_str(channel);
        entry.payload.clear();
        entry.payload.extend_from_slice(payload);
        entry.provenance = from;
        self.bytes += entry.cost();
        self.entries.push_back(entry);
        true
    }

    /// Takes the oldest message; it is there until the next call.
    pub fn pop(&mut self, subscriptions: &mut Subscriptions) -> Option<&Waiting> {
        let entry = self.entries.pop_front()?;
        self.bytes -= entry.cost();
        for &id in &entry.holders {
            subscriptions.taken(id);
        }
        let before = mem::replace(&mut self.taken, entry);
        self.keep(before);
        Some(&self.taken)
    }

    /// Forgets a subscription that has ended: what only it held no longer waits.
    pub fn forget(&mut self, id: SubscriptionId) {
        while self.release(id, |_| true) {}
    }

    /// Releases the oldest message held by `id` for which `such` is true. False if there is none.
    fn release(&mut self, id: SubscriptionId, such: impl Fn(&Waiting) -> bool) -> bool {
        let mut entries = self.entries.iter_mut().enumerate();
        let Some((index, entry)) = entries.find(|(_, entry)| entry.holders.contains(&id) && such(entry)) else {
            return false;
        };
        entry.holders.retain(|&holder| holder != id);
        if entry.holders.is_empty()
            && let Some(gone) = self.entries.remove(index)
        {
            self.bytes -= gone.cost();
            self.keep(gone);
        }
        true
    }

    fn keep(&mut self, gone: Waiting) {
        if self.spare.len() < SPARE_MAX && gone.payload.capacity() <= SPARE_SIZE {
            self.spare.push(gone);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subscription::Pattern;

    const FROM: Provenance = Provenance { at: 0, published: None, origin: Origin::Host(None) };

    struct Bench {
        subscriptions: Subscriptions,
        line: Line,
    }

    impl Bench {
        fn new(subscriptions: &[(&str, Queue)]) -> (Self, Vec<SubscriptionId>) {
            let mut bench =
                Self { subscriptions: Subscriptions::default(), line: Line::new(2 * Waiting::OVERHEAD + 10) };
            let ids = subscriptions.iter().map(|&(pattern, queue)| {
                bench.subscriptions.add(Pattern::new(pattern).expect("a good pattern"), queue)
            });
            let ids = ids.collect();
            (bench, ids)
        }

        /// Pushes messages of one byte: `A1` is a 1 on channel A.
        fn push(&mut self, messages: &[&str]) {
            for message in messages {
                let (channel, payload) = message.split_at(1);
                self.line.push(&mut self.subscriptions, channel, payload.as_bytes(), FROM);
            }
        }

        fn take_all(&mut self) -> Vec<String> {
            let mut taken = Vec::new();
            while let Some(Waiting { channel, payload, .. }) = self.line.pop(&mut self.subscriptions) {
                taken.push(format!("{channel}{}", String::from_utf8_lossy(payload)));
            }
            taken
        }

        fn dropped(&self, ids: &[SubscriptionId]) -> Vec<u64> {
            ids.iter().map(|&id| self.subscriptions.dropped(id).unwrap_or(u64::MAX)).collect()
        }
    }

    #[test]
    fn oldest_keeps_what_came_first() {
        let (mut bench, ids) = Bench::new(&[("A", Queue::Oldest(2))]);
        bench.push(&["A1", "A2", "A3", "B1"]);
        assert_eq!(bench.take_all(), ["A1", "A2"]);
        assert_eq!(bench.dropped(&ids), [1]);
        bench.push(&["A4"]);
        assert_eq!(bench.take_all(), ["A4"], "there is room again");
    }

    #[test]
    fn newest_keeps_what_came_last() {
        let (mut bench, ids) = Bench::new(&[(".*", Queue::Newest(2))]);
        bench.push(&["A1", "B2", "A3", "A4"]);
        assert_eq!(bench.take_all(), ["A3", "A4"]);
        assert_eq!(bench.dropped(&ids), [2]);
    }

    #[test]
    fn last_keeps_one_of_each_channel_in_the_order_of_arrival() {
        let (mut bench, ids) = Bench::new(&[(".*", Queue::Last)]);
        bench.push(&["A1", "B2", "A3", "B4", "C5"]);
        assert_eq!(bench.take_all(), ["A3", "B4", "C5"]);
        assert_eq!(bench.dropped(&ids), [2]);
    }

    #[test]
    fn last_follows_so_many_channels_and_no_more() {
        let (mut bench, ids) = Bench::new(&[(".*", Queue::Last)]);
        for n in 0..2 * LAST_MAX {
            bench.line.push(&mut bench.subscriptions, &n.to_string(), b"", FROM);
        }
        assert_eq!((bench.line.len(), bench.dropped(&ids)), (LAST_MAX, vec![LAST_MAX as u64]));
        assert_eq!(bench.take_all().first(), Some(&LAST_MAX.to_string()));
    }

    #[test]
    fn without_a_limit_the_bytes_are_the_limit() {
        let (mut bench, ids) = Bench::new(&[("A", Queue::Transport)]);
        bench.push(&["A1234", "A5678", "A9012", "A3456"]);
        assert_eq!(bench.take_all(), ["A1234", "A5678", "A9012"]);
        assert_eq!(bench.dropped(&ids), [1]);
    }

    #[test]
    fn a_message_stays_while_one_subscription_holds_it_and_is_taken_once() {
        let (mut bench, ids) = Bench::new(&[("A", Queue::Newest(1)), (".*", Queue::Oldest(3)), ("A", Queue::Last)]);
        bench.push(&["A1", "A2", "B3", "A4"]);
        assert_eq!(bench.take_all(), ["A1", "A2", "B3", "A4"]);
        assert_eq!(bench.dropped(&ids), [2, 1, 2]);
        bench.push(&["A5", "A6", "A7"]);
        assert!(bench.subscriptions.remove(ids[1]));
        bench.line.forget(ids[1]);
        assert_eq!(bench.take_all(), ["A7"], "the first two waited for the subscription that has ended");
    }

    #[test]
    fn a_limit_of_none_takes_none() {
        let (mut bench, ids) = Bench::new(&[("A", Queue::Newest(0)), ("A", Queue::Oldest(0))]);
        bench.push(&["A1", "A2"]);
        assert!(bench.take_all().is_empty() && bench.line.is_empty());
        assert_eq!(bench.dropped(&ids), [2, 2]);
    }
}
