//! A data sheet, asked for what a drive needs.

use super::refusal::{Reason, Refusal};
use crate::dictionary::DataType;
use crate::eds::{Eds, Object};

/// A data sheet of the node with an id.
#[derive(Clone, Copy)]
pub(super) struct Sheet<'a> {
    pub eds: &'a Eds,
    pub node: u8,
}

impl<'a> Sheet<'a> {
    pub fn has(&self, index: u16) -> bool {
        self.eds.group(index).is_some()
    }

    pub fn need(&self, index: u16, sub: u8) -> Result<&'a Object, Refusal> {
        self.eds.object(index, sub).ok_or(Refusal::new(index, sub, Reason::Missing))
    }

    /// An integer of at most 32 bits.
    pub fn integer(&self, index: u16, sub: u8) -> Result<&'a Object, Refusal> {
        use DataType::{I8, I16, I24, I32, U8, U16, U24, U32};
        let object = self.need(index, sub)?;
        let fits = matches!(object.data_type, I8 | I16 | I24 | I32 | U8 | U16 | U24 | U32);
        if fits { Ok(object) } else { Err(Refusal::new(index, sub, Reason::Type)) }
    }

    /// One that is written at boot-up.
    pub fn writable(&self, index: u16, sub: u8) -> Result<&'a Object, Refusal> {
        let object = self.integer(index, sub)?;
        let writable = object.access.writes() && !object.refuses_write;
        if writable { Ok(object) } else { Err(Refusal::new(index, sub, Reason::NotWritable)) }
    }

    /// One of exactly this type.
    pub fn typed(&self, index: u16, sub: u8, data_type: DataType) -> Result<&'a Object, Refusal> {
        let object = self.need(index, sub)?;
        if object.data_type == data_type { Ok(object) } else { Err(Refusal::new(index, sub, Reason::Type)) }
    }

    /// The value that the sheet states: that of a DCF, else the default.
    pub fn stated(&self, index: u16, sub: u8) -> Option<i64> {
        let object = self.integer(index, sub).ok()?;
        let setting = object.parameter.as_ref().or(object.default.as_ref())?;
        Some(setting.number(object.data_type, self.node))
    }

    /// The least and the greatest value of an object.
    pub fn limits(&self, object: &Object) -> (i64, i64) {
        let (low, high) = object.data_type.range();
        let number = |setting: &crate::eds::Setting| setting.number(object.data_type, self.node);
        (object.low.as_ref().map_or(low, number), object.high.as_ref().map_or(high, number))
    }

    /// Refuses a value that an object does not take.
    pub fn check(&self, object: &Object, value: i64) -> Result<(), Refusal> {
        let (low, high) = self.limits(object);
        match (low..=high).contains(&value) {
            true => Ok(()),
            false => Err(Refusal::new(object.index, object.sub, Reason::OutOfLimits { value, low, high })),
        }
    }

    /// An object that takes this value.
    pub fn takes(&self, index: u16, sub: u8, value: i64) -> Result<&'a Object, Refusal> {
        let object = self.writable(index, sub)?;
        self.check(object, value).map(|()| object)
    }
}
