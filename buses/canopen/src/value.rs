//! What an object holds: numbers with their width, and the bytes of an SDO transfer.

use alloc::vec::Vec;
use core::fmt;
use core::ops::Deref;

/// A number in the type of its object; the variant gives the width on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)] // the names are the description
pub enum Value {
    U8(u8),
    U16(u16),
    U32(u32),
    I8(i8),
    I16(i16),
    I32(i32),
}

impl Value {
    /// The little-endian bytes; the first [`width`](Self::width) of them count.
    #[must_use]
    pub const fn bytes(self) -> [u8; 4] {
        self.bits().to_le_bytes()
    }

    /// Bytes on the wire: 1, 2 or 4.
    #[must_use]
    pub const fn width(self) -> usize {
        match self {
            Self::U8(_) | Self::I8(_) => 1,
            Self::U16(_) | Self::I16(_) => 2,
            Self::U32(_) | Self::I32(_) => 4,
        }
    }

    /// The bit pattern, without sign extension: `I8(-1)` is 0xFF.
    #[must_use]
    pub const fn bits(self) -> u32 {
        match self {
            Self::U8(v) => v as u32,
            Self::U16(v) => v as u32,
            Self::U32(v) => v,
            Self::I8(v) => v as u8 as u32,
            Self::I16(v) => v as u16 as u32,
            Self::I32(v) => v as u32,
        }
    }
}

macro_rules! value_from {
    ($($variant:ident $type:ty),*) => {
        $(impl From<$type> for Value {
            fn from(value: $type) -> Self { Self::$variant(value) }
        })*
    };
}
value_from!(U8 u8, U16 u16, U32 u32, I8 i8, I16 i16, I32 i32);

macro_rules! payload_from {
    ($($type:ty),*) => {
        $(impl From<$type> for Payload {
            fn from(value: $type) -> Self { Self::from(&value.to_le_bytes()[..]) }
        })*
    };
}
payload_from!(u8, u16, u32, u64, i8, i16, i32, i64, f32, f64);

/// The data of an SDO transfer. Up to eight bytes lie inside; only longer data is allocated.
#[derive(Clone)]
pub struct Payload(Repr);

#[derive(Clone)]
enum Repr {
    Short { len: u8, bytes: [u8; 8] },
    Long(Vec<u8>),
}

impl Payload {
    /// No data.
    pub const EMPTY: Self = Self(Repr::Short { len: 0, bytes: [0; 8] });

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        match &self.0 {
            Repr::Short { len, bytes } => &bytes[..usize::from(*len)],
            Repr::Long(bytes) => bytes,
        }
    }

    /// The bit pattern of one to four little-endian bytes, without sign extension; `None` for other lengths.
    #[must_use]
    pub fn bits(&self) -> Option<u32> {
        let bytes = self.as_slice();
        let mut word = [0; 4];
        word.get_mut(..bytes.len())?.copy_from_slice(bytes);
        (!bytes.is_empty()).then_some(u32::from_le_bytes(word))
    }

    /// Appends `data`.
    pub(crate) fn extend(&mut self, data: &[u8]) {
        match &mut self.0 {
            Repr::Short { len, bytes } => {
                let old = usize::from(*len);
                let new = old + data.len();
                if new <= 8 {
                    bytes[old..new].copy_from_slice(data);
                    *len = new as u8;
                } else {
                    let mut long = Vec::with_capacity(new.max(32));
                    long.extend_from_slice(&bytes[..old]);
                    long.extend_from_slice(data);
                    self.0 = Repr::Long(long);
                }
            }
            Repr::Long(bytes) => bytes.extend_from_slice(data),
        }
    }
}

impl Deref for Payload {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        self.as_slice()
    }
}

impl From<&[u8]> for Payload {
    fn from(data: &[u8]) -> Self {
        let mut payload = Self::EMPTY;
        payload.extend(data);
        payload
    }
}

impl From<Value> for Payload {
    fn from(value: Value) -> Self {
        Self::from(&value.bytes()[..value.width()])
    }
}

impl PartialEq for Payload {
    fn eq(&self, other: &Self) -> bool {
        self.as_slice() == other.as_slice()
    }
}

impl Eq for Payload {}

impl fmt::Debug for Payload {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02X?}", self.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_payload_keeps_its_bytes_across_the_border_of_eight() {
        let mut payload = Payload::EMPTY;
        assert_eq!(payload.bits(), None);
        for (count, byte) in (0..12u8).enumerate() {
            payload.extend(&[byte]);
            assert_eq!(payload.len(), count + 1);
        }
        assert_eq!(&*payload, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
        assert_eq!(payload.bits(), None);
    }

    #[test]
    fn a_value_is_as_wide_as_its_type() {
        assert_eq!(&*Payload::from(Value::I16(-2)), &[0xFE, 0xFF]);
        assert_eq!(&*Payload::from(-2_i64), &[0xFE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]);
        assert_eq!(&*Payload::from(1.0_f32), &[0, 0, 0x80, 0x3F]);
        assert_eq!(Value::I8(-1).bits(), 0xFF);
        assert_eq!(Payload::from(Value::I32(-1500)).bits(), Some(0xFFFF_FA24));
    }
}
