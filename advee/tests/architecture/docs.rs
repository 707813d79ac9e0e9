//! Pages with broken relative links or invalid TOML, and lines that are too wide, in pages and in code.
//! Each library has an example.

use std::fs;
use std::path::{Path, PathBuf};

/// Generated and third-party folders.
const NOT_OURS: [&str; 9] = ["target", "node_modules", "dist", "dev", "run", "log", ".git", ".venv", ".peers"];

/// Maximum width of a line, in code, comments and prose; tables and URLs may be wider.
const WIDTH: usize = 120;

/// Number of wider lines in Rust and in Markdown. Both numbers may only decrease: lower them after wrapping some.
const WIDER: [(&str, usize); 2] = [("rs", 70), ("md", 129)];

/// Files below the checkout with this extension.
pub(super) fn files(extension: &str) -> Vec<PathBuf> {
    fn walk(folder: &Path, extension: &str, files: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).expect("readable").map(|entry| entry.expect("an entry")) {
            let (path, name) = (entry.path(), entry.file_name());
            let is_folder = entry.file_type().expect("a type").is_dir();
            if is_folder && !NOT_OURS.iter().any(|other| name == *other) {
                walk(&path, extension, files);
            } else if !is_folder && path.extension().is_some_and(|end| end == extension) {
                files.push(path);
            }
        }
    }
    let mut files = Vec::new();
    walk(&super::root(), extension, &mut files);
    files.sort();
    files
}

/// Lines of a page: number, text, and the language of the surrounding code block, if any.
pub(super) fn lines(text: &str) -> Vec<(usize, &str, Option<&str>)> {
    let mut block = None;
    let mut lines = Vec::new();
    for (number, line) in text.lines().enumerate() {
        match line.trim().strip_prefix("```") {
            Some(language) => block = if block.is_some() { None } else { Some(language.trim()) },
            None => lines.push((number + 1, line, block)),
        }
    }
    lines
}

/// Targets of the links in a line.
fn links(line: &str) -> impl Iterator<Item = &str> {
    line.split("](").skip(1).filter_map(|rest| rest.split_once(')').map(|(target, _)| target))
}

