//! The report for people.

use super::Group;
use super::finding::{Finding, Level};
use crate::style::Style;
use std::fmt::Write;

/// Words are broken at this column; commands never.
const WIDTH: usize = 100;
/// Column of texts.
const INDENT: usize = 26;

impl Style {
    fn level(&self, level: Level, text: &str) -> String {
        let code = match level {
            Level::Ok => "32",
            Level::Warning => "1;33",
            Level::Fail => "1;31",
        };
        self.paint(code, text)
    }

    /// The whole report; the last line counts.
    pub fn text(&self, groups: &[Group], counts: &[(Level, usize)]) -> String {
        let mut text = String::new();
        for (name, findings) in groups {
            let _ = writeln!(text, "{}", self.paint("1", name));
            for finding in findings {
                self.finding(&mut text, finding);
            }
        }
        let counts = counts.iter().filter(|(_, count)| *count > 0);
        let counts: Vec<String> =
            counts.map(|(level, count)| self.level(*level, &format!("{count} {level}"))).collect();
        let _ = writeln!(text, "\n{}", counts.join(", "));
        text
    }

    fn finding(&self, text: &mut String, finding: &Finding) {
        let Finding { check, level, what, why, cure } = finding;
        let level = self.level(*level, &format!("{level:8}"));
        let mut lines = wrap(what, WIDTH - INDENT).into_iter();
        let first = lines.next().unwrap_or_default();
        let _ = writeln!(text, "  {level} {check:14} {first}");
        for line in lines {
            let _ = writeln!(text, "{:INDENT$}{line}", "");
        }
        for line in wrap(why, WIDTH - INDENT) {
            let _ = writeln!(text, "{:INDENT$}{}", "", self.paint("2", &line));
        }
        if !cure.is_empty() {
            let _ = writeln!(text, "{:INDENT$}{}", "", self.paint("36", &format!("$ {cure}")));
        }
    }
}

/// Breaks a text between words into lines of at most `width` characters; a longer word stands alone.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}
