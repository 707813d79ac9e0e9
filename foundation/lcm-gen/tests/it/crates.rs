//! Separate crates that use generated code where only `core` and `alloc` exist.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "the tests build crates")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use lcm_gen::rust::{self, Options};
use lcm_gen::{Schema, build};

use crate::support::files;

/// Cortex-M4.
const BARE: &str = "thumbv7em-none-eabi";

/// Runs cargo in a crate outside the workspace, with the dependency versions of the workspace.
fn cargo(folder: &Path, arguments: &[&str]) {
    let lock = folder.join("Cargo.lock");
    fs::copy(files::folder("../../../Cargo.lock"), &lock).unwrap(); // cargo removes the unused entries
    let mut command = Command::new(env!("CARGO"));
    command.args(arguments).args(["--quiet", "--offline"]).current_dir(folder).env_remove("RUSTFLAGS");
    let output =
        command.env("CARGO_TARGET_DIR", Path::new(env!("CARGO_TARGET_TMPDIR")).join("crates")).output().unwrap();
    fs::remove_file(lock).unwrap();
    assert!(output.status.success(), "cargo {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Standard library of [`BARE`]. rustup has it; a distribution's compiler comes with its own libraries only.
fn bare_library() -> Option<()> {
    let library = Command::new("rustc").args(["--print", "target-libdir", "--target", BARE]).output().unwrap();
    let there = Path::new(String::from_utf8_lossy(&library.stdout).trim()).is_dir();
    let found = if there { Ok(()) } else { Err(format!("the standard library of {BARE} (rustup target add {BARE})")) };
    match testing::tool("rustup", "--version") {
        Ok(()) => testing::peer_or_skip(found),
        Err(_) => testing::machine_or_skip(found),
    }
}

#[test]
fn a_crate_with_a_build_script_needs_no_operating_system() {
    let sensor = files::folder("../examples/sensor");
    cargo(&sensor, &["test"]);
    if bare_library().is_some() {
        cargo(&sensor, &["build", "--target", BARE]);
    }
}

/// Without serde, with views, one file per package: the sample types in a crate of their own.
#[test]
fn a_file_for_each_package_is_the_same_code() {
    let crate_folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("packages");
    fs::create_dir_all(crate_folder.join("src/types")).unwrap();
    let lcm = files::folder("../../lcm").canonicalize().unwrap();
    let manifest = format!(
        "[package]\nname = \"packages\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\n\
         lcm = {{ path = {lcm:?}, default-features = false }}\n"
    );
    fs::write(crate_folder.join("Cargo.toml"), manifest).unwrap();
    let lib = "#![no_std]\n#![deny(warnings, missing_docs)]\n//! Types.\n/// Generated.\npub mod types;\n";
    fs::write(crate_folder.join("src/lib.rs"), lib).unwrap();
    let schema = build::read(&[files::folder("vectors/types"), files::folder("more")]).unwrap();
    let generated = rust::generate_files(&schema, &Options { views: true, ..Options::default() }).unwrap();
    let names: Vec<&str> = generated.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["mod.rs", "advee.rs", "more.rs", "vec.rs"]);
    for (name, code) in &generated {
        fs::write(crate_folder.join("src/types").join(name), code).unwrap();
    }
    cargo(&crate_folder, &["check"]);
}

#[test]
fn a_package_named_mod_has_no_file() {
    let generate = |text| rust::generate_files(&Schema::new(&[("a.lcm", text)]).unwrap(), &Options::default());
    let error = generate("package mod.x;\nstruct x_t { }").unwrap_err().to_string();
    assert_eq!(error, "a.lcm:2:8: the package `mod` cannot have a file beside `mod.rs`");
    assert_eq!(generate("package x.mod; struct x_t { }").unwrap().len(), 2);
}

#[test]
fn an_unreadable_file_is_reported_in_one_line() {
    let none = files::folder("support");
    assert_eq!(build::read(&[&none]).unwrap_err(), format!("{}: no .lcm files", none.display()));
    let missing = files::folder("missing.lcm");
    let error = build::read(&[&missing]).unwrap_err();
    assert!(error.starts_with(&missing.display().to_string()) && error.lines().count() == 1, "{error}");
    let twice = files::folder("more");
    assert_eq!(build::read(&[&twice, &twice.join("large_t.lcm")]).map(|schema| schema.definitions().len()), Ok(12));
}

#[test]
fn a_folder_that_links_to_itself_is_read_once() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("circle");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("x_t.lcm"), "struct x_t { }").unwrap();
    std::os::unix::fs::symlink(&folder, folder.join("circle")).unwrap();
    assert_eq!(build::read(&[&folder]).map(|schema| schema.definitions().len()), Ok(1));
}

#[test]
fn bytes_that_are_not_utf_8_are_reported_with_their_position() {
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("latin1.lcm");
    fs::write(&file, b"// \xc5\xbe\nstruct x_t {\n  // \xc5\xbe\xe1\n}\n").unwrap();
    let wrong = build::read(&[&file]).map(drop).unwrap_err();
    assert_eq!(wrong, format!("{}:3:7: not UTF-8: byte 0xe1", file.display()));
}
