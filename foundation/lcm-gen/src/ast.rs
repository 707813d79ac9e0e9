//! Content of a `.lcm` file.

use crate::At;
use base::listed;

/// Struct or enum.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// Package, `a.b.c`; empty without one.
    pub package: String,
    /// Name without the package.
    pub short: String,
    /// Comment before it, line by line.
    pub doc: Vec<String>,
    /// Kind with its content.
    pub kind: Kind,
    /// File that contains it, as named by the caller.
    pub file: String,
    /// Position of its name.
    pub at: At,
}

impl Definition {
    /// Name with the package: `common.data_state_t`.
    #[must_use]
    pub fn name(&self) -> String {
        qualified(&self.package, &self.short)
    }

    /// Members of a struct; empty for an enum.
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

/// Kind of a definition.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// `struct`.
    Struct {
        /// Constants, in order.
        constants: Vec<Constant>,
        /// Members, in order.
        members: Vec<Member>,
    },
    /// `enum`, a deprecated construct that official tools still accept.
    Enum {
        /// Values, in order.
        values: Vec<Value>,
    },
}

/// Value of an enum.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Value {
    /// Name.
    pub name: String,
    /// Number.
    pub number: i32,
    /// Comment before it, line by line.
    pub doc: Vec<String>,
}

/// Constant of a struct, which affects neither fingerprint nor encoding.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    /// Name.
    pub name: String,
    /// Type; never `byte`, `boolean` or `string`.
    pub ty: Primitive,
    /// Value as written.
    pub text: String,
    /// Value.
    pub literal: Literal,
    /// Comment before it, line by line.
    pub doc: Vec<String>,
}

/// Value of a constant, in the range of its type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Literal {
    /// Value of an integer type.
    Int(i64),
    /// Value of type `float` or `double`.
    Float(f64),
}

/// Member of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Name.
    pub name: String,
    /// Type, or type of the elements.
    pub ty: MemberType,
    /// Dimensions, outermost first; empty for a scalar.
    pub dims: Vec<Dim>,
    /// Comment before it, line by line.
    pub doc: Vec<String>,
    /// Position of its type.
    pub at: At,
}

impl Member {
    /// True if any dimension is variable.
    #[must_use]
    pub fn is_variable(&self) -> bool {
        self.dims.iter().any(|dim| dim.size == Size::Variable)
    }

    /// Number of elements over all dimensions; `None` if one is variable.
    pub(crate) fn fixed_count(&self) -> Option<usize> {
        self.dims.iter().try_fold(1_usize, |product, dim| match dim.size {
            Size::Fixed(count) => Some(product.saturating_mul(count)),
            Size::Variable => None,
        })
    }
}

/// Type of a member.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MemberType {
    /// Primitive type.
    Primitive(Primitive),
    /// Another definition, by its name with package.
    Named(String),
}

/// Dimension of an array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dim {
    /// Number of elements.
    pub size: Size,
    /// Text that enters the fingerprint: a literal or a constant's value as written, or the length member's name.
    pub text: String,
}

/// Number of elements of a dimension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Constant number.
    Fixed(usize),
    /// Value of the member named by [`Dim::text`].
    Variable,
}

listed! {
    /// Primitive types.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[allow(missing_docs, reason = "their names say it all")]
    pub enum Primitive {
        Int8 => "int8_t",
        Int16 => "int16_t",
        Int32 => "int32_t",
        Int64 => "int64_t",
        Byte => "byte",
        Float => "float",
        Double => "double",
        String => "string",
        Boolean => "boolean",
    }
}

impl Primitive {
    /// Type of this name in the language.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|ty| ty.name() == name)
    }

    /// Bits of an integer type, the only types allowed for the length of an array.
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

    /// Minimum size of an encoded value, bytes; the exact size for all types but `string`.
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
