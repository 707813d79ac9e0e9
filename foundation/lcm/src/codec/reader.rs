//! Takes members from the bytes of a message.

use alloc::borrow::ToOwned;
use alloc::string::String;
use alloc::vec::Vec;

use super::{DecodeError, Elements, Fixed, MAX_DEPTH, MAX_EMPTY, has_nul};

/// Remaining bytes of a message. No method panics, or allocates more than the bytes can fill, whatever their content.
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    depth: usize,
    empties: usize,
}

impl<'a> Reader<'a> {
    /// Reads from the start of `bytes`.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, depth: 0, empties: MAX_EMPTY }
    }

    /// Reads what follows the fingerprint at the start of `message`.
    ///
    /// # Errors
    /// [`DecodeError::Truncated`] or [`DecodeError::Fingerprint`].
    #[inline]
    pub fn of(message: &'a [u8], expected: u64) -> Result<Self, DecodeError> {
        let mut r = Self::new(message);
        match r.get_u64()? {
            found if found == expected => Ok(r),
            found => Err(DecodeError::Fingerprint { expected, found }),
        }
    }

    /// Checks that no bytes are left.
    ///
    /// # Errors
    /// [`DecodeError::LeftOver`].
    #[inline]
    pub fn end(&self) -> Result<(), DecodeError> {
        match self.bytes.len() {
            0 => Ok(()),
            extra => Err(DecodeError::LeftOver { extra }),
        }
    }

    /// Number of bytes that are left.
    #[must_use]
    pub fn remaining(&self) -> usize {
        self.bytes.len()
    }

    /// Next `needed` bytes, borrowed.
    ///
    /// # Errors
    /// [`DecodeError::Truncated`].
    #[inline]
    pub fn take(&mut self, needed: usize) -> Result<&'a [u8], DecodeError> {
        let truncated = DecodeError::Truncated { needed, left: self.bytes.len() };
        let (head, rest) = self.bytes.split_at_checked(needed).ok_or(truncated)?;
        self.bytes = rest;
        Ok(head)
    }

    #[inline]
    pub(super) fn get_u64(&mut self) -> Result<u64, DecodeError> {
        let mut bytes = [0; 8];
        bytes.copy_from_slice(self.take(8)?);
        Ok(u64::from_be_bytes(bytes))
    }

    /// A value of fixed size.
    ///
    /// # Errors
    /// [`DecodeError::Truncated`].
    #[inline]
    pub fn get<T: Fixed>(&mut self) -> Result<T, DecodeError> {
        self.take(T::SIZE).map(T::load)
    }

    /// Next `N` bytes, borrowed.
    ///
    /// # Errors
    /// [`DecodeError::Truncated`].
    pub fn block<const N: usize>(&mut self) -> Result<&'a [u8; N], DecodeError> {
        let truncated = DecodeError::Truncated { needed: N, left: self.bytes.len() };
        let (head, rest) = self.bytes.split_first_chunk().ok_or(truncated)?;
        self.bytes = rest;
        Ok(head)
    }

    /// Next `count` bytes, borrowed.
    ///
    /// # Errors
    /// [`DecodeError::Count`] if fewer bytes are left.
    pub fn bytes(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        self.claim(count, 1, 1)?;
        self.take(count)
    }

    /// Next `count` values of fixed size, borrowed.
    ///
    /// # Errors
    /// [`DecodeError::Count`] when there are not bytes enough.
    pub fn elements<T: Fixed>(&mut self, count: usize) -> Result<Elements<'a, T>, DecodeError> {
        self.claim(count, T::SIZE, 1)?;
        Ok(Elements::new(self.take(count * T::SIZE)?, count))
    }

    /// `count` values of fixed size.
    ///
    /// # Errors
    /// [`DecodeError::Count`] when there are not bytes enough; nothing was allocated then.
    pub fn get_vec<T: Fixed>(&mut self, count: usize) -> Result<Vec<T>, DecodeError> {
        self.claim(count, T::SIZE, 1)?;
        if T::SIZE == 0 {
            return Ok((0..count).map(|_| T::load(&[])).collect());
        }
        let bytes = self.take(count * T::SIZE)?;
        Ok(bytes.chunks_exact(T::SIZE).map(T::load).collect())
    }

    /// Next string, borrowed: its length with the NUL, UTF-8, NUL.
    ///
    /// # Errors
    /// When the length, the NUL or the text is not as it must be.
    pub fn str(&mut self) -> Result<&'a str, DecodeError> {
        let len: i32 = self.get()?;
        let bad_length = DecodeError::StringLength { len, left: self.bytes.len() };
        let size = usize::try_from(len).ok().filter(|&size| 0 < size && size <= self.bytes.len());
        let (&last, text) = self.take(size.ok_or(bad_length)?)?.split_last().ok_or(bad_length)?;
        if last != 0 {
            return Err(DecodeError::Unterminated);
        }
        if has_nul(text) {
            return Err(DecodeError::InnerNul);
        }
        core::str::from_utf8(text).map_err(|error| DecodeError::NotUtf8 { valid_up_to: error.valid_up_to() })
    }

    /// A string.
    ///
    /// # Errors
    /// As [`str`](Self::str).
    pub fn string(&mut self) -> Result<String, DecodeError> {
        self.str().map(ToOwned::to_owned)
    }

    /// A length member of type `T` that is nothing but the length of arrays.
    ///
    /// # Errors
    /// [`DecodeError::Truncated`], or [`DecodeError::Count`] for a negative one.
    pub fn count<T: Fixed + Into<i64>>(&mut self) -> Result<usize, DecodeError> {
        let count = self.get::<T>()?;
        self.length(count)
    }

    /// Array length from the value of a length member.
    ///
    /// # Errors
    /// [`DecodeError::Count`] for a negative one.
    pub fn length(&self, count: impl Into<i64>) -> Result<usize, DecodeError> {
        let count = count.into();
        usize::try_from(count).map_err(|_| DecodeError::Count { count, max: self.bytes.len() })
    }

    /// Claims room for `count` elements of at least `min` bytes each; an element without bytes counts as `shown` (at
    /// least 1) towards [`MAX_EMPTY`].
    ///
    /// # Errors
    /// [`DecodeError::Count`] for a count that the rest of the message cannot hold.
    pub fn claim(&mut self, count: usize, min: usize, shown: usize) -> Result<(), DecodeError> {
        let max = self.bytes.len().checked_div(min).unwrap_or(self.empties / shown);
        if count > max {
            return Err(DecodeError::Count { count: i64::try_from(count).unwrap_or(i64::MAX), max });
        }
        if min == 0 {
            self.empties -= count * shown;
        }
        Ok(())
    }

    /// `count` elements of at least `min` bytes each.
    ///
    /// # Errors
    /// [`DecodeError::Count`] if fewer bytes are left, and any error of `element`.
    pub fn vec<T>(
        &mut self,
        count: usize,
        min: usize,
        mut element: impl FnMut(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<Vec<T>, DecodeError> {
        self.claim(count, min, 1)?;
        let mut elements = Vec::with_capacity(count.min(1024)); // more only as they really come
        for _ in 0..count {
            elements.push(element(self)?);
        }
        Ok(elements)
    }

    /// `N` elements.
    ///
    /// # Errors
    /// What `element` returns.
    pub fn array<T, const N: usize>(
        &mut self,
        mut element: impl FnMut(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<[T; N], DecodeError> {
        let mut elements = [const { None }; N];
        for place in &mut elements {
            *place = Some(element(self)?);
        }
        Ok(elements.map(|element| element.unwrap_or_else(|| unreachable!("every place was filled"))))
    }

    /// A value of a recursive type, one level further down.
    ///
    /// # Errors
    /// [`DecodeError::Depth`], and any error of `value`.
    pub fn nested<T>(&mut self, value: impl FnOnce(&mut Self) -> Result<T, DecodeError>) -> Result<T, DecodeError> {
        if self.depth == MAX_DEPTH {
            return Err(DecodeError::Depth { max: MAX_DEPTH });
        }
        self.depth += 1;
        let value = value(self)?;
        self.depth -= 1;
        Ok(value)
    }
}
