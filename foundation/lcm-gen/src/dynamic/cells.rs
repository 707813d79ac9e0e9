//! Messages as cells of a table: nested members and elements of arrays get a column each.
//!
//! Messages of one type differ in the lengths of their arrays, so the columns are known after the last message:
//! [`Columns::measure`] takes each message in, [`Columns::write`] then writes it. A message with shorter arrays leaves
//! cells empty.

use super::cursor::{Cursor, chunk, integer};
use super::table::{Element, Field, Len, Struct};
use super::{Message, Types};
use crate::Primitive;
use serde_json::ser::{CompactFormatter, Formatter};

/// Columns of a table of messages of one type.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Columns(Shape);

#[derive(Clone, Debug, Default, PartialEq, Eq)]
enum Shape {
    /// Not seen yet: no column.
    #[default]
    Unknown,
    Scalar,
    /// Number of elements, all of one shape.
    Array(usize, Box<Shape>),
    /// Members by name.
    Struct(Vec<(String, Shape)>),
}

impl Columns {
    /// Number of columns.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.columns()
    }

    /// True if messages of the type may have further columns.
    #[must_use]
    pub fn may_grow(&self) -> bool {
        self.0.may_grow()
    }

    /// Appends the names, each behind a comma: `,estimate.x,srfs[3].distance`.
    pub fn names(&self, out: &mut String) {
        self.0.names("", out);
    }

    /// Adds the columns of a message, of each array at most `elements_max`.
    pub fn measure(&mut self, message: &Message<'_>, elements_max: usize) {
        let cursor = Cursor::new(message.body);
        Measure { types: message.ty.types, cursor, elements_max }.body(message.ty.table(), Some(&mut self.0));
    }

    /// Appends the cells of a measured message, each behind a comma: numbers as in JSON, `true`, `nan`, `-inf`, texts
    /// in quotes where CSV needs them (RFC 4180). Returns the number of elements without a column, which are left out.
    pub fn write(&self, message: &Message<'_>, out: &mut Vec<u8>) -> u64 {
        let mut row = Row { types: message.ty.types, cursor: Cursor::new(message.body), out, left_out: 0 };
        row.body(message.ty.table(), Some(&self.0));
        row.left_out
    }
}

impl Shape {
    fn columns(&self) -> usize {
        match self {
            Self::Unknown => 0,
            Self::Scalar => 1,
            Self::Array(count, element) => count.saturating_mul(element.columns()),
            Self::Struct(members) => members.iter().fold(0, |sum, (_, shape)| sum.saturating_add(shape.columns())),
        }
    }

    fn may_grow(&self) -> bool {
        match self {
            Self::Unknown | Self::Array(..) => true,
            Self::Scalar => false,
            Self::Struct(members) => members.iter().any(|(_, shape)| shape.may_grow()),
        }
    }

    fn names(&self, name: &str, out: &mut String) {
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
}

/// Size of a value with these dimensions whose elements have `element` bytes; `None` if it depends on its content.
fn fixed(element: Option<usize>, dims: &[Len]) -> Option<usize> {
    dims.iter().try_fold(element?, |size, len| match len {
        Len::Fixed(count) => Some(size.saturating_mul(*count)),
        Len::Slot(_) => None,
    })
}

/// First pass over a message. Where the shape is `None`, nothing is measured.
struct Measure<'a> {
    types: &'a Types,
    cursor: Cursor<'a>,
    elements_max: usize,
}

