//! The `advee` executable.
fn main() {}
