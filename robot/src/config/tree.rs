//! TOML as a tree in which every value knows where it was written, so that an error can name file and line even after
//! several files were laid over each other.

use super::one_line;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::rc::Rc;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Where a value was written.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// A line of a file, counted from 1.
    File(Rc<str>, usize),
    /// An override on the command line.
    CommandLine,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(file, line) => write!(f, "{file}:{line}"),
            Self::CommandLine => f.write_str("--set"),
        }
    }
}

/// A value and where it was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Where.
    pub origin: Origin,
    /// What.
    pub value: Value,
}

/// What TOML can say, without dates, which no configuration of ours has.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `true`, `false`.
    Bool(bool),
    /// Decimal, `0x10`, `0b1`.
    Integer(i64),
    /// With a point or an exponent.
    Float(f64),
    /// Text.
    String(String),
    /// `[ … ]`, `[[ … ]]`.
    Array(Vec<Node>),
    /// `{ … }`, `[ … ]`.
    Table(BTreeMap<String, Node>),
}

impl fmt::Display for Value {
    /// As an error shows it: short.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            Self::Float(value) => write!(f, "{value:?}"),
            Self::String(value) => write!(f, "{value:?}"),
            Self::Array(items) => write!(f, "[{} items]", items.len()),
            Self::Table(_) => f.write_str("{table}"),
        }
    }
}

impl Node {
    /// The tree of a file's text; else what is wrong with its syntax, a line each.
    pub fn parse(path: &Path, text: &str) -> Result<Self, Vec<String>> {
        let source = Source { file: path.display().to_string().into(), text };
        let (table, errors) = DeTable::parse_recoverable(text);
        let mut problems: Vec<String> = errors
            .iter()
            .map(|error| format!("{}: {}", source.origin(error.span().map_or(0, |span| span.start)), error.message()))
            .collect();
        let root = source.table(table.get_ref(), 0, &mut problems);
        if problems.is_empty() { Ok(root) } else { Err(problems.into_iter().map(one_line).collect()) }
    }

    /// Lays `over` over this: tables merge key by key, everything else is replaced.
    pub fn merge(&mut self, over: Self) {
        match (&mut self.value, over.value) {
            (Value::Table(base), Value::Table(over)) => {
                for (key, node) in over {
                    match base.get_mut(&key) {
                        Some(old) => old.merge(node),
                        None => drop(base.insert(key, node)),
                    }
                }
            }
            (_, value) => *self = Self { origin: over.origin, value },
        }
    }

    /// Applies one `--set table.key=value`. The value is TOML; what is not counts as a string. A part of the key may
    /// be an item of an array: its `name`, or its place from 0.
    pub fn set(&mut self, assignment: &str) -> Result<(), String> {
        self.assign(assignment).map_err(one_line)
    }

    fn assign(&mut self, assignment: &str) -> Result<(), String> {
        let malformed = || format!("--set {assignment}: expected table.key=value");
        let (path, text) = assignment.split_once('=').ok_or_else(malformed)?;
        let (path, text) = (path.trim(), text.trim());
        if path.split('.').any(str::is_empty) {
            return Err(malformed());
        }
        let source = Source { file: "--set".into(), text };
        let mut problems = Vec::new();
        let value = match DeValue::parse(text) {
            Ok(value) => source.value(value.get_ref(), &mut problems).unwrap_or(Value::String(text.into())),
            Err(_) => Value::String(text.into()),
        };
        let mut node = self;
        for part in path.split('.') {
            let table = || Self { origin: Origin::CommandLine, value: Value::Table(BTreeMap::new()) };
            node = match &mut node.value {
                Value::Table(map) => map.entry(part.into()).or_insert_with(table),
                Value::Array(items) => {
                    let count = items.len();
                    let place = items.iter().position(|item| item.is_named(part)).or_else(|| part.parse().ok());
                    let item = place.and_then(|place| items.get_mut(place));
                    item.ok_or_else(|| format!("--set {assignment}: {part} is none of the {count} items"))?
                }
                other => return Err(format!("--set {assignment}: {other} has no key {part}")),
            };
        }
        let mut over = Self { origin: Origin::CommandLine, value };
        over.came_from_command_line();
        node.merge(over);
        Ok(())
    }

    fn is_named(&self, name: &str) -> bool {
        let Value::Table(map) = &self.value else {
            return false;
        };
        map.get("name").is_some_and(|node| matches!(&node.value, Value::String(own) if own == name))
    }

    fn came_from_command_line(&mut self) {
        self.origin = Origin::CommandLine;
        match &mut self.value {
            Value::Array(items) => items.iter_mut().for_each(Self::came_from_command_line),
            Value::Table(map) => map.values_mut().for_each(Self::came_from_command_line),
            _ => {}
        }
    }
}

/// A text and its name, to make origins of spans.
struct Source<'a> {
    file: Rc<str>,
    text: &'a str,
}

impl Source<'_> {
    fn origin(&self, at: usize) -> Origin {
        let before = &self.text.as_bytes()[..at.min(self.text.len())];
        Origin::File(self.file.clone(), 1 + before.iter().filter(|byte| **byte == b'\n').count())
    }

    fn table(&self, table: &DeTable<'_>, at: usize, problems: &mut Vec<String>) -> Node {
        let entries = table.iter().filter_map(|(key, value)| {
            // The key's line, not the value's: for a multi-line array that is where people look.
            let origin = self.origin(key.span().start);
            let value = self.node(value, problems)?;
            Some((key.get_ref().to_string(), Node { origin, ..value }))
        });
        Node { value: Value::Table(entries.collect()), origin: self.origin(at) }
    }

    fn node(&self, value: &Spanned<DeValue<'_>>, problems: &mut Vec<String>) -> Option<Node> {
        let origin = self.origin(value.span().start);
        match self.value(value.get_ref(), problems) {
            Ok(value) => Some(Node { origin, value }),
            Err(problem) => {
                problems.push(format!("{origin}: {problem}"));
                None
            }
        }
    }

    fn value(&self, value: &DeValue<'_>, problems: &mut Vec<String>) -> Result<Value, String> {
        Ok(match value {
            DeValue::Boolean(value) => Value::Bool(*value),
            DeValue::String(value) => Value::String(value.to_string()),
            DeValue::Integer(value) => Value::Integer(
                i64::from_str_radix(value.as_str(), value.radix())
                    .map_err(|_| format!("{value}: expected an integer of at most 64 bits"))?,
            ),
            DeValue::Float(value) => {
                Value::Float(value.as_str().parse().map_err(|_| format!("{value}: expected a number"))?)
            }
            DeValue::Datetime(value) => return Err(format!("{value}: no key takes a date")),
            DeValue::Array(items) => Value::Array(items.iter().filter_map(|item| self.node(item, problems)).collect()),
            DeValue::Table(table) => self.table(table, 0, problems).value,
        })
    }
}