impl<'a> Measure<'a> {
    fn body(&mut self, ty: &'a Struct, mut shape: Option<&mut Shape>) {
        if ty.values.is_some() {
            self.cursor.take(4);
            return scalar(shape);
        }
        if let Some(shape @ Shape::Unknown) = &mut shape {
            let shown = ty.fields.iter().filter(|field| !field.implicit);
            **shape = Shape::Struct(shown.map(|field| (field.name.clone(), Shape::Unknown)).collect());
        }
        let members = match shape {
            Some(Shape::Struct(members)) => members.as_mut_slice(),
            _ => &mut [],
        };
        let mut members = members.iter_mut().map(|(_, shape)| shape);
        let base = self.cursor.open(ty.slots);
        for field in &ty.fields {
            let shape = if field.implicit { None } else { members.next() };
            match (field.slot, field.element) {
                (Some(slot), Element::Primitive(ty)) => {
                    self.cursor.length(base, slot, ty);
                    scalar(shape);
                }
                _ => self.array(field, &field.dims, base, shape),
            }
        }
        self.cursor.close(base);
    }

    fn array(&mut self, field: &'a Field, dims: &'a [Len], base: usize, mut shape: Option<&mut Shape>) {
        // The first value of a fixed size has all columns.
        if let Some(size) = fixed(field.fixed, dims)
            && !matches!(shape, Some(Shape::Unknown))
        {
            self.cursor.take(size);
            return;
        }
        match (dims, field.element) {
            ([], Element::Struct(at)) => self.body(&self.types.structs[at], shape),
            ([], Element::Primitive(Primitive::String)) => {
                self.cursor.text();
                scalar(shape);
            }
            ([], Element::Primitive(ty)) => {
                self.cursor.take(ty.min_size());
                scalar(shape);
            }
            ([len, row @ ..], _) => {
                let count = self.cursor.len(base, *len);
                if let Some(shape @ Shape::Unknown) = &mut shape {
                    **shape = Shape::Array(0, Box::default());
                }
                let (mut columns, mut element) = match shape {
                    Some(Shape::Array(columns, element)) => (Some(columns), Some(&mut **element)),
                    _ => (None, None),
                };
                let shown = if element.is_some() { count.min(self.elements_max) } else { 0 };
                if let Some(columns) = &mut columns {
                    **columns = shown.max(**columns);
                }
                for at in 0..count {
                    let shape = if at < shown { element.as_deref_mut() } else { None };
                    if let Some(size) = fixed(field.fixed, row)
                        && !matches!(shape, Some(Shape::Unknown))
                    {
                        self.cursor.take(size.saturating_mul(count - at));
                        break;
                    }
                    self.array(field, row, base, shape);
                }
            }
        }
    }
}

/// A value is a column.
fn scalar(shape: Option<&mut Shape>) {
    if let Some(shape @ Shape::Unknown) = shape {
        *shape = Shape::Scalar;
    }
}

/// Second pass over a message. Where the shape is `None`, nothing is written.
struct Row<'a, 'o> {
    types: &'a Types,
    cursor: Cursor<'a>,
    out: &'o mut Vec<u8>,
    left_out: u64,
}

