//! Options of the linker that make the released executable smaller, as far as the linker here knows them.
#![allow(clippy::disallowed_methods, reason = "a build script runs on the builder's machine")]

use std::path::Path;
use std::process::{Command, Stdio};
use std::{env, fs};

/// Relative relocations as a bit map: a twentieth of their size. The C library reads it from version 2.36 on.
const PACKED: &[&str] = &["-z", "pack-relative-relocs"];
/// Functions with the same instructions are there once. Nothing here compares addresses of functions.
const FOLDED: &[&str] = &["--icf=all"];
/// No tables for unwinding the stack: a panic ends the process at once, and the tables are of no use without symbols.
const NO_TABLES: &str =
    "SECTIONS { /DISCARD/ : { *(.eh_frame .gcc_except_table .gcc_except_table.*) } } INSERT AFTER .text;";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // Other profiles unwind. For ARM the standard library is built with this crate: a trial program cannot be linked.
    let var = |name| env::var(name).unwrap_or_default();
    if var("PROFILE") != "release" || var("TARGET") != "x86_64-unknown-linux-gnu" || var("HOST") != var("TARGET") {
        return;
    }
    let out = var("OUT_DIR");
    let script = Path::new(&out).join("no_tables.ld");
    let script = script.to_str().filter(|_| fs::write(&script, NO_TABLES).is_ok());
    let no_tables = script.map(|script| vec!["--no-eh-frame-hdr", "-T", script]).unwrap_or_default();
    for options in [PACKED, FOLDED, &no_tables] {
        let option = format!("-Wl,{}", options.join(","));
        if links(&out, &option) {
            println!("cargo:rustc-link-arg-bin=advee={option}");
        }
    }
}

/// True if the linker accepts an option.
fn links(out: &str, option: &str) -> bool {
    let var = |name| env::var(name).unwrap_or_default();
    let source = Path::new(out).join("trial.rs");
    let mut rustc = Command::new(var("RUSTC"));
    rustc.args(var("CARGO_ENCODED_RUSTFLAGS").split('\x1f').filter(|flag| !flag.is_empty()));
    rustc.args(env::var("RUSTC_LINKER").iter().map(|linker| format!("-Clinker={linker}")));
    rustc.args(["--edition=2024", "-Cpanic=abort", &format!("-Clink-arg={option}"), "--out-dir", out]).arg(&source);
    let quiet = rustc.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    fs::write(&source, "fn main() {}").is_ok() && quiet.status().is_ok_and(|status| status.success())
}
