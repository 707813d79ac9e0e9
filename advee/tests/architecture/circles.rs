//! Import circles: files of a crate that import each other, so that none can be understood or moved without the others.
//!
//! Paths by `crate::`, `super::` and `self::` count, in `use` and in the code, followed through `pub use`. Paths of a
//! file to its own modules do not count: a parent and its children are one unit.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Module by its path in the crate; the root is empty.
type Module = Vec<String>;

/// Largest circle that is allowed.
const ALLOWED: usize = 3;

#[test]
fn no_circle_has_more_than_three_files() {
    let mut wrong = Vec::new();
    for folder in super::members() {
        let largest = largest(&sources(&super::root().join(&folder).join("src")));
        if largest.len() > ALLOWED {
            let names: Vec<String> = largest.iter().map(|module| module.join("/")).collect();
            wrong.push(format!("{folder}: {} files import each other, allowed are {ALLOWED}: {names:?}", names.len()));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Modules of a crate without tests, with their code.
fn sources(src: &Path) -> BTreeMap<Module, String> {
    let mut sources = BTreeMap::new();
    for file in super::sources(src) {
        let relative = file.strip_prefix(src).expect("below it").with_extension("");
        let mut module: Module = relative.iter().map(|part| part.to_string_lossy().into_owned()).collect();
        if ["lib", "main"].iter().any(|root| module == [*root]) {
            module.clear();
        }
        let is_test =
            |part: &String| ["tests", "testing", "bench"].contains(&part.as_str()) || part.ends_with("_tests");
        if !module.iter().any(is_test) {
            sources.insert(module, code(&fs::read_to_string(&file).expect("readable")));
        }
    }
    sources
}

/// Text of a file without comments and without the tests at its end.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

/// `use` statements as formatted by rustfmt, each with true if public and its paths; and the code without them.
fn uses(code: &str) -> (Vec<(bool, Vec<String>)>, String) {
    let (mut uses, mut rest, mut lines) = (Vec::new(), String::new(), code.lines());
    while let Some(line) = lines.next() {
        let (visible, tree) = match line.trim_start().split_once("use ") {
            Some((before, tree)) if before.is_empty() || before.starts_with("pub") => (!before.is_empty(), tree),
            _ => {
                rest.push_str(line);
                rest.push('\n');
                continue;
            }
        };
        let mut tree = tree.to_string();
        while !tree.contains(';') {
            let Some(line) = lines.next() else { break };
            tree.push_str(line.trim());
        }
        uses.push((visible, expanded(tree.trim_end_matches(';'))));
    }
    (uses, rest)
}

/// Paths of a `use` tree.
fn expanded(tree: &str) -> Vec<String> {
    let Some((before, inside)) = tree.split_once('{') else { return vec![tree.trim().to_string()] };
    let inside = inside.rsplit_once('}').map_or(inside, |(inside, _)| inside);
    let (mut parts, mut depth) = (vec![String::new()], 0);
    for letter in inside.chars() {
        depth += i32::from(letter == '{') - i32::from(letter == '}');
        match letter {
            ',' if depth == 0 => parts.push(String::new()),
            _ => parts.last_mut().expect("one at least").push(letter),
        }
    }
    let parts = parts.iter().filter(|part| !part.trim().is_empty());
    parts.flat_map(|part| expanded(&format!("{}{}", before.trim(), part.trim()))).collect()
}

/// Paths by `crate::` and `super::` in the code itself.
fn paths(code: &str) -> Vec<String> {
    let word = |letter: char| letter.is_alphanumeric() || letter == '_' || letter == ':';
    let words = code.split(|letter| !word(letter));
    words.filter(|path| ["crate::", "super::"].iter().any(|start| path.starts_with(start))).map(Into::into).collect()
}

/// File that a path in `from` refers to, and the name in it; `None` for other crates and relative paths.
fn target(from: &Module, path: &str, known: &BTreeMap<Module, String>) -> Option<(Module, String)> {
    let path = path.split(" as ").next().unwrap_or_default();
    let mut parts = path.split("::").peekable();
    let mut at = match *parts.peek()? {
        "crate" => {
            parts.next();
            Vec::new()
        }
        "super" | "self" => from.clone(),
        _ => return None,
    };
    while let Some(word) = parts.next_if(|part| ["super", "self"].contains(part)) {
        if word == "super" {
            at.pop()?;
        }
    }
    while let Some(part) = parts.peek() {
        let deeper: Module = at.iter().cloned().chain([(*part).to_string()]).collect();
        if !known.contains_key(&deeper) {
            break;
        }
        at = deeper;
        parts.next();
    }
    known.contains_key(&at).then(|| (at, parts.next().unwrap_or_default().to_string()))
}

/// Largest set of files that all reach each other.
fn largest(sources: &BTreeMap<Module, String>) -> Vec<Module> {
    let mut exported: BTreeMap<(Module, String), Module> = BTreeMap::new();
    let mut found: BTreeMap<&Module, Vec<(Module, String)>> = BTreeMap::new();
    for (module, code) in sources {
        let (uses, rest) = uses(code);
        for (public, all) in uses {
            for path in all {
                if public {
                    // Relative paths refer to modules of the file itself.
                    let first = path.split("::").next().unwrap_or_default();
                    let own: Module = module.iter().cloned().chain([first.to_string()]).collect();
                    let path = if sources.contains_key(&own) { format!("self::{path}") } else { path };
                    let name = path.rsplit("::").next().unwrap_or_default().to_string();
                    if let Some((to, _)) = target(module, &path, sources).filter(|(to, _)| to != module) {
                        exported.insert((module.clone(), name), to);
                    }
                } else {
                    found.entry(module).or_default().extend(target(module, &path, sources));
                }
            }
        }
        found.entry(module).or_default().extend(paths(&rest).iter().filter_map(|path| target(module, path, sources)));
    }
    let arrows: BTreeMap<&Module, BTreeSet<Module>> = sources
        .keys()
        .map(|module| {
            let to = found.remove(module).unwrap_or_default().into_iter().map(|(mut to, name)| {
                for _ in 0..5 {
                    let Some(further) = exported.get(&(to.clone(), name.clone())) else { break };
                    to.clone_from(further);
                }
                to
            });
            (module, to.filter(|to| !to.starts_with(module)).collect())
        })
        .collect();
    let reached = |from: &Module| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(next) = open.pop() {
            for to in arrows.get(&next).into_iter().flatten() {
                if seen.insert(to.clone()) {
                    open.push(to.clone());
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = sources.keys().map(|module| (module, reached(module))).collect();
    let circle = |module: &Module| -> Vec<Module> {
        let both = |other: &&Module| reached[module].contains(*other) && reached[*other].contains(module);
        sources.keys().filter(both).cloned().collect()
    };
    sources.keys().map(circle).max_by_key(Vec::len).unwrap_or_default()
}

fn of(files: &[(&str, &str)]) -> Vec<String> {
    let module = |name: &str| name.split('/').filter(|part| !part.is_empty()).map(Into::into).collect();
    let sources = files.iter().map(|(name, text)| (module(name), code(text))).collect();
    largest(&sources).iter().map(|module| module.join("/")).collect()
}

#[test]
fn a_circle_is_found_through_use_code_and_public_names() {
    let files = [
        ("", "mod a; mod b; mod c; mod d;\npub use c::{C, Other};\n"),
        ("a", "use super::b::{self, B};\nfn a() {}\n"),
        ("b", "fn b() -> crate::C { loop {} }\n"),
        ("c", "// use crate::d;\nuse crate::{\n    a::A,\n};\nuse std::fmt;\n"),
        ("d", "use crate::a::A;\n#[cfg(test)]\nmod tests { use crate::b; }\n"),
    ];
    assert_eq!(of(&files), ["a", "b", "c"]);
}

#[test]
fn a_file_and_its_own_modules_are_no_circle() {
    let files = [("", "mod a;\n"), ("a", "mod b;\nuse self::b::B;\nuse crate::a::b::C;\n"), ("a/b", "use super::A;\n")];
    assert_eq!(of(&files), [""; 0]);
}
