//! Electronic data sheets and device configuration files (CiA 306-1): which objects a device has, their names, types
//! and defaults, and how one device is to be set up.
//!
//! The format is an INI dialect that vendors write by hand, so much is tolerated and told by [`Eds::warnings`]; what
//! cannot be understood without a guess is an [`Error`] with its line. A file is hostile input: it is bounded in size
//! and in objects, and read in one pass.
//!
//! Read `ini` first for the lines, then `fields` and `build` for what they mean.

mod agrees;
mod build;
mod concise;
mod configuration;
mod device;
mod fields;
mod ini;
mod names;
mod number;
#[cfg(test)]
mod tests;

use crate::dictionary::{Access, DataType, Entry};
use crate::{Dictionary, Payload};
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

pub use concise::{ConciseError, read_concise, write_concise};
pub use device::{Commissioning, Device};
pub(crate) use names::same_name;
pub use names::{Name, address};
pub use number::Setting;

/// The longest file, in bytes.
pub const MAX_FILE: usize = 4 << 20;
/// Most objects in a file, each sub-index counted.
pub const MAX_OBJECTS: usize = 65_536;
/// The longest name, in bytes; the rest is cut off.
pub const MAX_NAME: usize = 256;
/// Most warnings that are kept.
pub const MAX_WARNINGS: usize = 1000;

/// Finding in a file: an error, or a warning about what was tolerated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// The line, from 1; 0: the file as a whole.
    pub line: u32,
    /// Text of the file, shortened.
    pub found: String,
    /// Expected text, or how the found one was read.
    pub text: &'static str,
}

/// Why a file was not read.
pub type Error = Note;

impl Note {
    fn new(line: u32, found: &str, text: &'static str) -> Self {
        const SHOWN: usize = 60;
        let mut short: String = found.chars().take(SHOWN).map(|c| if c.is_control() { '?' } else { c }).collect();
        if found.chars().nth(SHOWN).is_some() {
            short.push('…');
        }
        Self { line, found: short, text }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(f, "{}: {}", self.found, self.text),
            line => write!(f, "line {line}: `{}`: {}", self.found, self.text),
        }
    }
}

impl core::error::Error for Note {}

/// The kind of an object (CiA 301, Table 42).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names are the description
pub enum ObjectType {
    Null,
    Domain,
    DefType,
    DefStruct,
    Var,
    Array,
    Record,
}

/// Description of an index as a whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The index.
    pub index: u16,
    /// Name.
    pub name: String,
    /// Kind.
    pub object_type: ObjectType,
}

/// One object: an index and a sub-index that can be read or written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Object {
    /// The line of its section, or of the one that describes its array; from 1.
    pub line: u32,
    /// The index.
    pub index: u16,
    /// The sub-index.
    pub sub: u8,
    /// Own name, without that of its index; see [`Eds::name`].
    pub name: String,
    /// Name given by the system integrator (DCF); often empty.
    pub denotation: String,
    /// Data type.
    pub data_type: DataType,
    /// Access rights.
    pub access: Access,
    /// May lie in a PDO.
    pub mappable: bool,
    /// Value in a new device.
    pub default: Option<Setting>,
    /// Value in the configured device (DCF).
    pub parameter: Option<Setting>,
    /// The least value.
    pub low: Option<Setting>,
    /// The greatest value.
    pub high: Option<Setting>,
    /// ObjFlags, bit 0: a configuration tool must not write it.
    pub refuses_write: bool,
    /// ObjFlags, bit 1: a configuration tool must not read it.
    pub refuses_read: bool,
    /// The file with its contents (`DownloadFile` of a DCF); empty: none.
    pub file: String,
}

/// An EDS or a DCF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Eds {
    device: Device,
    groups: Vec<Group>,
    objects: Vec<Object>,
    warnings: Vec<Note>,
}

impl Eds {
    /// Reads a file: UTF-8, or else Latin-1.
    ///
    /// # Errors
    /// It is too long, it has no objects or too many, a line is none of the format, or a value to be configured
    /// cannot be understood.
    pub fn parse(file: &[u8]) -> Result<Self, Error> {
        if file.len() > MAX_FILE {
            return Err(Note::new(0, "the file", "longer than 4 MiB"));
        }
        let text = ini::decode(file)?;
        build::build(&ini::Ini::parse(&text)?)
    }

    /// Device that the file describes.
    #[must_use]
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// All objects, ascending.
    #[must_use]
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// One object.
    #[must_use]
    pub fn object(&self, index: u16, sub: u8) -> Option<&Object> {
        let at = self.objects.binary_search_by_key(&(index, sub), |object| (object.index, object.sub)).ok()?;
        Some(&self.objects[at])
    }

    /// All indices, ascending.
    #[must_use]
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// One index.
    #[must_use]
    pub fn group(&self, index: u16) -> Option<&Group> {
        self.groups.binary_search_by_key(&index, |group| group.index).ok().map(|at| &self.groups[at])
    }

    /// Tolerated deviations, at most [`MAX_WARNINGS`].
    #[must_use]
    pub fn warnings(&self) -> &[Note] {
        &self.warnings
    }

    /// The objects of a new device with this node id, to be served. What cannot be written has the value of the DCF,
    /// if that has one: it describes the device then.
    #[must_use]
    pub fn dictionary(&self, node: u8) -> Dictionary {
        let mut dictionary = Dictionary::new(node);
        let id = dictionary.node();
        for object in &self.objects {
            let parameter = object.parameter.as_ref().filter(|_| !object.access.writes());
            let value = parameter.or(object.default.as_ref());
            let number = |setting: &Setting| setting.number(object.data_type, id);
            let mut entry = Entry::new(
                object.index,
                object.sub,
                object.data_type,
                object.access,
                value.map_or(0, |value| value.number(object.data_type, 0)),
            );
            if value.is_some_and(Setting::is_relative) {
                entry = entry.plus_node_id();
            }
            if object.mappable {
                entry = entry.mappable();
            }
            let (low, high) = object.data_type.range();
            let limits = (object.low.as_ref().map_or(low, number), object.high.as_ref().map_or(high, number));
            let bytes = value.filter(|_| object.data_type.width().is_none()).map_or(Payload::EMPTY, |v| v.data(id));
            dictionary.add(entry.limits(limits.0, limits.1), bytes);
        }
        dictionary
    }
}
