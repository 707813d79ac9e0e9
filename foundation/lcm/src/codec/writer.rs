//! Puts members behind each other.

use super::{EncodeError, Fixed, MAX_DEPTH, fixed, has_nul};

/// How much more the buffer is grown than is needed at once: room for some strings, so that most messages grow it once.
const SLACK: usize = 64;

/// The end of a buffer, to which members are appended. The buffer is grown in steps ahead of the position, so that
/// storing a number is one comparison and one store.
#[derive(Debug)]
pub struct Writer<'a> {
    out: &'a mut Vec<u8>,
    position: usize,
    depth: usize,
}

impl<'a> Writer<'a> {
    /// Writes to the end of `out`, where at least `size` bytes are expected.
    pub(super) fn new(out: &'a mut Vec<u8>, size: usize) -> Self {
        let position = out.len();
        out.resize(position + size + SLACK, 0);
        Self { out, position, depth: 0 }
    }

    /// How far the buffer has been written; what lies behind is room.
    pub(super) fn position(&self) -> usize {
        self.position
    }

    #[inline]
    fn room(&mut self, size: usize) -> &mut [u8] {
        let end = self.position + size;
        if end > self.out.len() {
            self.out.resize(end + SLACK, 0);
        }
        let room = &mut self.out[self.position..end];
        self.position = end;
        room
    }

    pub(super) fn put_u64(&mut self, value: u64) {
        self.room(8).copy_from_slice(&value.to_be_bytes());
    }

    /// A value of fixed size.
    #[inline]
    pub fn put<T: Fixed>(&mut self, value: &T) {
        value.store(self.room(T::SIZE));
    }

    /// The elements of an array, each of fixed size.
    #[inline]
    pub fn put_all<T: Fixed>(&mut self, values: &[T]) {
        fixed::store_all(values, self.room(values.len() * T::SIZE));
    }

    /// A string: its length with the NUL, UTF-8, NUL.
    ///
    /// # Errors
    /// [`EncodeError::Nul`]; [`EncodeError::TooLong`] from 2 GiB on.
    pub fn string(&mut self, member: &'static str, text: &str) -> Result<(), EncodeError> {
        let max = i32::MAX as usize - 1;
        let too_long = EncodeError::TooLong { member, len: text.len(), max };
        let len = i32::try_from(text.len().saturating_add(1)).map_err(|_| too_long)?;
        if has_nul(text.as_bytes()) {
            return Err(EncodeError::Nul { member });
        }
        let room = self.room(text.len() + 5);
        room[..4].copy_from_slice(&len.to_be_bytes());
        room[4..4 + text.len()].copy_from_slice(text.as_bytes());
        room[4 + text.len()] = 0;
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

    /// The array length that a length member's value stands for.
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
    /// [`EncodeError::Depth`], and whatever `value` returns.
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