#[test]
fn every_relative_link_leads_to_a_file() {
    let mut wrong = Vec::new();
    for page in files("md") {
        let text = fs::read_to_string(&page).expect("readable");
        let folder = page.parent().expect("a folder");
        for (number, line, block) in lines(&text) {
            for target in links(line).filter(|_| block.is_none()) {
                let path = target.split('#').next().unwrap_or_default();
                if !path.is_empty() && !path.contains(':') && !folder.join(path).exists() {
                    wrong.push(format!("{}:{number}: {target}", page.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "links that lead nowhere: {wrong:#?}");
}

#[test]
fn every_page_of_docs_is_in_the_table_of_contents() {
    let docs = super::root().join("docs");
    let contents = fs::read_to_string(docs.join("SUMMARY.md")).expect("docs/SUMMARY.md is there");
    let listed: Vec<PathBuf> = contents.lines().flat_map(links).map(|target| docs.join(target)).collect();
    let pages = files("md").into_iter().filter(|page| page.starts_with(&docs) && !page.ends_with("SUMMARY.md"));
    let missing: Vec<PathBuf> = pages.filter(|page| !listed.contains(page)).collect();
    assert!(missing.is_empty(), "pages that docs/SUMMARY.md does not list: {missing:#?}");
}

#[test]
fn every_block_of_toml_can_be_read() {
    let mut wrong = Vec::new();
    for page in files("md") {
        let text = fs::read_to_string(&page).expect("readable");
        let lines = lines(&text);
        // Lines of one block have consecutive numbers.
        let toml: Vec<(usize, &str)> = lines
            .iter()
            .filter(|(.., block)| *block == Some("toml"))
            .map(|(number, line, _)| (*number, *line))
            .collect();
        for block in toml.chunk_by(|(before, _), (after, _)| before + 1 == *after) {
            let text: Vec<&str> = block.iter().map(|(_, line)| *line).collect();
            if let Err(error) = text.join("\n").parse::<toml::Table>() {
                wrong.push(format!("{}:{}: {}", page.display(), block[0].0, error.message()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// True if a line is too wide.
fn is_wide(line: &str, is_table: bool) -> bool {
    line.chars().count() > WIDTH && !is_table && !line.contains("://")
}

#[test]
fn fewer_and_fewer_lines_are_wider_than_they_may_be() {
    for (extension, allowed) in WIDER {
        let mut wide = Vec::new();
        for file in files(extension).into_iter().filter(|file| !file.ends_with("generated.rs")) {
            let text = fs::read_to_string(&file).expect("readable");
            let numbered: Vec<(usize, &str, bool)> = match extension {
                "md" => {
                    let prose = lines(&text).into_iter().filter(|(.., block)| block.is_none());
                    prose.map(|(number, line, _)| (number, line, line.trim_start().starts_with('|'))).collect()
                }
                _ => text.lines().enumerate().map(|(number, line)| (number + 1, line, false)).collect(),
            };
            let wider = numbered.into_iter().filter(|(_, line, is_table)| is_wide(line, *is_table));
            wide.extend(wider.map(|(number, ..)| format!("{}:{number}", file.display())));
        }
        let count = wide.len();
        assert!(
            count <= allowed,
            "{count} lines of {extension} have more than {WIDTH} columns, {allowed} may: {wide:#?}"
        );
        println!("{count} lines of {extension} have more than {WIDTH} columns; {allowed} may");
    }
}

/// Number of Rust code blocks in the doc comments of a source file. Blocks that are not compiled as they stand do not
/// count: `ignore`, `compile_fail`, `text`, other languages.
fn examples(source: &str) -> usize {
    let (mut count, mut open) = (0, false);
    for line in source.lines().map(str::trim_start) {
        let Some(doc) = line.strip_prefix("//!").or_else(|| line.strip_prefix("///")) else {
            open = false;
            continue;
        };
        if let Some(attributes) = doc.trim().strip_prefix("```") {
            let is_rust =
                attributes.split(',').all(|word| ["", "rust", "no_run", "should_panic"].contains(&word.trim()));
            count += usize::from(is_rust && !open);
            open = !open;
        }
    }
    count
}

#[test]
fn every_library_shows_an_example() {
    // Support of tests.
    let exempt = ["foundation/testing", "fuzz"];
    let mut without = Vec::new();
    for folder in super::members().iter().filter(|folder| !exempt.contains(&folder.as_str())) {
        let sources = super::root().join(folder).join("src");
        let Ok(lib) = fs::read_to_string(sources.join("lib.rs")) else { continue };
        assert!(lib.lines().any(|line| line.starts_with("pub ")), "{folder} is a library without public items");
        let text = |file: &PathBuf| fs::read_to_string(file).expect("readable");
        if super::sources(&sources).iter().all(|file| examples(&text(file)) == 0) {
            without.push(folder.clone());
        }
    }
    assert!(without.is_empty(), "crates whose documentation has no example in Rust: {without:?}");
}

#[test]
fn examples_are_blocks_of_rust_in_doc_comments() {
    let block = |prefix: &str, attributes: &str| format!("{prefix} ```{attributes}\n{prefix} x\n{prefix} ```\n");
    for attributes in ["", "rust", "no_run", "rust,should_panic"] {
        assert_eq!(examples(&block("//!", attributes)), 1, "{attributes}");
        assert_eq!(examples(&block("    ///", attributes)), 1, "{attributes}");
    }
    for attributes in ["text", "ignore", "toml", "compile_fail", "rust,ignore"] {
        assert_eq!(examples(&block("//!", attributes)), 0, "{attributes}");
    }
    assert_eq!(examples(&block("//", "")), 0);
    assert_eq!(examples(&block("//!", "text").repeat(2)), 0);
    assert_eq!(examples(&(block("///", "") + "fn f() {}\n" + &block("///", ""))), 2);
}

#[test]
fn lines_links_and_widths_are_recognized() {
    let text = "a [b](c.md) [d](e/f.md#g)\n```toml\nx = 1\n```\nend";
    assert_eq!(
        lines(text).iter().map(|(number, _, block)| (*number, *block)).collect::<Vec<_>>(),
        [(1, None), (3, Some("toml")), (5, None)]
    );
    assert_eq!(links(text.lines().next().expect("a line")).collect::<Vec<_>>(), ["c.md", "e/f.md#g"]);
    let wide = "x".repeat(WIDTH + 1);
    assert!(is_wide(&wide, false) && !is_wide(&wide, true) && !is_wide(&format!("http://{wide}"), false));
    assert!(!is_wide(&wide[1..], false));
}
