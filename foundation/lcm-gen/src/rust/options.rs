//! What is generated beside the types themselves.

/// What is generated beside the types themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Which of serde's traits the types derive.
    pub serde: Serde,
    /// True if types that borrow from a message ([`View`](../../lcm/codec/trait.View.html)) stand beside those that
    /// can.
    pub views: bool,
}

/// Which of serde's traits the types derive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Serde {
    /// None: the code does not mention serde.
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
