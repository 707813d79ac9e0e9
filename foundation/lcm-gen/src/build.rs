//! For build scripts: reads a folder of `.lcm` files and writes Rust files.
#![allow(clippy::disallowed_methods, reason = "build scripts run on the builder's machine, not on the robot")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::Schema;
use crate::rust::{self, Options};

/// Reads every `.lcm` file in and below `folder`, in order of their paths, and writes the Rust code of all of them to
/// `out`. Tells Cargo to come back when one changes.
///
/// # Errors
/// One line: what could not be read or written, or what is wrong in which file.
pub fn generate(folder: &Path, out: &Path, options: &Options) -> Result<(), String> {
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut files = Vec::new();
    for path in lcm_files(folder)? {
        let text = fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        files.push((path.display().to_string(), text));
    }
    let schema = Schema::new(&files).map_err(|error| error.to_string())?;
    let code = rust::generate(&schema, options).map_err(|error| error.to_string())?;
    write(out, &code)
}

/// Writes an expression of type `&[(&str, &str)]` to `out`: the paths below `folder` of the files that [`generate`]
/// reads, with `/` between their parts, and their texts.
///
/// # Errors
/// One line: what could not be read or written.
pub fn list(folder: &Path, out: &Path) -> Result<(), String> {
    let mut code = String::from("&[\n");
    for path in lcm_files(folder)? {
        let below = path.strip_prefix(folder).unwrap_or(&path);
        let name: Vec<_> = below.iter().map(|part| part.to_string_lossy()).collect();
        let whole = path.canonicalize().map_err(|error| format!("{}: {error}", path.display()))?;
        let _ = writeln!(code, "    ({:?}, include_str!({whole:?})),", name.join("/"));
    }
    code.push_str("]\n");
    write(out, &code)
}

fn write(out: &Path, code: &str) -> Result<(), String> {
    fs::write(out, code).map_err(|error| format!("{}: {error}", out.display()))
}

fn lcm_files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let mut found = Vec::new();
    find(folder, &mut found).map_err(|error| format!("{}: {error}", folder.display()))?;
    found.sort();
    Ok(found)
}

fn find(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            find(&path, found)?;
        } else if path.extension().is_some_and(|extension| extension == "lcm") {
            found.push(path);
        }
    }
    Ok(())
}
