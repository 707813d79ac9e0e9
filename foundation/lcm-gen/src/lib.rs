//! The LCM type language: parser, fingerprints, Rust generator.
