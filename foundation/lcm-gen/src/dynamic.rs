//! Decoding and encoding of messages without generated code, for types known only from their `.lcm` files.
//!
//! A message identifies its type by its fingerprint. [`Types::decode`] validates the bytes, as strictly and with the
//! same bounds as generated code, and returns a [`Message`]: a view that can be read without further errors, as a
//! [`Value`] or, with the feature `serde`, directly into any format; with the feature `cells` as a row of a table.
//! [`Type::encode`] is the inverse.
//!
//! ```
//! use lcm_gen::{Schema, dynamic::{Missing, Types, Value}};
//!
//! let files = [("scan.lcm", "package demo; struct scan_t { int32_t n; float distance[n]; string sensor; }")];
//! let types = Types::new(&Schema::new(&files).unwrap());
//! let scan = Value::Struct(vec![
//!     ("distance".into(), Value::Array(vec![Value::Int(1), Value::Float(2.5)])), // `n` follows from it
//!     ("sensor".into(), Value::Text("front".into())),
//! ]);
//! let mut bytes = Vec::new();
//! types.get("demo.scan_t").unwrap().encode(&scan, Missing::Refuse, &mut bytes).unwrap();
//!
//! let message = types.decode(&bytes).unwrap().unwrap();
//! assert_eq!(message.ty().name(), "demo.scan_t");
//! assert_eq!(message.value().get("sensor"), Some(&Value::Text("front".into())));
//! ```
//!
//! Members are those of generated code: a length member that is the outermost dimension of an array is only the array's
//! length, so it is left out.

#[cfg(feature = "cells")]
mod cells;
mod check;
pub(crate) mod cursor;
mod encode;
mod error;
#[cfg(feature = "serde")]
mod serde;
pub(crate) mod table;
mod value;

use crate::Schema;
use lcm::codec::Reader;
use std::collections::BTreeMap;
use table::{Struct, table};

#[cfg(feature = "cells")]
pub use cells::Columns;
pub use encode::Missing;
pub use error::{EncodeError, Why};
pub use lcm::codec::{DecodeError, MAX_DEPTH, MAX_EMPTY};
pub use value::Value;

/// Longest message produced by [`Type::encode`], bytes: receivers accept no more (`lcm/lcm_udpm.c`).
pub const MESSAGE_MAX: usize = 1 << 28;

/// Types of a [`Schema`], prepared for decoding.
#[derive(Clone, Debug, Default)]
pub struct Types {
    structs: Vec<Struct>,
    /// Of types that differ only in their name, and so have the same fingerprint, the first.
    by_fingerprint: BTreeMap<u64, usize>,
    by_name: BTreeMap<String, usize>,
}

impl Types {
    /// All types of the schema.
    #[must_use]
    pub fn new(schema: &Schema) -> Self {
        let structs = table(schema);
        let (mut by_fingerprint, mut by_name) = (BTreeMap::new(), BTreeMap::new());
        for (i, ty) in structs.iter().enumerate() {
            by_fingerprint.entry(ty.fingerprint).or_insert(i);
            by_name.insert(ty.name.clone(), i);
        }
        Self { structs, by_fingerprint, by_name }
    }

    /// Type by its name with package: `common.data_state_t`.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Type<'_>> {
        self.by_name.get(name).map(|&index| Type { types: self, index })
    }

    /// Type by its fingerprint. Types with the same members in the same order have the same fingerprint, whatever their
    /// names: the first of them is returned.
    #[must_use]
    pub fn by_fingerprint(&self, fingerprint: u64) -> Option<Type<'_>> {
        self.by_fingerprint.get(&fingerprint).map(|&index| Type { types: self, index })
    }

    /// All types, in order of the schema.
    pub fn iter(&self) -> impl Iterator<Item = Type<'_>> {
        (0..self.structs.len()).map(|index| Type { types: self, index })
    }

    /// Finds the message's type by its fingerprint and validates the bytes. `None` if no type has the fingerprint, or
    /// the bytes are too short for one.
    ///
    /// # Errors
    /// `bytes` is not exactly one message of the type.
    pub fn decode<'a>(&'a self, bytes: &'a [u8]) -> Option<Result<Message<'a>, DecodeError>> {
        let fingerprint = u64::from_be_bytes(*bytes.first_chunk()?);
        Some(self.by_fingerprint(fingerprint)?.decode(bytes))
    }
}

/// Type of [`Types`].
#[derive(Clone, Copy, Debug)]
pub struct Type<'a> {
    types: &'a Types,
    index: usize,
}

impl<'a> Type<'a> {
    fn table(self) -> &'a Struct {
        &self.types.structs[self.index]
    }

    /// Name with package.
    #[must_use]
    pub fn name(self) -> &'a str {
        &self.table().name
    }

    /// Fingerprint at the beginning of its messages.
    #[must_use]
    pub fn fingerprint(self) -> u64 {
        self.table().fingerprint
    }

    /// True if it has a scalar member of this name and primitive type: `("timestamp", Primitive::Int64)`.
    #[must_use]
    pub fn has(self, member: &str, ty: crate::Primitive) -> bool {
        let is = |field: &table::Field| {
            field.name == member && field.dims.is_empty() && field.element == table::Element::Primitive(ty)
        };
        self.table().fields.iter().any(is)
    }

    /// Validates a message. Allocates nothing that depends on the message.
    ///
    /// # Errors
    /// `bytes` is not exactly one message of this type.
    pub fn decode(self, bytes: &'a [u8]) -> Result<Message<'a>, DecodeError> {
        check::body(self.types, self.table(), Reader::of(bytes, self.fingerprint())?)?;
        Ok(Message { ty: self, body: &bytes[8..] })
    }

    /// Appends the message with the content of `value`, fingerprint and body, to `out`.
    ///
    /// Numbers may be integers or floats if the conversion is exact; floats also texts (`"nan"`, `"-inf"`) and null,
    /// which is NaN; enums also the names of their values; arrays of bytes also texts of hexadecimal digits. Length
    /// members may be left out.
    ///
    /// # Errors
    /// The value does not match the type; the error has the path and the reason. `out` is then unchanged.
    pub fn encode(self, value: &Value<'_>, missing: Missing, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let start = out.len();
        out.extend_from_slice(&self.fingerprint().to_be_bytes());
        let result = encode::body(self.types, self.table(), value, missing, out);
        if result.is_err() {
            out.truncate(start);
        }
        result
    }
}

/// Validated message of a type.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    ty: Type<'a>,
    body: &'a [u8],
}

impl<'a> Message<'a> {
    /// Type.
    #[must_use]
    pub fn ty(&self) -> Type<'a> {
        self.ty
    }

    /// Content as a tree; texts and names are borrowed.
    #[must_use]
    pub fn value(&self) -> Value<'a> {
        value::read(self.ty.types, self.ty.table(), self.body)
    }
}
