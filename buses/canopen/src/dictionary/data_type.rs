//! The data types of CiA 301, Table 44: their codes and widths, and their values as text.

use super::time;
use crate::Payload;
use alloc::borrow::Cow;
use alloc::string::String;
use alloc::vec::Vec;
use base::listed;
use core::fmt::Write;
use core::str::FromStr;

listed! {
    /// Data type of an object (CiA 301, Table 44); the name is that of the standard: `UNSIGNED16`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[allow(missing_docs)] // the names are the description
    #[repr(u16)]
    pub enum DataType {
        Bool = 0x01 => "BOOLEAN",
        I8 = 0x02 => "INTEGER8",
        I16 = 0x03 => "INTEGER16",
        I32 = 0x04 => "INTEGER32",
        U8 = 0x05 => "UNSIGNED8",
        U16 = 0x06 => "UNSIGNED16",
        U32 = 0x07 => "UNSIGNED32",
        F32 = 0x08 => "REAL32",
        /// Visible string.
        Text = 0x09 => "VISIBLE_STRING",
        Octets = 0x0A => "OCTET_STRING",
        /// UTF-16, little endian.
        Unicode = 0x0B => "UNICODE_STRING",
        TimeOfDay = 0x0C => "TIME_OF_DAY",
        TimeDifference = 0x0D => "TIME_DIFFERENCE",
        /// Anything, up to [`MAX_BYTES`](super::MAX_BYTES).
        Domain = 0x0F => "DOMAIN",
        I24 = 0x10 => "INTEGER24",
        F64 = 0x11 => "REAL64",
        I40 = 0x12 => "INTEGER40",
        I48 = 0x13 => "INTEGER48",
        I56 = 0x14 => "INTEGER56",
        I64 = 0x15 => "INTEGER64",
        U24 = 0x16 => "UNSIGNED24",
        U40 = 0x18 => "UNSIGNED40",
        U48 = 0x19 => "UNSIGNED48",
        U56 = 0x1A => "UNSIGNED56",
        U64 = 0x1B => "UNSIGNED64",
    }
}

listed! {
    /// Why a text is no value of a type.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum ParseError {
        /// Neither decimal nor `0x…`; a leading zero is refused, because it means octal in an EDS.
        NotANumber => "not a number: decimal without leading zeros, or 0x…",
        /// The number does not fit the type.
        OutOfRange => "out of the range of its type",
        /// Not pairs of hexadecimal digits.
        NotBytes => "not bytes: pairs of hexadecimal digits",
        /// Neither `YYYY-MM-DD hh:mm:ss.mmm` (TIME_OF_DAY) nor `Nd hh:mm:ss.mmm` (TIME_DIFFERENCE).
        NotATime => "not a time: 2026-05-31 12:34:56.789, or as a difference 2d 12:34:56.789",
    }
}

impl core::error::Error for ParseError {}

