//! Static description of one object.

use super::DataType;

/// Access to an object by SDO and PDO. The application has full access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the description
pub enum Access {
    Const,
    ReadOnly,
    WriteOnly,
    ReadWrite,
    /// Read and write; into a TPDO only (CiA 306: `rwr`).
    ReadWriteTransmit,
    /// Read and write; into an RPDO only (CiA 306: `rww`).
    ReadWriteReceive,
}

impl Access {
    /// True if SDO may read it.
    #[must_use]
    pub const fn reads(self) -> bool {
        !matches!(self, Self::WriteOnly)
    }

    /// True if SDO may write it.
    #[must_use]
    pub const fn writes(self) -> bool {
        !matches!(self, Self::Const | Self::ReadOnly)
    }

    /// True if it may lie in an RPDO (`received`), or in a TPDO.
    pub(super) const fn maps(self, received: bool) -> bool {
        match self {
            Self::ReadWriteTransmit => !received,
            Self::ReadWriteReceive => received,
            _ if received => self.writes(),
            _ => self.reads(),
        }
    }
}

/// One object of a static table, built by chained calls.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    pub(super) index: u16,
    pub(super) sub: u8,
    pub(super) data_type: DataType,
    pub(super) access: Access,
    pub(super) mappable: bool,
    pub(super) plus_node_id: bool,
    pub(super) value: i64,
    pub(super) text: &'static str,
    pub(super) low: i64,
    pub(super) high: i64,
}

impl Entry {
    /// An object with `value` as its default; of a REAL its bit pattern.
    #[must_use]
    pub const fn new(index: u16, sub: u8, data_type: DataType, access: Access, value: i64) -> Self {
        let (low, high) = data_type.range();
        let value = data_type.wrap(value);
        Self { index, sub, data_type, access, mappable: false, plus_node_id: false, value, text: "", low, high }
    }

    /// May be mapped into a PDO, in the directions its access allows.
    #[must_use]
    pub const fn mappable(self) -> Self {
        Self { mappable: true, ..self }
    }

    /// Writes outside `low..=high` are refused; of a REAL their bit patterns.
    #[must_use]
    pub const fn limits(self, low: i64, high: i64) -> Self {
        Self { low, high, ..self }
    }

    /// The default is `$NODEID` plus the given value.
    #[must_use]
    pub const fn plus_node_id(self) -> Self {
        Self { plus_node_id: true, ..self }
    }

    /// The default of what is no number.
    #[must_use]
    pub const fn text(self, text: &'static str) -> Self {
        Self { text, ..self }
    }

    /// Index and sub-index.
    #[must_use]
    pub const fn key(&self) -> (u16, u8) {
        (self.index, self.sub)
    }
}
