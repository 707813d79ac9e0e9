//! Values as a file writes them.

use crate::Payload;
use crate::dictionary::{DataType, ParseError, integer};

/// A value of an object: fixed, or relative to the node id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    data: Payload,
    plus_node_id: bool,
}

impl Setting {
    /// Fixed.
    pub(super) fn fixed(data: Payload) -> Self {
        Self { data, plus_node_id: false }
    }

    /// True if `$NODEID` is added.
    #[must_use]
    pub fn is_relative(&self) -> bool {
        self.plus_node_id
    }

    /// The bytes for a node with this id.
    #[must_use]
    pub fn data(&self, node: u8) -> Payload {
        if !self.plus_node_id {
            return self.data.clone();
        }
        Payload::from(&self.sum(node).to_le_bytes()[..self.data.len().min(8)])
    }

    /// Value for a node with this id, in the form of [`Dictionary::get`](crate::Dictionary::get); 0 if it is not
    /// numeric.
    #[must_use]
    pub fn number(&self, data_type: DataType, node: u8) -> i64 {
        data_type.wrap(self.sum(node) as i64)
    }

    fn sum(&self, node: u8) -> u64 {
        let bytes = self.data.iter().take(8).rev();
        let value = bytes.fold(0, |sum: u64, byte| sum << 8 | u64::from(*byte));
        value.wrapping_add(if self.plus_node_id { u64::from(node) } else { 0 })
    }
}

/// Value read, and a remark if its notation was not as it should be.
pub(super) type Read<T> = Result<(T, Option<&'static str>), ParseError>;

/// Longest text of a number; longer ones are refused without a look at them.
const LONGEST: usize = 64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Number {
    pub(super) value: i128,
    /// Hexadecimal: the bit pattern.
    bits: bool,
    plus_node_id: bool,
}

/// A number of CiA 306: decimal, `0x…`, or octal behind a 0; `$NODEID` may be added at either side.
pub(super) fn number(text: &str) -> Read<Number> {
    let text = text.trim();
    if text.len() > LONGEST || !text.is_ascii() {
        return Err(ParseError::NotANumber);
    }
    match node_relative(text) {
        Err(_) if text.contains(';') => {
            let (number, _) = node_relative(text.split(';').next().unwrap_or(text).trim_end())?;
            Ok((number, Some("a comment behind the value is left out")))
        }
        read => read,
    }
}

fn node_relative(text: &str) -> Read<Number> {
    const NODE_ID: &str = "$NODEID";
    let Some(at) = text.to_ascii_uppercase().find(NODE_ID) else {
        return plain(text);
    };
    let (before, after) = (text[..at].trim(), text[at + NODE_ID.len()..].trim());
    let rest = match (before, after) {
        ("", "") => "0",
        ("", after) => after.strip_prefix('+').ok_or(ParseError::NotANumber)?,
        (before, "") => before.strip_suffix('+').ok_or(ParseError::NotANumber)?,
        _ => return Err(ParseError::NotANumber),
    };
    let (number, note) = plain(rest.trim())?;
    Ok((Number { plus_node_id: true, ..number }, note))
}

fn plain(text: &str) -> Read<Number> {
    let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
    let bits = matches!(digits.get(..2), Some("0x" | "0X"));
    let number = |value| Number { value, bits, plus_node_id: false };
    if let Some(value) = bits.then(|| digits[2..].strip_prefix('-')).flatten() {
        let value = u64::from_str_radix(value, 16).map_err(|_| ParseError::NotANumber)?;
        return Ok((number(-i128::from(value)), Some("the sign stands before 0x")));
    }
    if !bits && digits.len() > 1 && digits.starts_with('0') && digits.bytes().all(|byte| byte.is_ascii_digit()) {
        let sign = if text.starts_with('-') { -1 } else { 1 };
        match u64::from_str_radix(digits, 8) {
            Ok(value) => return Ok((number(sign * i128::from(value)), None)),
            Err(_) if digits.contains(['8', '9']) => {
                let value = digits.parse::<u64>().map_err(|_| ParseError::OutOfRange)?;
                return Ok((number(sign * i128::from(value)), Some("no octal number; taken as decimal")));
            }
            Err(_) => return Err(ParseError::OutOfRange),
        }
    }
    integer(text).map(|value| (number(value), None)).ok_or(ParseError::NotANumber)
}

/// The value of an object of this type.
pub(super) fn setting(text: &str, data_type: DataType) -> Read<Setting> {
    use DataType::{Bool, Domain, F32, F64, Octets, Text, TimeDifference, TimeOfDay, Unicode};
    let as_text = || data_type.parse(text).map(|data| (Setting::fixed(data), None));
    match data_type {
        Text | Unicode | Octets | Domain => as_text(),
        Bool | F32 | F64 | TimeOfDay | TimeDifference if as_text().is_ok() => as_text(),
        _ => {
            let (Number { value, bits, plus_node_id }, note) = number(text)?;
            if plus_node_id {
                data_type.encode(value + 127, bits)?;
            }
            let data = data_type.encode(value, bits)?;
            Ok((Setting { data, plus_node_id }, note))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use DataType::{I8, I16, I32, U8, U32};

    fn value(text: &str, data_type: DataType, node: u8) -> Option<i64> {
        setting(text, data_type).ok().map(|(setting, _)| setting.number(data_type, node))
    }

    #[test]
    fn numbers_are_decimal_hexadecimal_and_octal() {
        for (text, expected) in [
            ("10", 10),
            ("0x10", 16),
            ("0X1f", 31),
            ("010", 8),
            ("0", 0),
            ("00", 0),
            ("-5", -5),
            ("-0x5", -5),
            ("0x-80000000", -0x8000_0000),
            ("089", 89),
            ("0xFFFFFFFF", -1),
            ("7 ; seven", 7),
        ] {
            assert_eq!(value(text, I32, 1), Some(expected), "{text}");
        }
        let tolerated = |text| number(text).unwrap().1.is_some();
        let noted: [bool; 5] = ["0x-8", "089", "7;", "010", "0x10"].map(tolerated);
        assert_eq!(noted, [true, true, true, false, false]);
    }

    #[test]
    fn the_node_id_is_added_at_either_side() {
        for text in ["$NODEID+0x180", "0x180+$NODEID", "$NodeId + 384", "384 + $nodeid"] {
            let (setting, _) = setting(text, U32).unwrap();
            assert_eq!((&*setting.data(5), setting.is_relative()), (&[0x85, 1, 0, 0][..], true), "{text}");
        }
        assert_eq!(value("$NODEID", U8, 127), Some(127));
        assert_eq!(value("$NODEID+0xC0000380", U32, 3), Some(0xC000_0383));
        for bad in ["$NODEID-1", "1$NODEID", "1+$NODEID+1", "$NODEID+", "-$NODEID", "$NODEID+$NODEID"] {
            assert_eq!(value(bad, U32, 1), None, "{bad}");
        }
        assert_eq!(value("$NODEID+0x81", U8, 1), None, "does not fit for each node");
    }

    #[test]
    fn what_is_no_number_of_the_type_is_refused() {
        for text in ["", "x", "0x", "1.5", "--1", "0x1_0", "99999999999999999999", "0x10000000000000000", "ﬁ"] {
            assert_eq!(value(text, I32, 1), None, "{text}");
        }
        assert_eq!([value("128", I8, 1), value("0x80", I8, 1), value("0xFFFF", I16, 1)], [None, Some(-128), Some(-1)]);
    }
}
