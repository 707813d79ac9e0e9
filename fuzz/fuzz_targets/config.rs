//! The files of a configuration folder, an override, a world: a refusal is at least one line, each of one line.
#![no_main]
use robot::config::{Config, ConfigError, migrated, parsed_world};
use settings::Node;
use std::path::Path;

libfuzzer_sys::fuzz_target!(|texts: (&str, &str, &str)| {
    let (text, over, set) = texts;
    let (tree, over) = (Node::parse(Path::new("robot.toml"), text), Node::parse(Path::new("sim.toml"), over));
    for refused in [&tree, &over].into_iter().filter_map(|tree| tree.as_ref().err()) {
        lines(refused);
    }
    match migrated(Path::new("robot.toml"), text) {
        Ok(text) => assert_eq!(migrated(Path::new("robot.toml"), &text).as_ref(), Ok(&text), "renamed once"),
        Err(ConfigError(refused)) => lines(&refused),
    }
    let (Ok(tree), Ok(over)) = (tree, over) else { return };
    if let Err(ConfigError(refused)) = parsed_world(tree.clone(), Path::new("world.toml"), &[format!("world.{set}")]) {
        lines(&refused);
    }
    let modules = over.clone();
    if let Err(ConfigError(refused)) = Config::merge(tree, Some(over), modules, &[set]) {
        lines(&refused);
    }
});

fn lines(refused: &[String]) {
    assert!(!refused.is_empty(), "refused without a word");
    for line in refused {
        assert!(!line.is_empty() && !line.contains('\n'), "{line:?}");
    }
}
