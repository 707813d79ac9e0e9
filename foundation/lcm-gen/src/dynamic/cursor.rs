//! Numbers from bytes, and a cursor in the bytes of a validated message, where nothing can be missing.

use super::table::Len;
use crate::Primitive;

/// First `N` bytes; zeros if there are fewer, which does not occur in a validated message.
pub fn chunk<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.first_chunk().copied().unwrap_or([0; N])
}

/// Integer of this type.
pub fn integer(ty: Primitive, bytes: &[u8]) -> i64 {
    match ty {
        Primitive::Int8 => i8::from_be_bytes(chunk(bytes)).into(),
        Primitive::Int16 => i16::from_be_bytes(chunk(bytes)).into(),
        Primitive::Int32 => i32::from_be_bytes(chunk(bytes)).into(),
        Primitive::Int64 => i64::from_be_bytes(chunk(bytes)),
        Primitive::Byte | Primitive::Boolean => u8::from_be_bytes(chunk(bytes)).into(),
        Primitive::Float | Primitive::Double | Primitive::String => 0,
    }
}

/// Position in a validated message, and the lengths in scope.
pub struct Cursor<'a> {
    bytes: &'a [u8],
    /// Values of the length fields of the open structs, innermost last.
    lengths: Vec<usize>,
}

impl<'a> Cursor<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, lengths: Vec::new() }
    }

    pub fn take(&mut self, size: usize) -> &'a [u8] {
        let (head, rest) = self.bytes.split_at_checked(size).unwrap_or_default();
        self.bytes = rest;
        head
    }

    pub fn text(&mut self) -> &'a str {
        let size = integer(Primitive::Int32, self.take(4));
        let text = self.take(usize::try_from(size).unwrap_or_default());
        text.split_last().and_then(|(_, text)| std::str::from_utf8(text).ok()).unwrap_or_default()
    }

    /// Opens a struct with `slots` lengths; returns the base for the other calls.
    pub fn open(&mut self, slots: usize) -> usize {
        let base = self.lengths.len();
        self.lengths.resize(base + slots, 0);
        base
    }

    /// Closes a struct.
    pub fn close(&mut self, base: usize) {
        self.lengths.truncate(base);
    }

    /// Reads a length of the struct.
    pub fn length(&mut self, base: usize, slot: usize, ty: Primitive) -> i64 {
        let value = integer(ty, self.take(ty.min_size()));
        if let Some(length) = self.lengths.get_mut(base + slot) {
            *length = usize::try_from(value).unwrap_or_default();
        }
        value
    }

    pub fn len(&self, base: usize, len: Len) -> usize {
        match len {
            Len::Fixed(count) => count,
            Len::Slot(slot) => self.lengths.get(base + slot).copied().unwrap_or_default(),
        }
    }
}
