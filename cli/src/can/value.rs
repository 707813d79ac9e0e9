//! Text of an object's bytes, by its type, or by its length where the type is unknown; and parsing of such text.

use canopen::axis::{PowerState, status};
use canopen::dictionary::DataType;
use serde_json::{Value, json};

/// A value for people and for programs.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// In words.
    pub text: String,
    /// A number, a text, or an array of bytes.
    pub json: Value,
}

/// Maximum number of bytes shown in a line.
const SHOWN: usize = 24;

/// Bytes in the order of the wire: `4b 41 60`; long data are cut.
pub fn bytes(data: &[u8]) -> String {
    let text: Vec<String> = data.iter().take(SHOWN).map(|byte| format!("{byte:02x}")).collect();
    let more = if data.len() > SHOWN { format!(" … ({} bytes)", data.len()) } else { String::new() };
    text.join(" ") + &more
}

/// An object as it is written: `0x6041`, `0x1018:1`.
pub fn object(index: u16, sub: u8) -> String {
    if sub == 0 { format!("0x{index:04X}") } else { format!("0x{index:04X}:{sub}") }
}

/// Up to eight little-endian bytes, without sign; none for other lengths.
pub fn number(data: &[u8]) -> Option<u64> {
    let mut word = [0; 8];
    word.get_mut(..data.len())?.copy_from_slice(data);
    (!data.is_empty()).then(|| u64::from_le_bytes(word))
}

/// Text of the data of an object.
pub fn show(index: u16, data_type: Option<DataType>, data: &[u8]) -> Shown {
    let Some(data_type) = data_type.filter(|data_type| data_type.width().is_none_or(|width| width == data.len()))
    else {
        return untyped(data);
    };
    let text = data_type.show(data);
    match data_type {
        DataType::Text | DataType::Unicode => Shown { text: format!("{text:?}"), json: json!(text) },
        DataType::TimeOfDay | DataType::TimeDifference => Shown { json: json!(text), text },
        DataType::Octets | DataType::Domain => Shown { text: bytes(data), json: json!(data) },
        DataType::F32 | DataType::F64 => {
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            Shown { json: json!(number), text }
        }
        _ => {
            let bits = number(data).unwrap_or_default();
            let json = if data_type.is_signed() { json!(text.parse::<i64>().ok()) } else { json!(bits) };
            Shown { text: said(index, data_type, bits, text), json }
        }
    }
}

/// A number with its meaning: states by name, bit fields and identifiers in hexadecimal.
fn said(index: u16, data_type: DataType, bits: u64, decimal: String) -> String {
    let width = data_type.width().unwrap_or(4) * 2;
    match index {
        0x6040 => format!("0x{bits:04X} {}", command(bits as u16)),
        0x6041 => {
            let word = bits as u16;
            let state = PowerState::decode(word).map_or("?".into(), |state| state.to_string());
            let more = STATUS_BITS.iter().filter(|(bit, _)| word & bit != 0).map(|(_, name)| format!(", {name}"));
            format!("0x{word:04X} {state}{}", more.collect::<String>())
        }
        0x6060 | 0x6061 => match mode(bits as u8 as i8) {
            "" => decimal,
            name => format!("{decimal} {name}"),
        },
        0x1000..=0x1FFF if data_type == DataType::U32 => format!("0x{bits:0width$X}"),
        0x1001 | 0x603F => format!("0x{bits:0width$X}"),
        _ => decimal,
    }
}

/// Bits of a statusword beside the state that mean the same in every mode, as far as they are news.
const STATUS_BITS: [(u16, &str); 3] =
    [(status::WARNING, "warning"), (status::TARGET_REACHED, "target reached"), (status::LIMIT, "at a limit")];

/// Command in a controlword (CiA 402-2).
fn command(word: u16) -> &'static str {
    match word {
        _ if word & 0x80 != 0 => "fault reset",
        _ if word & 0x02 == 0 => "disable voltage",
        _ if word & 0x04 == 0 => "quick stop",
        _ if word & 0x01 == 0 => "shutdown",
        _ if word & 0x08 == 0 => "switch on",
        _ if word & 0x100 != 0 => "enable, halt",
        _ => "enable",
    }
}

/// A mode of operation (CiA 402-2).
const fn mode(mode: i8) -> &'static str {
    match mode {
        1 => "profile position",
        2 => "velocity",
        3 => "profile velocity",
        4 => "profile torque",
        6 => "homing",
        7 => "interpolated position",
        8 => "cyclic synchronous position",
        9 => "cyclic synchronous velocity",
        10 => "cyclic synchronous torque",
        _ => "",
    }
}

/// Data of no known type: a number of one to eight bytes in every reading, and the text that it may be.
fn untyped(data: &[u8]) -> Shown {
    let text = printable(data).map(|text| format!(" {text:?}")).unwrap_or_default();
    match (number(data), data.len()) {
        (Some(bits), len @ (1 | 2 | 4 | 8)) if len <= 4 || text.is_empty() => {
            let signed = (bits << (64 - 8 * len)).cast_signed() >> (64 - 8 * len);
            let signed = if signed < 0 { format!(", {signed}") } else { String::new() };
            Shown { text: format!("0x{bits:0width$X} ({bits}{signed}){text}", width = 2 * len), json: json!(bits) }
        }
        _ if !text.is_empty() => Shown { text: text.trim_start().into(), json: json!(data) },
        _ => Shown { text: bytes(data), json: json!(data) },
    }
}

