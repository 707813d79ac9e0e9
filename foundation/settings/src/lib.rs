//! Configuration files, declared and read strictly: every key is checked, every unknown key is an error, and all errors
//! are collected, each a line `file:line: key = value: expected …`, before the file is rejected.
//!
//! A crate declares its tables with [`settings!`]; the macro generates the types, their reader, and their rows in the
//! docs.
#![forbid(unsafe_code)]

mod corners;
mod declare;
mod footprint;
mod moved;
mod reader;
pub mod robot;
mod rows;
mod rule;
#[cfg(test)]
mod tests;
mod tree;

pub use corners::{CORNERS_MAX, Corners};
pub use declare::{Declared, Given, Section};
pub use footprint::{FOOTPRINT_CORNERS_MAX, Footprint};
pub use moved::{Moved, Moves, notices};
pub use reader::{Entry, Problems, Table};
pub use rows::{Need, Row, Rows, markdown};
pub use rule::{Blank, Bytes, Choice, Form, Off, Parsed, Rule, Span, Texts, ZeroOr};
pub use tree::{Node, Origin, Value};

use std::fmt;
use std::fs;
use std::path::Path;

/// All errors, one line each; never empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError(pub Vec<String>);

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join("\n"))
    }
}

impl std::error::Error for ConfigError {}

/// Escapes control characters, so that a key or a value in an error stays on one line.
pub(crate) fn one_line(text: String) -> String {
    if !text.contains(char::is_control) {
        return text;
    }
    text.chars().map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() }).collect()
}

/// Parses one file.
///
/// # Errors
/// The file cannot be read, or is not TOML.
pub fn read(path: &Path) -> Result<Node, ConfigError> {
    match fs::read_to_string(path) {
        Ok(text) => Node::parse(path, &text).map_err(ConfigError),
        Err(error) => Err(ConfigError(vec![format!("{}: {error}", path.display())])),
    }
}

/// Reads a parsed file as one section.
///
/// # Errors
/// One line for each error.
pub fn read_as<T: Section>(node: &Node) -> Result<T, ConfigError> {
    let problems = Problems::default();
    let section = Table::root(node, &problems).map(Table::whole);
    match (section, problems.lines()) {
        (Some(section), lines) if lines.is_empty() => Ok(section),
        (_, lines) => Err(ConfigError(lines)),
    }
}
