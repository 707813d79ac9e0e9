//! Encoding of values.

use super::error::Why;
use super::table::{Element, Field, Len, Struct};
use super::{EncodeError, MAX_DEPTH, MESSAGE_MAX, Types, Value};
use crate::Primitive;
use std::borrow::Cow;

/// Treatment of members without a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Missing {
    /// Error, except for lengths, which follow from the arrays.
    #[default]
    Refuse,
    /// Zero, false or empty.
    Zero,
}

pub fn body(types: &Types, ty: &Struct, value: &Value<'_>, missing: Missing, out: &mut Vec<u8>) -> Outcome {
    let end = out.len() + MESSAGE_MAX - 8;
    Encoder { types, missing, out, end, depth: 0 }.body(ty, Some(value))
}

type Outcome = Result<(), EncodeError>;

struct Encoder<'a> {
    types: &'a Types,
    missing: Missing,
    out: &'a mut Vec<u8>,
    /// Maximum length of `out`.
    end: usize,
    depth: usize,
}

impl Encoder<'_> {
    fn put(&mut self, bytes: &[u8]) -> Outcome {
        if bytes.len() > self.end - self.out.len() {
            return Err(Why::TooLong.into());
        }
        self.out.extend_from_slice(bytes);
        Ok(())
    }

    /// Encodes a struct; without a value everything in it is zero.
    fn body(&mut self, ty: &Struct, value: Option<&Value<'_>>) -> Outcome {
        if let Some(values) = &ty.values {
            return self.enumerated(values, value);
        }
        let members = match value {
            None => None,
            Some(Value::Struct(members)) => Some(members.as_slice()),
            Some(other) => return Err(Why::Kind { expected: "an object", found: other.kind() }.into()),
        };
        let given = members.map(|members| assigned(ty, members)).transpose()?;
        let given = |i: usize| given.as_ref().and_then(|given| given[i]);
        let mut lengths = vec![0; ty.slots];
        for (i, field) in ty.fields.iter().enumerate() {
            if let (Some(slot), Element::Primitive(primitive)) = (field.slot, field.element) {
                let arrays = ty.fields.iter().enumerate().map(|(i, field)| (field, given(i)));
                lengths[slot] = length(primitive, given(i), slot, arrays).map_err(|error| error.within(&field.name))?;
            }
        }
        let is_missing = |field: &Field| value.is_some() && self.missing == Missing::Refuse && field.slot.is_none();
        if let Some((_, field)) =
            ty.fields.iter().enumerate().find(|(i, field)| given(*i).is_none() && is_missing(field))
        {
            return Err(EncodeError::from(Why::Missing).within(&field.name));
        }
        for (i, field) in ty.fields.iter().enumerate() {
            let done = match (field.slot, field.element) {
                (Some(slot), Element::Primitive(ty)) => self.integer(ty, lengths[slot] as i64),
                _ => self.array(field, &field.dims, &lengths, given(i)),
            };
            done.map_err(|error| error.within(&field.name))?;
        }
        Ok(())
    }

    fn array(&mut self, field: &Field, dims: &[Len], lengths: &[usize], value: Option<&Value<'_>>) -> Outcome {
        let [len, row @ ..] = dims else {
            return self.element(field, value);
        };
        let expected = count_of(*len, lengths);
        let bytes;
        let elements = match value {
            Some(Value::Array(elements)) => elements.as_slice(),
            Some(Value::Text(text)) if row.is_empty() && field.element == Element::Primitive(Primitive::Byte) => {
                let wrong = Why::Kind { expected: "an array or hexadecimal digits", found: "a text" };
                bytes = unhex(text).ok_or(wrong)?;
                return exactly(expected, bytes.len()).and_then(|()| self.put(&bytes));
            }
            Some(other) => return Err(Why::Kind { expected: "an array", found: other.kind() }.into()),
            // Rows without bytes need no iteration, and could be very many.
            None if field.min == 0 || row.iter().any(|len| count_of(*len, lengths) == 0) => return Ok(()),
            None => return (0..expected).try_for_each(|_| self.array(field, row, lengths, None)),
        };
        exactly(expected, elements.len())?;
        for (i, element) in elements.iter().enumerate() {
            let done = self.array(field, row, lengths, Some(element));
            done.map_err(|error| error.within(&format!("[{i}]")))?;
        }
        Ok(())
    }

    fn element(&mut self, field: &Field, value: Option<&Value<'_>>) -> Outcome {
        match (field.element, value) {
            (Element::Struct(place), _) => {
                self.depth += usize::from(field.recursive);
                if self.depth > MAX_DEPTH {
                    return Err(Why::Depth.into());
                }
                let types = self.types;
                self.body(&types.structs[place], value)?;
                self.depth -= usize::from(field.recursive);
                Ok(())
            }
            (Element::Primitive(Primitive::String), None) => self.put(&[0, 0, 0, 1, 0]),
            (Element::Primitive(ty), None) => self.put(&[0; 8][..ty.min_size()]),
            (Element::Primitive(ty), Some(value)) => self.primitive(ty, value),
        }
    }

    fn primitive(&mut self, ty: Primitive, value: &Value<'_>) -> Outcome {
        match (ty, value) {
            (Primitive::String, Value::Text(text)) => {
                if text.contains('\0') {
                    return Err(Why::Nul.into());
                }
                let size = u32::try_from(text.len() + 1).map_err(|_| Why::TooLong)?;
                self.put(&size.to_be_bytes())?;
                self.put(text.as_bytes())?;
                self.put(&[0])
            }
            (Primitive::String, other) => Err(Why::Kind { expected: "a text", found: other.kind() }.into()),
            (Primitive::Boolean, Value::Bool(value)) => self.put(&[u8::from(*value)]),
            (Primitive::Boolean, Value::Int(value @ 0..=1)) => self.put(&[u8::from(*value != 0)]),
            (Primitive::Boolean, other) => Err(Why::Kind { expected: "a boolean", found: other.kind() }.into()),
            (Primitive::Double, value) => self.put(&double(value)?.to_be_bytes()),
            (Primitive::Float, Value::Single(value)) => self.put(&value.to_be_bytes()),
            (Primitive::Float, value) => {
                let double = double(value)?;
                let single = double as f32;
                if double.is_finite() && single.is_infinite() {
                    return Err(Why::Range { ty: ty.name() }.into());
                }
                self.put(&single.to_be_bytes())
            }
            (ty, value) => {
                let value = whole(ty, value)?;
                self.integer(ty, value)
            }
        }
    }

    fn integer(&mut self, ty: Primitive, value: i64) -> Outcome {
        let in_range = match ty {
            Primitive::Byte => u8::try_from(value).is_ok(),
            ty => fits(ty, value),
        };
        if !in_range {
            return Err(Why::Range { ty: ty.name() }.into());
        }
        self.put(&value.to_be_bytes()[8 - ty.min_size()..])
    }

    fn enumerated(&mut self, values: &[(String, i32)], value: Option<&Value<'_>>) -> Outcome {
        let number = match value {
            None => 0,
            Some(Value::Text(name)) => {
                let known = values.iter().find(|(known, _)| known == name);
                known.ok_or_else(|| Why::NoValue { name: name.clone().into_owned() })?.1.into()
            }
            Some(value) => whole(Primitive::Int32, value)?,
        };
        self.integer(Primitive::Int32, number)
    }
}

