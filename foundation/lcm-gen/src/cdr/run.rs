//! Execution of a plan: LCM bytes in, CDR bytes out. Possible errors, and the order in which they are detected, are
//! those of [`dynamic::check`](crate::dynamic).

use super::plan::{Array, Body, Item, Step};
use super::writer::Writer;
use super::{ConvertError, LENGTHS_MAX, MESSAGE_MAX};
use crate::dynamic::table::Len;
use crate::dynamic::{DecodeError, MAX_EMPTY, cursor};
use lcm::codec::Reader;

/// Converts one message with its fingerprint.
pub fn message(bodies: &[Body], body: &Body, bytes: &[u8], out: &mut Vec<u8>) -> Result<(), ConvertError> {
    let reader = Reader::of(bytes, body.fingerprint)?;
    // Usual size: the input with a little padding.
    out.reserve(bytes.len() + bytes.len() / 4);
    let mut run = Run { bodies, reader, to: Writer::new(out), lengths: [0; LENGTHS_MAX] };
    run.body(body, 0)?;
    Ok(run.reader.end()?)
}

struct Run<'a, 'o> {
    bodies: &'a [Body],
    reader: Reader<'a>,
    to: Writer<'o>,
    /// Lengths in scope, those of the outermost struct first.
    lengths: [usize; LENGTHS_MAX],
}

impl<'a> Run<'a, '_> {
    /// Converts a struct whose lengths are stored from `base` on.
    fn body(&mut self, body: &'a Body, base: usize) -> Result<(), ConvertError> {
        if body.empties > MAX_EMPTY {
            let count = i64::try_from(body.empties).unwrap_or(i64::MAX);
            return Err(DecodeError::Count { count, max: MAX_EMPTY }.into());
        }
        for step in &body.steps {
            match step {
                Step::Numbers { width, count } => {
                    let bytes = self.reader.take(width.saturating_mul(*count))?;
                    self.numbers(*width, bytes);
                }
                Step::Booleans { count } => {
                    let bytes = self.reader.take(*count)?;
                    self.booleans(bytes);
                }
                Step::Length { slot, ty } => {
                    let bytes = self.reader.take(ty.min_size())?;
                    let count = cursor::integer(*ty, bytes);
                    self.lengths[base + slot] = self.reader.length(count)?;
                    self.numbers(ty.min_size(), bytes);
                }
                Step::Array(array) => {
                    if array.is_sequence() {
                        let count = self.product(&array.dims, 1, base);
                        self.to.count(count);
                    }
                    self.array(array, &array.dims, base, base + body.slots)?;
                }
                Step::Nothing => self.to.u8(0),
            }
        }
        if self.to.len() > MESSAGE_MAX { Err(ConvertError::TooLong) } else { Ok(()) }
    }

    fn length(&self, len: Len, base: usize) -> usize {
        match len {
            Len::Fixed(count) => count,
            Len::Slot(slot) => self.lengths[base + slot],
        }
    }

    fn product(&self, dims: &[Len], element: usize, base: usize) -> usize {
        dims.iter().fold(element, |product, len| product.saturating_mul(self.length(*len, base)))
    }

    /// Converts the elements of an array, or of a row of it; their own lengths are stored from `inner` on.
    fn array(&mut self, array: &'a Array, dims: &[Len], base: usize, inner: usize) -> Result<(), ConvertError> {
        let is_fixed = |dims: &[Len]| dims.iter().all(|len| matches!(len, Len::Fixed(_)));
        match (array.fixed, dims) {
            (Some(_), dims) if is_fixed(dims) => {
                let count = self.product(dims, 1, base);
                self.elements(array, count, inner)
            }
            (Some(size), [len, row @ ..]) if is_fixed(row) => {
                let (count, row) = (self.length(*len, base), self.product(row, 1, base));
                self.claim(array, count, size.saturating_mul(row))?;
                self.elements(array, count.saturating_mul(row), inner)
            }
            (_, [len, row @ ..]) => {
                let (count, min) = (self.length(*len, base), self.product(row, array.min, base));
                if matches!(len, Len::Slot(_)) {
                    self.claim(array, count, min)?;
                }
                (0..count).try_for_each(|_| self.array(array, row, base, inner))
            }
            (_, []) => match array.element {
                Item::Struct(place) => self.body(&self.bodies[place], inner),
                // All other types have a fixed size.
                _ => self.string(),
            },
        }
    }

    /// Converts `count` elements of a fixed size.
    fn elements(&mut self, array: &'a Array, count: usize, inner: usize) -> Result<(), ConvertError> {
        let size = array.min.saturating_mul(count);
        match array.element {
            Item::Number { width } => {
                let bytes = self.reader.take(size)?;
                self.numbers(width, bytes);
                Ok(())
            }
            Item::Boolean => {
                let bytes = self.reader.take(size)?;
                self.booleans(bytes);
                Ok(())
            }
            Item::Struct(place) => {
                let body = &self.bodies[place];
                (0..count).try_for_each(|_| self.body(body, inner))
            }
            Item::String => (0..count).try_for_each(|_| self.string()),
        }
    }

    /// Checks `count` elements of at least `min` bytes each; rejects a count that the rest of the message cannot
    /// contain.
    fn claim(&mut self, array: &Array, count: usize, min: usize) -> Result<(), DecodeError> {
        let shown = match array.element {
            Item::Struct(place) if min == 0 => self.bodies[place].empties.max(1),
            _ => 1,
        };
        self.reader.claim(count, min, shown)
    }

    fn string(&mut self) -> Result<(), ConvertError> {
        self.to.string(self.reader.str()?);
        Ok(())
    }

    fn booleans(&mut self, bytes: &[u8]) {
        self.to.out.extend(bytes.iter().map(|&byte| u8::from(byte != 0)));
    }

    /// Appends numbers of this width with swapped byte order. Without numbers there is no alignment.
    #[inline]
    fn numbers(&mut self, width: usize, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.to.align(width);
        }
        match width {
            2 => self.turned::<2>(bytes),
            4 => self.turned::<4>(bytes),
            8 => self.turned::<8>(bytes),
            _ => self.to.out.extend_from_slice(bytes),
        }
    }

    #[inline]
    fn turned<const N: usize>(&mut self, bytes: &[u8]) {
        let at = self.to.out.len();
        self.to.out.extend_from_slice(bytes);
        for number in self.to.out[at..].as_chunks_mut::<N>().0 {
            number.reverse();
        }
    }
}