impl DataType {
    /// The type with this code, which is also the index of its dummy object.
    #[must_use]
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|data_type| data_type.code() == code)
    }

    /// The code of the standard.
    #[must_use]
    pub const fn code(self) -> u16 {
        self as u16
    }

    /// Bytes in an SDO transfer; `None` when that varies.
    #[must_use]
    pub const fn width(self) -> Option<usize> {
        Some(match self {
            Self::Bool | Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I24 | Self::U24 => 3,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I40 | Self::U40 => 5,
            Self::I48 | Self::U48 | Self::TimeOfDay | Self::TimeDifference => 6,
            Self::I56 | Self::U56 => 7,
            Self::I64 | Self::U64 | Self::F64 => 8,
            Self::Text | Self::Octets | Self::Unicode | Self::Domain => return None,
        })
    }

    /// Bits in a PDO; `None` when that varies. A BOOLEAN takes one, though SDO spends a byte on it.
    #[must_use]
    pub const fn bits(self) -> Option<u8> {
        match (self, self.width()) {
            (Self::Bool, _) => Some(1),
            (_, Some(width)) => Some(width as u8 * 8),
            (_, None) => None,
        }
    }

    /// True if it is an INTEGER.
    #[must_use]
    pub const fn is_signed(self) -> bool {
        matches!(self, Self::I8 | Self::I16 | Self::I24 | Self::I32 | Self::I40 | Self::I48 | Self::I56 | Self::I64)
    }

    /// The least and the greatest value, in the form of [`Dictionary::get`](super::Dictionary::get).
    #[must_use]
    pub const fn range(self) -> (i64, i64) {
        match (self, self.width()) {
            (Self::Bool, _) => (0, 1),
            (Self::F32, _) => (f32::NEG_INFINITY.to_bits() as i64, f32::INFINITY.to_bits() as i64),
            (Self::F64, _) => (f64::NEG_INFINITY.to_bits() as i64, f64::INFINITY.to_bits() as i64),
            (_, None) => (0, 0),
            (_, Some(width)) if self.is_signed() => (i64::MIN >> (64 - 8 * width), i64::MAX >> (64 - 8 * width)),
            (_, Some(width)) => (0, (u64::MAX >> (64 - 8 * width)) as i64),
        }
    }

    /// `value` as it reads back from an object of this type: cut to its width, then sign-extended.
    pub(crate) const fn wrap(self, value: i64) -> i64 {
        match (self, self.width()) {
            (Self::Bool, _) => (value != 0) as i64,
            (_, None) => 0,
            (_, Some(width)) if self.is_signed() => value << (64 - 8 * width) >> (64 - 8 * width),
            (_, Some(width)) => ((value as u64) << (64 - 8 * width) >> (64 - 8 * width)) as i64,
        }
    }

    /// True if `a <= b`; not when one of them is not a number.
    pub(crate) fn at_most(self, a: i64, b: i64) -> bool {
        match self {
            Self::F32 => f32::from_bits(a as u32) <= f32::from_bits(b as u32),
            Self::F64 => f64::from_bits(a as u64) <= f64::from_bits(b as u64),
            Self::U64 => a as u64 <= b as u64,
            _ => a <= b,
        }
    }

    /// Bytes of an integer, if it fits. Hexadecimal (`bits`) gives the bit pattern, so that 0xFFFF is an INTEGER16 too;
    /// for REAL it always does.
    pub(crate) fn encode(self, value: i128, bits: bool) -> Result<Payload, ParseError> {
        let width = self.width().ok_or(ParseError::NotANumber)?;
        let (low, high) = match self {
            Self::Bool => (0, 1),
            Self::F32 | Self::F64 if !bits => return Err(ParseError::NotANumber),
            _ if self.is_signed() => {
                let half = 1_i128 << (8 * width - 1);
                (-half, if bits { 2 * half - 1 } else { half - 1 })
            }
            _ => (0, (1 << (8 * width)) - 1),
        };
        let fits = (low..=high).contains(&value);
        fits.then(|| Payload::from(&value.to_le_bytes()[..width])).ok_or(ParseError::OutOfRange)
    }

    /// The bytes of a value written as text: numbers in decimal or as `0x…` (their bit pattern), REAL also as `1.5`,
    /// BOOLEAN also as `true`, OCTET_STRING and DOMAIN as hexadecimal digits, the others as they are. What
    /// [`Self::show`] wrote is read again, if nothing had to be escaped.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse(self, text: &str) -> Result<Payload, ParseError> {
        let text = if self == Self::Text || self == Self::Unicode { text } else { text.trim() };
        match self {
            Self::Text => Ok(Payload::from(text.as_bytes())),
            Self::Unicode => Ok(text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<_>>().as_slice().into()),
            Self::Octets | Self::Domain => hex_bytes(text).ok_or(ParseError::NotBytes),
            Self::Bool if text.eq_ignore_ascii_case("true") => Ok(Payload::from(1_u8)),
            Self::Bool if text.eq_ignore_ascii_case("false") => Ok(Payload::from(0_u8)),
            Self::TimeOfDay | Self::TimeDifference if !is_hex(text) => {
                time::parse(text, self == Self::TimeOfDay).ok_or(ParseError::NotATime)
            }
            Self::F32 if !is_hex(text) => real(text, f32::is_finite).map(Payload::from),
            Self::F64 if !is_hex(text) => real(text, f64::is_finite).map(Payload::from),
            _ => {
                let digits = text.trim_start_matches(['-', '+']);
                if digits.len() > 1 && digits.starts_with('0') && !is_hex(text) {
                    return Err(ParseError::NotANumber);
                }
                self.encode(integer(text).ok_or(ParseError::NotANumber)?, is_hex(text))
            }
        }
    }

    /// A value as text, in the form that [`Self::parse`] reads: decimal, hexadecimal bytes, text (control characters
    /// escaped, zeros at its end left out), or a time. Data that is not as wide as the type is shown as bytes.
    #[must_use]
    pub fn show(self, data: &[u8]) -> String {
        let mut out = String::new();
        let mut bits = [0; 8];
        let fits = self.width() == Some(data.len());
        if fits {
            bits[..data.len()].copy_from_slice(data);
        }
        let raw = i64::from_le_bytes(bits);
        // Writing to a String cannot fail.
        let _ = match self {
            Self::Text => show_text(&mut out, &String::from_utf8_lossy(data)),
            Self::Unicode => {
                let units = data.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
                show_text(&mut out, &Cow::Owned(char::decode_utf16(units).map(|c| c.unwrap_or('\u{FFFD}')).collect()))
            }
            _ if !fits => show_bytes(&mut out, data),
            Self::F32 => write!(out, "{:?}", f32::from_bits(raw as u32)),
            Self::F64 => write!(out, "{:?}", f64::from_bits(raw as u64)),
            Self::TimeOfDay | Self::TimeDifference => time::show(&mut out, raw, self == Self::TimeOfDay),
            Self::U64 => write!(out, "{}", raw as u64),
            Self::Bool => write!(out, "{raw}"),
            _ => write!(out, "{}", self.wrap(raw)),
        };
        out
    }
}