/// Values by fields of the struct.
fn assigned<'v, 'a>(
    ty: &Struct,
    members: &'v [(Cow<'a, str>, Value<'a>)],
) -> Result<Vec<Option<&'v Value<'a>>>, EncodeError> {
    let mut given = vec![None; ty.fields.len()];
    for (i, (name, value)) in members.iter().enumerate() {
        // The members are usually in order.
        let here = ty.fields.get(i).filter(|field| field.name == *name).map(|_| i);
        let place = here.or_else(|| ty.fields.iter().position(|field| field.name == *name));
        let wrong = |why: Why| EncodeError::from(why).within(name);
        let place = &mut given[place.ok_or_else(|| wrong(Why::Unknown))?];
        if place.replace(value).is_some() {
            return Err(wrong(Why::Twice));
        }
    }
    Ok(given)
}

/// Value of a length field: the given one, else the length of an array that uses it.
fn length<'f, 'v>(
    ty: Primitive,
    given: Option<&Value<'_>>,
    slot: usize,
    mut arrays: impl Iterator<Item = (&'f Field, Option<&'v Value<'v>>)>,
) -> Result<usize, EncodeError> {
    let len = match given {
        Some(value) => whole(ty, value)?,
        None => arrays.find_map(|(field, value)| measured(field, slot, value?)).unwrap_or_default() as i64,
    };
    if !fits(ty, len) {
        return Err(Why::LengthRange { len }.into());
    }
    Ok(usize::try_from(len).map_err(|_| Why::LengthRange { len })?)
}

/// Length of the dimension with this slot, if the field has it and its outer dimensions are not empty.
fn measured(field: &Field, slot: usize, value: &Value<'_>) -> Option<usize> {
    let level = field.dims.iter().position(|len| *len == Len::Slot(slot))?;
    let row = (0..level).try_fold(value, |value, _| match value {
        Value::Array(elements) => elements.first(),
        _ => None,
    })?;
    match row {
        Value::Array(elements) => Some(elements.len()),
        Value::Text(text) => Some(text.len() / 2),
        _ => None,
    }
}

fn count_of(len: Len, lengths: &[usize]) -> usize {
    match len {
        Len::Fixed(count) => count,
        Len::Slot(slot) => lengths[slot],
    }
}

fn exactly(expected: usize, found: usize) -> Outcome {
    if expected == found { Ok(()) } else { Err(Why::Length { expected, found }.into()) }
}

/// True if the value is in the range of a signed integer type.
fn fits(ty: Primitive, value: i64) -> bool {
    let bits = ty.integer_bits().unwrap_or(64);
    let rest = value >> (bits - 1);
    rest == 0 || rest == -1
}

fn whole(ty: Primitive, value: &Value<'_>) -> Result<i64, EncodeError> {
    const EXACT: f64 = 9_007_199_254_740_992.0; // 2^53: floats up to here represent integers exactly
    match *value {
        Value::Int(value) => Ok(value),
        Value::Float(value) if value.trunc() == value && value.abs() <= EXACT => Ok(value as i64),
        Value::Single(value) if value.trunc() == value && f64::from(value.abs()) <= EXACT => Ok(value as i64),
        Value::Float(value) if value.trunc() == value => Err(Why::Range { ty: ty.name() }.into()),
        ref other => Err(Why::Kind { expected: "a whole number", found: other.kind() }.into()),
    }
}

fn double(value: &Value<'_>) -> Result<f64, EncodeError> {
    match value {
        Value::Int(value) => Ok(*value as f64),
        Value::Single(value) => Ok(f64::from(*value)),
        Value::Float(value) => Ok(*value),
        Value::Null => Ok(f64::NAN),
        Value::Text(text) => text.parse().map_err(|_| Why::Kind { expected: "a number", found: "a text" }.into()),
        other => Err(Why::Kind { expected: "a number", found: other.kind() }.into()),
    }
}

fn unhex(text: &str) -> Option<Vec<u8>> {
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let (pairs, rest) = text.as_bytes().as_chunks::<2>();
    let bytes = pairs.iter().map(|[high, low]| Some((digit(*high)? * 16 + digit(*low)?) as u8));
    if rest.is_empty() { bytes.collect() } else { None }
}
