//! Keys that have a new name and are still read under the old one: in files, in overrides, and in a file's text, which
//! is given the new names.

use crate::tree::{Node, Origin, Value};
use crate::{ConfigError, Row, one_line};
use std::ops::Range;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// The keys of a declaration that have older names.
#[derive(Clone, Debug, Default)]
pub struct Moves(Vec<Move>);

#[derive(Clone, Debug)]
struct Move {
    /// The table of the key, by new names.
    table: Vec<String>,
    old: &'static str,
    new: String,
}

/// An old name that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Moved {
    /// Where.
    pub origin: Origin,
    /// The old name of the key, without its table.
    pub old: &'static str,
    /// The new one.
    pub new: String,
}

/// A line for each key that was found under its old name, with the first place of it.
#[must_use]
pub fn notices(found: &[Moved]) -> Vec<String> {
    let mut lines: Vec<(&Moved, usize)> = Vec::new();
    for moved in found {
        match lines.iter_mut().find(|(known, _)| (known.old, &known.new) == (moved.old, &moved.new)) {
            Some((_, more)) => *more += 1,
            None => lines.push((moved, 0)),
        }
    }
    let line = |(Moved { origin, old, new }, more): (&Moved, usize)| {
        let more = if more > 0 {
            format!(", also in {more} other place{}", if more > 1 { "s" } else { "" })
        } else {
            String::new()
        };
        format!("{origin}: {old} is the old name of {new}{more}; advee config migrate renames it")
    };
    lines.into_iter().map(line).collect()
}

impl Moves {
    /// The moves that these rows name.
    #[must_use]
    pub fn of(rows: &[Row]) -> Self {
        let moved = |row: &Row| {
            let (new, table) = row.path.split_last()?;
            Some(Move { table: table.into(), old: row.was?, new: new.clone() })
        };
        Self(rows.iter().filter_map(moved).collect())
    }

    /// Gives each key of a file its new name; what was found is added to `found`.
    ///
    /// # Errors
    /// A table has a key under both names.
    pub fn rename(&self, node: &mut Node, found: &mut Vec<Moved>) -> Result<(), ConfigError> {
        self.rename_below(node, &[], found)
    }

    /// The same of what stands below the table `path`.
    fn rename_below(&self, node: &mut Node, path: &[&str], found: &mut Vec<Moved>) -> Result<(), ConfigError> {
        let mut twice = Vec::new();
        for known in self.0.iter().filter(|known| starts_with(&known.table, path)) {
            rename(node, &known.table[path.len()..], known, found, &mut twice);
        }
        if twice.is_empty() { Ok(()) } else { Err(ConfigError(twice)) }
    }

    /// Applies an override `table.key=value`, whose names may be old ones (see [`Node::put`]).
    ///
    /// # Errors
    /// It is no assignment, or to nothing that can be assigned to.
    pub fn set(&self, node: &mut Node, assignment: &str, found: &mut Vec<Moved>) -> Result<(), ConfigError> {
        let refused = |line| ConfigError(vec![one_line(line)]);
        let (mut path, mut value) = Node::assignment(assignment).map_err(refused)?;
        for known in &self.0 {
            let length = known.table.len();
            let is_old = path.get(length) == Some(&known.old) && path.iter().zip(&known.table).all(|(a, b)| fits(b, a));
            if is_old {
                path[length] = &known.new;
                found.push(Moved { origin: Origin::CommandLine, old: known.old, new: known.new.clone() });
            }
        }
        self.rename_below(&mut value, &path, found)?;
        node.put(&path, value).map_err(|why| refused(format!("--set {assignment}: {why}")))
    }

    /// The text of a file with the new names; all else stays as it is, and comments stay in their columns.
    ///
    /// # Errors
    /// It is no TOML, or has a key under both names.
    pub fn migrate(&self, path: &Path, text: &str) -> Result<String, ConfigError> {
        let mut node = Node::parse(path, text).map_err(ConfigError)?;
        self.rename(&mut node, &mut Vec::new())?;
        let mut text = text.to_owned();
        // A table may have several headings; each round finds the first that is left.
        while let Some((known, key, value)) = self.first(&text) {
            let change = known.new.len() as isize - key.len() as isize;
            keep_column(&mut text, value.end, change);
            text.replace_range(key, &known.new);
        }
        Ok(text)
    }

    fn first(&self, text: &str) -> Option<(&Move, Range<usize>, Range<usize>)> {
        let table = DeTable::parse(text).ok()?;
        self.0.iter().find_map(|known| {
            let (key, value) = find(table.get_ref(), &known.table, known.old)?;
            Some((known, key, value))
        })
    }
}

/// Whether a step of a declared path is this step of a file's path.
fn fits(declared: &str, step: &str) -> bool {
    declared == "[]" || declared.starts_with('<') || declared == step
}

fn starts_with(declared: &[String], path: &[&str]) -> bool {
    declared.len() >= path.len() && declared.iter().zip(path).all(|(declared, step)| fits(declared, step))
}

fn rename(node: &mut Node, table: &[String], known: &Move, found: &mut Vec<Moved>, twice: &mut Vec<String>) {
    let Some((step, rest)) = table.split_first() else {
        let Value::Table(map) = &mut node.value else { return };
        let Some(value) = map.remove(known.old) else { return };
        let (origin, old, new) = (value.origin.clone(), known.old, known.new.clone());
        if map.contains_key(&new) {
            twice.push(format!("{origin}: {old}: the old name of {new}, which is there, too"));
        }
        map.entry(new.clone()).or_insert(value);
        found.push(Moved { origin, old, new });
        return;
    };
    match &mut node.value {
        Value::Array(items) if step == "[]" => {
            items.iter_mut().for_each(|item| rename(item, rest, known, found, twice));
        }
        Value::Table(map) => {
            let fitting = map.iter_mut().filter(|(name, _)| fits(step, name));
            fitting.for_each(|(_, node)| rename(node, rest, known, found, twice));
        }
        _ => {}
    }
}

/// Where a key `old` stands in the tables that `path` leads to, and its value.
fn find(table: &DeTable<'_>, path: &[String], old: &str) -> Option<(Range<usize>, Range<usize>)> {
    let Some((step, rest)) = path.split_first() else {
        let (key, value) = table.iter().find(|(key, _)| key.get_ref() == old)?;
        return Some((key.span(), value.span()));
    };
    let below = table.iter().filter(|(key, _)| fits(step, key.get_ref()));
    { below }.find_map(|(_, value)| find_in(value.get_ref(), rest, old))
}

fn find_in(value: &DeValue<'_>, path: &[String], old: &str) -> Option<(Range<usize>, Range<usize>)> {
    match value {
        DeValue::Table(table) => find(table, path, old),
        DeValue::Array(items) if path.first().is_some_and(|step| step == "[]") => {
            items.iter().find_map(|item| find_in(item.get_ref(), &path[1..], old))
        }
        _ => None,
    }
}

/// Moves the comment that follows a value by taking or giving spaces before it, where there are at least two.
fn keep_column(text: &mut String, value: usize, change: isize) {
    let rest = &text[value..];
    let spaces = rest.len() - rest.trim_start_matches(' ').len();
    if spaces < 2 || !rest[spaces..].starts_with('#') {
        return;
    }
    let kept = spaces.saturating_add_signed(-change).max(1);
    text.replace_range(value..value + spaces, &" ".repeat(kept));
}
