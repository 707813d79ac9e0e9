//! Puts members behind each other.

use super::{EncodeError, Fixed, MAX_DEPTH, fixed, has_nul};

/// Remaining room for a message. The size is computed beforehand ([`Type::body_size`](super::Type::body_size)), so
/// everything fits.
///
/// # Panics
/// Every method that puts something in, when a hand-written `body_size` was too small.
#[derive(Debug)]
pub struct Writer<'a> {
    room: &'a mut [u8],
    depth: usize,
}

impl<'a> Writer<'a> {
    pub(super) fn new(room: &'a mut [u8]) -> Self {
        Self { room, depth: 0 }
    }

    /// Number of bytes that are left.
    pub(super) fn left(&self) -> usize {
        self.room.len()
    }

    #[inline]
    fn take(&mut self, size: usize) -> &'a mut [u8] {
        let (taken, rest) = core::mem::take(&mut self.room).split_at_mut(size);
        self.room = rest;
        taken
    }

    #[inline]
    pub(super) fn put_u64(&mut self, value: u64) {
        self.take(8).copy_from_slice(&value.to_be_bytes());
    }

    /// A value of fixed size.
    #[inline]
    pub fn put<T: Fixed>(&mut self, value: &T) {
        value.store(self.take(T::SIZE));
    }

    /// The elements of an array, each of fixed size.
    #[inline]
    pub fn put_all<T: Fixed>(&mut self, values: &[T]) {
        fixed::store_all(values, self.take(values.len() * T::SIZE));
    }

    /// A string: its length with the NUL, UTF-8, NUL.
    ///
    /// # Errors
    /// [`EncodeError::Nul`]; [`EncodeError::TooLong`] from 2 GiB on.
    #[inline]
    pub fn string(&mut self, member: &'static str, text: &str) -> Result<(), EncodeError> {
        let max = i32::MAX as usize - 1;
        let too_long = EncodeError::TooLong { member, len: text.len(), max };
        let len = i32::try_from(text.len().saturating_add(1)).map_err(|_| too_long)?;
        if has_nul(text.as_bytes()) {
            return Err(EncodeError::Nul { member });
        }
        self.put(&len);
        self.take(text.len()).copy_from_slice(text.as_bytes());
        self.put(&0_u8);
        Ok(())
    }

    /// A length member of type `T` that is nothing but the length of arrays.
    ///
    /// # Errors
    /// [`EncodeError::TooLong`] when `len` does not fit `T`.
    pub fn count<T: Fixed + TryFrom<usize>>(&mut self, member: &'static str, len: usize) -> Result<(), EncodeError> {
        let max = (1_usize << (8 * T::SIZE - 1).min(usize::BITS as usize - 1)) - 1;
        let count = T::try_from(len).map_err(|_| EncodeError::TooLong { member, len, max })?;
        self.put(&count);
        Ok(())
    }

    /// Array length from the value of a length member.
    ///
    /// # Errors
    /// [`EncodeError::Negative`].
    pub fn length(&self, member: &'static str, value: impl Into<i64>) -> Result<usize, EncodeError> {
        let value = value.into();
        usize::try_from(value).map_err(|_| EncodeError::Negative { member, value })
    }

    /// Holds an array's length against what it must be.
    ///
    /// # Errors
    /// [`EncodeError::Length`] when they differ.
    #[inline]
    pub fn check(&self, member: &'static str, expected: usize, found: usize) -> Result<(), EncodeError> {
        if expected == found { Ok(()) } else { Err(EncodeError::Length { member, expected, found }) }
    }

    /// A value of a recursive type, one level further down.
    ///
    /// # Errors
    /// [`EncodeError::Depth`], and any error of `value`.
    pub fn nested(&mut self, value: impl FnOnce(&mut Self) -> Result<(), EncodeError>) -> Result<(), EncodeError> {
        if self.depth == MAX_DEPTH {
            return Err(EncodeError::Depth { max: MAX_DEPTH });
        }
        self.depth += 1;
        value(self)?;
        self.depth -= 1;
        Ok(())
    }
}
