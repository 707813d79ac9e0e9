//! Sorting in little code.

use alloc::vec::Vec;
use core::cmp::Ordering;

/// Stable sorting for lists that are short or sorted rarely. The order is that of `sort`, `sort_by` and `sort_by_key`,
/// whose code is there once for each type and comparison, with about 5 KB each time; this one is there once in all, and
/// each use adds some 200 bytes. It compares through a pointer and allocates a number for each element: what is sorted
/// at the robot's rates, or has many thousand elements, is better sorted by the standard library.
pub trait Arrange<T> {
    /// Sorts by a comparison, which is a total order.
    fn arrange_by(&mut self, compare: impl FnMut(&T, &T) -> Ordering);

    /// Sorts by a key.
    fn arrange_by_key<K: Ord>(&mut self, key: impl FnMut(&T) -> K);

    /// Sorts by the elements' own order.
    fn arrange(&mut self)
    where
        T: Ord;
}

impl<T> Arrange<T> for [T] {
    fn arrange_by(&mut self, mut compare: impl FnMut(&T, &T) -> Ordering) {
        let list = &*self;
        let mut places = places(list.len(), &mut |a, b| compare(&list[a], &list[b]));
        // Each element that has to move is part of a circle of such elements.
        for begin in 0..places.len() {
            let mut at = begin;
            loop {
                let from = core::mem::replace(&mut places[at], at);
                if from == begin || from == at {
                    break;
                }
                self.swap(at, from);
                at = from;
            }
        }
    }

    fn arrange_by_key<K: Ord>(&mut self, mut key: impl FnMut(&T) -> K) {
        self.arrange_by(|a, b| key(a).cmp(&key(b)));
    }

    fn arrange(&mut self)
    where
        T: Ord,
    {
        self.arrange_by(T::cmp);
    }
}

/// For each place of the sorted list, where its element is now.
fn places(count: usize, compare: &mut dyn FnMut(usize, usize) -> Ordering) -> Vec<usize> {
    let mut places: Vec<usize> = (0..count).collect();
    places.sort_by(|a, b| compare(*a, *b));
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_is_that_of_the_standard_library() {
        let mut state = 1_u32;
        for len in (0..60).chain([1000]) {
            for different in [1, 2, 7, 1000] {
                let mut next = || {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 16) % different
                };
                let list: Vec<(u32, usize)> = (0..len).map(|place| (next(), place)).collect();
                let (mut ours, mut theirs) = (list.clone(), list.clone());
                ours.arrange_by_key(|(key, _)| *key);
                theirs.sort_by_key(|(key, _)| *key);
                assert_eq!(ours, theirs);
                ours.arrange_by(|a, b| b.cmp(a));
                theirs.sort_by(|a, b| b.cmp(a));
                assert_eq!(ours, theirs);
                ours.arrange();
                theirs.sort();
                assert_eq!(ours, theirs);
            }
        }
    }
}
