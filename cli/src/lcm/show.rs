//! Text form of messages: on one line, or on several.

use lcm_gen::dynamic::Value;
use messages::Message;
use messages::lowlevel::Hold;
use serde::Serialize;
use serde_json::ser::{Formatter, Serializer};
use std::fmt::Write as _;
use std::io::{self, Write};

/// The sentences of a message on `LL_DATA_HOLD`, in its order; `None` of any other message.
pub fn hold_words(channel: &str, data: &[u8]) -> Option<Vec<String>> {
    match Message::receive(channel, data) {
        Some(Ok(Message::LlDataHold(list))) => Some(list.holds.iter().map(Hold::words).collect()),
        _ => None,
    }
}

/// `key=value key=value`, members in the order of the type; arrays in brackets, nested structs in braces.
pub fn compact(message: &impl Serialize) -> String {
    let mut out = Vec::new();
    let style = Compact { depth: 0, key: false };
    // Writing to a Vec cannot fail, and every message can be written as JSON.
    let _ = message.serialize(&mut Serializer::with_formatter(&mut out, style));
    String::from_utf8(out).unwrap_or_default()
}

/// JSON with other punctuation.
struct Compact {
    depth: u32,
    key: bool,
}

impl Formatter for Compact {
    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth += 1;
        if self.depth > 1 { writer.write_all(b"{") } else { Ok(()) }
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth -= 1;
        if self.depth > 0 { writer.write_all(b"}") } else { Ok(()) }
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.key = true;
        if first { Ok(()) } else { writer.write_all(b" ") }
    }

    fn end_object_key<W: ?Sized + Write>(&mut self, _writer: &mut W) -> io::Result<()> {
        self.key = false;
        Ok(())
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b"=")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        if first { Ok(()) } else { writer.write_all(b" ") }
    }

    fn begin_string<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        if self.key { Ok(()) } else { writer.write_all(b"\"") }
    }

    fn end_string<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        if self.key { Ok(()) } else { writer.write_all(b"\"") }
    }

    /// JSON escapes the control characters below 0x20 only; a terminal obeys those from 0x7f to 0x9f too.
    fn write_string_fragment<W: ?Sized + Write>(&mut self, writer: &mut W, fragment: &str) -> io::Result<()> {
        for piece in fragment.split_inclusive(char::is_control) {
            let text = piece.trim_end_matches(char::is_control);
            writer.write_all(text.as_bytes())?;
            piece[text.len()..].chars().try_for_each(|c| write!(writer, "\\u{:04x}", u32::from(c)))?;
        }
        Ok(())
    }
}

/// A member a line, indented; arrays of numbers and texts on the line of their member.
pub fn pretty(value: &Value<'_>) -> String {
    let mut out = String::new();
    match value {
        Value::Struct(members) => members_of(members, "  ", "  ", &mut out),
        other => {
            let _ = writeln!(out, "  {}", inline(other));
        }
    }
    out.truncate(out.trim_end().len());
    out
}

/// `first` precedes the first member, `indent` the others.
fn members_of(members: &[(std::borrow::Cow<'_, str>, Value<'_>)], first: &str, indent: &str, out: &mut String) {
    if members.is_empty() {
        let _ = writeln!(out, "{first}{{}}");
    }
    let mut before = first;
    for (name, value) in members {
        let deeper = format!("{indent}  ");
        match value {
            Value::Struct(members) if !members.is_empty() => {
                let _ = writeln!(out, "{before}{name}:");
                members_of(members, &deeper, &deeper, out);
            }
            Value::Array(elements) if elements.iter().any(is_large) => {
                let _ = writeln!(out, "{before}{name}:");
                elements_of(elements, &deeper, out);
            }
            value => {
                let _ = writeln!(out, "{before}{name}: {}", inline(value));
            }
        }
        before = indent;
    }
}

fn elements_of(elements: &[Value<'_>], indent: &str, out: &mut String) {
    for element in elements {
        match element {
            Value::Struct(members) => members_of(members, &format!("{indent}- "), &format!("{indent}  "), out),
            Value::Array(rows) if rows.iter().any(is_large) => {
                let _ = writeln!(out, "{indent}-");
                elements_of(rows, &format!("{indent}  "), out);
            }
            other => {
                let _ = writeln!(out, "{indent}- {}", inline(other));
            }
        }
    }
}

/// True if it takes lines of its own.
fn is_large(value: &Value<'_>) -> bool {
    matches!(value, Value::Struct(_) | Value::Array(_))
}

fn inline(value: &Value<'_>) -> String {
    match value {
        Value::Null => "null".into(),
        Value::Bool(value) => value.to_string(),
        Value::Int(value) => value.to_string(),
        // As in JSON, which has no other numbers.
        Value::Single(value) if !value.is_finite() => "null".into(),
        Value::Float(value) if !value.is_finite() => "null".into(),
        Value::Single(value) => format!("{value:?}"),
        Value::Float(value) => format!("{value:?}"),
        // As in JSON, and nothing in it acts on a terminal.
        Value::Text(text) => format!("\"{}\"", text.escape_debug()),
        Value::Array(elements) => format!("[{}]", elements.iter().map(inline).collect::<Vec<_>>().join(", ")),
        Value::Struct(_) => "{}".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_text_acts_on_a_terminal() {
        let text = "a\u{9b}2J\u{1b}[2J\u{7f}\u{80}b\u{e9}";
        assert_eq!(compact(&[text]), "[\"a\\u009b2J\\u001b[2J\\u007f\\u0080b\u{e9}\"]");
    }

    #[test]
    fn a_message_on_many_lines_reads_like_yaml() {
        let range = |id| Value::Struct(vec![("id".into(), Value::Int(id)), ("x".into(), Value::Float(0.5))]);
        let row = |values: &[i64]| Value::Array(values.iter().map(|value| Value::Int(*value)).collect());
        let message = Value::Struct(vec![
            ("timestamp".into(), Value::Int(7)),
            ("module".into(), Value::Text("a \"b\"\u{1b}[2J".into())),
            ("irs".into(), Value::Array(vec![range(1), range(2)])),
            ("pose".into(), range(3)),
            ("raw".into(), row(&[1, 2])),
            ("grid".into(), Value::Array(vec![row(&[1, 2]), row(&[])])),
            ("ok".into(), Value::Bool(true)),
            ("voltage".into(), Value::Single(0.1)),
            ("none".into(), Value::Array(vec![])),
            ("nothing".into(), Value::Struct(vec![])),
            ("nan".into(), Value::Float(f64::NAN)),
            ("far".into(), Value::Array(vec![Value::Single(f32::INFINITY), Value::Single(1.0)])),
        ]);
        let text = r#"  timestamp: 7
  module: "a \"b\"\u{1b}[2J"
  irs:
    - id: 1
      x: 0.5
    - id: 2
      x: 0.5
  pose:
    id: 3
    x: 0.5
  raw: [1, 2]
  grid:
    - [1, 2]
    - []
  ok: true
  voltage: 0.1
  none: []
  nothing: {}
  nan: null
  far: [null, 1.0]"#;
        assert_eq!(pretty(&message), text);
    }
}
