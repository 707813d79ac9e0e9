//! Encoding of numbers, texts and bytes in a record: unsigned numbers as LEB128 (groups of seven bits, least
//! significant first), signed ones with zigzag encoding, texts and bytes preceded by their length.

use super::Malformed;

pub(super) fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

pub(super) fn signed(out: &mut Vec<u8>, value: i64) {
    varint(out, (value << 1 ^ value >> 63) as u64);
}

pub(super) fn bytes(out: &mut Vec<u8>, value: &[u8]) {
    varint(out, value.len() as u64);
    out.extend_from_slice(value);
}

pub(super) fn text(out: &mut Vec<u8>, value: &str) {
    bytes(out, value.as_bytes());
}

/// Unread rest of a record.
#[derive(Clone, Copy, Debug)]
pub(super) struct Decoder<'a>(pub &'a [u8]);

impl<'a> Decoder<'a> {
    pub fn u8(&mut self) -> Result<u8, Malformed> {
        let (first, rest) = self.0.split_first().ok_or(Malformed("a byte"))?;
        self.0 = rest;
        Ok(*first)
    }

    pub fn varint(&mut self) -> Result<u64, Malformed> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.u8()?;
            let bits = u64::from(byte & 0x7F);
            if bits << shift >> shift != bits {
                break;
            }
            value |= bits << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(Malformed("a number"))
    }

    pub fn signed(&mut self) -> Result<i64, Malformed> {
        let value = self.varint()?;
        Ok((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// Parses a number of a smaller type.
    pub fn small<T: TryFrom<u64>>(&mut self) -> Result<T, Malformed> {
        T::try_from(self.varint()?).map_err(|_| Malformed("a number in its range"))
    }

    pub fn flag(&mut self) -> Result<bool, Malformed> {
        match self.u8()? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(Malformed("yes or no")),
        }
    }

    pub fn f64(&mut self) -> Result<f64, Malformed> {
        let (bits, rest) = self.0.split_first_chunk().ok_or(Malformed("eight bytes"))?;
        self.0 = rest;
        Ok(f64::from_le_bytes(*bits))
    }

    /// Takes `count` bytes.
    pub fn slice(&mut self, count: usize) -> Result<&'a [u8], Malformed> {
        let (slice, rest) = self.0.split_at_checked(count).ok_or(Malformed("as many bytes as announced"))?;
        self.0 = rest;
        Ok(slice)
    }

    pub fn bytes(&mut self) -> Result<&'a [u8], Malformed> {
        let count = self.small()?;
        self.slice(count)
    }

    pub fn text(&mut self) -> Result<&'a str, Malformed> {
        std::str::from_utf8(self.bytes()?).map_err(|_| Malformed("a text"))
    }

    /// Parses the number of following items, limited to what the rest can contain at one byte each.
    pub fn count(&mut self) -> Result<usize, Malformed> {
        let count = self.small()?;
        if count <= self.0.len() { Ok(count) } else { Err(Malformed("as many items as announced")) }
    }
}