/// At least three characters that can be read, maybe with zeros behind them.
fn printable(data: &[u8]) -> Option<&str> {
    let text = std::str::from_utf8(data).ok()?.trim_end_matches('\0');
    (text.len() >= 3 && text.chars().all(|c| c.is_ascii_graphic() || c == ' ')).then_some(text)
}

/// A type by its name: `u16` or `UNSIGNED16`, `text` or `VISIBLE_STRING`.
pub fn data_type(text: &str) -> Result<DataType, String> {
    let short = |data_type: &DataType| format!("{data_type:?}").to_ascii_lowercase();
    let is_meant = |data_type: &&DataType| {
        text.eq_ignore_ascii_case(data_type.name()) || text.eq_ignore_ascii_case(&short(data_type))
    };
    let all = || DataType::ALL.iter().map(short).collect::<Vec<_>>().join(", ");
    DataType::ALL.iter().find(is_meant).copied().ok_or_else(|| format!("expected one of {}", all()))
}

/// Parses a value. Without a type: `0x…`, a number as wide as its digits.
pub fn parse(data_type: Option<DataType>, text: &str) -> Result<Vec<u8>, String> {
    if let Some(data_type) = data_type {
        let parsed = data_type.parse(text).map_err(|error| format!("{text:?} for {}: {error}", data_type.name()))?;
        return Ok(parsed.to_vec());
    }
    let digits = text.strip_prefix("0x").filter(|digits| [2, 4, 8, 16].contains(&digits.len()));
    let number =
        digits.and_then(|digits| u64::from_str_radix(digits, 16).ok().map(|number| (number, digits.len() / 2)));
    let why = || "its type is not known: say --type, --eds, or a number of 2, 4, 8 or 16 digits after 0x".to_string();
    let (number, len) = number.filter(|_| !text.contains('+')).ok_or_else(why)?;
    Ok(number.to_le_bytes()[..len].into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(index: u16, data_type: Option<DataType>, data: &[u8]) -> String {
        show(index, data_type, data).text
    }

    #[test]
    fn a_value_reads_as_a_person_would_say_it() {
        let u16 = Some(DataType::U16);
        assert_eq!(text(0x6041, u16, &[0x37, 0x02]), "0x0237 operation enabled");
        assert_eq!(text(0x6041, u16, &[0xB7, 0x06]), "0x06B7 operation enabled, warning, target reached");
        assert_eq!(text(0x6040, u16, &[0x0F, 0x00]), "0x000F enable");
        assert_eq!(text(0x6040, u16, &[0x0B, 0x00]), "0x000B quick stop");
        assert_eq!(text(0x6060, Some(DataType::I8), &[3]), "3 profile velocity");
        assert_eq!(text(0x60FF, Some(DataType::I32), &[0x24, 0xFA, 0xFF, 0xFF]), "-1500");
        assert_eq!(text(0x1000, Some(DataType::U32), &[0x92, 0x01, 0x02, 0x00]), "0x00020192");
        assert_eq!(text(0x1017, u16, &[100, 0]), "100");
        assert_eq!(text(0x1008, Some(DataType::Text), b"EPOS\x1b"), r#""EPOS\\u{1b}""#);
        assert_eq!(text(0x2000, Some(DataType::F32), &1.5_f32.to_le_bytes()), "1.5");
    }

    #[test]
    fn without_a_type_every_reading_is_shown() {
        assert_eq!(text(0x2000, None, &[0xFE]), "0xFE (254, -2)");
        assert_eq!(text(0x2000, None, &[0x37, 0x02]), "0x0237 (567)");
        assert_eq!(text(0x2000, None, b"EPOS"), r#"0x534F5045 (1397706821) "EPOS""#);
        assert_eq!(text(0x2000, None, b"a device"), r#""a device""#);
        assert_eq!(text(0x2000, None, b"a name"), r#""a name""#);
        assert_eq!(text(0x2000, None, &[1, 2, 3]), "01 02 03");
        assert_eq!(text(0x2000, None, &[]), "");
        // One that is not as wide as its type is none of it.
        assert_eq!(text(0x6041, Some(DataType::U16), &[1]), "0x01 (1)");
    }

    #[test]
    fn what_is_typed_becomes_the_bytes_of_the_wire() {
        assert_eq!(parse(Some(DataType::I16), "-2"), Ok(vec![0xFE, 0xFF]));
        assert!(parse(Some(DataType::U8), "256").unwrap_err().contains("UNSIGNED8"));
        assert_eq!(parse(None, "0x000F"), Ok(vec![0x0F, 0x00]), "a number, not bytes in this order");
        assert!(parse(None, "15").unwrap_err().contains("--type"));
        assert!(parse(None, "0x+1").is_err() && parse(None, "0x123").is_err());
        assert_eq!((data_type("u16"), data_type("unsigned16")), (Ok(DataType::U16), Ok(DataType::U16)));
        assert!(data_type("u17").unwrap_err().contains("u16, u32"));
    }
}
