//! Serialization of messages into any serde format, and deserialization of values.

use super::cursor::{Cursor, chunk, integer};
use super::table::{Element, Field, Len, Struct};
use super::{Message, Types, Value};
use crate::Primitive;
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::cell::RefCell;
use std::fmt;

/// A struct is a map of its members in order. The serializer must accept every member, once, as formats do. In a format
/// for people, infinities are the texts `inf` and `-inf`: JSON has no such numbers.
impl Serialize for Message<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let place = Place { types: self.ty.types, cursor: &RefCell::new(Cursor::new(self.body)) };
        Body(place, self.ty.table()).serialize(serializer)
    }
}

/// Read position in a message. Serde serializes through shared references, hence the cell.
#[derive(Clone, Copy)]
struct Place<'c, 'a> {
    types: &'a Types,
    cursor: &'c RefCell<Cursor<'a>>,
}

struct Body<'c, 'a>(Place<'c, 'a>, &'a Struct);

impl Serialize for Body<'_, '_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self(place, ty) = self;
        let cursor = place.cursor;
        if ty.values.is_some() {
            return serializer.serialize_i32(i32::from_be_bytes(chunk(cursor.borrow_mut().take(4))));
        }
        let base = cursor.borrow_mut().open(ty.slots);
        let mut map = serializer.serialize_map(Some(ty.fields.iter().filter(|field| !field.implicit).count()))?;
        for field in &ty.fields {
            match (field.slot, field.element) {
                (Some(slot), Element::Primitive(ty)) => {
                    let length = cursor.borrow_mut().length(base, slot, ty);
                    if !field.implicit {
                        map.serialize_entry(&field.name, &length)?;
                    }
                }
                _ => map.serialize_entry(&field.name, &Array { place: *place, field, dims: &field.dims, base })?,
            }
        }
        cursor.borrow_mut().close(base);
        map.end()
    }
}

/// Member, or a row of it.
struct Array<'c, 'a> {
    place: Place<'c, 'a>,
    field: &'a Field,
    dims: &'a [Len],
    base: usize,
}

impl Serialize for Array<'_, '_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { place, field, dims, base } = *self;
        let cursor = place.cursor;
        match (dims, field.element) {
            ([], Element::Struct(at)) => Body(place, &place.types.structs[at]).serialize(serializer),
            ([], Element::Primitive(Primitive::String)) => {
                let text = cursor.borrow_mut().text();
                serializer.serialize_str(text)
            }
            ([], Element::Primitive(ty)) => {
                let bytes = cursor.borrow_mut().take(ty.min_size());
                scalar(ty, bytes, serializer)
            }
            ([len], Element::Primitive(ty)) if ty != Primitive::String => {
                let count = cursor.borrow().len(base, *len);
                let bytes = cursor.borrow_mut().take(count.saturating_mul(ty.min_size()));
                scalars(ty, bytes, count, serializer)
            }
            ([len, row @ ..], _) => {
                let count = cursor.borrow().len(base, *len);
                let mut seq = serializer.serialize_seq(Some(count))?;
                for _ in 0..count {
                    seq.serialize_element(&Array { place, field, dims: row, base })?;
                }
                seq.end()
            }
        }
    }
}

fn scalar<S: Serializer>(ty: Primitive, bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    match ty {
        Primitive::Boolean => serializer.serialize_bool(integer(ty, bytes) != 0),
        Primitive::Byte => serializer.serialize_u8(u8::from_be_bytes(chunk(bytes))),
        Primitive::Float => Single::read(bytes).serialize(serializer),
        Primitive::Double => Double::read(bytes).serialize(serializer),
        _ => serializer.serialize_i64(integer(ty, bytes)),
    }
}

struct Single(f32);

impl Single {
    fn read(bytes: &[u8]) -> Self {
        Self(f32::from_be_bytes(chunk(bytes)))
    }
}

impl Serialize for Single {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.is_infinite() && serializer.is_human_readable() {
            true => serializer.collect_str(&self.0),
            false => serializer.serialize_f32(self.0),
        }
    }
}

struct Double(f64);

impl Double {
    fn read(bytes: &[u8]) -> Self {
        Self(f64::from_be_bytes(chunk(bytes)))
    }
}

impl Serialize for Double {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.is_infinite() && serializer.is_human_readable() {
            true => serializer.collect_str(&self.0),
            false => serializer.serialize_f64(self.0),
        }
    }
}

/// The type is matched once, not for each element.
fn scalars<S: Serializer>(ty: Primitive, bytes: &[u8], count: usize, serializer: S) -> Result<S::Ok, S::Error> {
    let mut seq = serializer.serialize_seq(Some(count))?;
    let mut elements = bytes.chunks_exact(ty.min_size());
    match ty {
        Primitive::Boolean => elements.try_for_each(|bytes| seq.serialize_element(&(bytes != [0])))?,
        Primitive::Byte => bytes.iter().try_for_each(|byte| seq.serialize_element(byte))?,
        Primitive::Float => elements.try_for_each(|bytes| seq.serialize_element(&Single::read(bytes)))?,
        Primitive::Double => elements.try_for_each(|bytes| seq.serialize_element(&Double::read(bytes)))?,
        _ => elements.try_for_each(|bytes| seq.serialize_element(&integer(ty, bytes)))?,
    }
    seq.end()
}

/// Any JSON value. A duplicate member is detected when the value is encoded.
impl<'de> Deserialize<'de> for Value<'static> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;

        impl<'de> Visitor<'de> for Any {
            type Value = Value<'static>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a value")
            }

            fn visit_unit<E>(self) -> Result<Self::Value, E> {
                Ok(Value::Null)
            }

            fn visit_bool<E>(self, value: bool) -> Result<Self::Value, E> {
                Ok(Value::Bool(value))
            }

            fn visit_i64<E>(self, value: i64) -> Result<Self::Value, E> {
                Ok(Value::Int(value))
            }

            fn visit_u64<E>(self, value: u64) -> Result<Self::Value, E> {
                Ok(i64::try_from(value).map_or(Value::Float(value as f64), Value::Int))
            }

            fn visit_f64<E>(self, value: f64) -> Result<Self::Value, E> {
                Ok(Value::Float(value))
            }

            fn visit_str<E>(self, value: &str) -> Result<Self::Value, E> {
                Ok(Value::Text(Cow::Owned(value.to_owned())))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
                let mut elements = Vec::new();
                while let Some(element) = seq.next_element()? {
                    elements.push(element);
                }
                Ok(Value::Array(elements))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut members: Vec<(Cow<'static, str>, Value<'static>)> = Vec::new();
                while let Some((name, value)) = map.next_entry::<String, _>()? {
                    members.push((Cow::Owned(name), value));
                }
                Ok(Value::Struct(members))
            }
        }

        deserializer.deserialize_any(Any)
    }
}
