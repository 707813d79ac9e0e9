//! Values in frames: numbers in bytes, bits, and numbers as ASCII digits.

use crate::Bytes;
use base::listed;
use core::fmt::Write;
use heapless::{String, Vec};

/// Characters of a number as text at most.
pub const DIGITS_MAX: usize = 16;
/// Bytes of [`Place::after`] at most.
pub const AFTER_MAX: usize = 16;

listed! {
    /// What a value is in a frame.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Kind {
        /// A byte.
        U8 => "u8",
        /// A byte, two's complement.
        I8 => "i8",
        /// 16 bits without sign.
        U16 => "u16",
        /// 16 bits, two's complement.
        I16 => "i16",
        /// 32 bits without sign.
        U32 => "u32",
        /// 32 bits, two's complement.
        I32 => "i32",
        /// 32 bits, IEEE 754.
        F32 => "f32",
        /// One bit of a byte.
        Bit => "bit",
        /// Decimal digits, with a sign and a point or without.
        Decimal => "decimal",
        /// Hexadecimal digits, without sign.
        Hex => "hex",
    }
}

impl Kind {
    /// True if it is text.
    #[must_use]
    pub const fn is_text(self) -> bool {
        matches!(self, Self::Decimal | Self::Hex)
    }

    /// Bytes of one that is no text; of text 0.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::Decimal | Self::Hex => 0,
            Self::U8 | Self::I8 | Self::Bit => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
        }
    }

    fn range(self) -> (f64, f64) {
        match self {
            Self::Bit => (0.0, 1.0),
            Self::U8 => (0.0, u8::MAX.into()),
            Self::I8 => (i8::MIN.into(), i8::MAX.into()),
            Self::U16 => (0.0, u16::MAX.into()),
            Self::I16 => (i16::MIN.into(), i16::MAX.into()),
            Self::U32 | Self::Hex => (0.0, u32::MAX.into()),
            Self::I32 => (i32::MIN.into(), i32::MAX.into()),
            Self::F32 => (f32::MIN.into(), f32::MAX.into()),
            Self::Decimal => (-1e15, 1e15),
        }
    }
}

/// Where a value is, and what it means: value = number × scale + offset.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// Its first byte, from 0; with `after` counted from behind that.
    pub at: usize,
    /// The value is behind the first occurrence of these bytes. Empty: it is where `at` says.
    pub after: Vec<u8, AFTER_MAX>,
    /// Its type.
    pub kind: Kind,
    /// Of several bytes the low one is first.
    pub low_first: bool,
    /// The bit of [`Kind::Bit`], 0 the lowest.
    pub bit: u8,
    /// Characters of a text. Absent: as many as belong to a number.
    pub length: Option<usize>,
    /// Digits behind the point of a decimal text that is written.
    pub decimals: usize,
    /// A decimal text that is written has a sign in any case.
    pub signed: bool,
    /// Unit of the value for each unit of the number; not 0.
    pub scale: f64,
    /// The value where the number is 0.
    pub offset: f64,
    /// The number by which the device reports that it has no value.
    pub unknown: Option<f64>,
}

impl Place {
    /// Bytes that it occupies; `None`: that depends on the value, or on the frame.
    #[must_use]
    pub fn span(&self) -> Option<core::ops::Range<usize>> {
        let size = if self.kind.is_text() { self.length? } else { self.kind.size() };
        self.after.is_empty().then_some(self.at..self.at + size)
    }

    /// The value in the data of an answer; `None`: there is no number, or the device reports that it has none.
    #[must_use]
    pub fn value(&self, data: &[u8]) -> Option<f64> {
        let behind = match self.after.len() {
            0 => 0,
            len => data.windows(len).position(|window| window == self.after.as_slice())? + len,
        };
        let field = data.get(behind.checked_add(self.at)?..)?;
        let number = if self.kind.is_text() { self.of_text(field)? } else { self.of_bytes(field)? };
        if self.unknown == Some(number) {
            return None;
        }
        let value = number * self.scale + self.offset;
        value.is_finite().then_some(value)
    }

    fn of_bytes(&self, field: &[u8]) -> Option<f64> {
        let mut word = [0; 4];
        let bytes = field.get(..self.kind.size())?;
        // As a number of 32 bits, the high byte first.
        for (n, byte) in bytes.iter().enumerate() {
            word[if self.low_first { 3 - n } else { 4 - bytes.len() + n }] = *byte;
        }
        let bits = u32::from_be_bytes(word);
        Some(match self.kind {
            Kind::I8 => (bits as i8).into(),
            Kind::I16 => (bits as i16).into(),
            Kind::I32 => (bits as i32).into(),
            Kind::F32 => f32::from_bits(bits).into(),
            Kind::Bit => (bits >> (self.bit % 8) & 1).into(),
            _ => bits.into(),
        })
    }

