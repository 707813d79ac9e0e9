//! Arrays that stay in the message.

use alloc::vec::Vec;
use core::fmt;
use core::marker::PhantomData;

use super::Fixed;

/// Elements of a variable array within the message, big-endian; each is decoded on access.
pub struct Elements<'a, T> {
    bytes: &'a [u8],
    len: usize,
    element: PhantomData<T>,
}

impl<'a, T: Fixed> Elements<'a, T> {
    /// `bytes` are those of `len` elements.
    pub(super) fn new(bytes: &'a [u8], len: usize) -> Self {
        Self { bytes, len, element: PhantomData }
    }

    /// Number of them.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there are no elements.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Element at an index; `None` from [`len`](Self::len) on.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<T> {
        (index < self.len).then(|| T::load(&self.bytes[index * T::SIZE..(index + 1) * T::SIZE]))
    }

    /// Iterator over all elements, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = T> + DoubleEndedIterator + use<'a, T> {
        let bytes = self.bytes;
        (0..self.len).map(move |i| T::load(&bytes[i * T::SIZE..(i + 1) * T::SIZE]))
    }

    /// Copies all elements.
    #[must_use]
    pub fn to_vec(&self) -> Vec<T> {
        self.iter().collect()
    }
}

impl<T> Clone for Elements<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Elements<'_, T> {}

impl<T: Fixed + PartialEq> PartialEq for Elements<'_, T> {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl<T: Fixed + fmt::Debug> fmt::Debug for Elements<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}