fn is_hex(text: &str) -> bool {
    let digits = text.trim_start_matches(['-', '+']);
    digits.starts_with("0x") || digits.starts_with("0X")
}

/// A decimal or hexadecimal number of up to 64 bits, signed.
pub(crate) fn integer(text: &str) -> Option<i128> {
    let negative = text.starts_with('-');
    let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
    let (digits, radix) = match digits.get(..2) {
        Some("0x" | "0X") => (&digits[2..], 16),
        _ => (digits, 10),
    };
    magnitude(digits, radix).map(|value| if negative { -value } else { value })
}

/// Digits only: `from_str_radix` would take a second sign.
pub(super) fn magnitude(digits: &str, radix: u32) -> Option<i128> {
    let good = digits.chars().all(|digit| digit.is_digit(radix));
    good.then(|| u64::from_str_radix(digits, radix).ok()).flatten().map(i128::from)
}

/// Words such as `inf` and `nan` are refused as slips; a bit pattern can express them.
fn real<T: FromStr + Copy>(text: &str, is_finite: fn(T) -> bool) -> Result<T, ParseError> {
    let number = text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E'));
    let value = number.then(|| text.parse().ok()).flatten().ok_or(ParseError::NotANumber)?;
    is_finite(value).then_some(value).ok_or(ParseError::OutOfRange)
}

fn hex_bytes(text: &str) -> Option<Payload> {
    let text = text.strip_prefix("0x").or(text.strip_prefix("0X")).unwrap_or(text);
    let mut nibbles = text.chars().filter(|c| !c.is_ascii_whitespace()).map(|c| c.to_digit(16));
    let mut bytes = Vec::with_capacity(text.len() / 2);
    while let Some(high) = nibbles.next() {
        bytes.push((high? << 4 | nibbles.next()??) as u8);
    }
    Some(bytes.as_slice().into())
}

fn show_bytes(out: &mut String, data: &[u8]) -> core::fmt::Result {
    for (at, byte) in data.iter().enumerate() {
        write!(out, "{}{byte:02X}", if at > 0 { " " } else { "" })?;
    }
    Ok(())
}

