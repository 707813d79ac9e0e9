//! Commands that pages show: the executable must know each of them, and the Makefile each target.

use super::docs::{files, lines};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use std::collections::BTreeSet;
use std::fs;

/// Pages that show commands of their time, or of other programs' versions.
const OTHER: [&str; 3] = ["docs/facts/", "docs/decisions/", "CHANGELOG.md"];

/// Words of a shell line, up to its first pipe, redirection, comment or next command; of a list by commas its first.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
    for letter in line.chars() {
        match (quote, letter) {
            (Some(open), _) if letter == open => quote = None,
            (Some(_), _) => word.push(letter),
            (None, '\'' | '"') => quote = Some(letter),
            (None, '|' | '>' | '<' | ';' | '&' | '#') => break,
            (None, _) if letter.is_whitespace() => words.push(std::mem::take(&mut word)),
            (None, _) => word.push(letter),
        }
    }
    words.push(word);
    words.retain(|word| !word.is_empty());
    if let Some(at) = words.iter().position(|word| word.ends_with(',')) {
        words.truncate(at + 1);
        words[at].pop();
    }
    words
}

/// Arguments of a call of the executable in a line of a code block; `None` where it is no such line.
fn call(line: &str) -> Option<Vec<String>> {
    let line = line.trim_start();
    let words = words(line.strip_prefix("$ ").or_else(|| line.strip_prefix("# ")).unwrap_or(line));
    let is_prefix =
        |word: &str| word == "sudo" || word.split_once('=').is_some_and(|(name, _)| name == name.to_uppercase());
    let at = words.iter().position(|word| !is_prefix(word))?;
    let is_executable = words[at] == "advee" || words[at].ends_with("/advee");
    (is_executable && words.len() > at + 1).then(|| words[at + 1..].to_vec())
}

/// True for a line of a drawing or a table without borders: columns, which no shell line has before its comment.
fn has_columns(line: &str) -> bool {
    line.split('#').next().unwrap_or_default().trim().contains("  ")
}

/// Texts in backticks.
fn quoted(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// True for a word that stands for something: `FILE`, `[--json]`, `NODE|all`, `...`.
fn is_placeholder(word: &str) -> bool {
    word.contains(['[', ']', '|', '…', '\\', '<']) || word.contains("...") || word.chars().any(char::is_uppercase)
}

/// What the executable has against the arguments. `mentioned`: the text is a name of the command, not a whole call.
fn objection(arguments: &[String], mentioned: bool) -> Option<String> {
    let error = cli::command().try_get_matches_from([&["advee".to_string()], arguments].concat()).err()?;
    let value = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        _ => String::new(),
    };
    let allowed = match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => true,
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => mentioned,
        ErrorKind::MissingRequiredArgument | ErrorKind::MissingSubcommand | ErrorKind::TooFewValues => mentioned,
        ErrorKind::InvalidValue if value(ContextKind::InvalidValue).is_empty() => mentioned,
        ErrorKind::InvalidValue | ErrorKind::ValueValidation => is_placeholder(&value(ContextKind::InvalidValue)),
        ErrorKind::UnknownArgument => is_placeholder(&value(ContextKind::InvalidArg)),
        ErrorKind::InvalidSubcommand => is_placeholder(&value(ContextKind::InvalidSubcommand)),
        _ => false,
    };
    (!allowed).then(|| error.to_string().lines().next().unwrap_or_default().to_string())
}

#[test]
fn each_command_of_the_executable_that_a_page_shows_is_one() {
    let (mut wrong, mut seen) = (Vec::new(), 0);
    for page in files("md") {
        let name = page.strip_prefix(super::root()).expect("below it").display().to_string();
        if OTHER.iter().any(|other| name.starts_with(other)) {
            continue;
        }
        let text = fs::read_to_string(&page).expect("readable");
        for (number, line, block) in lines(&text) {
            let mut calls = Vec::new();
            match block {
                Some("sh" | "bash" | "console") => calls.extend(call(line).map(|call| (call, false))),
                Some("") if !has_columns(line) => calls.extend(call(line).map(|call| (call, false))),
                Some(_) => {}
                None => calls.extend(quoted(line).filter_map(|text| Some((call(text)?, true)))),
            }
            for (call, mentioned) in calls {
                seen += 1;
                wrong.extend(objection(&call, mentioned).map(|why| format!("{name}:{number}: {call:?}: {why}")));
            }
        }
    }
    assert!(seen > 100, "only {seen} commands were found in the pages");
    assert!(wrong.is_empty(), "commands that the executable does not know: {wrong:#?}");
}

#[test]
fn each_target_of_make_that_a_page_shows_is_one() {
    let makefile = fs::read_to_string(super::root().join("Makefile")).expect("readable");
    let targets: BTreeSet<&str> =
        makefile.lines().filter_map(|line| line.split_once(':')).map(|(name, _)| name).collect();
    let mut wrong = Vec::new();
    for page in files("md") {
        let text = fs::read_to_string(&page).expect("readable");
        for (number, line, block) in lines(&text) {
            let texts: Vec<&str> = if block.is_some() { vec![line] } else { quoted(line).collect() };
            for text in texts {
                let words = words(text.trim_start().trim_start_matches("$ "));
                if words.first().is_some_and(|word| word == "make")
                    && !words.iter().any(|word| word == "-C")
                    && let Some(target) = words[1..].iter().find(|word| !word.contains('=') && !word.starts_with('-'))
                    && !targets.contains(target.as_str())
                {
                    wrong.push(format!("{}:{number}: make {target}", page.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "targets that the Makefile does not have: {wrong:#?}");
}

#[test]
fn a_call_is_found_in_a_line_of_a_shell() {
    let call = |line: &str| call(line).map(|words| words.join(" "));
    assert_eq!(call("$ sudo target/release/advee log mark \"the dog\"  # then").as_deref(), Some("log mark the dog"));
    assert_eq!(call("ADVEE_RUN=/tmp advee up --sim | tee x").as_deref(), Some("up --sim"));
    assert_eq!(call("advee log info, play"), Some("log info".into()));
    assert_eq!(call("the advee up"), None);
    assert!(has_columns("advee up      starts the watchdog") && !has_columns("advee up --sim      # starts it"));
    assert!(objection(&words("diag --no-such-option"), true).is_some());
    assert!(objection(&words("no-such-command"), true).is_some());
    assert!(objection(&words("goal"), true).is_none());
}