impl<'a> Row<'a, '_> {
    fn body(&mut self, ty: &'a Struct, shape: Option<&Shape>) {
        if ty.values.is_some() {
            let bytes = self.cursor.take(4);
            return self.scalar(Primitive::Int32, bytes, shape);
        }
        let members = match shape {
            Some(Shape::Struct(members)) => members.as_slice(),
            _ => &[],
        };
        let mut members = members.iter().map(|(_, shape)| shape);
        let base = self.cursor.open(ty.slots);
        for field in &ty.fields {
            let shape = if field.implicit { None } else { members.next() };
            match (field.slot, field.element) {
                (Some(slot), Element::Primitive(ty)) => {
                    let length = self.cursor.length(base, slot, ty);
                    if let Some(Shape::Scalar) = shape {
                        self.out.push(b',');
                        int(self.out, length);
                    }
                }
                _ => self.array(field, &field.dims, base, shape),
            }
        }
        self.cursor.close(base);
    }

    fn array(&mut self, field: &'a Field, dims: &'a [Len], base: usize, shape: Option<&Shape>) {
        match (dims, field.element) {
            ([], Element::Primitive(Primitive::String)) => {
                let text = self.cursor.text();
                if let Some(Shape::Scalar) = shape {
                    self.out.push(b',');
                    quoted(self.out, text);
                }
            }
            ([], Element::Primitive(ty)) => {
                let bytes = self.cursor.take(ty.min_size());
                self.scalar(ty, bytes, shape);
            }
            ([], Element::Struct(at)) => self.body(&self.types.structs[at], shape),
            ([len, row @ ..], element) => {
                let count = self.cursor.len(base, *len);
                let (columns, shape) = match shape {
                    Some(Shape::Array(columns, element)) => (*columns, Some(&**element)),
                    _ => (0, None),
                };
                let shown = count.min(columns);
                match element {
                    Element::Primitive(ty) if ty != Primitive::String && row.is_empty() => {
                        let size = ty.min_size();
                        let bytes = self.cursor.take(count.saturating_mul(size));
                        bytes.chunks_exact(size).take(shown).for_each(|bytes| self.scalar(ty, bytes, shape));
                    }
                    _ => {
                        (0..shown).for_each(|_| self.array(field, row, base, shape));
                        match fixed(field.fixed, row) {
                            Some(size) => {
                                self.cursor.take(size.saturating_mul(count - shown));
                            }
                            None => (shown..count).for_each(|_| self.array(field, row, base, None)),
                        }
                    }
                }
                if let Some(shape) = shape {
                    self.left_out += (count - shown) as u64;
                    if columns > shown {
                        let empty = (columns - shown).saturating_mul(shape.columns());
                        self.out.resize(self.out.len() + empty, b',');
                    }
                }
            }
        }
    }

    fn scalar(&mut self, ty: Primitive, bytes: &[u8], shape: Option<&Shape>) {
        let Some(Shape::Scalar) = shape else { return };
        let out = &mut *self.out;
        out.push(b',');
        match ty {
            Primitive::Double => {
                let value = f64::from_be_bytes(chunk(bytes));
                if value.is_finite() {
                    let _ = CompactFormatter.write_f64(out, value);
                } else {
                    out.extend_from_slice(infinite(value));
                }
            }
            Primitive::Float => {
                let value = f32::from_be_bytes(chunk(bytes));
                if value.is_finite() {
                    let _ = CompactFormatter.write_f32(out, value);
                } else {
                    out.extend_from_slice(infinite(value.into()));
                }
            }
            Primitive::Boolean => out.extend_from_slice(if integer(ty, bytes) == 0 { b"false" } else { b"true" }),
            _ => int(out, integer(ty, bytes)),
        }
    }
}

/// Writing to a vector cannot fail.
fn int(out: &mut Vec<u8>, value: i64) {
    match u8::try_from(value) {
        Ok(digit @ 0..=9) => out.push(b'0' + digit),
        _ => {
            let _ = CompactFormatter.write_i64(out, value);
        }
    }
}

/// Text of a number that is not finite.
fn infinite(value: f64) -> &'static [u8] {
    match value {
        f64::INFINITY => b"inf",
        f64::NEG_INFINITY => b"-inf",
        _ => b"nan",
    }
}

