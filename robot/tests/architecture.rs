//! The picture in ARCHITECTURE.md and the code cannot part: crates use what their row allows, pure crates say so.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("robot lies in the workspace").into()
}

/// crate → (folder, what it may use; none: all).
fn table() -> BTreeMap<String, (String, Option<BTreeSet<String>>)> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md is there");
    let unquote = |cell: &str| cell.trim().trim_matches('`').to_string();
    text.lines()
        .filter(|line| line.starts_with("| `"))
        .filter_map(|line| {
            let cells: Vec<&str> = line.trim_matches('|').split('|').collect();
            let [name, folder, may] = cells[..] else { return None };
            let may = match may.trim() {
                "all" => None,
                "-" => Some(BTreeSet::new()),
                list => Some(list.split(',').map(unquote).collect()),
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
        let Some(may) = may else { continue };
        for section in ["dependencies", "build-dependencies"] {
            let uses = manifest.get(section).and_then(toml::Value::as_table).into_iter().flat_map(toml::Table::keys);
            for used in uses.filter(|used| ours.contains(used)) {
                assert!(may.contains(used), "{name} uses {used}, which its row in ARCHITECTURE.md does not allow");
            }
        }
    }
}

#[test]
fn the_table_itself_has_no_arrow_upwards() {
    let table = table();
    // Repeatedly take away what depends on nothing that is left; a circle would remain.
    let mut left: BTreeMap<_, _> = table.iter().filter_map(|(name, (_, may))| Some((name, may.clone()?))).collect();
    while let Some(name) = left.iter().find(|(_, may)| may.iter().all(|m| !left.contains_key(m))).map(|(n, _)| *n) {
        left.remove(name);
    }
    assert!(left.is_empty(), "a circle among {:?}", left.keys());
    assert!(!table.values().any(|(_, may)| may.as_ref().is_some_and(|may| may.contains("advee"))));
}

/// All Rust files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files = entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] });
    files.filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

#[test]
fn engines_are_no_std_and_libraries_forbid_unsafe_code() {
    // Where a library reaches the system's own calls and memory, each with its reason.
    let with_unsafe = ["foundation/lcm/src/live/sys.rs", "foundation/lcm/src/shm/memory.rs"];
    for folder in members() {
        let lib = fs::read_to_string(root().join(&folder).join("src/lib.rs")).unwrap();
        let engine = ["foundation/base", "busses/rs485", "busses/canopen", "busses/i2c"].contains(&folder.as_str());
        assert!(!engine || lib.contains("#![no_std]"), "{folder} is an engine: no_std");
        let word = if folder == "foundation/lcm" { "deny" } else { "forbid" };
        assert!(
            folder == "robot" || lib.contains(&format!("#![{word}(unsafe_code)]")),
            "{folder}: {word}(unsafe_code)"
        );
    }
    let mut allowed: Vec<String> = sources(&root().join("foundation/lcm/src"))
        .into_iter()
        .filter(|file| fs::read_to_string(file).unwrap().contains("allow(unsafe_code"))
        .map(|file| file.strip_prefix(root()).unwrap().display().to_string())
        .collect();
    allowed.sort();
    assert_eq!(allowed, with_unsafe);
}

#[test]
fn nothing_that_runs_on_the_robot_needs_atomics_of_64_bits() {
    // ARMv5TE has none, and this test needs no compiler for it. What such a machine does otherwise stands in a `cfg`.
    for folder in members() {
        let mut files = sources(&root().join(&folder).join("src"));
        // Tests of all but the host run on such machines too (`make arm`).
        let tests = root().join(&folder).join("tests");
        if folder != "robot" && tests.is_dir() {
            files.extend(sources(&tests));
        }
        for file in files {
            let text = fs::read_to_string(&file).unwrap();
            // A file for machines that have them, or the line after a `cfg` for those.
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
    let documented: Vec<String> = text
        .lines()
        .filter(|line| line.starts_with("| 0x"))
        .map(|line| line.split('|').skip(1).take(3).map(str::trim).collect::<Vec<_>>().join(" "))
        .collect();
    let row = |fault: &base::Fault| {
        format!("0x{:04X} {} {}", *fault as u16, fault.name(), format!("{:?}", fault.kind()).to_uppercase())
    };
    let coded: Vec<String> = base::Fault::ALL.iter().map(row).collect();
    assert_eq!(documented, coded);
}

#[test]
fn every_dependency_that_reaches_the_robot_has_a_reason() {
    let reasons = fs::read_to_string(root().join("docs/decisions/0005-dependencies.md")).unwrap();
    let table = table();
    for folder in members() {
        let manifest = manifest(&folder);
        let Some(dependencies) = manifest.get("dependencies").and_then(toml::Value::as_table) else { continue };
        for used in dependencies.keys().filter(|used| !table.contains_key(*used)) {
            assert!(reasons.contains(&format!("`{used}`")), "{folder} uses {used}: say why in docs/decisions/0005");
        }
    }
}
