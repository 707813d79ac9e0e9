//! Writes to a node's objects at boot-up: what the master's configuration and a PDO's remapping consist of.

use crate::Payload;

/// Way of writing an object at boot-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum How {
    /// Read first, written only if different, and read back.
    #[default]
    WhereDifferent,
    /// The same, and left out where the node has no such object.
    WhereThere,
    /// Written at each boot-up, and read back: for objects whose writing does something.
    Always,
    /// Written at each boot-up, never read: for objects that cannot be read, or read as something else, like 0x1010.
    Blindly,
}

/// An object to write at boot-up.
///
/// Where one object is written more than once, as the remapping of a PDO does, its order matters: everything between
/// its first and its last writing is done in full, or not at all when each object holds already what it shall in the
/// end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigWrite {
    /// The object's index.
    pub index: u16,
    /// The object's sub-index.
    pub sub: u8,
    /// Value, of any type.
    pub value: Payload,
    /// True if it is compared before and after.
    pub how: How,
}

impl ConfigWrite {
    /// Write `value` to an object, where it differs: a number of the object's width, or its bytes.
    #[must_use]
    pub fn new(index: u16, sub: u8, value: impl Into<Payload>) -> Self {
        Self { index, sub, value: value.into(), how: How::WhereDifferent }
    }

    /// A write with [`How::WhereThere`].
    #[must_use]
    pub fn where_there(self) -> Self {
        Self { how: How::WhereThere, ..self }
    }

    /// A write with [`How::Always`].
    #[must_use]
    pub fn always(self) -> Self {
        Self { how: How::Always, ..self }
    }

    /// A write with [`How::Blindly`].
    #[must_use]
    pub fn blindly(self) -> Self {
        Self { how: How::Blindly, ..self }
    }
}
