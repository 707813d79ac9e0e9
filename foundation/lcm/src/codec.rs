//! Encoding and decoding of messages: what generated code calls.
//!
//! A message is its type's fingerprint (8 bytes, big-endian) and a body: the members in order of declaration, without
//! padding, tags or lengths of arrays. `lcm-gen` writes an [`impl Type`](Type) for every type: straight-line code that
//! puts each member into a [`Writer`] or takes it from a [`Reader`]. Whatever always takes the same number of bytes is
//! [`Fixed`] and is stored and loaded whole. A [`View`] reads the same bytes and leaves strings and variable arrays
//! where they stand.
//!
//! Needs `core` and `alloc` only; memory is allocated for `String`s and `Vec`s that are decoded, and for nothing else.
//!
//! ```
//! use lcm::codec::{DecodeError, EncodeError, Reader, Type, Writer};
//!
//! // What lcm-gen makes of `struct point_t { double x; string name; }`, without the documentation.
//! #[derive(Debug, PartialEq)]
//! struct Point { x: f64, name: String }
//!
//! impl Type for Point {
//!     const FINGERPRINT: u64 = 0x7e83589fb0ba0f1b;
//!     const NAME: &'static str = "point_t";
//!     const MIN_SIZE: usize = 13;
//!     fn body_size(&self) -> usize { 13 + self.name.len() }
//!     fn encode_body(&self, w: &mut Writer<'_>) -> Result<(), EncodeError> {
//!         w.put(&self.x);
//!         w.string("name", &self.name)
//!     }
//!     fn decode_body(r: &mut Reader<'_>) -> Result<Self, DecodeError> {
//!         Ok(Self { x: r.get()?, name: r.string()? })
//!     }
//! }
//!
//! let (point, mut message) = (Point { x: 0.5, name: "A".into() }, Vec::new());
//! point.encode(&mut message).unwrap();
//! assert_eq!((message.len(), Point::decode(&message)), (8 + 14, Ok(point)));
//! ```
//! Decoding is stricter than in liblcm, since the bytes come from a network: counts are compared with the remaining
//! bytes before anything is allocated, recursion is bounded, strings are validated, and excess bytes are an error. The
//! memory used for a message is bounded by a constant multiple of its size.

mod elements;
mod error;
mod fixed;
mod reader;
mod writer;

pub use elements::Elements;
pub use error::{DecodeError, EncodeError};
pub use fixed::Fixed;
pub use reader::Reader;
pub use writer::Writer;

/// Re-exported for generated code, so that it needs no `extern crate alloc`.
#[doc(no_inline)]
pub use alloc::{string::String, vec::Vec};

/// Maximum nesting depth of recursive types, in both directions. The depth of other types is fixed by their definition.
pub const MAX_DEPTH: usize = 64;

/// Maximum number of elements that take no bytes (empty structs, rows of length 0) a message may announce in all: such
/// counts cannot be held against the bytes that are left.
pub const MAX_EMPTY: usize = 65_536;

/// Fewest bytes of an encoded string: its length and the final NUL.
pub const STRING_MIN: usize = 5;

/// A type of the LCM type language; implemented by generated code.
pub trait Type: Sized {
    /// Fingerprint in front of every encoded message of this type.
    const FINGERPRINT: u64;

    /// The name in the definition, with its package: `common.data_state_t`.
    const NAME: &'static str;

    /// Fewest bytes that a body takes.
    const MIN_SIZE: usize;

    /// Number of bytes the members take, without a fingerprint.
    fn body_size(&self) -> usize;

    /// Writes the members, without a fingerprint, as in a nested value: `body_size` bytes, unless it fails.
    ///
    /// # Errors
    /// When the value cannot be expressed; see [`EncodeError`].
    fn encode_body(&self, w: &mut Writer<'_>) -> Result<(), EncodeError>;

    /// Reads the members, without a fingerprint, as in a nested value.
    ///
    /// # Errors
    /// When the bytes are not such a value; see [`DecodeError`].
    fn decode_body(r: &mut Reader<'_>) -> Result<Self, DecodeError>;

    /// Number of bytes the message takes, with its fingerprint.
    fn encoded_size(&self) -> usize {
        8 + self.body_size()
    }

    /// Writes the message, fingerprint and body, to the start of `out` and returns its length. Allocates nothing.
    ///
    /// # Errors
    /// When `out` is too short, or the value cannot be expressed: arrays that share a length differ in theirs, a string
    /// holds a NUL, a count does not fit. What `out` holds then has no meaning.
    #[inline]
    fn encode_into(&self, out: &mut [u8]) -> Result<usize, EncodeError> {
        let (needed, room) = (self.encoded_size(), out.len());
        let out = out.get_mut(..needed).ok_or(EncodeError::NoRoom { needed, room })?;
        let mut w = Writer::new(out);
        w.put_u64(Self::FINGERPRINT);
        self.encode_body(&mut w)?;
        Ok(needed - w.left())
    }

    /// Appends the message, fingerprint and body, to `out`.
    ///
    /// # Errors
    /// As [`encode_into`](Self::encode_into); `out` is as before then, and never too short.
    fn encode(&self, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let start = out.len();
        out.resize(start + self.encoded_size(), 0);
        let result = self.encode_into(&mut out[start..]);
        out.truncate(start + *result.as_ref().unwrap_or(&0));
        result.map(|_| ())
    }

    /// Reads a whole message, fingerprint and body.
    ///
    /// # Errors
    /// When `bytes` are anything but one message of this type.
    #[inline]
    fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut r = Reader::of(bytes, Self::FINGERPRINT)?;
        let value = Self::decode_body(&mut r)?;
        r.end()?;
        Ok(value)
    }
}

/// A value whose strings and variable arrays stay in the bytes of the message: as strict as [`Type::decode`] and as
/// complete, but it allocates only lists of what itself varies in size. Generated on request beside the [`Type`], named
/// like it with `Ref` behind.
pub trait View<'a>: Sized {
    /// The type that it is a view of.
    type Of: Type;

    /// Reads the members, without a fingerprint, as in a nested value.
    ///
    /// # Errors
    /// When the bytes are not such a value; see [`DecodeError`].
    fn decode_body(r: &mut Reader<'a>) -> Result<Self, DecodeError>;

    /// Reads a whole message, fingerprint and body.
    ///
    /// # Errors
    /// When `bytes` are anything but one message of the type.
    #[inline]
    fn decode(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let mut r = Reader::of(bytes, Self::Of::FINGERPRINT)?;
        let value = Self::decode_body(&mut r)?;
        r.end()?;
        Ok(value)
    }
}

/// The fingerprint in front of an encoded message, if it is long enough to have one.
#[must_use]
pub fn fingerprint(message: &[u8]) -> Option<u64> {
    message.first_chunk().map(|bytes| u64::from_be_bytes(*bytes))
}

/// True if a NUL is among the bytes; eight at a time, since most strings are too short for `memchr` to pay.
#[inline]
fn has_nul(bytes: &[u8]) -> bool {
    const LOW: u64 = 0x0101_0101_0101_0101;
    const HIGH: u64 = 0x8080_8080_8080_8080;
    let in_word = |word: &[u8; 8]| {
        let word = u64::from_le_bytes(*word);
        word.wrapping_sub(LOW) & !word & HIGH != 0
    };
    match bytes.last_chunk() {
        Some(last) => bytes.as_chunks().0.iter().any(in_word) || in_word(last), // which may overlap
        None => bytes.contains(&0),
    }
}

#[cfg(test)]
mod tests;
