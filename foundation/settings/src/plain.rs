//! Keys read by hand, for tables that are not declared with the macro.

use crate::reader::{Problems, Table};
use crate::tree::{Node, Value};
use std::fmt::Display;
use std::ops::RangeInclusive;

impl<'a> Table<'a> {
    /// Reads `node`, which must be a table; `path` is its name in errors, empty for a whole file.
    #[must_use]
    pub fn new(node: &'a Node, path: &str, problems: &'a Problems) -> Option<Self> {
        crate::Entry::new(path.into(), node, problems).table()
    }

    /// Rejects `item`, of the list `key`, as not `expected`.
    pub fn refuse_item(&self, key: &str, item: &Node, expected: impl Display) {
        self.problems.add_item(&item.origin, &self.name(key), format!(" = {}: expected {expected}", item.value));
    }

    fn wrong(&self, key: &str, expected: impl Display) {
        match self.map.get(key) {
            Some(Node { origin, value }) => {
                self.problems.add(origin, &self.name(key), format!(" = {value}: expected {expected}"));
            }
            None => self.refuse_missing(key, expected),
        }
    }

    /// Takes a key as it is.
    pub fn node(&mut self, key: &'static str) -> Option<&'a Node> {
        self.known.push(key);
        self.map.get(key)
    }

    /// Reads a number in `range`; an integer counts as one. Mandatory without `default`.
    pub fn number(&mut self, key: &'static str, default: Option<f64>, range: RangeInclusive<f64>) -> f64 {
        let value = match self.node(key).map(|node| &node.value) {
            Some(Value::Float(value)) => Some(*value),
            Some(Value::Integer(value)) => Some(*value as f64),
            Some(_) => None,
            None => default,
        };
        value.filter(|value| range.contains(value)).unwrap_or_else(|| {
            self.wrong(key, format_args!("a number from {} to {}", range.start(), range.end()));
            *range.start()
        })
    }

    /// Reads an integer in `range`. Mandatory without `default`.
    pub fn integer<T>(&mut self, key: &'static str, default: Option<T>, range: RangeInclusive<T>) -> T
    where
        T: TryFrom<i64> + PartialOrd + Copy + Display,
    {
        let value = match self.node(key).map(|node| &node.value) {
            Some(Value::Integer(value)) => T::try_from(*value).ok(),
            Some(_) => None,
            None => default,
        };
        value.filter(|value| range.contains(value)).unwrap_or_else(|| {
            self.wrong(key, format_args!("an integer from {} to {}", range.start(), range.end()));
            *range.start()
        })
    }

    /// Reads `true` or `false`.
    pub fn boolean(&mut self, key: &'static str, default: bool) -> bool {
        match self.node(key).map(|node| &node.value) {
            None => default,
            Some(Value::Bool(value)) => *value,
            Some(_) => {
                self.wrong(key, "true or false");
                default
            }
        }
    }

    /// Reads a text that is not empty. Mandatory without `default`.
    pub fn text(&mut self, key: &'static str, default: Option<&str>) -> String {
        match self.node(key).map(|node| &node.value) {
            Some(Value::String(value)) if !value.is_empty() => value.clone(),
            None if default.is_some() => default.unwrap_or_default().into(),
            _ => {
                self.wrong(key, "a text");
                String::new()
            }
        }
    }

    /// Reads one of the named choices. Mandatory without `default`.
    pub fn choice<T: Copy>(&mut self, key: &'static str, default: Option<T>, choices: &[(&str, T)]) -> T {
        let found = match self.node(key).map(|node| &node.value) {
            Some(Value::String(value)) => choices.iter().find(|(name, _)| name == value).map(|(_, choice)| *choice),
            Some(_) => None,
            None => default,
        };
        found.unwrap_or_else(|| {
            let names: Vec<String> = choices.iter().map(|(name, _)| format!("{name:?}")).collect();
            self.wrong(key, names.join(" or "));
            choices[0].1
        })
    }

    /// Reads a list of texts; empty if absent.
    pub fn texts(&mut self, key: &'static str) -> Vec<String> {
        let texts = match self.node(key).map(|node| &node.value) {
            None => return Vec::new(),
            Some(Value::Array(items)) => items.iter().map(text_of).collect(),
            Some(_) => None,
        };
        texts.unwrap_or_else(|| {
            self.wrong(key, "a list of texts");
            Vec::new()
        })
    }

    /// Reads a list of integers in `range`; empty if absent.
    pub fn integers(&mut self, key: &'static str, range: RangeInclusive<u16>) -> Vec<u16> {
        let number = |node: &Node| match node.value {
            Value::Integer(value) => u16::try_from(value).ok().filter(|value| range.contains(value)),
            _ => None,
        };
        let numbers = match self.node(key).map(|node| &node.value) {
            None => return Vec::new(),
            Some(Value::Array(items)) => items.iter().map(number).collect(),
            Some(_) => None,
        };
        numbers.unwrap_or_else(|| {
            self.wrong(key, format_args!("a list of integers from {} to {}", range.start(), range.end()));
            Vec::new()
        })
    }

    /// Reads a mandatory table.
    pub fn table(&mut self, key: &'static str) -> Option<Table<'a>> {
        let Some(node) = self.node(key) else {
            self.wrong(key, "a table");
            return None;
        };
        Table::new(node, &self.name(key), self.problems)
    }

    /// Reads an optional table.
    pub fn table_if_any(&mut self, key: &'static str) -> Option<Table<'a>> {
        let node = self.node(key)?;
        Table::new(node, &self.name(key), self.problems)
    }

    /// Reads all tables of a table whose keys are names chosen by the user (`can.main`), in order of the names.
    pub fn named_tables(&mut self, key: &'static str) -> Vec<(String, Table<'a>)> {
        let Some(parent) = self.table_if_any(key) else {
            return Vec::new();
        };
        let tables = parent.map.iter();
        let tables = tables
            .filter_map(|(name, node)| Some((name.clone(), Table::new(node, &parent.name(name), self.problems)?)));
        tables.collect()
    }

    /// Reads a list of tables; empty if absent.
    pub fn tables(&mut self, key: &'static str) -> Vec<Table<'a>> {
        match self.node(key).map(|node| &node.value) {
            None => Vec::new(),
            Some(Value::Array(items)) => {
                let items = items.iter().enumerate();
                let name = self.name(key);
                items.filter_map(|(n, item)| Table::new(item, &format!("{name}[{n}]"), self.problems)).collect()
            }
            Some(_) => {
                self.wrong(key, "a list of tables");
                Vec::new()
            }
        }
    }
}

fn text_of(node: &Node) -> Option<String> {
    match &node.value {
        Value::String(text) if !text.is_empty() => Some(text.clone()),
        _ => None,
    }
}
