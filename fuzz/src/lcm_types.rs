//! Parser of LCM type definitions.

use lcm_gen::Schema;
use lcm_gen::rust::{self, Options, Serde};

/// A file of LCM's type language, through to the generated code.
///
/// Each type has a fingerprint; code for all types in one file can be generated where code in several files can.
pub fn lcm_types(data: &[u8]) {
    let Some(text) = crate::input::<&str>(data) else { return };
    let Ok(schema) = Schema::new(&[("fuzz.lcm", text)]) else { return };
    for definition in schema.definitions() {
        assert!(schema.fingerprint(&definition.name()).is_some());
    }
    let options = Options { serde: Serde::Both, views: true };
    let whole = rust::generate(&schema, &options);
    let files = rust::generate_files(&schema, &options);
    // Only a package that is named `mod` can be in one file and not in several.
    assert!(whole.is_ok() || files.is_err());
}
