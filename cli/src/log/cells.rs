//! Messages as cells of a table: nested members and elements of arrays get a column each.
//!
//! The same walk measures, when the shape may grow, and writes, when it stays as it is: what a message has fewer of
//! leaves its cells empty.

use serde::ser::{Error as _, Impossible, Serialize, SerializeMap, SerializeSeq, Serializer};
use std::io::Write as _;

/// Error that cannot occur with messages of LCM.
pub type Error = serde::de::value::Error;

/// Which columns there are.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Shape {
    /// Not seen yet: no column.
    #[default]
    Unknown,
    Scalar,
    /// Number of elements, all of one shape.
    Array(usize, Box<Shape>),
    /// Members by name.
    Struct(Vec<(String, Shape)>),
}

/// Writer of cells.
#[derive(Default)]
pub struct Sink {
    /// Cells, each behind a comma.
    pub out: Vec<u8>,
    /// The shape may grow, and nothing is written.
    pub grow: bool,
    /// Maximum number of columns of an array.
    pub elements_max: usize,
    /// Elements beyond that, which were left out.
    pub left_out: u64,
    /// The next value is one of these.
    pub silent: bool,
}

impl Shape {
    /// Number of columns.
    pub fn columns(&self) -> usize {
        match self {
            Self::Unknown => 0,
            Self::Scalar => 1,
            Self::Array(count, element) => count.saturating_mul(element.columns()),
            Self::Struct(members) => members.iter().fold(0, |sum, (_, shape)| sum.saturating_add(shape.columns())),
        }
    }

    /// True if messages of the type may have other shapes.
    pub fn may_grow(&self) -> bool {
        match self {
            Self::Unknown | Self::Array(..) => true,
            Self::Scalar => false,
            Self::Struct(members) => members.iter().any(|(_, shape)| shape.may_grow()),
        }
    }

    /// Appends the columns' names, each behind a comma; `name` is what all begin with.
    pub fn names(&self, name: &str, out: &mut String) {
        match self {
            Self::Unknown => {}
            Self::Scalar => {
                out.push(',');
                out.push_str(name);
            }
            Self::Array(count, element) => (0..*count).for_each(|i| element.names(&format!("{name}[{i}]"), out)),
            Self::Struct(members) => {
                let dot = if name.is_empty() { "" } else { "." };
                members.iter().for_each(|(member, shape)| shape.names(&format!("{name}{dot}{member}"), out));
            }
        }
    }

    /// Takes a message in: its cells, or its shape.
    pub fn take(&mut self, message: &impl Serialize, sink: &mut Sink) -> Result<(), Error> {
        message.serialize(Cells { shape: self, sink })
    }
}

/// Serializer of one value.
struct Cells<'s> {
    shape: &'s mut Shape,
    sink: &'s mut Sink,
}

impl Cells<'_> {
    fn scalar(self, write: impl FnOnce(&mut Vec<u8>)) -> Result<(), Error> {
        if self.sink.silent {
            return Ok(());
        }
        if self.sink.grow {
            if matches!(self.shape, Shape::Unknown) {
                *self.shape = Shape::Scalar;
            }
            return Ok(());
        }
        if matches!(self.shape, Shape::Scalar) {
            self.sink.out.push(b',');
            write(&mut self.sink.out);
        }
        Ok(())
    }

    fn float(self, value: f64, write: impl FnOnce(&mut Vec<u8>)) -> Result<(), Error> {
        self.scalar(|out| match value {
            value if value.is_nan() => out.extend_from_slice(b"nan"),
            f64::INFINITY => out.extend_from_slice(b"inf"),
            f64::NEG_INFINITY => out.extend_from_slice(b"-inf"),
            _ => write(out),
        })
    }
}

/// Writing to a vector cannot fail.
fn number(out: &mut Vec<u8>, value: &impl Serialize) {
    let _ = serde_json::to_writer(out, value);
}

/// A text as CSV has it: in quotes where it must be (RFC 4180).
fn quoted(out: &mut Vec<u8>, text: &str) {
    if !text.contains([',', '"', '\n', '\r']) {
        out.extend_from_slice(text.as_bytes());
        return;
    }
    let _ = write!(out, "\"{}\"", text.replace('"', "\"\""));
}

