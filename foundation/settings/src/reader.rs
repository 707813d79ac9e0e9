//! Strict reader: every known key is checked, every unknown key is an error, and all errors are collected before the
//! file is rejected.

use crate::declare::Section;
use crate::one_line;
use crate::rule::Rule;
use crate::tree::{Node, Origin, Value};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Display;

const NO_KEYS: &BTreeMap<String, Node> = &BTreeMap::new();

/// Errors so far; only the first one of each key.
#[derive(Debug, Default)]
pub struct Problems(RefCell<Vec<(Origin, String, String)>>);

impl Problems {
    /// Adds an error of the key `name` at `origin`: `: unknown key`, ` = 3: expected …`.
    pub fn add(&self, origin: &Origin, name: &str, what: String) {
        if !self.has(origin, name) {
            self.add_item(origin, name, what);
        }
    }

    /// Adds an error of a list item without a name.
    pub fn add_item(&self, origin: &Origin, name: &str, what: String) {
        self.0.borrow_mut().push((origin.clone(), name.into(), what));
    }

    fn has(&self, origin: &Origin, name: &str) -> bool {
        self.0.borrow().iter().any(|(at, noted, _)| noted == name && at == origin)
    }

    /// One line each, in the order of the file.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut found = self.0.borrow().clone();
        found.sort_by(|a, b| a.0.cmp(&b.0));
        found.into_iter().map(|(origin, name, what)| one_line(format!("{origin}: {name}{what}"))).collect()
    }
}

/// Value of a key, with the destination of errors about it.
#[derive(Debug)]
pub struct Entry<'a> {
    /// Name of the key with those of its tables: `rs485.a.nodes[0].address`.
    pub name: String,
    /// Last part of the name.
    pub title: &'a str,
    /// Value.
    pub node: &'a Node,
    problems: &'a Problems,
}

impl<'a> Entry<'a> {
    /// Rejects the value as not `expected`.
    pub fn refuse(&self, expected: impl Display) {
        let what = format!(" = {}: expected {expected}", self.node.value);
        self.problems.add(&self.node.origin, &self.name, what);
    }

    /// Value as a table; anything else is rejected.
    #[must_use]
    pub fn table(&self) -> Option<Table<'a>> {
        let Value::Table(map) = &self.node.value else {
            self.refuse("a table");
            return None;
        };
        let (path, title) = (self.name.clone(), self.title);
        Some(Table { path, title, origin: &self.node.origin, map, known: Vec::new(), problems: self.problems })
    }

    /// Item `n` of a list.
    #[must_use]
    pub fn item(&self, n: usize) -> Option<Entry<'a>> {
        let Value::Array(items) = &self.node.value else { return None };
        let name = format!("{}[{n}]", self.name);
        Some(Entry { name, title: self.title, node: items.get(n)?, problems: self.problems })
    }
}

/// Table being read. Each key that is taken is known; [`Table::end`] rejects the others.
///
/// A method that finds an error records it and returns a value in range, so that reading continues.
#[derive(Debug)]
pub struct Table<'a> {
    path: String,
    title: &'a str,
    origin: &'a Origin,
    pub(crate) map: &'a BTreeMap<String, Node>,
    pub(crate) known: Vec<&'static str>,
    pub(crate) problems: &'a Problems,
}

impl<'a> Table<'a> {
    /// Table of a whole file; anything else is rejected.
    #[must_use]
    pub fn root(node: &'a Node, problems: &'a Problems) -> Option<Self> {
        Entry { name: String::new(), title: "", node, problems }.table()
    }

    /// Table without keys.
    #[must_use]
    pub fn empty(origin: &'a Origin, problems: &'a Problems) -> Self {
        Self { path: String::new(), title: "", origin, map: NO_KEYS, known: Vec::new(), problems }
    }

    /// Last part of the name: `main` for `[can.main]`.
    #[must_use]
    pub fn title(&self) -> String {
        self.title.into()
    }