fn show_text(out: &mut String, text: &str) -> core::fmt::Result {
    for c in text.trim_end_matches('\0').chars() {
        if c.is_control() { write!(out, "{}", c.escape_default())? } else { out.push(c) }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::DataType::*;
    use super::*;

    #[test]
    fn codes_and_widths_are_those_of_table_44() {
        for data_type in DataType::ALL {
            assert_eq!(DataType::from_code(data_type.code()), Some(data_type));
        }
        assert_eq!(DataType::ALL.len(), 25);
        for reserved in [0x00, 0x0E, 0x17, 0x1C, 0x20, 0x40, 0xFFFF] {
            assert_eq!(DataType::from_code(reserved), None);
        }
        assert_eq!((Bool.width(), Bool.bits()), (Some(1), Some(1)));
        assert_eq!((U24.width(), U24.bits(), TimeOfDay.width(), Text.width()), (Some(3), Some(24), Some(6), None));
    }

    #[test]
    fn each_type_reads_its_text_and_writes_it_again() {
        for (data_type, text, bytes) in [
            (Bool, "1", &[1][..]),
            (I8, "-128", &[0x80]),
            (U8, "255", &[0xFF]),
            (I16, "-2", &[0xFE, 0xFF]),
            (I24, "-2", &[0xFE, 0xFF, 0xFF]),
            (U24, "16777215", &[0xFF, 0xFF, 0xFF]),
            (I40, "-549755813888", &[0, 0, 0, 0, 0x80]),
            (U40, "1099511627775", &[0xFF; 5]),
            (I48, "1", &[1, 0, 0, 0, 0, 0]),
            (I56, "-1", &[0xFF; 7]),
            (I64, "-9223372036854775808", &[0, 0, 0, 0, 0, 0, 0, 0x80]),
            (U64, "18446744073709551615", &[0xFF; 8]),
            (F32, "1.5", &[0, 0, 0xC0, 0x3F]),
            (F64, "-0.25", &[0, 0, 0, 0, 0, 0, 0xD0, 0xBF]),
            (Text, "EPOS 70/10", b"EPOS 70/10"),
            (Octets, "C8 3D BB", &[0xC8, 0x3D, 0xBB]),
            (Domain, "", &[]),
            (Unicode, "c✓", &[0x63, 0, 0x13, 0x27]),
            (TimeOfDay, "2011-06-01 12:00:00.000", &[0x00, 0x2E, 0x93, 0x02, 0x1D, 0x27]),
            (TimeOfDay, "1984-02-29 23:59:59.999", &[0xFF, 0x5B, 0x26, 0x05, 59, 0]),
            (TimeDifference, "2d 00:00:01.500", &[0xDC, 0x05, 0, 0, 2, 0]),
        ] {
            let payload = data_type.parse(text).unwrap();
            assert_eq!(&*payload, bytes, "{text}");
            assert_eq!(data_type.show(bytes), text);
        }
    }

    #[test]
    fn hexadecimal_is_the_bit_pattern() {
        assert_eq!(&*I16.parse("0xFFFE").unwrap(), &[0xFE, 0xFF]);
        assert_eq!(&*I16.parse("-0x2").unwrap(), &[0xFE, 0xFF]);
        assert_eq!(&*F32.parse("0x3FC00000").unwrap(), &[0, 0, 0xC0, 0x3F]);
        assert_eq!(&*TimeDifference.parse("0x0002000005DC").unwrap(), &[0xDC, 0x05, 0, 0, 2, 0]);
        assert_eq!(&*Domain.parse("0xc83dbb").unwrap(), &[0xC8, 0x3D, 0xBB]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        for (data_type, text) in [
            (U8, "256"),
            (U8, "-1"),
            (I8, "128"),
            (I8, "0x100"),
            (I8, "-129"),
            (Bool, "2"),
            (U64, "18446744073709551616"),
            (U32, ""),
            (U32, "1.0"),
            (U32, "0100"),
            (U32, "--1"),
            (U32, "0x-1"),
            (U32, "0x"),
            (F32, "nan"),
            (F64, "1e999"),
            (F32, "1e39"),
            (Octets, "C8 3"),
            (Octets, "XY"),
            (TimeOfDay, "2026-02-29 00:00:00"),
            (TimeOfDay, "2026-02-28 24:00:00"),
            (TimeOfDay, "1983-12-31 00:00:00"),
            (TimeOfDay, "4294967295-01-01 00:00:00"),
            (TimeDifference, "65536d 00:00:00"),
            (TimeDifference, "1d 00:00:00."),
        ] {
            assert!(data_type.parse(text).is_err(), "{} {text}", data_type.name());
        }
    }

    #[test]
    fn data_of_another_width_is_shown_as_bytes_and_texts_cannot_play_tricks() {
        assert_eq!(U16.show(&[1, 2, 3]), "01 02 03");
        assert_eq!(Text.show(b"a\x1b[2Jb\0\0"), "a\\u{1b}[2Jb");
        assert_eq!(Text.show(&[0x41, 0xFF]), "A\u{FFFD}");
        assert_eq!(Unicode.show(&[0x00, 0xD8, 0x41]), "\u{FFFD}");
        assert_eq!(TimeOfDay.show(&[0xFF; 6]), "2163-06-06 74:33:55.455");
    }
}
