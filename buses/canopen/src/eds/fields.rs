//! One section that describes an object, line by line.

use super::ini::{Ini, Line, Section};
use super::number::{number, setting};
use super::{Error, MAX_NAME, MAX_WARNINGS, Note, Object, ObjectType, Setting};
use crate::Payload;
use crate::dictionary::{Access, DataType};
use alloc::string::String;
use alloc::vec::Vec;

/// The first `len` bytes of a text, or a few less where a character would be split.
pub(super) fn cut(text: &str, len: usize) -> &str {
    let end = (0..=len.min(text.len())).rev().find(|at| text.is_char_boundary(*at));
    &text[..end.unwrap_or(0)]
}

/// The warnings so far.
#[derive(Default)]
pub(super) struct Notes(pub(super) Vec<Note>);

impl Notes {
    pub(super) fn push(&mut self, line: &Line<'_>, text: &'static str) {
        self.at(line.number, line.value, text);
    }

    pub(super) fn at(&mut self, number: u32, found: &str, text: &'static str) {
        if self.0.len() < MAX_WARNINGS {
            self.0.push(Note::new(number, found, text));
        }
    }

    /// A value as a name.
    pub(super) fn name(&mut self, line: &Line<'_>) -> String {
        let name = cut(line.value, MAX_NAME);
        if name.len() < line.value.len() {
            self.push(line, "a name this long is cut off");
        }
        String::from(name)
    }
}

#[derive(Clone, Copy)]
pub(super) enum Key {
    Name,
    ObjectType,
    DataType,
    Access,
    Default,
    Parameter,
    Low,
    High,
    Mapping,
    Flags,
    Compact,
    Denotation,
    File,
}

const KEYS: [&str; 13] = [
    "parametername",
    "objecttype",
    "datatype",
    "accesstype",
    "defaultvalue",
    "parametervalue",
    "lowlimit",
    "highlimit",
    "pdomapping",
    "objflags",
    "compactsubobj",
    "denotation",
    "downloadfile",
];

/// The lines of one section that mean something here.
pub(super) struct Fields<'a> {
    pub(super) number: u32,
    pub(super) title: &'a str,
    lines: [Option<Line<'a>>; KEYS.len()],
}

impl<'a> Fields<'a> {
    pub(super) fn read(ini: &Ini<'a>, section: &Section<'a>, notes: &mut Notes) -> Self {
        let mut lines = [None; KEYS.len()];
        for line in ini.lines(section) {
            if let Some(at) = KEYS.iter().position(|key| line.is(key)) {
                match lines[at] {
                    Some(_) => notes.push(line, "a second value; the first one counts"),
                    None => lines[at] = Some(*line),
                }
            }
        }
        Self { number: section.number, title: section.name, lines }
    }

    /// Fields of a section without any of these keys.
    pub(super) fn nothing(section: &Section<'a>) -> Self {
        Self { number: section.number, title: section.name, lines: [None; KEYS.len()] }
    }