    fn of_text(&self, field: &[u8]) -> Option<f64> {
        let text = match self.length {
            Some(length) => field.get(..length)?.trim_ascii(),
            None => {
                let text = field.trim_ascii_start();
                &text[..self.number_len(text)]
            }
        };
        if text.len() > DIGITS_MAX || self.number_len(text) != text.len() {
            return None;
        }
        let text = core::str::from_utf8(text).ok()?;
        match self.kind {
            Kind::Hex => u32::from_str_radix(text, 16).ok().map(f64::from),
            _ => text.parse().ok().filter(|_| text.bytes().any(|byte| byte.is_ascii_digit())),
        }
    }

    /// Characters at the beginning of a text that may belong to a number: never those of an exponent.
    fn number_len(&self, text: &[u8]) -> usize {
        let digits = |text: &[u8]| text.iter().take_while(|byte| byte.is_ascii_digit()).count();
        if self.kind == Kind::Hex {
            return text.iter().take_while(|byte| byte.is_ascii_hexdigit()).count();
        }
        let sign = usize::from(matches!(text, [b'+' | b'-', ..]));
        let whole = sign + digits(&text[sign..]);
        match text.get(whole) {
            Some(b'.') => whole + 1 + digits(&text[whole + 1..]),
            _ => whole,
        }
    }

    /// The number of a value, as near as the type has one; `None`: it has none.
    fn number(&self, value: f64) -> Option<f64> {
        let exact = (value - self.offset) / self.scale;
        let number = match self.kind {
            Kind::F32 => exact,
            Kind::Bit => Some(exact).filter(|exact| *exact == 0.0 || *exact == 1.0)?,
            Kind::Decimal => exact,
            _ => libm::round(exact),
        };
        let (least, greatest) = self.kind.range();
        // Without the sign of zero.
        (least..=greatest).contains(&number).then_some(number + 0.0)
    }

    /// A value as text of [`Self::length`]; `None`: there is no room.
    #[must_use]
    pub fn text(&self, value: f64) -> Option<String<DIGITS_MAX>> {
        let (number, width) = (self.number(value)?, self.length.unwrap_or_default());
        let mut text = String::new();
        let decimals = self.decimals;
        let written = match (self.kind, self.signed) {
            (Kind::Hex, _) => write!(text, "{:0width$X}", number as u32),
            (_, true) => write!(text, "{number:+0width$.decimals$}"),
            (_, false) => write!(text, "{number:0width$.decimals$}"),
        };
        written.ok().filter(|()| self.length.is_none_or(|length| text.len() == length))?;
        // What rounds to zero has no minus.
        let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
        match text.strip_prefix('-').filter(|_| is_zero) {
            Some(_) => Self { scale: 1.0, offset: 0.0, ..self.clone() }.text(0.0),
            None => Some(text),
        }
    }

    /// True if a value can be written.
    #[must_use]
    pub fn has(&self, value: f64) -> bool {
        if self.kind.is_text() { self.text(value).is_some() } else { self.number(value).is_some() }
    }

    /// Writes a value to the data of a request: in place, a text without a length is inserted. False: the value has no
    /// number, or the place is beyond the data.
    #[must_use]
    pub fn write(&self, value: f64, data: &mut Bytes) -> bool {
        self.try_write(value, data).is_some()
    }

    fn try_write(&self, value: f64, data: &mut Bytes) -> Option<()> {
        if self.kind.is_text() {
            let text = self.text(value)?;
            if self.length.is_none() {
                let behind = Bytes::from_slice(data.get(self.at..)?).ok()?;
                data.truncate(self.at);
                data.extend_from_slice(text.as_bytes()).ok()?;
                return data.extend_from_slice(&behind).ok();
            }
            data.get_mut(self.at..self.at + text.len())?.copy_from_slice(text.as_bytes());
            return Some(());
        }
        let number = self.number(value)?;
        let place = data.get_mut(self.at..self.at + self.kind.size())?;
        match self.bytes(number).as_slice() {
            [bit] if self.kind == Kind::Bit => {
                let mask = 1 << (self.bit % 8);
                place[0] = place[0] & !mask | bit << (self.bit % 8);
            }
            bytes => place.copy_from_slice(bytes),
        }
        Some(())
    }

    fn bytes(&self, number: f64) -> Vec<u8, 4> {
        let bits = match self.kind {
            Kind::F32 => (number as f32).to_bits(),
            _ => number as i64 as u32,
        };
        let mut bytes: Vec<u8, 4> = bits.to_be_bytes().into_iter().skip(4 - self.kind.size().min(4)).collect();
        if self.low_first {
            bytes.reverse();
        }
        bytes
    }
}
