//! Reader of `.lcm` files and writer of Rust files, for build scripts and command lines.
//!
//! A crate with its types in a folder `types` needs this `build.rs`, `lcm-gen` in its build dependencies and `lcm`
//! (`no_std` without features) in its dependencies:
//!
//! ```no_run
//! use std::{env, path::Path};
//!
//! use lcm_gen::{build, rust::Options};
//!
//! fn main() -> Result<(), String> {
//!     let out = env::var("OUT_DIR").map_err(|error| error.to_string())?;
//!     build::generate("types", Path::new(&out).join("types.rs"), &Options::default())
//! }
//! ```
//!
//! and `include!(concat!(env!("OUT_DIR"), "/types.rs"));` in the module of the types. The tests build the crate in
//! `foundation/lcm-gen/examples/sensor` this way.
#![allow(clippy::disallowed_methods, reason = "runs on the builder's machine, not on the robot")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::Schema;
use crate::rust::{self, Options};

/// Reads every `.lcm` file in and below `folder`, in order of their paths, and writes the Rust code of all of them to
/// `out`. Declares the files to Cargo, so that a change runs the build script again.
///
/// # Errors
/// One line: the path that could not be read or written, or the error in a file.
pub fn generate(folder: impl AsRef<Path>, out: impl AsRef<Path>, options: &Options) -> Result<(), String> {
    println!("cargo::rerun-if-changed={}", folder.as_ref().display());
    let schema = read(&[folder.as_ref()])?;
    let code = rust::generate(&schema, options).map_err(|error| error.to_string())?;
    write(out.as_ref(), &code)
}

/// Reads files, and every `.lcm` file in and below folders, in order of their paths.
///
/// # Errors
/// One line: the path that could not be read, the folder without files, or the error in a file.
pub fn read(places: &[impl AsRef<Path>]) -> Result<Schema, String> {
    let mut paths = Vec::new();
    for place in places {
        let place = place.as_ref();
        let found = if place.is_dir() { lcm_files(place)? } else { vec![place.to_owned()] };
        if found.is_empty() {
            return Err(format!("{}: no .lcm files", place.display()));
        }
        paths.extend(found);
    }
    paths.sort();
    paths.dedup();
    let mut files = Vec::new();
    for path in paths {
        files.push((path.display().to_string(), read_text(&path)?));
    }
    Schema::new(&files).map_err(|error| error.to_string())
}

/// Reads a file of definitions.
///
/// # Errors
/// One line: the path that could not be read, or the position of what is not UTF-8 in it.
pub fn read_text(path: &Path) -> Result<String, String> {
    let bytes = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let valid = String::from_utf8_lossy(valid);
        let line = valid.matches('\n').count() + 1;
        let column = valid.chars().rev().take_while(|&c| c != '\n').count() + 1;
        let byte = error.as_bytes()[valid.len()];
        format!("{}:{line}:{column}: not UTF-8: byte 0x{byte:02x}", path.display())
    })
}

/// Writes an expression of type `&[(&str, &str)]` to `out`: the paths below `folder` of the files that [`generate`]
/// reads, with `/` between their parts, and their texts.
///
/// # Errors
/// One line: the path that could not be read or written.
pub fn list(folder: impl AsRef<Path>, out: impl AsRef<Path>) -> Result<(), String> {
    let folder = folder.as_ref();
    let mut code = String::from("&[\n");
    for path in lcm_files(folder)? {
        let below = path.strip_prefix(folder).unwrap_or(&path);
        let name: Vec<_> = below.iter().map(|part| part.to_string_lossy()).collect();
        let whole = path.canonicalize().map_err(|error| format!("{}: {error}", path.display()))?;
        let _ = writeln!(code, "    ({:?}, include_str!({whole:?})),", name.join("/"));
    }
    code.push_str("]\n");
    write(out.as_ref(), &code)
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

/// Links to folders are not followed: they may form a cycle.
fn find(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        if entry.file_type()?.is_dir() {
            find(&path, found)?;
        } else if path.extension().is_some_and(|extension| extension == "lcm") {
            found.push(path);
        }
    }
    Ok(())
}