/// A text as CSV has it: in quotes where it must be (RFC 4180).
fn quoted(out: &mut Vec<u8>, text: &str) {
    let special = |byte: &u8| matches!(byte, b',' | b'"' | b'\n' | b'\r');
    if !text.as_bytes().iter().any(special) {
        out.extend_from_slice(text.as_bytes());
        return;
    }
    out.push(b'"');
    for byte in text.bytes() {
        out.push(byte);
        if byte == b'"' {
            out.push(byte);
        }
    }
    out.push(b'"');
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Schema;
    use crate::dynamic::{Missing, Value};
    use serde_json::{Value as Json, json};

    const FILE: &str = "package demo;
        struct part_t { string n; double x; }
        struct rest_t { boolean d; int32_t rows; int8_t width; byte e[rows][width]; }
        struct all_t { int64_t a; float f; int32_t count; part_t b[count]; rest_t c; double z[2]; }
        struct rows_t { int32_t n; int32_t m; int16_t a[n][m]; string t[n]; int32_t z; }";

    /// Lines of a table of these messages, and the number of elements that were left out.
    fn table(ty: &str, messages: &[Json], elements_max: usize) -> (Vec<String>, u64) {
        let types = Types::new(&Schema::new(&[("demo.lcm", FILE)]).unwrap());
        let encoded = messages.iter().map(|message| {
            let value: Value<'_> = serde_json::from_value(message.clone()).unwrap();
            let mut bytes = Vec::new();
            types.get(ty).unwrap().encode(&value, Missing::Refuse, &mut bytes).unwrap();
            bytes
        });
        let encoded: Vec<Vec<u8>> = encoded.collect();
        let mut columns = Columns::default();
        encoded.iter().for_each(|bytes| columns.measure(&types.decode(bytes).unwrap().unwrap(), elements_max));
        let mut names = String::new();
        columns.names(&mut names);
        let (mut lines, mut left_out) = (vec![names], 0);
        for bytes in &encoded {
            let mut out = Vec::new();
            left_out += columns.write(&types.decode(bytes).unwrap().unwrap(), &mut out);
            assert_eq!(out.iter().filter(|byte| **byte == b',').count(), columns.count());
            lines.push(String::from_utf8(out).unwrap());
        }
        (lines, left_out)
    }

    #[test]
    fn nested_members_and_elements_are_columns_and_what_is_missing_is_empty() {
        let messages = [
            json!({"a": 1, "f": 0.1, "b": [], "c": {"d": true, "width": 2, "e": [[1, 2], [3, 200]]}, "z": [1, -2.5]}),
            json!({"a": -25, "f": "nan", "b": [{"n": "left", "x": 0.1}, {"n": "", "x": "-inf"}],
                "c": {"d": false, "width": 0, "e": []}, "z": ["inf", 1e300]}),
        ];
        let (lines, left_out) = table("demo.all_t", &messages, 10);
        assert_eq!(
            lines[0],
            ",a,f,b[0].n,b[0].x,b[1].n,b[1].x,c.d,c.width,c.e[0][0],c.e[0][1],c.e[1][0],c.e[1][1],z[0],z[1]"
        );
        assert_eq!(lines[1], ",1,0.1,,,,,true,2,1,2,3,200,1.0,-2.5");
        assert_eq!(lines[2], ",-25,nan,left,0.1,,-inf,false,0,,,,,inf,1e+300");
        assert_eq!(left_out, 0);
    }

    #[test]
    fn elements_beyond_the_limit_are_left_out_and_counted() {
        let message = json!({"m": 3, "a": [[1, 2, 3], [4, 5, 6], [7, 8, 9]], "t": ["x", "y", "z"], "z": 9});
        let (lines, left_out) = table("demo.rows_t", &[message], 2);
        assert_eq!(lines, [",m,a[0][0],a[0][1],a[1][0],a[1][1],t[0],t[1],z", ",3,1,2,4,5,x,y,9"]);
        assert_eq!(left_out, 4);
        let message = json!({"m": 2, "a": [[1, 2]], "t": ["x"], "z": 9});
        assert_eq!(table("demo.rows_t", &[message], 0), (vec![",m,z".into(), ",2,9".into()], 2));
    }

    #[test]
    fn a_type_without_arrays_has_all_its_columns_after_the_first_message() {
        let types = Types::new(&Schema::new(&[("demo.lcm", FILE)]).unwrap());
        let mut columns = Columns::default();
        assert!(columns.may_grow());
        let mut measure = |name: &str| {
            let mut bytes = Vec::new();
            let empty = Value::Struct(Vec::new());
            types.get(name).unwrap().encode(&empty, Missing::Zero, &mut bytes).unwrap();
            columns = Columns::default();
            columns.measure(&types.decode(&bytes).unwrap().unwrap(), 10);
            (columns.count(), columns.may_grow())
        };
        assert_eq!(measure("demo.part_t"), (2, false));
        assert_eq!(measure("demo.rest_t"), (2, true));
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
