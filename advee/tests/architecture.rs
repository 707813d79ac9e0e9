//! Keeps ARCHITECTURE.md and the code consistent: crates use only what their row allows, pure crates declare it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "architecture/circles.rs"]
mod circles;
#[path = "architecture/commands.rs"]
mod commands;
#[path = "architecture/docs.rs"]
mod docs;
#[path = "architecture/prose.rs"]
mod prose;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("robot lies in the workspace").into()
}

/// Rows of ARCHITECTURE.md: crate → (folder, crates it may use; `None`: all).
fn table() -> BTreeMap<String, (String, Option<BTreeSet<String>>)> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md is there");
    let unquote = |cell: &str| cell.trim().trim_matches('`').to_string();
    let rows = text.lines().filter(|line| line.starts_with("| `"));
    let names: BTreeSet<String> = rows.clone().filter_map(|line| Some(unquote(line.split('|').nth(1)?))).collect();
    rows.filter_map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').collect();
        let [name, folder, may] = cells[..] else { return None };
        let may = match may.trim() {
            "all" => None,
            "-" => Some(BTreeSet::new()),
            list => match list.strip_prefix("all but ") {
                Some(not) => {
                    let not: BTreeSet<String> = not.split(',').map(unquote).collect();
                    Some(names.difference(&not).filter(|other| **other != unquote(name)).cloned().collect())
                }
                None => Some(list.split(',').map(unquote).collect()),
            },
        };
        Some((unquote(name), (folder.trim().to_string(), may)))
    })
    .collect()
}

fn members() -> Vec<String> {
    let manifest: toml::Table = fs::read_to_string(root().join("Cargo.toml")).unwrap().parse().unwrap();
    let members = manifest["workspace"]["members"].as_array().unwrap();
    members.iter().map(|member| member.as_str().unwrap().to_string()).collect()
}

fn manifest(folder: &str) -> toml::Table {
    fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap().parse().unwrap()
}

#[test]
fn every_crate_uses_only_what_its_row_allows() {
    let table = table();
    let ours: BTreeSet<&String> = table.keys().collect();
    for folder in members() {
        let manifest = manifest(&folder);
        let name = manifest["package"]["name"].as_str().unwrap();
        let (row_folder, may) = table.get(name).unwrap_or_else(|| panic!("{name} has no row in ARCHITECTURE.md"));
        assert_eq!(*row_folder, folder, "{name} lies elsewhere than its row says");
        for section in ["dependencies", "build-dependencies"] {
            let section = manifest.get(section).and_then(toml::Value::as_table);
            assert!(section.is_none_or(|uses| !uses.contains_key("testing")), "{name}: testing is for tests only");
            let uses = section.into_iter().flat_map(toml::Table::keys);
            let Some(may) = may else { continue };
            for used in uses.filter(|used| ours.contains(used)) {
                assert!(may.contains(used), "{name} uses {used}, which its row in ARCHITECTURE.md does not allow");
            }
        }
    }
}

#[test]
fn the_oldest_compiler_is_the_same_everywhere() {
    let workspace: toml::Table = fs::read_to_string(root().join("Cargo.toml")).unwrap().parse().unwrap();
    let version = workspace["workspace"]["package"]["rust-version"].as_str().unwrap();
    // The lint `incompatible_msrv` enforces it in the code.
    assert_eq!(workspace["workspace"]["lints"]["clippy"]["incompatible_msrv"].as_str(), Some("deny"));
    for folder in members() {
        let inherits = manifest(&folder)["package"]["rust-version"].get("workspace").and_then(toml::Value::as_bool);
        assert_eq!(inherits, Some(true), "{folder} has a rust-version of its own");
    }
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    assert!(readme.contains(&format!("({version} or newer)")), "README.md names another compiler than {version}");
}

#[test]
fn the_table_itself_has_no_circle() {
    let table = table();
    // Repeatedly removes crates without remaining dependencies; a circle would be left.
    let mut left: BTreeMap<_, _> = table.iter().filter_map(|(name, (_, may))| Some((name, may.clone()?))).collect();
    while let Some(name) = left.iter().find(|(_, may)| may.iter().all(|m| !left.contains_key(m))).map(|(n, _)| *n) {
        left.remove(name);
    }
    assert!(left.is_empty(), "a circle among {:?}", left.keys());
    assert!(!table.values().any(|(_, may)| may.as_ref().is_some_and(|may| may.contains("advee"))));
}

