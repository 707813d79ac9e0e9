//! From lines to objects.

use super::fields::{Fields, Key, Notes, cut, object, parameter};
use super::ini::{Ini, Section};
use super::number::number;
use super::{Device, Eds, Error, Group, MAX_NAME, MAX_OBJECTS, Note, Object, ObjectType, Setting};
use crate::Payload;
use crate::dictionary::{Access, DataType};
use alloc::collections::{BTreeMap, BTreeSet};
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

/// Kind of a section of an object dictionary.
enum Part {
    Head,
    Sub(u8),
    Names,
    Values,
    Denotations,
}

/// `1018`, `1018sub1` (hexadecimal), `1003Name`, …
fn part(name: &str) -> Option<(u16, Part)> {
    let (index, rest) = name.split_at_checked(4)?;
    let hex = |text: &str| text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let index = hex(index).then(|| u16::from_str_radix(index, 16).ok()).flatten()?;
    let rest = rest.trim();
    let part = match rest.get(..3) {
        _ if rest.is_empty() => Part::Head,
        Some(sub) if sub.eq_ignore_ascii_case("sub") => {
            let digits = rest[3..].trim();
            Part::Sub(hex(digits).then(|| u8::from_str_radix(digits, 16).ok()).flatten()?)
        }
        _ if rest.eq_ignore_ascii_case("name") => Part::Names,
        _ if rest.eq_ignore_ascii_case("value") => Part::Values,
        _ if rest.eq_ignore_ascii_case("denotation") => Part::Denotations,
        _ => return None,
    };
    Some((index, part))
}

/// The sections of one index.
#[derive(Default)]
struct Parts<'a> {
    head: Option<&'a Section<'a>>,
    subs: BTreeMap<u8, &'a Section<'a>>,
    names: Option<&'a Section<'a>>,
    values: Option<&'a Section<'a>>,
    denotations: Option<&'a Section<'a>>,
}

struct Builder<'a, 'b> {
    ini: &'b Ini<'a>,
    notes: Notes,
    groups: Vec<Group>,
    objects: Vec<Object>,
}

pub(super) fn build(ini: &Ini<'_>) -> Result<Eds, Error> {
    let mut notes = Notes::default();
    let device = Device::read(ini, &mut notes);
    if let Some(section) = ini.section("supportedmodules") {
        notes.at(section.number, section.name, "modules are not read");
    }
    let mut parts = BTreeMap::<u16, Parts<'_>>::new();
    for section in &ini.sections {
        let Some((index, part)) = part(section.name) else {
            continue;
        };
        let parts = parts.entry(index).or_default();
        let before = match part {
            Part::Sub(sub) => parts.subs.insert(sub, section),
            Part::Head => parts.head.replace(section),
            Part::Names => parts.names.replace(section),
            Part::Values => parts.values.replace(section),
            Part::Denotations => parts.denotations.replace(section),
        };
        if before.is_some() {
            return Err(Note::new(section.number, section.name, "a second section of this name"));
        }
    }
    let mut builder = Builder { ini, notes, groups: Vec::new(), objects: Vec::new() };
    builder.compare_lists(&parts);
    for (index, parts) in &parts {
        builder.group(*index, parts)?;
    }
    if builder.objects.is_empty() {
        return Err(Note::new(0, "the file", "describes no object"));
    }
    let Builder { notes, groups, objects, .. } = builder;
    Ok(Eds { device, groups, objects, warnings: notes.0 })
}

