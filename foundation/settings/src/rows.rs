//! The declared keys as rows: for the docs, and for keys that are still read under older names.

use std::fmt::Write;

/// A key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// The names of the tables down to it, and its own. `<name>` is one of the user's choice, `[]` an item of a list.
    pub path: Vec<String>,
    /// Its older name.
    pub was: Option<&'static str>,
    /// The choice that it belongs to; empty: it does not depend on one.
    pub only: &'static str,
    /// What is allowed: `a number from 0 to 1`.
    pub expected: String,
    /// What it is when it is left out.
    pub need: Need,
    /// What it means.
    pub about: String,
}

/// What a key is when it is left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Need {
    /// An error.
    Required,
    /// Nothing.
    Optional,
    /// It follows from other keys.
    Derived,
    /// This, as it is written in a file.
    Default(String),
}

/// The rows of a declaration, as [`settings!`](crate::settings!) makes them.
#[derive(Debug, Default)]
pub struct Rows {
    path: Vec<String>,
    only: &'static str,
    pub(crate) rows: Vec<Row>,
}

impl Rows {
    /// Begins a row.
    pub fn key(&mut self, key: &str, was: Option<&'static str>, about: &str) {
        let path = self.path.iter().cloned().chain([key.into()]).collect();
        let (about, only) = (about.trim().into(), self.only);
        self.rows.push(Row { path, was, only, expected: String::new(), need: Need::Required, about });
    }

    /// Adds rows one step below.
    pub fn below(&mut self, step: &str, add: impl FnOnce(&mut Self)) {
        self.path.push(step.into());
        add(self);
        self.path.pop();
    }

    /// Adds rows of keys that there are only with the choice `only`.
    pub fn only(&mut self, only: &'static str, add: impl FnOnce(&mut Self)) {
        let before = std::mem::replace(&mut self.only, only);
        add(self);
        self.only = before;
    }

    pub(crate) fn last(&mut self, expected: &str, need: Need) {
        if let Some(row) = self.rows.last_mut() {
            row.expected = expected.into();
            row.need = need;
        }
    }

    /// Adds rows within the table that the last row is.
    pub(crate) fn within(&mut self, add: impl FnOnce(&mut Self)) {
        let Some(row) = self.rows.last() else { return };
        let before = std::mem::replace(&mut self.path, row.path.clone());
        add(self);
        self.path = before;
    }
}

/// Endings of keys, longer ones first, and their units.
const UNITS: [(&str, &str); 19] = [
    ("_mps2", "m/s²"),
    ("_radps", "rad/s"),
    ("_radpm", "rad/m"),
    ("_bytes", "B"),
    ("memory_max", "B"),
    ("cpu_max", "cores"),
    ("_mps", "m/s"),
    ("_rad", "rad"),
    ("_per_c", "1/°C"),
    ("_per_hour", "1/h"),
    ("_ms", "ms"),
    ("_hz", "Hz"),
    ("_ah", "A h"),
    ("_m", "m"),
    ("_s", "s"),
    ("_c", "°C"),
    ("baud", "Bd"),
    ("bitrate", "bit/s"),
    ("rpm_min", "1/min"),
];

impl Row {
    /// The path as people write it: `can.<name>.nodes[].id`.
    #[must_use]
    pub fn name(&self) -> String {
        let mut name = String::new();
        for step in &self.path {
            let dot = if name.is_empty() || step == "[]" { "" } else { "." };
            // Writing to a string does not fail.
            let _ = write!(name, "{dot}{step}");
        }
        name
    }

    /// The unit that the key's own name says; empty for what has none.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        let key = self.path.last().map_or("", String::as_str);
        match key {
            "x" | "y" => "m",
            "theta" => "rad",
            "hz" => "Hz",
            _ => UNITS.iter().find(|(ending, _)| key.ends_with(ending)).map_or("", |(_, unit)| unit),
        }
    }

    /// Whether other rows are below this one.
    fn is_table(&self, rows: &[Self]) -> bool {
        rows.iter().any(|row| row.path.len() > self.path.len() && row.path.starts_with(&self.path))
    }

    /// The heading of a table: `[limits]`, `[[can.<name>.nodes]]`, with the prefix of its keys.
    fn heading(&self, rows: &[Self]) -> (String, Vec<String>) {
        let below = rows.iter().find(|row| row.path.len() > self.path.len() && row.path.starts_with(&self.path));
        let prefix = below.map(|row| row.path[..row.path.len() - 1].to_vec()).unwrap_or_default();
        let name = Self { path: prefix.clone(), ..self.clone() }.name();
        let heading = match name.strip_suffix("[]") {
            Some(name) => format!("[[{name}]]"),
            None => format!("[{name}]"),
        };
        (heading, prefix)
    }
}

/// The rows as Markdown: the keys of no table first, then a section for each table.
#[must_use]
pub fn markdown(rows: &[Row]) -> String {
    let mut text = keys(rows, &[]);
    for row in rows.iter().filter(|row| row.is_table(rows)) {
        let (heading, prefix) = row.heading(rows);
        // Writing to a string does not fail.
        let _ = write!(text, "\n### `{heading}`\n\n{}\n{}", row.about, keys(rows, &prefix));
    }
    text
}

/// The table of the keys right below `prefix` that are no tables themselves.
fn keys(rows: &[Row], prefix: &[String]) -> String {
    let own = rows.iter().filter(|row| row.path[..row.path.len() - 1] == *prefix && !row.is_table(rows));
    let mut text = String::new();
    for row in own {
        let (key, unit) = (row.path.last().map_or("", String::as_str), row.unit());
        let default = match &row.need {
            Need::Required => "required".into(),
            Need::Optional => "–".into(),
            Need::Derived => "see there".into(),
            Need::Default(value) => format!("`{value}`"),
        };
        let only = if row.only.is_empty() { String::new() } else { format!("`{}`: ", row.only) };
        let was = row.was.map(|was| format!(" (was `{was}`)")).unwrap_or_default();
        let expected = row.expected.replace('|', "\\|");
        let _ = writeln!(text, "| `{key}` | {unit} | {expected} | {default} | {only}{}{was} |", row.about);
    }
    match text.is_empty() {
        true => text,
        false => format!("\n| key | unit | value | default | meaning |\n|---|---|---|---|---|\n{text}"),
    }
}