    /// The line of a key that has a value.
    fn get(&self, key: Key) -> Option<&Line<'a>> {
        self.lines[key as usize].as_ref().filter(|line| !line.value.is_empty())
    }

    pub(super) fn name(&self, key: Key, notes: &mut Notes) -> String {
        self.get(key).map_or_else(String::new, |line| notes.name(line))
    }

    pub(super) fn number(&self, key: Key, notes: &mut Notes) -> Option<i128> {
        let line = self.get(key)?;
        match number(line.value) {
            Ok((number, note)) => {
                note.into_iter().for_each(|note| notes.push(line, note));
                Some(number.value)
            }
            Err(_) => {
                notes.push(line, "expected a number; left out");
                None
            }
        }
    }

    pub(super) fn object_type(&self, notes: &mut Notes) -> Option<ObjectType> {
        let code = self.number(Key::ObjectType, notes)?;
        Some(match code {
            0 => ObjectType::Null,
            2 => ObjectType::Domain,
            5 => ObjectType::DefType,
            6 => ObjectType::DefStruct,
            7 => ObjectType::Var,
            8 => ObjectType::Array,
            9 => ObjectType::Record,
            _ => {
                notes.at(self.number, self.title, "no object type of CiA 301; left out");
                return None;
            }
        })
    }

    /// Data type, and true if the file has it.
    fn data_type(&self, is_domain: bool, notes: &mut Notes) -> (DataType, bool) {
        let code = self.number(Key::DataType, notes).and_then(|code| u16::try_from(code).ok());
        match code.and_then(DataType::from_code) {
            Some(data_type) => (data_type, true),
            None if is_domain && self.get(Key::DataType).is_none() => (DataType::Domain, true),
            None => {
                notes.at(self.number, self.title, "no data type of CiA 301; taken as DOMAIN");
                (DataType::Domain, false)
            }
        }
    }

    fn access(&self, is_domain: bool, notes: &mut Notes) -> Access {
        let written = self.get(Key::Access).map_or("", |line| line.value);
        let all = [
            ("ro", Access::ReadOnly),
            ("wo", Access::WriteOnly),
            ("rw", Access::ReadWrite),
            ("rwr", Access::ReadWriteTransmit),
            ("rww", Access::ReadWriteReceive),
            ("const", Access::Const),
        ];
        let access = all.iter().find(|(word, _)| word.eq_ignore_ascii_case(written));
        match access {
            Some((_, access)) => *access,
            None if is_domain && written.is_empty() => Access::ReadWrite,
            None => {
                notes.at(self.number, self.title, "no AccessType of CiA 306; taken as ro");
                Access::ReadOnly
            }
        }
    }

    /// Default value; an invalid one is left out.
    fn default(&self, data_type: DataType, is_known: bool, notes: &mut Notes) -> Option<Setting> {
        let line = self.get(Key::Default).filter(|_| is_known)?;
        match (setting(line.value, data_type), data_type) {
            (Ok((setting, note)), _) => {
                note.into_iter().for_each(|note| notes.push(line, note));
                Some(setting)
            }
            (Err(_), DataType::Octets | DataType::Domain) => {
                notes.push(line, "not hexadecimal bytes; taken as text");
                Some(Setting::fixed(Payload::from(line.value.as_bytes())))
            }
            (Err(_), _) => {
                notes.push(line, "not a value of its data type; no default is taken");
                None
            }
        }
    }

    fn limits(&self, data_type: DataType, notes: &mut Notes) -> (Option<Setting>, Option<Setting>) {
        let mut limit = |key| {
            let line = self.get(key).filter(|_| data_type.width().is_some())?;
            let limit = setting(line.value, data_type);
            if limit.is_err() {
                notes.push(line, "not a value of its data type; no limit is taken");
            }
            limit.ok().map(|(limit, _)| limit)
        };
        let (low, high) = (limit(Key::Low), limit(Key::High));
        let both = low.as_ref().zip(high.as_ref());
        if both.is_some_and(|(low, high)| !data_type.at_most(low.number(data_type, 1), high.number(data_type, 1))) {
            notes.at(self.number, self.title, "its LowLimit is above its HighLimit; neither is taken");
            return (None, None);
        }
        (low, high)
    }
}

/// Value to be configured; never guessed.
pub(super) fn parameter(
    line: &Line<'_>,
    data_type: DataType,
    is_known: bool,
    notes: &mut Notes,
) -> Result<Setting, Error> {
    let error = |text| Note::new(line.number, line.value, text);
    if !is_known {
        return Err(error("a value to be configured, but no data type of CiA 301"));
    }
    let (setting, note) = setting(line.value, data_type).map_err(|_| error("expected a value of its data type"))?;
    note.into_iter().for_each(|note| notes.push(line, note));
    Ok(setting)
}

pub(super) fn object(fields: &Fields<'_>, (index, sub): (u16, u8), notes: &mut Notes) -> Result<Object, Error> {
    let is_domain = matches!(fields.number(Key::ObjectType, &mut Notes::default()), Some(2));
    let (data_type, is_known) = fields.data_type(is_domain, notes);
    let (low, high) = fields.limits(data_type, notes);
    let flags = fields.number(Key::Flags, notes).unwrap_or(0);
    let parameter = fields.get(Key::Parameter).map(|line| parameter(line, data_type, is_known, notes));
    Ok(Object {
        line: fields.number,
        index,
        sub,
        name: fields.name(Key::Name, notes),
        denotation: fields.name(Key::Denotation, notes),
        data_type,
        access: fields.access(is_domain, notes),
        mappable: fields.number(Key::Mapping, notes).is_some_and(|value| value != 0),
        default: fields.default(data_type, is_known, notes),
        parameter: parameter.transpose()?,
        low,
        high,
        refuses_write: flags & 1 != 0,
        refuses_read: flags & 2 != 0,
        file: fields.name(Key::File, notes),
    })
}
