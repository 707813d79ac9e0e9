//! Objects by what people call them.

use super::{Eds, Object};
use core::fmt;

/// The name of an object: `Identity object.Vendor-ID`, or `Controlword`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Name<'a> {
    /// Name of its index.
    pub index: &'a str,
    /// Name of its sub-index; `None` where the index has one object only.
    pub sub: Option<&'a str>,
}

impl fmt::Display for Name<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.index)?;
        self.sub.map_or(Ok(()), |sub| write!(f, ".{sub}"))
    }
}

/// True if two names are the same when case, spaces, dashes and underscores do not count.
pub(crate) fn same_name(a: &str, b: &str) -> bool {
    letters(a).eq(letters(b))
}

fn letters(name: &str) -> impl Iterator<Item = char> + '_ {
    name.chars().filter(|c| !matches!(c, ' ' | '-' | '_')).flat_map(char::to_lowercase)
}

/// Index and sub-index as they are written: `0x6041`, `6041`, `0x1018:1`, `1018sub1`. Behind a colon the sub-index is
/// decimal or `0x…`, behind `sub` it is hexadecimal as in the file. An index has four digits.
#[must_use]
pub fn address(text: &str) -> Option<(u16, u8)> {
    let text = text.trim();
    let digits = text.strip_prefix("0x").or(text.strip_prefix("0X")).unwrap_or(text);
    let (index, rest) = digits.split_at_checked(4)?;
    let hex = |text: &str| {
        let good = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        good.then(|| u16::from_str_radix(text, 16).ok()).flatten()
    };
    let sub = match rest.get(..3) {
        _ if rest.is_empty() => Some(0),
        Some(sub) if sub.eq_ignore_ascii_case("sub") => hex(&rest[3..]),
        _ => {
            let sub = rest.strip_prefix(':')?;
            match sub.strip_prefix("0x").or(sub.strip_prefix("0X")) {
                Some(digits) => hex(digits),
                None => sub.bytes().all(|byte| byte.is_ascii_digit()).then(|| sub.parse().ok()).flatten(),
            }
        }
    };
    Some((hex(index)?, u8::try_from(sub?).ok()?))
}

impl Eds {
    /// The name of an object; `None` when the file does not have it.
    #[must_use]
    pub fn name(&self, index: u16, sub: u8) -> Option<Name<'_>> {
        self.object(index, sub).map(|object| self.name_of(object))
    }

    fn name_of<'a>(&'a self, object: &'a Object) -> Name<'a> {
        match self.group(object.index) {
            Some(group) if self.is_group(object.index) => Name { index: &group.name, sub: Some(&object.name) },
            _ => Name { index: &object.name, sub: None },
        }
    }

    /// True if an index has sub-indices.
    pub(super) fn is_group(&self, index: u16) -> bool {
        use super::ObjectType::{Array, DefStruct, Record};
        self.group(index).is_some_and(|group| matches!(group.object_type, Array | Record | DefStruct))
    }

    /// The object that is meant: [`address`] (which the file need not have), `Controlword`, `Identity object` (its
    /// sub-index 0), `Identity object.Vendor-ID`, or a denotation of the DCF. Case, spaces, dashes and underscores do
    /// not count. `None` when no object is called so, or more than one: a write must not go to the wrong one.
    #[must_use]
    pub fn resolve(&self, text: &str) -> Option<(u16, u8)> {
        if let Some(address) = address(text) {
            return Some(address);
        }
        let mut found = None;
        for object in self.objects.iter().filter(|object| self.is_called(object, text)) {
            if found.replace((object.index, object.sub)).is_some() {
                return None;
            }
        }
        found
    }

    fn is_called(&self, object: &Object, text: &str) -> bool {
        let denoted = !object.denotation.is_empty() && same_name(&object.denotation, text);
        let name = self.name_of(object);
        let called = match name.sub {
            None => same_name(name.index, text),
            Some(sub) => {
                let whole = object.sub == 0 && same_name(name.index, text);
                whole || letters(name.index).chain(['.']).chain(letters(sub)).eq(letters(text))
            }
        };
        denoted || called && !text.is_empty()
    }
}
