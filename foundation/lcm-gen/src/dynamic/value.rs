//! Messages as trees.

use super::Types;
use super::cursor::{Cursor, chunk, integer};
use super::table::{Element, Field, Len, Struct};
use crate::Primitive;
use std::borrow::Cow;

/// Value of a message or of a part of one.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Value<'a> {
    /// No value; for a float, NaN. Never read from a message.
    #[default]
    Null,
    /// `boolean`
    Bool(bool),
    /// Any integer type, `byte`, or an enum.
    Int(i64),
    /// `float`
    Single(f32),
    /// `double`
    Float(f64),
    /// `string`
    Text(Cow<'a, str>),
    /// Array of one dimension; further dimensions are nested arrays.
    Array(Vec<Value<'a>>),
    /// Struct: names and values of its members.
    Struct(Vec<(Cow<'a, str>, Value<'a>)>),
}

impl<'a> Value<'a> {
    /// Member of a struct.
    #[must_use]
    pub fn get(&self, member: &str) -> Option<&Value<'a>> {
        match self {
            Self::Struct(members) => members.iter().find(|(name, _)| name == member).map(|(_, value)| value),
            _ => None,
        }
    }

    /// Kind of the value for error messages: `a number`.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Null => "null",
            Self::Bool(_) => "a boolean",
            Self::Int(_) | Self::Single(_) | Self::Float(_) => "a number",
            Self::Text(_) => "a text",
            Self::Array(_) => "an array",
            Self::Struct(_) => "an object",
        }
    }
}

/// Value of validated bytes.
pub fn read<'a>(types: &'a Types, ty: &'a Struct, bytes: &'a [u8]) -> Value<'a> {
    body(types, ty, &mut Cursor::new(bytes))
}

fn body<'a>(types: &'a Types, ty: &'a Struct, cursor: &mut Cursor<'a>) -> Value<'a> {
    if ty.values.is_some() {
        return Value::Int(integer(Primitive::Int32, cursor.take(4)));
    }
    let base = cursor.open(ty.slots);
    let mut members = Vec::with_capacity(ty.fields.len());
    for field in &ty.fields {
        let value = match (field.slot, field.element) {
            (Some(slot), Element::Primitive(ty)) => Value::Int(cursor.length(base, slot, ty)),
            _ => array(types, field, &field.dims, base, cursor),
        };
        if !field.implicit {
            members.push((Cow::Borrowed(field.name.as_str()), value));
        }
    }
    cursor.close(base);
    Value::Struct(members)
}

fn array<'a>(types: &'a Types, field: &'a Field, dims: &[Len], base: usize, cursor: &mut Cursor<'a>) -> Value<'a> {
    match (dims, field.element) {
        ([len, row @ ..], _) => {
            let count = cursor.len(base, *len);
            Value::Array((0..count).map(|_| array(types, field, row, base, cursor)).collect())
        }
        ([], Element::Struct(place)) => body(types, &types.structs[place], cursor),
        ([], Element::Primitive(Primitive::String)) => Value::Text(Cow::Borrowed(cursor.text())),
        ([], Element::Primitive(ty)) => {
            let bytes = cursor.take(ty.min_size());
            match ty {
                Primitive::Boolean => Value::Bool(integer(ty, bytes) != 0),
                Primitive::Float => Value::Single(f32::from_be_bytes(chunk(bytes))),
                Primitive::Double => Value::Float(f64::from_be_bytes(chunk(bytes))),
                _ => Value::Int(integer(ty, bytes)),
            }
        }
    }
}
