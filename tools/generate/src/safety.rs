//! The safety case of `docs/safety.md`, made from `docs/safety.toml`: for each hazard the function that reduces the
//! risk, where it is in the code, the tests that prove it, and the worst figure with its date and command. What it
//! names must exist: a dead reference or a missing figure is an error.

use crate::{read, text};
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::Path;

/// The file that the safety case is made from.
pub const SOURCE: &str = "docs/safety.toml";

/// Width of the page, columns.
const WIDTH: usize = 120;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Case {
    hazard: Vec<Hazard>,
}

/// One hazard. All texts are one sentence or more, in Markdown.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Hazard {
    /// Heading.
    name: String,
    /// Source of the hazard, hazardous situation and harm, in the terms of ISO 12100.
    situation: String,
    /// The protective function.
    function: String,
    /// Where it is: `path: item`.
    code: Vec<String>,
    /// Tests that prove it: `path: name`.
    tests: Vec<String>,
    /// The worst figures that were measured.
    figures: Vec<Figure>,
    /// What the function cannot do: residual risk, and the hardware that an integrator must add.
    remains: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Figure {
    worst: String,
    /// Date of the measurement.
    date: toml::value::Datetime,
    /// What measures it again.
    command: String,
}

/// The safety case of the repository at `root`, as a part of a page in `docs`.
///
/// # Errors
/// One line: the file cannot be read, a text is empty, or a place that it names does not exist.
pub fn case(root: &Path) -> Result<String, String> {
    let case: Case = toml::from_str(&read(root, SOURCE)?).map_err(|error| format!("{SOURCE}: {}", error.message()))?;
    let mut page = String::new();
    for (number, hazard) in (1..).zip(&case.hazard) {
        hazard.check(root).map_err(|error| format!("{SOURCE}: {}: {error}", hazard.name))?;
        hazard.write(number, &mut page);
    }
    Ok(page)
}

impl Hazard {
    fn check(&self, root: &Path) -> Result<(), String> {
        for (key, text) in [
            ("name", &self.name),
            ("situation", &self.situation),
            ("function", &self.function),
            ("remains", &self.remains),
        ] {
            filled(key, text)?;
        }
        if self.code.is_empty() || self.tests.is_empty() || self.figures.is_empty() {
            return Err("needs code, tests and figures".into());
        }
        for figure in &self.figures {
            filled("worst", &figure.worst)?;
            filled("command", &figure.command)?;
            if figure.date.date.is_none() || figure.date.time.is_some() {
                return Err(format!("{}: a date is a day", figure.date));
            }
            if !figure.worst.contains(|letter: char| letter.is_ascii_digit()) {
                return Err(format!("`{}` has no number", figure.worst));
            }
        }
        self.code.iter().try_for_each(|place| find(root, place, |_, text, item| is_defined(text, item)))?;
        self.tests.iter().try_for_each(|place| find(root, place, is_tested))
    }

    fn write(&self, number: usize, page: &mut String) {
        let Self { name, situation, function, remains, .. } = self;
        let situation = text::reflow(situation, WIDTH).join("\n");
        let _ = writeln!(page, "### {number}. {name}\n\n{situation}\n\n| | |\n|---|---|\n| function | {function} |");
        for (title, places) in [("code", &self.code), ("tests", &self.tests)] {
            let links: Vec<String> = places.iter().filter_map(|place| place.split_once(": ")).map(link).collect();
            let _ = writeln!(page, "| {title} | {} |", links.join("<br>"));
        }
        for Figure { worst, date, command } in &self.figures {
            let _ = writeln!(page, "| worst measured | {worst} ({date}, `{command}`) |");
        }
        let _ = writeln!(page, "| what remains | {remains} |\n");
    }
}

/// A link from a page in `docs` to an item of a file.
fn link((path, item): (&str, &str)) -> String {
    format!("[`{item}`](../{path})")
}

fn filled(key: &str, text: &str) -> Result<(), String> {
    if text.trim().is_empty() { Err(format!("`{key}` is empty")) } else { Ok(()) }
}

/// Finds `path: item` in the repository, by `holds(path, text, item)`.
fn find(root: &Path, place: &str, holds: fn(&str, &str, &str) -> bool) -> Result<(), String> {
    let (path, item) = place.split_once(": ").ok_or_else(|| format!("`{place}` is not `path: item`"))?;
    if holds(path, &read(root, path)?, item) { Ok(()) } else { Err(format!("{path} has no `{item}`")) }
}

/// Words that come before the name of an item, or of a configuration key.
const DEFINES: [&str; 9] = ["fn", "struct", "enum", "const", "static", "trait", "mod", "as", "def"];

