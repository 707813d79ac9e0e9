//! What a `.lcm` file says.

use crate::At;

/// A struct or an enum.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// The package, `a.b.c`; empty when there is none.
    pub package: String,
    /// The name without the package.
    pub short: String,
    /// The comment before it, line by line.
    pub doc: Vec<String>,
    /// What it is.
    pub kind: Kind,
    /// The file that it stands in, as the caller named it.
    pub file: String,
    /// Where its name stands.
    pub at: At,
}

impl Definition {
    /// The name with the package: `common.data_state_t`.
    #[must_use]
    pub fn name(&self) -> String {
        qualified(&self.package, &self.short)
    }

    /// The members of a struct; none for an enum.
    #[must_use]
    pub fn members(&self) -> &[Member] {
        match &self.kind {
            Kind::Struct { members, .. } => members,
            Kind::Enum { .. } => &[],
        }
    }
}

pub(crate) fn qualified(package: &str, short: &str) -> String {
    if package.is_empty() { short.to_owned() } else { format!("{package}.{short}") }
}

/// What a definition is.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// `struct`, the usual thing.
    Struct {
        /// Constants, in order.
        constants: Vec<Constant>,
        /// Members, in order.
        members: Vec<Member>,
    },
    /// `enum`, a leftover of the language that official tools still accept.
    Enum {
        /// Values, in order.
        values: Vec<Value>,
    },
}

/// A value of an enum.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Value {
    /// Name.
    pub name: String,
    /// Number.
    pub number: i32,
    /// The comment before it, line by line.
    pub doc: Vec<String>,
}

/// A constant of a struct. It takes no part in fingerprint or encoding.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    /// Name.
    pub name: String,
    /// Type; never `byte`, `boolean` or `string`.
    pub ty: Primitive,
    /// The value as written.
    pub text: String,
    /// The value.
    pub literal: Literal,
    /// The comment before it, line by line.
    pub doc: Vec<String>,
}

/// A constant's value, in the range of its type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Literal {
    /// Of an integer type.
    Int(i64),
    /// Of `float` or `double`.
    Float(f64),
}

/// A member of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Name.
    pub name: String,
    /// Type, or its elements'.
    pub ty: MemberType,
    /// Dimensions, outermost first; none for a scalar.
    pub dims: Vec<Dim>,
    /// The comment before it, line by line.
    pub doc: Vec<String>,
    /// Where its type stands.
    pub at: At,
}

impl Member {
    /// True if any dimension is variable.
    #[must_use]
    pub fn is_variable(&self) -> bool {
        self.dims.iter().any(|dim| dim.size == Size::Variable)
    }

    /// Number of elements all dimensions make together; `None` when one is variable.
    pub(crate) fn fixed_count(&self) -> Option<usize> {
        self.dims.iter().try_fold(1_usize, |product, dim| match dim.size {
            Size::Fixed(count) => Some(product.saturating_mul(count)),
            Size::Variable => None,
        })
    }
}

/// The type of a member.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MemberType {
    /// One of the language's own.
    Primitive(Primitive),
    /// Another definition, by its name with package.
    Named(String),
}

/// A dimension of an array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dim {
    /// Number of elements.
    pub size: Size,
    /// What the fingerprint takes in: a literal or a constant's value as written, or the length member's name.
    pub text: String,
}

/// Number of elements a dimension has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// So many.
    Fixed(usize),
    /// As many as the member named by [`Dim::text`] says.
    Variable,
}

/// The language's own types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "their names say it all")]
pub enum Primitive {
    Int8,
    Int16,
    Int32,
    Int64,
    Byte,
    Float,
    Double,
    String,
    Boolean,
}

impl Primitive {
    /// By its name in the language.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "int8_t" => Self::Int8,
            "int16_t" => Self::Int16,
            "int32_t" => Self::Int32,
            "int64_t" => Self::Int64,
            "byte" => Self::Byte,
            "float" => Self::Float,
            "double" => Self::Double,
            "string" => Self::String,
            "boolean" => Self::Boolean,
            _ => return None,
        })
    }

    /// Name in the language.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Int8 => "int8_t",
            Self::Int16 => "int16_t",
            Self::Int32 => "int32_t",
            Self::Int64 => "int64_t",
            Self::Byte => "byte",
            Self::Float => "float",
            Self::Double => "double",
            Self::String => "string",
            Self::Boolean => "boolean",
        }
    }

    /// Bits of an integer type, the only types that an array's length may have.
    #[must_use]
    pub fn integer_bits(self) -> Option<u32> {
        match self {
            Self::Int8 => Some(8),
            Self::Int16 => Some(16),
            Self::Int32 => Some(32),
            Self::Int64 => Some(64),
            _ => None,
        }
    }

    /// Fewest bytes of an encoded value; all but `string` always take so many.
    #[must_use]
    pub fn min_size(self) -> usize {
        match self {
            Self::Int8 | Self::Byte | Self::Boolean => 1,
            Self::Int16 => 2,
            Self::Int32 | Self::Float => 4,
            Self::String => 5,
            Self::Int64 | Self::Double => 8,
        }
    }
}