    /// True if the table has this key.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        self.map.contains_key(key)
    }

    /// True if the key is present and without an error so far.
    #[must_use]
    pub fn is_good(&self, key: &str) -> bool {
        self.map.get(key).is_some_and(|node| !self.problems.has(&node.origin, &self.name(key)))
    }

    /// True if the value of the key is from the command line, not from a file.
    #[must_use]
    pub fn is_set(&self, key: &str) -> bool {
        self.map.get(key).is_some_and(|node| node.origin == Origin::CommandLine)
    }

    /// Rejects the value of `key` as not `expected`; no effect if the key is absent.
    pub fn refuse(&self, key: &str, expected: impl Display) {
        if let Some(entry) = self.entry(key) {
            entry.refuse(expected);
        }
    }

    /// Records that the mandatory `key` is absent.
    pub fn refuse_missing(&self, key: &str, expected: impl Display) {
        self.problems.add(self.origin, &self.name(key), format!(": missing, expected {expected}"));
    }

    /// Rejects `key` in each table of the list `list` whose value is a duplicate.
    pub fn unique<T: PartialEq>(&self, list: &str, key: &str, values: &[T], expected: impl Display) {
        let items: Vec<_> = (0..values.len()).map(|n| self.item(list, n)).collect();
        let good = |n: usize| items[n].as_ref().is_some_and(|item| !item.has(key) || item.is_good(key));
        for (n, value) in values.iter().enumerate() {
            if good(n) && (0..n).any(|other| values[other] == *value && good(other)) {
                items[n].iter().for_each(|item| item.refuse(key, &expected));
            }
        }
    }

    /// Table `key` once more, for checks against other tables; `None` if there is no such table.
    #[must_use]
    pub fn below(&self, key: &str) -> Option<Table<'a>> {
        let entry = self.entry(key)?;
        matches!(entry.node.value, Value::Table(_)).then(|| entry.table())?
    }

    /// Table `n` of the list `list` once more.
    #[must_use]
    pub fn item(&self, list: &str, n: usize) -> Option<Table<'a>> {
        let item = self.entry(list)?.item(n)?;
        matches!(item.node.value, Value::Table(_)).then(|| item.table())?
    }

    /// Name of a key of this table in errors.
    pub(crate) fn name(&self, key: &str) -> String {
        if self.path.is_empty() { key.into() } else { format!("{}.{key}", self.path) }
    }

    fn entry(&self, key: &str) -> Option<Entry<'a>> {
        let (title, node) = self.map.get_key_value(key)?;
        Some(Entry { name: self.name(key), title, node, problems: self.problems })
    }

    fn take(&mut self, key: &'static str) -> Option<Entry<'a>> {
        self.known.push(key);
        self.entry(key)
    }

    /// Reads a mandatory key.
    pub fn required<T>(&mut self, key: &'static str, rule: &impl Rule<T>) -> T {
        let Some(entry) = self.take(key) else {
            self.refuse_missing(key, rule.expected());
            return rule.stand_in();
        };
        rule.read(&entry).unwrap_or_else(|| rule.stand_in())
    }

    /// Reads an optional key.
    pub fn optional<T>(&mut self, key: &'static str, rule: &impl Rule<T>) -> Option<T> {
        let entry = self.take(key)?;
        Some(rule.read(&entry).unwrap_or_else(|| rule.stand_in()))
    }

    /// Reads a key with a default.
    pub fn default<T>(&mut self, key: &'static str, default: T, rule: &impl Rule<T>) -> T {
        self.optional(key, rule).unwrap_or(default)
    }

    /// Reads a table whose keys have their defaults if it is absent.
    pub fn inner<T: Section>(&mut self, key: &'static str) -> T {
        let missing = Table { path: self.name(key), map: NO_KEYS, known: Vec::new(), ..*self };
        let table = match self.take(key) {
            Some(entry) => entry.table().unwrap_or(missing),
            None => missing,
        };
        table.whole()
    }

    /// Reads all tables of a table whose keys are names chosen by the user (`can.main`), in order of the names.
    pub fn named<T: Section>(&mut self, key: &'static str) -> Vec<T> {
        let Some(parent) = self.take(key).and_then(|entry| entry.table()) else {
            return Vec::new();
        };
        let tables = parent.map.keys().filter_map(|name| parent.entry(name)?.table());
        tables.map(Table::whole).collect()
    }

    /// Reads a section, and rejects all other keys.
    #[must_use]
    pub fn whole<T: Section>(mut self) -> T {
        let section = T::read(&mut self);
        self.end();
        section
    }

    /// Rejects every key that was not taken.
    pub fn end(self) {
        for (key, node) in self.map {
            if !self.known.contains(&key.as_str()) {
                let known = self.known.join(", ");
                self.problems.add(&node.origin, &self.name(key), format!(": unknown key, expected one of {known}"));
            }
        }
    }
}
