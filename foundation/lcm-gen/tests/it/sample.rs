//! Checks that the generated code beside these tests is the generator's output.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "tests read their own files, which are there")]

use std::{env, fs};

use lcm_gen::rust::{Options, Serde};

use crate::support::files;

/// To accept a change of the generator: `LCM_GEN_BLESS=1 cargo test -p lcm-gen --test it sample`.
#[test]
fn the_checked_in_code_is_the_generator_s_output() {
    for (types, name) in [("vectors/types", "vectors"), ("more", "more")] {
        let schema = lcm_gen::Schema::new(&files::files(types)).unwrap();
        let options = Options { serde: Serde::Both, views: true };
        let code = lcm_gen::rust::generate(&schema, &options).unwrap();
        let path = files::folder(name).join("generated.rs");
        if env::var_os("LCM_GEN_BLESS").is_some() {
            fs::write(&path, &code).unwrap();
        }
        let known = fs::read_to_string(&path).unwrap();
        let differing = known.lines().zip(code.lines()).find(|(known, code)| known != code);
        assert!(known == code, "{} differs: {differing:?}", path.display());
    }
}
