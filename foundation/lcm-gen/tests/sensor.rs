//! A crate of its own that generates its types when it is built (`examples/sensor`): on this machine with its tests, and
//! for a processor without an operating system, where only `core` and `alloc` exist.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "the test builds a crate")]

use std::fs;
use std::path::Path;
use std::process::Command;

/// A Cortex-M4.
const BARE: &str = "thumbv7em-none-eabi";

#[test]
fn a_crate_with_a_build_script_works_without_std() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sensor");
    let cargo = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO"));
        command.args(arguments).args(["--quiet", "--offline"]).current_dir(here.join("examples/sensor"));
        command.env("CARGO_TARGET_DIR", &target).env_remove("RUSTFLAGS");
        let output = command.output().unwrap();
        assert!(output.status.success(), "cargo {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    // The versions that the workspace has; cargo takes out what is not needed.
    let lock = here.join("examples/sensor/Cargo.lock");
    fs::copy(here.join("../../Cargo.lock"), &lock).unwrap();
    cargo(&["test"]);
    let library = Command::new("rustc").args(["--print", "target-libdir", "--target", BARE]).output().unwrap();
    let installed = Path::new(String::from_utf8_lossy(&library.stdout).trim()).is_dir();
    if installed {
        cargo(&["build", "--target", BARE]);
    } else {
        println!("skipped: the standard library of {BARE} is not installed (rustup target add {BARE})");
    }
    fs::remove_file(lock).unwrap();
}
