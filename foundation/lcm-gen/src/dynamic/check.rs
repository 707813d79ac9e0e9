//! Validation of bytes against a type: all errors of a message are detected here, once.

use super::table::{Element, Field, Len, Struct};
use super::{DecodeError, MAX_DEPTH, MAX_EMPTY, Types, cursor};
use lcm::codec::Reader;

/// Checks that the rest of a message is exactly one value of `ty`.
pub fn body(types: &Types, ty: &Struct, reader: Reader<'_>) -> Result<(), DecodeError> {
    let mut check = Check { types, reader, depth: 0, lengths: Vec::new() };
    check.body(ty)?;
    check.reader.end()
}

struct Check<'a> {
    types: &'a Types,
    reader: Reader<'a>,
    depth: usize,
    /// Values of the length fields of the open structs, innermost last.
    lengths: Vec<usize>,
}

impl Check<'_> {
    fn body(&mut self, ty: &Struct) -> Result<(), DecodeError> {
        if ty.empties > MAX_EMPTY {
            let count = i64::try_from(ty.empties).unwrap_or(i64::MAX);
            return Err(DecodeError::Count { count, max: MAX_EMPTY });
        }
        if let Some(size) = ty.fixed {
            return self.reader.take(size).map(drop);
        }
        let base = self.lengths.len();
        self.lengths.resize(base + ty.slots, 0);
        for field in &ty.fields {
            match (field.slot, field.element) {
                (Some(slot), Element::Primitive(primitive)) => {
                    let count = cursor::integer(primitive, self.reader.take(field.min)?);
                    self.lengths[base + slot] = self.reader.length(count)?;
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
            (Some(element), dims) if is_fixed(dims) => self.reader.take(size(dims, element)).map(drop),
            (Some(element), [len, row @ ..]) if is_fixed(row) => {
                let (count, row) = (self.len(*len, base), size(row, element));
                self.claim(field, count, row)?;
                self.reader.take(count.saturating_mul(row)).map(drop)
            }
            (_, [len, row @ ..]) => {
                let (count, min) = (self.len(*len, base), size(row, field.min));
                if matches!(len, Len::Slot(_)) {
                    self.claim(field, count, min)?;
                }
                (0..count).try_for_each(|_| self.array(field, row, base))
            }
            (_, []) => match field.element {
                Element::Primitive(_) => self.reader.str().map(drop),
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

    /// Checks `count` elements of at least `min` bytes each; rejects a count that the rest of the message cannot
    /// contain.
    fn claim(&mut self, field: &Field, count: usize, min: usize) -> Result<(), DecodeError> {
        let shown = match field.element {
            Element::Struct(place) if min == 0 => self.types.structs[place].empties.max(1),
            _ => 1,
        };
        self.reader.claim(count, min, shown)
    }
}