/// All Rust files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    files_below(folder, &["rs"])
}

/// All files below a folder with one of these extensions.
fn files_below(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files = entries.flat_map(|path| if path.is_dir() { files_below(&path, extensions) } else { vec![path] });
    files.filter(|path| extensions.iter().any(|end| path.extension().is_some_and(|is| is == *end))).collect()
}

#[test]
fn engines_are_no_std_and_libraries_forbid_unsafe_code() {
    // Files that call the operating system or access raw memory.
    let with_unsafe = [
        "foundation/lcm/src/live/sys.rs",
        "foundation/lcm/src/shm/memory.rs",
        "host/src/ports/i2c/sys.rs",
        "host/src/sys.rs",
    ];
    for folder in members() {
        let root_file = root().join(&folder).join("src/lib.rs");
        let lib =
            fs::read_to_string(root_file).or_else(|_| fs::read_to_string(root().join(&folder).join("src/main.rs")));
        let lib = lib.unwrap();
        let engine = folder == "foundation/base" || folder.starts_with("buses/");
        assert!(!engine || lib.contains("#![no_std]"), "{folder} is an engine: no_std");
        let word = if ["foundation/lcm", "host"].contains(&folder.as_str()) { "deny" } else { "forbid" };
        assert!(lib.contains(&format!("#![{word}(unsafe_code)]")), "{folder}: {word}(unsafe_code)");
    }
    let mut allowed: Vec<String> = members()
        .iter()
        .flat_map(|folder| sources(&root().join(folder).join("src")))
        .filter(|file| fs::read_to_string(file).unwrap().contains("allow(unsafe_code"))
        .map(|file| file.strip_prefix(root()).unwrap().display().to_string())
        .collect();
    allowed.sort();
    assert_eq!(allowed, with_unsafe);
}

#[test]
fn nothing_that_runs_on_the_robot_needs_atomics_of_64_bits() {
    // ARMv5TE has none, and this test needs no compiler for it. Alternatives for such machines are behind a `cfg`.
    for folder in members() {
        let mut files = sources(&root().join(&folder).join("src"));
        // Tests of the crates below the host run on such machines too (`make arm`).
        let tests = root().join(&folder).join("tests");
        if folder != "advee" && tests.is_dir() {
            files.extend(sources(&tests));
        }
        for file in files {
            let text = fs::read_to_string(&file).unwrap();
            // A file for machines that have them, or the line after such a `cfg`.
            if text.contains("#![cfg(target_has_atomic = \"64\")]") {
                continue;
            }
            let lines: Vec<&str> = text.lines().map(str::trim).collect();
            for (before, line) in lines.iter().zip(lines.iter().skip(1)) {
                let wide = ["AtomicU64", "AtomicI64"].iter().any(|name| line.contains(name));
                let asked = *before == "#[cfg(target_has_atomic = \"64\")]";
                assert!(!wide || asked, "{}: {line}: another type, or a `cfg` before it", file.display());
            }
        }
    }
}

#[test]
fn docs_faults_is_the_list_in_the_code() {
    let text = fs::read_to_string(root().join("docs/faults.md")).unwrap();
    let documented: Vec<String> = text.lines().filter(|line| line.starts_with("| 0x")).map(str::to_owned).collect();
    let row = |fault: &base::Fault| {
        let (number, kind) = (*fault as u16, format!("{:?}", fault.kind()).to_uppercase());
        format!("| 0x{number:04X} | {} | {kind} | {} | {} |", fault.name(), fault.means(), fault.what_to_do())
    };
    let coded: Vec<String> = base::Fault::ALL.iter().map(row).collect();
    assert_eq!(documented, coded);
}

