//! Configuration files of a robot, and tables of drives.

use robot::config::drives::DriveTables;
use robot::config::{Config, ConfigError, migrated, parsed_world};
use settings::Node;
use std::path::Path;

/// A robot's file, which is read as a table of a drive, too, an override, and an assignment of `--set`, separated by
/// zero bytes.
///
/// A refusal has at least one line, and none of its lines is empty or broken.
pub fn config(data: &[u8]) {
    let Ok(texts) = std::str::from_utf8(data) else { return };
    let mut texts = texts.split('\0').chain(["", "", ""]);
    let [text, over, set] = std::array::from_fn(|_| texts.next().unwrap_or_default());
    let (tree, over) = (Node::parse(Path::new("robot.toml"), text), Node::parse(Path::new("sim.toml"), over));
    for refused in [&tree, &over].into_iter().filter_map(|tree| tree.as_ref().err()) {
        lines(refused);
    }
    let mut tables = DriveTables::default();
    if let Err(refused) = tables.add("own", Path::new("drives/own.toml"), text) {
        lines(&refused);
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
    if let Err(ConfigError(refused)) = Config::merge_with(tree, Some(over), modules, &tables, &[set]) {
        lines(&refused);
    }
}

fn lines(refused: &[String]) {
    assert!(!refused.is_empty(), "refused without a word");
    for line in refused {
        assert!(!line.is_empty() && !line.contains('\n'), "{line:?}");
    }
}
