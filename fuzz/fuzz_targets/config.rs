//! A configuration file.
#![no_main]
use robot::config::{Node, Problems, Robot, Table};
use std::path::Path;

libfuzzer_sys::fuzz_target!(|text: &str| {
    if let Ok(node) = Node::parse(Path::new("fuzz.toml"), text) {
        let problems = Problems::default();
        let _ = Table::new(&node, "", &problems).and_then(Robot::read);
    }
});
