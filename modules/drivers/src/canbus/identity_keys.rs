//! An object by which a drive is recognized, as a table of the configuration states it.

use canopen::master::Expect;
use settings::{Table, settings};

/// Greatest number of such objects of a drive.
const OBJECTS_MAX: usize = 32;

settings! {
    /// An object that the drive must have with this value before anything but a stop is written to it.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct IdentityKeys {
        /// Index of the object.
        index: u16 = required, 0x1000..=0x9FFF;
        /// Its sub-index.
        sub: u8 = 0, 0..=255;
        /// The bits that count.
        mask: u32 = u32::MAX, 1..=4_294_967_295;
        /// The value of these bits.
        equal: Option<u32> = optional, 0..=4_294_967_295;
        /// Their least value, in place of `equal`.
        at_least: Option<u32> = optional, 0..=4_294_967_295;
        /// Their greatest value, in place of `equal`.
        at_most: Option<u32> = optional, 0..=4_294_967_295;
    }
    check IdentityKeys::check;
}

impl IdentityKeys {
    fn check(&self, table: &Table<'_>) {
        match (self.equal, self.at_least, self.at_most) {
            (None, None, None) => table.refuse_missing("equal", "the value, or at_least, at_most or both"),
            (Some(_), None, None) | (None, _, _) => {}
            (Some(_), _, _) => table.refuse("equal", "nothing beside at_least and at_most"),
        }
        if self.equal.is_some_and(|value| value & !self.mask != 0) {
            table.refuse("equal", format_args!("a value within the mask, 0x{:X}", self.mask));
        }
        if let (Some(least), Some(most)) = (self.at_least, self.at_most)
            && least > most
        {
            table.refuse("at_most", "at least at_least");
        }
    }

    /// What the drive must be.
    #[must_use]
    pub fn expect(&self) -> Expect {
        let (min, max) = match self.equal {
            Some(value) => (value, value),
            None => (self.at_least.unwrap_or(0), self.at_most.unwrap_or(u32::MAX)),
        };
        Expect { index: self.index, sub: self.sub, mask: self.mask, min, max }
    }
}

/// What a drive must be by its vendor, its product, its least revision (0x1018), and further objects.
pub(super) fn expected(stated: [Option<u32>; 3], further: &[IdentityKeys]) -> Vec<Expect> {
    let [vendor, product, revision] = stated;
    let equal = |sub, value: Option<u32>| value.map(|value| Expect::equal(0x1018, sub, value));
    let revision = revision.map(|least| Expect::at_least(0x1018, 3, least));
    let stated = [equal(1, vendor), equal(2, product), revision].into_iter().flatten();
    stated.chain(further.iter().map(IdentityKeys::expect)).collect()
}

/// Refuses a list of more objects than a boot-up compares.
pub(super) fn check_count(table: &Table<'_>, identity: &[IdentityKeys]) {
    if identity.len() > OBJECTS_MAX {
        table.refuse("identity", format_args!("at most {OBJECTS_MAX} objects"));
    }
}
