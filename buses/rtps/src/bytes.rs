//! Reading and writing of numbers in either byte order.

use alloc::vec::Vec;

/// Bytes still to be read. Each reading returns `None` at the end, and then consumes nothing that matters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cursor<'a> {
    pub data: &'a [u8],
    pub little: bool,
}

impl<'a> Cursor<'a> {
    pub fn new(data: &'a [u8], little: bool) -> Self {
        Self { data, little }
    }

    pub fn take(&mut self, len: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.data.split_at_checked(len)?;
        self.data = rest;
        Some(taken)
    }

    pub fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub fn u16(&mut self) -> Option<u16> {
        let bytes = self.array()?;
        Some(if self.little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    pub fn u32(&mut self) -> Option<u32> {
        let bytes = self.array()?;
        Some(if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    pub fn i32(&mut self) -> Option<i32> {
        self.u32().map(u32::cast_signed)
    }

    /// A sequence number: high half signed, low half not (9.3.2.9).
    pub fn sequence(&mut self) -> Option<i64> {
        let (high, low) = (self.i32()?, self.u32()?);
        Some((i64::from(high) << 32) | i64::from(low))
    }
}

/// Appends numbers, least significant byte first.
pub(crate) trait Put {
    fn put_u16(&mut self, value: u16);
    fn put_u32(&mut self, value: u32);
    fn put_sequence(&mut self, value: i64);
}

impl Put for Vec<u8> {
    fn put_u16(&mut self, value: u16) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn put_u32(&mut self, value: u32) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn put_sequence(&mut self, value: i64) {
        self.put_u32((value >> 32) as u32);
        self.put_u32(value as u32);
    }
}