/// True if a source file defines `item`, or a variant of that name.
fn is_defined(text: &str, item: &str) -> bool {
    text.lines().any(|line| {
        let ends_word = |letter: char| !letter.is_alphanumeric() && letter != '_';
        let words: Vec<&str> = line.split(ends_word).filter(|word| !word.is_empty()).collect();
        let defined = words.windows(2).any(|pair| DEFINES.contains(&pair[0]) && pair[1] == item);
        let is_variant = words.first() == Some(&item) && line.trim_end().ends_with([',', '{']);
        defined || is_variant
    })
}

/// True if a source file has a test of this name. In a `.rs` file that is a function with the attribute `test`; a file
/// in another language may name a test by a string, or define it by `def`.
fn is_tested(path: &str, text: &str, name: &str) -> bool {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let function = format!("fn {name}(");
    let by_attribute = lines.iter().enumerate().any(|(at, line)| {
        let above = lines[..at].iter().rev().take_while(|line| line.starts_with("#[") || line.starts_with("//"));
        line.contains(&function) && above.clone().any(|line| *line == "#[test]")
    });
    if path.ends_with(".rs") {
        return by_attribute;
    }
    [format!("\"{name}\""), format!("def {name}(")].iter().any(|call| text.contains(call.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const CASE: &str = r#"
[[hazard]]
name = "Crushing"
situation = "The robot moves towards a person."
function = "It stops."
code = ["a.rs: stop"]
tests = ["a.rs: it_stops"]
figures = [{ worst = "0.3 m", date = 2026-01-31, command = "make test" }]
remains = "No brake."
"#;

    /// The safety case of a repository with this file and one source.
    fn made(name: &str, case: &str) -> Result<String, String> {
        let root = std::env::temp_dir().join(format!("generate-safety-{}-{name}", std::process::id()));
        fs::create_dir_all(root.join("docs")).unwrap();
        fs::write(root.join(SOURCE), case).unwrap();
        fs::write(root.join("a.rs"), "pub fn stop() {}\n\n/// Proof.\n#[test]\nfn it_stops() {}\nfn helper() {}\n")
            .unwrap();
        let page = super::case(&root);
        fs::remove_dir_all(root).unwrap();
        page
    }

    #[test]
    fn a_hazard_has_its_function_code_tests_and_figures() {
        let page = made("whole", CASE).unwrap();
        assert!(page.starts_with("### 1. Crushing\n\nThe robot moves towards a person.\n"), "{page}");
        assert!(page.contains("| tests | [`it_stops`](../a.rs) |\n"), "{page}");
        assert!(page.contains("| worst measured | 0.3 m (2026-01-31, `make test`) |\n"), "{page}");
    }

    #[test]
    fn what_does_not_exist_is_refused() {
        for (name, from, to, error) in [
            ("file", "a.rs: stop", "b.rs: stop", "b.rs"),
            ("item", "a.rs: stop", "a.rs: halt", "a.rs has no `halt`"),
            ("test", "a.rs: it_stops", "a.rs: helper", "a.rs has no `helper`"),
            ("figure", "0.3 m", "soon", "`soon` has no number"),
            ("figures", "[{ worst = \"0.3 m\", date = 2026-01-31, command = \"make test\" }]", "[]", "figures"),
            ("remains", "No brake.", " ", "`remains` is empty"),
            ("date", "2026-01-31", "10:00:00", "a date is a day"),
            ("key", "remains", "stays", "stays"),
        ] {
            let wrong = made(name, &CASE.replace(from, to)).unwrap_err();
            assert!(wrong.contains(error), "{name}: {wrong}");
        }
    }

    #[test]
    fn definitions_are_told_from_uses() {
        assert!(is_defined("    pub(super) fn guard(&self) {", "guard"));
        assert!(is_defined("    SecondMaster,", "SecondMaster"));
        assert!(is_defined("def hooked():", "hooked"));
        assert!(!is_defined("    guard(now);", "guard"));
        assert!(!is_defined("    let a = Fault::SecondMaster;", "SecondMaster"));
        assert!(is_tested("page.test.ts", "  await test(\"Stop\", …)", "Stop"));
        assert!(is_tested("test_page.py", "def test_stop():", "test_stop"));
    }

    #[test]
    fn a_name_in_quotes_is_no_test_of_rust() {
        let source = "#[test]\n#[ignore]\nfn it_stops() {\n    run(\"it_rolls\");\n}\n\n\nfn it_rolls() {}\n";
        assert!(is_tested("a.rs", source, "it_stops"));
        assert!(!is_tested("a.rs", source, "it_rolls"));
        assert!(!is_tested("a.rs", "// \"it_stops\" def it_stops(", "it_stops"));
    }
}
