//! TOML as a tree in which every value has its location, so that an error can name file and line even after several
//! files were merged.

use crate::one_line;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::rc::Rc;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Location of a value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// Line of a file, from 1.
    File(Rc<str>, usize),
    /// Override on the command line.
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

/// Value with its location.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Location.
    pub origin: Origin,
    /// Value.
    pub value: Value,
}

/// TOML value, without dates, which no key accepts.
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

impl Value {
    /// The value as a number; an integer counts as one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Float(value) => Some(*value),
            Self::Integer(value) => Some(*value as f64),
            _ => None,
        }
    }
}

impl fmt::Display for Value {
    /// Short form for errors.
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
    /// Parses the text of a file.
    ///
    /// # Errors
    /// One line for each syntax error.
    pub fn parse(path: &Path, text: &str) -> Result<Self, Vec<String>> {
        let source = Source::new(path.display().to_string(), text);
        let (table, errors) = DeTable::parse_recoverable(text);
        let mut problems: Vec<String> = errors
            .iter()
            .map(|error| format!("{}: {}", source.origin(error.span().map_or(0, |span| span.start)), error.message()))
            .collect();
        let root = source.table(table.get_ref(), 0, &mut problems);
        if problems.is_empty() { Ok(root) } else { Err(problems.into_iter().map(one_line).collect()) }
    }

    /// Value of a key of this table; `None` without one, and of what is no table.
    #[must_use]
    pub fn below(&self, key: &str) -> Option<&Self> {
        match &self.value {
            Value::Table(map) => map.get(key),
            _ => None,
        }
    }

    /// Merges `over` into this: tables key by key, everything else is replaced.
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

    /// Splits an override `table.key=value`. The value is TOML; otherwise it is taken as a string.
    ///
    /// # Errors
    /// The text is not an assignment to a key.
    pub fn assignment(text: &str) -> Result<(Vec<&str>, Self), String> {
        let malformed = || format!("--set {text}: expected table.key=value");
        let (path, value) = text.split_once('=').ok_or_else(malformed)?;
        let path: Vec<&str> = path.trim().split('.').collect();
        if path.contains(&"") {
            return Err(malformed());
        }
        let text = value.trim();
        let source = Source::new("--set", text);
        let value = match DeValue::parse(text) {
            Ok(value) => source.value(value.get_ref(), &mut Vec::new()).unwrap_or(Value::String(text.into())),
            Err(_) => Value::String(text.into()),
        };
        let mut node = Self { origin: Origin::CommandLine, value };
        node.came_from_command_line();
        Ok((path, node))
    }

    /// Applies an override: [`Self::assignment`], then [`Self::put`].
    ///
    /// # Errors
    /// Those of the two.
    pub fn set(&mut self, assignment: &str) -> Result<(), String> {
        let set = |(path, value): (Vec<&str>, Self)| {
            self.put(&path, value).map_err(|why| format!("--set {assignment}: {why}"))
        };
        Self::assignment(assignment).and_then(set).map_err(one_line)
    }

    /// Merges `value` into the node at `path`. A step may be an item of an array: its `name`, or its index from 0.
    ///
    /// # Errors
    /// A step leads to a value without keys.
    pub fn put(&mut self, path: &[&str], value: Self) -> Result<(), String> {
        let mut node = self;
        for step in path {
            let table = || Self { origin: Origin::CommandLine, value: Value::Table(BTreeMap::new()) };
            node = match &mut node.value {
                Value::Table(map) => map.entry((*step).into()).or_insert_with(table),
                Value::Array(items) => {
                    let count = items.len();
                    let place = items.iter().position(|item| item.is_named(step)).or_else(|| step.parse().ok());
                    let item = place.and_then(|place| items.get_mut(place));
                    item.ok_or_else(|| format!("{step} is none of the {count} items"))?
                }
                other => return Err(format!("{other} has no key {step}")),
            };
        }
        node.merge(value);
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

/// Text with its name, to convert spans to locations.
struct Source {
    file: Rc<str>,
    /// Where each line ends, in order.
    line_ends: Vec<usize>,
}

impl Source {
    fn new(file: impl Into<Rc<str>>, text: &str) -> Self {
        Self { file: file.into(), line_ends: text.match_indices('\n').map(|(at, _)| at).collect() }
    }

    fn origin(&self, at: usize) -> Origin {
        Origin::File(self.file.clone(), 1 + self.line_ends.partition_point(|end| *end < at))
    }

    fn table(&self, table: &DeTable<'_>, at: usize, problems: &mut Vec<String>) -> Node {
        let entries = table.iter().filter_map(|(key, value)| {
            // The key's line, not the value's: people look there for a multi-line array.
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
