//! Messages of types that are known from their `.lcm` files only: decoded and encoded without generated code.
//!
//! A message names its type by its fingerprint. [`Types::decode`] holds the bytes against the type, as strictly and
//! with the same bounds as generated code does, and lends a [`Message`]: a view that is read without any further error,
//! as a [`Value`] or, with the feature `serde`, straight into any format. [`Type::encode`] is the way back.
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
//! Members appear as in generated code: a length member that is the outermost dimension of an array is the array's
//! length and nothing else, so it is left out.

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

pub use encode::Missing;
pub use error::{EncodeError, Why};
pub use lcm::codec::{DecodeError, MAX_DEPTH, MAX_EMPTY};
pub use value::Value;

/// The longest message that [`Type::encode`] makes, bytes: no receiver takes more (`lcm/lcm_udpm.c`).
pub const MESSAGE_MAX: usize = 1 << 28;

/// The types of a [`Schema`], made ready for decoding.
#[derive(Clone, Debug, Default)]
pub struct Types {
    structs: Vec<Struct>,
    /// Of types that are alike but for their name, which have the same fingerprint, the first.
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

    /// By name with package: `common.data_state_t`.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Type<'_>> {
        self.by_name.get(name).map(|&index| Type { types: self, index })
    }

    /// By what stands in front of its messages. Types with the same members in the same order have the same
    /// fingerprint, whatever their names: the first of them.
    #[must_use]
    pub fn by_fingerprint(&self, fingerprint: u64) -> Option<Type<'_>> {
        self.by_fingerprint.get(&fingerprint).map(|&index| Type { types: self, index })
    }

    /// All of them, in order of the schema.
    pub fn iter(&self) -> impl Iterator<Item = Type<'_>> {
        (0..self.structs.len()).map(|index| Type { types: self, index })
    }

    /// Finds the message's type by its fingerprint, and holds the bytes against it. `None`: no type has it, or there is
    /// none.
    ///
    /// # Errors
    /// `bytes` are anything but one message of the type.
    pub fn decode<'a>(&'a self, bytes: &'a [u8]) -> Option<Result<Message<'a>, DecodeError>> {
        let fingerprint = u64::from_be_bytes(*bytes.first_chunk()?);
        Some(self.by_fingerprint(fingerprint)?.decode(bytes))
    }
}

/// One of [`Types`].
#[derive(Clone, Copy, Debug)]
pub struct Type<'a> {
    types: &'a Types,
    index: usize,
}

impl<'a> Type<'a> {
    fn table(self) -> &'a Struct {
        &self.types.structs[self.index]
    }

    /// The name with package.
    #[must_use]
    pub fn name(self) -> &'a str {
        &self.table().name
    }

    /// What stands in front of its messages.
    #[must_use]
    pub fn fingerprint(self) -> u64 {
        self.table().fingerprint
    }

    /// True if it has a member of that name and primitive type, not an array: `("timestamp", Primitive::Int64)`.
    #[must_use]
    pub fn has(self, member: &str, ty: crate::Primitive) -> bool {
        let is = |field: &table::Field| {
            field.name == member && field.dims.is_empty() && field.element == table::Element::Primitive(ty)
        };
        self.table().fields.iter().any(is)
    }

    /// Holds a message against the type. Allocates nothing that depends on the message.
    ///
    /// # Errors
    /// `bytes` are anything but one message of this type.
    pub fn decode(self, bytes: &'a [u8]) -> Result<Message<'a>, DecodeError> {
        check::body(self.types, self.table(), Reader::of(bytes, self.fingerprint())?)?;
        Ok(Message { ty: self, body: &bytes[8..] })
    }

    /// Appends the message that says `value`, fingerprint and body, to `out`.
    ///
    /// Numbers may be integers or floats where they lose nothing; floats also texts (`"nan"`, `"-inf"`) and null, which
    /// is not a number; enums also their values' names; rows of bytes also texts of hexadecimal digits. Length members
    /// may be left out.
    ///
    /// # Errors
    /// The value is not one of this type; where and why. `out` is as before then.
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

/// A message that is known to be one of its type.
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

    /// What it says, as a tree; texts and names are borrowed.
    #[must_use]
    pub fn value(&self) -> Value<'a> {
        value::read(self.ty.types, self.ty.table(), self.body)
    }
}