macro_rules! integers {
    ($($name:ident: $type:ty),*) => {
        $(fn $name(self, value: $type) -> Result<(), Error> {
            self.scalar(|out| number(out, &value))
        })*
    };
}

macro_rules! never {
    ($($name:ident($($arg:ty),*) -> $ok:ty;)*) => {
        $(fn $name(self, $(_: $arg),*) -> Result<$ok, Error> {
            Err(Error::custom("no value of a message"))
        })*
    };
}

impl<'s> Serializer for Cells<'s> {
    type Ok = ();
    type Error = Error;
    type SerializeSeq = Elements<'s>;
    type SerializeMap = Members<'s>;
    type SerializeTuple = Impossible<(), Error>;
    type SerializeTupleStruct = Impossible<(), Error>;
    type SerializeTupleVariant = Impossible<(), Error>;
    type SerializeStruct = Impossible<(), Error>;
    type SerializeStructVariant = Impossible<(), Error>;

    integers! {
        serialize_bool: bool, serialize_i8: i8, serialize_i16: i16, serialize_i32: i32, serialize_i64: i64,
        serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_u64: u64
    }

    fn serialize_f32(self, value: f32) -> Result<(), Error> {
        self.float(value.into(), |out| number(out, &value))
    }

    fn serialize_f64(self, value: f64) -> Result<(), Error> {
        self.float(value, |out| number(out, &value))
    }

    fn serialize_str(self, value: &str) -> Result<(), Error> {
        self.scalar(|out| quoted(out, value))
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Elements<'s>, Error> {
        let Self { shape, sink } = self;
        if sink.grow && matches!(shape, Shape::Unknown) {
            *shape = Shape::Array(0, Box::default());
        }
        Ok(Elements { shape, sink, at: 0 })
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Members<'s>, Error> {
        let Self { shape, sink } = self;
        if sink.grow && matches!(shape, Shape::Unknown) {
            *shape = Shape::Struct(Vec::new());
        }
        Ok(Members { shape, sink, at: 0 })
    }

    never! {
        serialize_char(char) -> ();
        serialize_bytes(&[u8]) -> ();
        serialize_none() -> ();
        serialize_unit() -> ();
        serialize_unit_struct(&'static str) -> ();
        serialize_unit_variant(&'static str, u32, &'static str) -> ();
        serialize_tuple(usize) -> Self::SerializeTuple;
        serialize_tuple_struct(&'static str, usize) -> Self::SerializeTupleStruct;
        serialize_tuple_variant(&'static str, u32, &'static str, usize) -> Self::SerializeTupleVariant;
        serialize_struct(&'static str, usize) -> Self::SerializeStruct;
        serialize_struct_variant(&'static str, u32, &'static str, usize) -> Self::SerializeStructVariant;
    }

    fn serialize_some<T: ?Sized + Serialize>(self, value: &T) -> Result<(), Error> {
        value.serialize(self)
    }

    fn serialize_newtype_struct<T: ?Sized + Serialize>(self, _: &'static str, value: &T) -> Result<(), Error> {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: ?Sized + Serialize>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        value: &T,
    ) -> Result<(), Error> {
        value.serialize(self)
    }
}

/// Elements of an array.
struct Elements<'s> {
    shape: &'s mut Shape,
    sink: &'s mut Sink,
    at: usize,
}

impl SerializeSeq for Elements<'_> {
    type Ok = ();
    type Error = Error;

    fn serialize_element<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), Error> {
        let (at, max) = (self.at, self.sink.elements_max);
        self.at += 1;
        match &mut *self.shape {
            Shape::Array(count, element) if !self.sink.silent => {
                if self.sink.grow && at < max {
                    *count = (*count).max(at + 1);
                }
                if at < *count {
                    return value.serialize(Cells { shape: element, sink: self.sink });
                }
                self.sink.left_out += u64::from(!self.sink.grow);
                self.silently(value)
            }
            _ => self.silently(value),
        }
    }