#[test]
fn docs_holds_is_the_list_in_the_code() {
    let text = fs::read_to_string(root().join("docs/holds.md")).unwrap();
    let is_row = |line: &&str| line.strip_prefix("| ").is_some_and(|rest| rest.starts_with(char::is_numeric));
    let documented: Vec<&str> = text.lines().filter(is_row).collect();
    let row = |hold: &messages::Hold| {
        let [words, remedy] = [hold.sentence(), hold.what_to_do()].map(|text| text.replace("{}", "SUBJECT"));
        format!("| {} | {} | {words} | {} | {remedy} |", hold.code(), hold.name(), hold.means())
    };
    let coded: Vec<String> = messages::Hold::ALL.iter().map(row).collect();
    assert_eq!(documented, coded);
}

#[test]
fn the_patch_of_deliberate_bugs_applies() {
    let check = ["apply", "--check", "advee/tests/sabotage/hooks.patch"];
    let checked = Command::new("git").args(check).current_dir(root()).output().expect("git is there");
    let why = String::from_utf8_lossy(&checked.stderr);
    let remedy = "run `tools/sabotage refresh`, mend the hunks that it names, then `tools/sabotage save`";
    assert!(checked.status.success(), "{why}: {remedy} (CONTRIBUTING.md)");
}

/// Exceptions, where text of such a name is data, not a sentence for people: file and expression.
const NO_PROSE: [(&str, &str); 1] = [
    // Name of the page's control that holds the robot: a closed type of its own.
    ("modules/web/page/src/drive/pad.tsx", "const held = now ?. source === pad ; const place"),
];
/// Files that make the sentences of causes, or parts of them with the figures of a cause.
const MAKERS: [&str; 5] = [
    "messages/src/hold.rs",
    "modules/drivers/src/canbus/drive.rs",
    "modules/planner/src/goal_state.rs",
    "modules/planner/src/search/request.rs",
    "modules/web/page/src/fixture.ts",
];

#[test]
fn no_program_decides_by_text_for_people() {
    use prose::Language;
    let crates = members().into_iter().map(|folder| root().join(folder).join("src"));
    let mut files: Vec<(PathBuf, Language)> = Vec::new();
    for folder in crates.chain([root().join("benches")]) {
        files.extend(sources(&folder).into_iter().map(|file| (file, Language::Rust)));
    }
    let page = root().join("modules/web/page/src");
    files.extend(files_below(&page, &["ts", "tsx"]).into_iter().map(|file| (file, Language::TypeScript)));
    assert!(files.len() > 500, "{} files", files.len());
    let sentences: Vec<&str> = messages::Hold::ALL.iter().map(|hold| hold.sentence()).collect();
    let mut found = Vec::new();
    for (file, language) in files {
        let name = file.strip_prefix(root()).unwrap().display().to_string();
        let is_test = ["tests.rs", ".test.ts"].iter().any(|end| name.ends_with(end)) || name.contains("/tests/");
        if is_test {
            continue;
        }
        let text = fs::read_to_string(&file).unwrap();
        let production = text.split("#[cfg(test)]\nmod ").next().unwrap();
        for (line, excerpt) in prose::decisions(production, language) {
            if !NO_PROSE.contains(&(name.as_str(), excerpt.as_str())) {
                found.push(format!("{name}:{line}: {excerpt}"));
            }
        }
        let made = prose::literals(production, language, &sentences);
        found.extend(
            made.iter()
                .filter(|_| !MAKERS.contains(&name.as_str()))
                .map(|(line, text)| format!("{name}:{line}: {text:?}: a sentence of messages::Hold, made there alone")),
        );
    }
    assert!(found.is_empty(), "decisions by text; compare a number of docs/holds.md:\n{}", found.join("\n"));
}

#[test]
fn every_dependency_that_reaches_the_robot_has_a_reason() {
    let reasons = fs::read_to_string(root().join("docs/dependencies.md")).unwrap();
    let table = table();
    for folder in members() {
        let manifest = manifest(&folder);
        let Some(dependencies) = manifest.get("dependencies").and_then(toml::Value::as_table) else { continue };
        for used in dependencies.keys().filter(|used| !table.contains_key(*used)) {
            assert!(reasons.contains(&format!("`{used}`")), "{folder} uses {used}: add a row to docs/dependencies.md");
        }
    }
}
