//! Options of the generator.

/// Options of the generator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Serde traits that the types derive.
    pub serde: Serde,
    /// True to generate types that borrow from a message ([`View`](../../lcm/codec/trait.View.html)), where possible.
    pub views: bool,
}

/// Serde traits that the types derive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Serde {
    /// No trait: the code does not mention serde.
    #[default]
    None,
    /// `Serialize`.
    Serialize,
    /// `Serialize` and `Deserialize`.
    Both,
}

impl Serde {
    pub(super) fn derives(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Serialize => ", ::serde::Serialize",
            Self::Both => ", ::serde::Serialize, ::serde::Deserialize",
        }
    }
}
