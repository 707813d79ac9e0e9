//! The files of a configuration folder, an override, a world: a refusal is at least one line, each of one line.
#![no_main]
use robot::config::{Config, ConfigError, Node, parsed_world};
use std::path::Path;

libfuzzer_sys::fuzz_target!(|texts: (&str, &str, &str)| {
    let (text, over, set) = texts;
    let (tree, over) = (Node::parse(Path::new("robot.toml"), text), Node::parse(Path::new("sim.toml"), over));
    for refused in [&tree, &over].into_iter().filter_map(|tree| tree.as_ref().err()) {
        lines(refused);
    }
    let (Ok(mut tree), Ok(over)) = (tree, over) else { return };
    if let Err(ConfigError(refused)) = parsed_world(tree.clone(), Path::new("world.toml"), &[format!("world.{set}")]) {
        lines(&refused);
    }
    let modules = over.clone();
    tree.merge(over);
    if let Err(why) = tree.set(set) {
        lines(&[why]);
    }
    if let Err(ConfigError(refused)) = Config::check(&tree, &modules, true) {
        lines(&refused);
    }
});

fn lines(refused: &[String]) {
    assert!(!refused.is_empty(), "refused without a word");
    for line in refused {
        assert!(!line.is_empty() && !line.contains('\n'), "{line:?}");
    }
}