    fn end(self) -> Result<(), Error> {
        if let Shape::Array(count, element) = &*self.shape
            && !self.sink.grow
            && !self.sink.silent
        {
            let empty = count.saturating_sub(self.at) * element.columns();
            self.sink.out.resize(self.sink.out.len() + empty, b',');
        }
        Ok(())
    }
}

impl Elements<'_> {
    /// A message's parts must be read to come to the next one.
    fn silently<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), Error> {
        let before = std::mem::replace(&mut self.sink.silent, true);
        let done = value.serialize(Cells { shape: &mut Shape::Unknown, sink: self.sink });
        self.sink.silent = before;
        done
    }
}

/// Members of a struct.
struct Members<'s> {
    shape: &'s mut Shape,
    sink: &'s mut Sink,
    at: usize,
}

impl SerializeMap for Members<'_> {
    type Ok = ();
    type Error = Error;

    fn serialize_key<T: ?Sized + Serialize>(&mut self, key: &T) -> Result<(), Error> {
        if let Shape::Struct(members) = &mut *self.shape
            && self.sink.grow
            && !self.sink.silent
            && members.len() == self.at
        {
            let quoted = serde_json::to_string(key).map_err(Error::custom)?;
            members.push((quoted.trim_matches('"').into(), Shape::Unknown));
        }
        Ok(())
    }

    fn serialize_value<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), Error> {
        let at = self.at;
        self.at += 1;
        match &mut *self.shape {
            Shape::Struct(members) if at < members.len() => {
                value.serialize(Cells { shape: &mut members[at].1, sink: self.sink })
            }
            _ => value.serialize(Cells { shape: &mut Shape::Unknown, sink: self.sink }),
        }
    }

    fn end(self) -> Result<(), Error> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// Lines of a table of these messages.
    fn table(messages: &[Value], elements_max: usize) -> (Vec<String>, u64) {
        let (mut shape, mut sink) = (Shape::default(), Sink { grow: true, elements_max, ..Sink::default() });
        messages.iter().for_each(|message| shape.take(message, &mut sink).unwrap());
        let mut names = String::new();
        shape.names("", &mut names);
        let mut lines = vec![names];
        sink.grow = false;
        for message in messages {
            sink.out.clear();
            shape.take(message, &mut sink).unwrap();
            assert_eq!(sink.out.iter().filter(|byte| **byte == b',').count(), shape.columns());
            lines.push(String::from_utf8(sink.out.clone()).unwrap());
        }
        (lines, sink.left_out)
    }

    #[test]
    fn nested_members_and_elements_are_columns_and_what_is_missing_is_empty() {
        let messages = [
            json!({"a": 1, "b": [], "c": {"d": true, "e": [[1, 2], [3]]}}),
            json!({"a": -2.5, "b": [{"x": 0.1, "n": "left"}], "c": {"d": false, "e": []}}),
        ];
        let (lines, left_out) = table(&messages, 10);
        assert_eq!(lines[0], ",a,b[0].n,b[0].x,c.d,c.e[0][0],c.e[0][1],c.e[1][0],c.e[1][1]");
        assert_eq!(lines[1..], [",1,,,true,1,2,3,", ",-2.5,left,0.1,false,,,,"]);
        assert_eq!(left_out, 0);
    }

    #[test]
    fn elements_beyond_the_limit_are_left_out_and_counted() {
        let (lines, left_out) = table(&[json!({"a": [[1, 2, 3], [4], [5, 6]], "z": 9})], 2);
        assert_eq!(lines, [",a[0][0],a[0][1],a[1][0],a[1][1],z", ",1,2,4,,9"]);
        assert_eq!(left_out, 2);
    }

    #[test]
    fn texts_are_quoted_where_csv_needs_it() {
        let mut out = Vec::new();
        for text in ["plain", "a,b", "say \"x\"", "two\nlines"] {
            quoted(&mut out, text);
            out.push(b' ');
        }
        assert_eq!(String::from_utf8(out).unwrap(), "plain \"a,b\" \"say \"\"x\"\"\" \"two\nlines\" ");
    }
}
