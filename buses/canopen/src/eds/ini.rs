//! The lines of the file: sections, `key=value`, comments.

use super::{Error, Note};
use alloc::borrow::Cow;
use alloc::string::String;
use alloc::vec::Vec;
use core::ops::Range;

/// A file as text. Old editors leave a byte order mark at its beginning, or the end-of-file character of DOS.
pub(super) fn decode(file: &[u8]) -> Result<Cow<'_, str>, Error> {
    let file = file.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(file);
    if file.contains(&0) {
        return Err(Note::new(0, "the file", "expected text in UTF-8 or Latin-1"));
    }
    Ok(match core::str::from_utf8(file) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(file.iter().map(|byte| char::from(*byte)).collect::<String>()),
    })
}

/// A line `key=value`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line<'a> {
    pub(super) number: u32,
    pub(super) key: &'a str,
    pub(super) value: &'a str,
}

impl Line<'_> {
    /// True if the key is `key`, given in lower case: vendors vary capitals and put spaces between words.
    pub(super) fn is(&self, key: &str) -> bool {
        same_word(self.key, key)
    }
}

fn same_word(written: &str, word: &str) -> bool {
    let letters = written.bytes().filter(|byte| *byte != b' ');
    letters.map(|byte| byte.to_ascii_lowercase()).eq(word.bytes())
}

/// A section: its name as written, and where its lines are.
#[derive(Clone, Debug)]
pub(super) struct Section<'a> {
    pub(super) number: u32,
    pub(super) name: &'a str,
    lines: Range<usize>,
}

/// All sections of a file.
#[derive(Debug)]
pub(super) struct Ini<'a> {
    lines: Vec<Line<'a>>,
    pub(super) sections: Vec<Section<'a>>,
}

impl<'a> Ini<'a> {
    pub(super) fn parse(text: &'a str) -> Result<Self, Error> {
        let mut ini = Self { lines: Vec::new(), sections: Vec::new() };
        for (number, line) in (1..).zip(text.lines()) {
            let line = line.trim_matches(|c: char| c.is_whitespace() || c == '\x1A');
            if line.is_empty() || line.starts_with([';', '#']) {
                continue;
            }
            let end = ini.lines.len();
            if let Some(name) = line.strip_prefix('[') {
                let name = name.split_once(']').ok_or_else(|| Note::new(number, line, "expected `]`"))?.0.trim();
                ini.sections.push(Section { number, name, lines: end..end });
                continue;
            }
            let section = ini.sections.last_mut();
            let section = section.ok_or_else(|| Note::new(number, line, "expected a [section] first"))?;
            let (key, value) = line
                .split_once('=')
                .ok_or_else(|| Note::new(number, line, "expected key=value, a [section] or a ; comment"))?;
            ini.lines.push(Line { number, key: key.trim(), value: value.trim() });
            section.lines.end = end + 1;
        }
        Ok(ini)
    }

    pub(super) fn lines(&self, section: &Section<'_>) -> &[Line<'a>] {
        &self.lines[section.lines.clone()]
    }

    /// The first section with this name, given in lower case.
    pub(super) fn section(&self, name: &str) -> Option<&Section<'a>> {
        self.sections.iter().find(|section| same_word(section.name, name))
    }
}
