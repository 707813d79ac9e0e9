//! A table in the making.

use super::description::Description;
use super::refusal::{Reason, Refusal};
use super::sheet::Sheet;
use crate::drives::cia402::{Parameters, Quantity, Setting};
use crate::master::Expect;
use alloc::vec::Vec;

pub(super) struct Draft<'a> {
    pub sheet: Sheet<'a>,
    pub description: &'a Description,
    pub parameters: Parameters,
    pub settings: Vec<Setting>,
    pub identity: Vec<Expect>,
    /// What the drive lacks to stop, where the second way stands in.
    pub reservations: Vec<Refusal>,
}

impl Draft<'_> {
    /// Writes an object, of whatever width it is.
    pub fn set(&mut self, index: u16, sub: u8, value: Quantity) -> Result<(), Refusal> {
        let object = self.sheet.writable(index, sub)?;
        let setting = Setting { index, sub, data_type: object.data_type, value };
        self.sheet.check(object, setting.number(&self.parameters))?;
        self.settings.push(setting);
        Ok(())
    }

    /// Writes an object where that can be done.
    pub fn set_where_there(&mut self, index: u16, sub: u8, value: i64) {
        // An object without which the drive stops, too.
        let _ = self.set(index, sub, Quantity::Fixed(value));
    }

    /// Compares an object at boot-up with what the sheet states.
    pub fn verify(&mut self, expect: Expect) {
        if self.sheet.eds.object(expect.index, expect.sub).is_some_and(|object| object.access.reads()) {
            self.identity.push(expect);
        }
    }

    /// Takes a refusal of something without which the drive may not stop: true if it is not there, and a manual or a
    /// second way stands in for it.
    pub fn excused(&mut self, result: Result<(), Refusal>) -> Result<bool, Refusal> {
        match result {
            Ok(()) => Ok(false),
            Err(refusal) if self.description.quirks.vouched.contains(&refusal.index) => Ok(true),
            // A limit of the configuration that the drive does not take is for the person who set it.
            Err(refusal @ Refusal { index, reason: Reason::OutOfLimits { .. }, .. }) if index != 0x1016 => Err(refusal),
            Err(refusal) if self.description.second_way => {
                self.reservations.push(refusal);
                Ok(true)
            }
            Err(refusal) => Err(refusal),
        }
    }

    /// An option code: the first one of `wanted` that the object takes. Where it cannot be written it must be, by the
    /// sheet and at boot-up, one of `sound`. Gives the code, if it is known.
    pub fn option(&mut self, wanted: &[i64], sound: Expect) -> Result<Option<i64>, Refusal> {
        let (index, sub) = (sound.index, sound.sub);
        let object = self.sheet.integer(index, sub)?;
        if self.sheet.writable(index, sub).is_ok() {
            let taken = wanted.iter().find(|code| self.sheet.check(object, **code).is_ok());
            let code = *taken.or(wanted.first()).unwrap_or(&0);
            self.set(index, sub, Quantity::Fixed(code))?;
            return Ok(Some(code));
        }
        let code = self.sheet.stated(index, sub);
        if let Some(code) = code.filter(|code| !sound.holds(*code as u32)) {
            return Err(Refusal::new(index, sub, Reason::RollsOn(code)));
        }
        self.verify(sound);
        Ok(code)
    }
}
