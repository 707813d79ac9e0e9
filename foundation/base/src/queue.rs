//! A bounded first-in first-out queue that counts what it had to refuse.

use heapless::Deque;

/// At most `N` items in order of arrival; a push into a full queue is refused and counted.
#[derive(Debug)]
pub struct Queue<T, const N: usize> {
    items: Deque<T, N>,
    dropped: u32,
}

impl<T, const N: usize> Queue<T, N> {
    /// An empty queue.
    #[must_use]
    pub const fn new() -> Self {
        Self { items: Deque::new(), dropped: 0 }
    }

    /// Appends `item`; false when the queue is full: the item is gone and counted.
    pub fn push(&mut self, item: T) -> bool {
        let pushed = self.items.push_back(item).is_ok();
        if !pushed {
            self.dropped = self.dropped.saturating_add(1);
        }
        pushed
    }

    /// Takes the oldest item.
    pub fn pop(&mut self) -> Option<T> {
        self.items.pop_front()
    }

    /// The oldest item.
    #[must_use]
    pub fn front(&self) -> Option<&T> {
        self.items.front()
    }

    /// Number of items that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// True if nothing waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// True if the next push would be refused.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.items.is_full()
    }

    /// Forgets all items; the count of refused ones stays.
    pub fn clear(&mut self) {
        self.items.clear();
    }

    /// Number of items refused since the start.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }
}

impl<T, const N: usize> Default for Queue<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_queue_refuses_and_counts() {
        let mut queue = Queue::<u8, 2>::new();
        assert!(queue.push(1) && queue.push(2) && !queue.push(3));
        assert_eq!((queue.pop(), queue.pop(), queue.pop(), queue.dropped()), (Some(1), Some(2), None, 1));
    }
}
