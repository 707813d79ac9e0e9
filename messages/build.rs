//! Generates the Rust types of `/messages/**/*.lcm`, and the list of these files.
#![allow(clippy::disallowed_methods, reason = "a build script runs on the builder's machine")]

use std::{env, path::Path};

use lcm_gen::build;
use lcm_gen::rust::{Options, Serde};

fn main() -> Result<(), String> {
    let out = env::var("OUT_DIR").map_err(|error| format!("OUT_DIR: {error}"))?;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let options = Options { serde: Serde::Serialize, ..Options::default() };
    build::generate(folder, Path::new(&out).join("types.rs"), &options)?;
    build::list(folder, Path::new(&out).join("files.rs"))
}
