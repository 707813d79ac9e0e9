//! Holds bytes against a type: everything that can be wrong with a message is found here, once.

use super::table::{Element, Field, Len, Struct};
use super::{DecodeError, MAX_DEPTH, MAX_EMPTY, Types, cursor};

/// Whether `bytes` are one value of `ty` and nothing more.
pub fn body(types: &Types, ty: &Struct, bytes: &[u8]) -> Result<(), DecodeError> {
    let mut check = Check { types, bytes, depth: 0, empties: MAX_EMPTY, lengths: Vec::new() };
    check.body(ty)?;
    match check.bytes.len() {
        0 => Ok(()),
        extra => Err(DecodeError::LeftOver { extra }),
    }
}

struct Check<'a> {
    types: &'a Types,
    bytes: &'a [u8],
    depth: usize,
    empties: usize,
    /// The length fields' values of the structs that are open, innermost last.
    lengths: Vec<usize>,
}

impl<'a> Check<'a> {
    fn take(&mut self, needed: usize) -> Result<&'a [u8], DecodeError> {
        let truncated = DecodeError::Truncated { needed, left: self.bytes.len() };
        let (head, rest) = self.bytes.split_at_checked(needed).ok_or(truncated)?;
        self.bytes = rest;
        Ok(head)
    }

    fn body(&mut self, ty: &Struct) -> Result<(), DecodeError> {
        if ty.empties > MAX_EMPTY {
            let count = i64::try_from(ty.empties).unwrap_or(i64::MAX);
            return Err(DecodeError::Count { count, max: MAX_EMPTY });
        }
        if let Some(size) = ty.fixed {
            return self.take(size).map(drop);
        }
        let base = self.lengths.len();
        self.lengths.resize(base + ty.slots, 0);
        for field in &ty.fields {
            match (field.slot, field.element) {
                (Some(slot), Element::Primitive(primitive)) => {
                    let count = cursor::integer(primitive, self.take(field.min)?);
                    let wrong = DecodeError::Count { count, max: self.bytes.len() };
                    self.lengths[base + slot] = usize::try_from(count).map_err(|_| wrong)?;
                }
                _ => self.array(field, &field.dims, base)?,
            }
        }
        self.lengths.truncate(base);
        Ok(())
    }

    fn len(&self, len: Len, base: usize) -> usize {
        match len {
            Len::Fixed(count) => count,
            Len::Slot(slot) => self.lengths[base + slot],
        }
    }

    fn array(&mut self, field: &Field, dims: &[Len], base: usize) -> Result<(), DecodeError> {
        let is_fixed = |dims: &[Len]| dims.iter().all(|len| matches!(len, Len::Fixed(_)));
        let size = |dims: &[Len], element: usize| {
            dims.iter().fold(element, |size, len| size.saturating_mul(self.len(*len, base)))
        };
        match (field.fixed, dims) {
            (Some(element), dims) if is_fixed(dims) => self.take(size(dims, element)).map(drop),
            (Some(element), [len, row @ ..]) if is_fixed(row) => {
                let (count, row) = (self.len(*len, base), size(row, element));
                self.claim(field, count, row)?;
                self.take(count.saturating_mul(row)).map(drop)
            }
            (_, [len, row @ ..]) => {
                let (count, min) = (self.len(*len, base), size(row, field.min));
                if matches!(len, Len::Slot(_)) {
                    self.claim(field, count, min)?;
                }
                (0..count).try_for_each(|_| self.array(field, row, base))
            }
            (_, []) => match field.element {
                Element::Primitive(_) => self.string(),
                Element::Struct(place) if field.recursive => {
                    if self.depth == MAX_DEPTH {
                        return Err(DecodeError::Depth { max: MAX_DEPTH });
                    }
                    self.depth += 1;
                    self.body(&self.types.structs[place])?;
                    self.depth -= 1;
                    Ok(())
                }
                Element::Struct(place) => self.body(&self.types.structs[place]),
            },
        }
    }

    /// `count` elements of at least `min` bytes each: refuses a count that the rest of the message cannot hold.
    fn claim(&mut self, field: &Field, count: usize, min: usize) -> Result<(), DecodeError> {
        let shown = match field.element {
            Element::Struct(place) if min == 0 => self.types.structs[place].empties.max(1),
            _ => 1,
        };
        claim(count, min, shown, self.bytes.len(), &mut self.empties)
    }

    fn string(&mut self) -> Result<(), DecodeError> {
        let len = self.take(4)?;
        text(self.take(string_length(len, self.bytes.len())?)?)
    }
}

/// `count` elements of at least `min` bytes each, of which each shows `shown` without bytes if it has none itself:
/// refuses a count that the bytes left cannot hold, or that leaves no `empties`.
pub fn claim(count: usize, min: usize, shown: usize, left: usize, empties: &mut usize) -> Result<(), DecodeError> {
    let max = left.checked_div(min).unwrap_or(*empties / shown);
    if count > max {
        return Err(DecodeError::Count { count: i64::try_from(count).unwrap_or(i64::MAX), max });
    }
    if min == 0 {
        *empties -= count * shown;
    }
    Ok(())
}

/// How many bytes a string takes behind its length, of those that are left.
pub fn string_length(len: &[u8], left: usize) -> Result<usize, DecodeError> {
    let len = i32::from_be_bytes(cursor::chunk(len));
    let wrong = DecodeError::StringLength { len, left };
    usize::try_from(len).ok().filter(|&size| 0 < size && size <= left).ok_or(wrong)
}

/// Whether the bytes are the text of a string and the NUL behind it.
pub fn text(bytes: &[u8]) -> Result<(), DecodeError> {
    let Some((&0, text)) = bytes.split_last() else {
        return Err(DecodeError::Unterminated);
    };
    if text.contains(&0) {
        return Err(DecodeError::InnerNul);
    }
    match std::str::from_utf8(text) {
        Ok(_) => Ok(()),
        Err(error) => Err(DecodeError::NotUtf8 { valid_up_to: error.valid_up_to() }),
    }
}
