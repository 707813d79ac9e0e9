//! Generates the Rust types of `types/*.lcm`.

use std::{env, path::Path};

use lcm_gen::{build, rust::Options};

fn main() -> Result<(), String> {
    let out = env::var("OUT_DIR").map_err(|error| error.to_string())?;
    let options = Options { views: true, ..Options::default() };
    build::generate("types", Path::new(&out).join("types.rs"), &options)
}