impl<'a> Builder<'a, '_> {
    /// The three lists against what is described.
    fn compare_lists(&mut self, parts: &BTreeMap<u16, Parts<'_>>) {
        let mut listed = BTreeSet::new();
        for name in ["mandatoryobjects", "optionalobjects", "manufacturerobjects"] {
            let Some(section) = self.ini.section(name) else {
                continue;
            };
            for line in self.ini.lines(section).iter().filter(|line| !line.is("supportedobjects")) {
                match number(line.value).ok().and_then(|(number, _)| u16::try_from(number.value).ok()) {
                    Some(index) if parts.contains_key(&index) => drop(listed.insert(index)),
                    Some(_) => self.notes.push(line, "listed, but not described"),
                    None => self.notes.push(line, "expected an index"),
                }
            }
        }
        let heads = parts.iter().filter(|(index, _)| **index >= 0x1000 && !listed.contains(*index));
        for section in heads.filter_map(|(_, parts)| parts.head) {
            self.notes.at(section.number, section.name, "described, but not listed");
        }
    }

    fn group(&mut self, index: u16, parts: &Parts<'a>) -> Result<(), Error> {
        let Some(head) = parts.head.or(parts.subs.values().next().copied()) else {
            return Ok(()); // names of nothing
        };
        let fields = if parts.head.is_some() {
            Fields::read(self.ini, head, &mut self.notes)
        } else {
            self.notes.at(head.number, head.name, "its index has no section of its own");
            Fields::nothing(head)
        };
        let mut quiet = Notes::default();
        let compact = fields.number(Key::Compact, &mut self.notes).unwrap_or(0);
        let has_subs = !parts.subs.is_empty() || compact > 0;
        let said = fields.object_type(&mut self.notes);
        let object_type = match said.unwrap_or(if has_subs { ObjectType::Record } else { ObjectType::Var }) {
            ObjectType::Var | ObjectType::Domain | ObjectType::Null if has_subs => {
                self.notes.at(head.number, head.name, "has sub-indices; taken as a record");
                ObjectType::Record
            }
            object_type => object_type,
        };
        // True if an object of this section repeats the attribute.
        let again = compact > 0 || matches!(object_type, ObjectType::Var | ObjectType::Domain);
        let name = fields.name(Key::Name, if again { &mut quiet } else { &mut self.notes });
        self.groups.push(Group { index, name, object_type });
        match object_type {
            ObjectType::Var | ObjectType::Domain => {
                let object = object(&fields, (index, 0), &mut self.notes)?;
                return self.push(object, head.number);
            }
            ObjectType::Array | ObjectType::Record if !has_subs => {
                self.notes.at(head.number, head.name, "has no sub-indices");
            }
            _ => {}
        }
        // Explicit subs replace those of the compact form.
        let mut all = BTreeMap::new();
        if compact > 0 {
            let compact = u8::try_from(compact).ok().filter(|count| *count < u8::MAX);
            let error = || Note::new(head.number, head.name, "CompactSubObj: expected 1 to 254");
            let objects = self.compact(&fields, index, compact.ok_or_else(error)?, parts)?;
            all.extend(objects.into_iter().map(|object| (object.sub, object)));
        }
        for (sub, section) in &parts.subs {
            let fields = Fields::read(self.ini, section, &mut self.notes);
            all.insert(*sub, object(&fields, (index, *sub), &mut self.notes)?);
        }
        all.into_values().try_for_each(|object| self.push(object, head.number))
    }

    fn push(&mut self, object: Object, line: u32) -> Result<(), Error> {
        if self.objects.len() == MAX_OBJECTS {
            return Err(Note::new(line, &object.name, "more than 65536 objects"));
        }
        self.objects.push(object);
        Ok(())
    }

    /// An array described by its index alone, with names, values and denotations of its elements apart.
    fn compact(&mut self, head: &Fields<'a>, index: u16, count: u8, parts: &Parts<'a>) -> Result<Vec<Object>, Error> {
        let mut template = object(head, (index, 1), &mut self.notes)?;
        if template.default.as_ref().is_some_and(|default| default.data(1).len() > 8) {
            self.notes.at(head.number, head.title, "a long default for each element is left out");
            template.default = None;
        }
        template.parameter = None;
        template.file.clear();
        // Entries of the error history and of mappings are writable; elsewhere sub-index 0 is the number of entries.
        let is_written = matches!(index, 0x1003 | 0x1600..=0x17FF | 0x1A00..=0x1BFF) && template.access.writes();
        let number = Object {
            sub: 0,
            name: String::from("NrOfObjects"),
            denotation: String::new(),
            data_type: DataType::U8,
            access: if is_written { Access::ReadWrite } else { Access::ReadOnly },
            mappable: false,
            default: Some(Setting::fixed(Payload::from(count))),
            low: None,
            high: None,
            ..template.clone()
        };
        let stem = cut(&template.name, MAX_NAME - 3);
        let element = |sub| Object { sub, name: format!("{stem}{sub}"), ..template.clone() };
        let mut objects: Vec<Object> = core::iter::once(number).chain((1..=count).map(element)).collect();
        for (section, key) in
            [(parts.names, Key::Name), (parts.values, Key::Parameter), (parts.denotations, Key::Denotation)]
        {
            let lines = section.map_or(&[][..], |section| self.ini.lines(section));
            for line in lines.iter().filter(|line| !line.is("nrofentries") && !line.value.is_empty()) {
                let Some(object) = line.key.parse().ok().and_then(|sub: usize| objects.get_mut(sub)) else {
                    self.notes.push(line, "no such element; left out");
                    continue;
                };
                match key {
                    Key::Parameter => {
                        let value = parameter(line, object.data_type, true, &mut self.notes)?;
                        object.parameter = Some(value);
                    }
                    Key::Denotation => object.denotation = self.notes.name(line),
                    _ => object.name = self.notes.name(line),
                }
            }
        }
        Ok(objects)
    }
}
